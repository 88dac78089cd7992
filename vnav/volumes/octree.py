"""An octree that says what is occupied, free and unknown (claim 3, S8); sole user of octomap.

Source: Hornung et al., OctoMap, 2013: each scan marks the voxels of its points occupied and all
that its rays pass through free; log-odds are summed, clamped, and thresholded at even odds.
"""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
import octomap
from numpy.typing import NDArray

from vnav.core.arrays import frozen
from vnav.errors import MEND, MapError, VnavError
from vnav.volumes.log_odds import KEYS, VoxelLogOdds
from vnav.volumes.tree_nodes import DEPTH, NODE, leaf_corners, tree_nodes

BINARY_HEADER = b"# Octomap OcTree binary file"
HEADER = b"# Octomap OcTree file"


@dataclass(frozen=True)
class Leaves:
    """Cubes that were seen: what no cube covers is unknown.

    ``centres_world`` (N, 3) float64 in metres, ``occupied`` (N,) bool, the others are free,
    ``size_m`` (N,) float64: edges, the resolution times a power of two.
    """

    centres_world: NDArray[np.float64]
    occupied: NDArray[np.bool_]
    size_m: NDArray[np.float64]

    def __post_init__(self) -> None:
        n = len(self.occupied)
        object.__setattr__(self, "centres_world", frozen(self.centres_world, float, (n, 3)))
        object.__setattr__(self, "occupied", frozen(self.occupied, bool, (n,)))
        object.__setattr__(self, "size_m", frozen(self.size_m, float, (n,)))

    def __len__(self) -> int:
        return len(self.occupied)


class Scans:
    """Scans in voxels of ``resolution_m``, which become an octree."""

    def __init__(self, resolution_m: float) -> None:
        self._empty = octomap.OcTree(resolution_m)
        ask = self._empty
        hit, miss = np.float32(ask.getProbHitLog()), np.float32(ask.getProbMissLog())
        least, most = ask.getClampingThresMinLog(), ask.getClampingThresMaxLog()
        odds = hit, miss, np.float32(least), np.float32(most)
        self._voxels = VoxelLogOdds(resolution_m, odds)

    def insert(
        self, points_world: NDArray[np.floating], sensor_world: NDArray[np.floating]
    ) -> None:
        """Add one scan: its points (N, 3), and the sensor (3,) that all its rays start from.

        Within a scan a voxel that holds a point is occupied whatever rays cross it, so one point
        a voxel does.
        """
        self._voxels.insert(points_world, sensor_world)

    def octree(self) -> "Octree":
        """What octomap makes of the same scans, inner nodes up to date, nothing pruned."""
        nodes = tree_nodes(*self._voxels.known())
        header = self._empty.write().replace(b"size 0\n", b"size %d\n" % len(nodes))
        return Octree(octomap.OcTree.read(header + nodes.tobytes()))


class Octree:
    """Occupancy of space in voxels of ``resolution_m``."""

    def __init__(self, tree: octomap.OcTree) -> None:
        self._tree = tree

    @classmethod
    def read(cls, path: Path) -> "Octree":
        """The octree of an .ot or .bt file; MapError where there is none, or not a whole one."""
        try:
            content = path.read_bytes()
        except OSError as error:
            raise MapError(
                f"expected an octree in {path}, found: {error.strerror}; run 'vnav fuse'"
            ) from error
        try:
            return cls._from_bytes(content)
        except ValueError as error:
            raise MapError(
                f"expected a whole octree in {path}, found {len(content)} bytes that are none;"
                f" {MEND}"
            ) from error

    @property
    def resolution_m(self) -> float:
        """Edge of the smallest voxels."""
        return float(self._tree.getResolution())

    def write(self, path: Path) -> None:
        """Write an .ot file, which holds log-odds, or a .bt file, which holds states only."""
        binary = path.suffix == ".bt"
        path.write_bytes(self.most_likely._tree.writeBinary() if binary else self._tree.write())

    @cached_property
    def most_likely(self) -> "Octree":
        """A copy whose voxels are surely occupied or free, equal neighbours made one cube."""
        copy = octomap.OcTree.read(self._tree.write())
        copy.writeBinary()  # octomap rounds and prunes the tree itself before it writes it
        return Octree(copy)

    def leaves(self) -> Leaves:
        """Every cube that was seen; of a tree without scans, none. Order is that of the tree."""
        _, _, content = self._tree.write().partition(b"\ndata\n")
        nodes = np.frombuffer(content, NODE)
        corner, level = leaf_corners(nodes)
        edge = 1 << (DEPTH - level)
        size_m = edge * np.float64(self.resolution_m)
        centres = ((corner - KEYS // 2) / edge[:, None] + 0.5) * size_m[:, None]
        occupied = nodes["log_odds"][nodes["children"] == 0] > self._tree.getOccupancyThresLog()
        return Leaves(centres, occupied, size_m)

    @classmethod
    def _from_bytes(cls, content: bytes) -> "Octree":
        """ValueError where the content is not what octomap would write itself."""
        if content.startswith(BINARY_HEADER):
            tree = octomap.OcTree(1.0)
            whole = tree.readBinary(content) and tree.writeBinary() == content
        elif content.startswith(HEADER):
            tree = octomap.OcTree.read(content)
            whole = tree.write() == content
        else:
            whole = False
        if not whole:
            raise ValueError("not a whole octree")
        octree = cls(tree)
        octree.leaves()  # ValueError where it has more levels than keys have bits
        return octree


def self_test() -> None:
    """Insert a scan of a wall, as octomap does and here; VnavError where they differ or err."""
    scans, peer = Scans(0.1), octomap.OcTree(0.1)
    sensor = np.array([0.05, 0.0, 0.0])
    wall = np.array([[1.05, y, z] for y in (-0.05, 0.05) for z in (-0.05, 0.05)])
    scans.insert(wall, sensor)
    peer.insertPointCloud(wall, sensor, lazy_eval=True)
    peer.updateInnerOccupancy()
    octree = scans.octree()
    leaves = octree.most_likely.leaves()
    occupied = leaves.centres_world[leaves.occupied]
    seen = occupied[np.lexsort(occupied.T[::-1])]
    if seen.shape != wall.shape or not np.allclose(seen, wall) or leaves.occupied.all():
        raise VnavError(
            f"expected octomap to mark a wall of 4 voxels and free space before it, found"
            f" {len(seen)} occupied of {len(leaves)} cubes; reinstall octomap-python"
        )
    if octree._tree.write() != peer.write():
        raise VnavError(
            "expected octomap to insert a scan as vnav does, found another tree; install a version"
            " of octomap-python that vnav was tested with"
        )

"""Does a map let go of what has left a room, and take up what has come?

    python benchmarks/moved_furniture.py [--seeds 5] [--out bench/moved] [--record]

renders a room before and after a chair moved, a box went and a door was opened, each on a walk of
its own. It maps the first capture, extends the map by the second, and holds both maps against the
truth. A place counts as gone where the first map is occupied, something stood there, and at least
three keyframes of the second capture measure depth beyond it by more than their noise. Exit code 1
where something is not as wanted.
"""

import argparse
import dataclasses
import shutil
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from recording import ROOT, Measurement, add_record_option, conclude
from scipy.spatial import cKDTree

import vnav
from vnav.config import CaptureConfig, Config
from vnav.core import se3
from vnav.core.voxels import Voxels
from vnav.io.formats.ply import read_cloud, read_mesh
from vnav.io.formats.trajectories import read_photo_poses, read_tum
from vnav.io.sources.open_capture import open_capture
from vnav.io.store.artifacts import load_keyframe_depth, load_odometry, load_optimised, map_cameras
from vnav.io.store.index_file import load_index
from vnav.io.store.map_folder import MapFolder
from vnav.io.store.tree_file import load_tree
from vnav.pipeline.extend import extend, made_with
from vnav.stages.locate import Locator
from vnav.synthetic import MINIATURE, SCENES, Box, Scene, write_capture
from vnav.synthetic.scene import faces_of
from vnav.volumes.octree import Octree

Array = NDArray[np.float64]
Chosen = NDArray[np.bool_]

FRAMES, PHOTOS = 80, 10  # of each capture
STATES = "before", "after"
VIEWS = 3  # keyframes that must see through a place, or see it
LATTICE_M = 0.02  # of points on a surface
ON_M = 0.03  # a landmark so near to a thing is on it
CLEAR_CELLS = 1.5  # so far from all that stands a cell holds nothing of it
WRONG_M, WRONG_DEG = 0.30, 10.0


@dataclass(frozen=True)
class Measured:
    """A finished map with its keyframes' depth, and where it truly is.

    ``T_truth_world`` from the world of the map; ``T_truth_camera`` (K, 4, 4) of its keyframes.
    """

    folder: MapFolder
    T_truth_world: Array
    rows: NDArray[np.intp]
    T_truth_camera: Array
    is_new: Chosen  # of the last capture

    def truly(self, points_world: Array) -> Array:
        """Points (N, 3) in the true world."""
        return se3.transform(self.T_truth_world, points_world)

    def depth_beyond(self, points_truth: Array) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """How many new keyframes see through points (N, 3), and how many see something there.

        By what they measured at the point's pixel, by more or less than three standard deviations
        and a cell.
        """
        config = made_with(self.folder)
        frames, cameras = load_odometry(self.folder).frames, map_cameras(self.folder)
        counts = np.zeros((2, len(points_truth)), np.intp)
        for row, T in zip(self.rows[self.is_new], self.T_truth_camera[self.is_new], strict=True):
            camera = cameras[frames.capture[row]]
            points = se3.transform(se3.inverse(T), points_truth)
            px = np.nan_to_num(np.rint(camera.project(points)), nan=-1).astype(int)
            seen = ((px >= 0) & (px < camera.size)).all(1)
            u, v = px[seen].T
            depth_m, z = load_keyframe_depth(self.folder, int(row))[v, u], points[seen, 2]
            off_m = 3 * config.registration.depth_sigma_per_m2 * z**2 + config.fuse.octree_m
            counts[0, seen] += depth_m > z + off_m
            counts[1, seen] += (np.abs(depth_m - z) <= off_m) & (depth_m > 0)
        return counts[0], counts[1]


def measured(folder: MapFolder, captures: Sequence[Path]) -> Measured:
    """A map made of these captures, in order."""
    found, odometry = load_optimised(folder).T_world_camera, load_odometry(folder)
    truth = np.concatenate([read_tum(c / "groundtruth.txt").T_world_camera for c in captures])
    known, rows = np.isfinite(found[:, 0, 0]), odometry.keyframe_rows
    rows = rows[known[rows]]
    T_truth_world = se3.align(truth[known, :3, 3], found[known, :3, 3])
    is_new = odometry.frames.capture[rows] == len(captures) - 1
    return Measured(folder, T_truth_world, rows, truth[rows], is_new)


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--out", type=Path, default=ROOT / "bench" / "moved")
    add_record_option(parser)
    asked = parser.parse_args(arguments)
    found = [m for seed in range(asked.seeds) for m in measure(asked.out / str(seed), seed)]
    return conclude("moved_furniture", found, asked, arguments)


def measure(out: Path, seed: int) -> list[Measurement]:
    """Both maps of the room of a seed, made in a folder unless they are there."""
    captures = [out / f"room_{state}" for state in STATES]
    for capture in captures:
        if not capture.is_dir():
            spec = dataclasses.replace(MINIATURE, scene=capture.name, frames=FRAMES, seed=seed)
            write_capture(capture, dataclasses.replace(spec, photos=PHOTOS))
    first, both = MapFolder(out / "first"), MapFolder(out / "both")
    if not both.root.is_dir():
        vnav.build_map(captures[0], first.root)
        shutil.copytree(first.root, both.root)
        extend(both, open_capture(captures[1], CaptureConfig()), Config())
    rooms = [SCENES[capture.name](seed) for capture in captures]
    name = f"room before and after, seed {seed}"
    maps = measured(first, captures[:1]), measured(both, captures)
    return [
        *of_volumes(name, *rooms, *maps),
        *of_landmarks(name, *rooms, maps[1]),
        *of_photos(name, maps[1], captures),
    ]


def of_volumes(
    name: str, before: Scene, after: Scene, first: Measured, both: Measured
) -> list[Measurement]:
    """What became of the places of what has gone, and of what has come."""
    left, came = _only_in(before, after), _only_in(after, before)
    gone = first.truly(_centres(_voxels(first.folder, occupied=True)))
    cell_m = made_with(first.folder).fuse.octree_m
    clear = CLEAR_CELLS * cell_m
    gone = gone[(distance(gone, left) <= cell_m) & (distance(gone, _boxes(after)) > clear)]
    gone = gone[both.depth_beyond(gone)[0] >= VIEWS]
    gone_world = se3.transform(se3.inverse(both.T_truth_world), gone)
    freed = _voxels(both.folder, occupied=False).stands_at(gone_world)

    new = surface(came)
    new = new[both.depth_beyond(new)[1] >= VIEWS]
    occupied = both.truly(_centres(_voxels(both.folder, occupied=True)))
    taken = cKDTree(occupied).query(new)[0] <= cell_m
    counts = zip(_near(first, gone, cell_m), _near(both, gone, cell_m), strict=True)
    vertices, points = ((before, 1 - now / before) for before, now in counts)
    rows = {
        "cells of what has gone": (len(gone), freed.mean()),
        "surface of what has come": (len(new), taken.mean()),
        "mesh of what has gone": vertices,
        "cloud of what has gone": points,
    }
    return [
        measurement
        for what, (places, share) in rows.items()
        for measurement in (
            Measurement(name, what, "places", places),
            Measurement(name, what, "as it is now", float(share), "", "at least 0.95"),
        )
    ]


def of_landmarks(name: str, before: Scene, after: Scene, both: Measured) -> list[Measurement]:
    """Which landmarks are retired: on what has gone, and on what is there."""
    index = load_index(both.folder, load_tree(both.folder))
    points = both.truly(index.points_world.astype(float))
    clear = CLEAR_CELLS * made_with(both.folder).fuse.octree_m
    there = distance(points, _boxes(after))
    gone = (distance(points, _only_in(before, after)) <= ON_M) & (there > clear)
    gone[gone] = both.depth_beyond(points[gone])[0] >= VIEWS
    stays = there <= ON_M
    what = "landmarks on what has gone", "landmarks on what is there"
    return [
        Measurement(name, what[0], "places", int(gone.sum())),
        Measurement(name, what[0], "retired", index.retired[gone].mean(), "", "at least 0.95"),
        Measurement(name, what[1], "places", int(stays.sum())),
        Measurement(name, what[1], "retired", index.retired[stays].mean(), "", "at most 0.01"),
    ]


def of_photos(name: str, both: Measured, captures: Sequence[Path]) -> list[Measurement]:
    """Photos of each state, asked of the map of both."""
    locator, found = Locator.open(both.folder, Config()), []
    for state, capture in zip(STATES, captures, strict=True):
        truth = read_photo_poses(capture / "photos" / "groundtruth.txt")
        answers = [locator.locate(photo) for photo in sorted((capture / "photos").glob("*.jpg"))]
        located = [answer for answer in answers if answer.best]
        off = [
            se3.inverse(truth[a.path.name]) @ both.T_truth_world @ a.best.view.T_world_camera
            for a in located
            if a.best
        ]
        far = [np.linalg.norm(T[:3, 3]) > WRONG_M for T in off]
        turned = [np.rad2deg(se3.rotation_angle(T)) > WRONG_DEG for T in off]
        what = f"photos of the room {state}"
        wrong = int(np.logical_or(far, turned).sum())
        found += [
            Measurement(name, what, "asked", len(answers)),
            Measurement(name, what, "answered", len(located)),
            Measurement(name, what, "wrong", wrong, "", "at most 0"),
        ]
    return found


def distance(points: Array, boxes: Sequence[Box]) -> Array:
    """How far points (N, 3) are from the nearest of the boxes, 0 inside."""
    nearest = np.full(len(points), np.inf)
    for box in boxes:
        own = np.abs((points - box.centre) @ box.R_world_box) - np.array(box.size) / 2
        nearest = np.minimum(nearest, np.linalg.norm(np.maximum(own, 0), axis=1))
    return nearest


def surface(boxes: Sequence[Box]) -> Array:
    """Points (N, 3) on all faces of the boxes, `LATTICE_M` apart."""
    found = [np.zeros((0, 3))]
    for face in (face for box in boxes for face in faces_of(box, 0)):
        a, b = (np.arange(LATTICE_M / 2, size, LATTICE_M) / size for size in face.size_m)
        grid = np.stack(np.meshgrid(a, b), -1).reshape(-1, 2)
        found.append(face.corner + grid @ np.stack([face.u_edge, face.v_edge]))
    return np.concatenate(found)


def _boxes(scene: Scene) -> list[Box]:
    return [box for piece in scene.pieces for box in piece]


def _only_in(scene: Scene, other: Scene) -> list[Box]:
    return [box for box in _boxes(scene) if box not in _boxes(other)]


def _voxels(folder: MapFolder, occupied: bool) -> Voxels:
    """Where the octree of a map is occupied, or free."""
    octree = Octree.read(folder.stage("fuse") / "occupancy.bt")
    leaves = octree.leaves()
    chosen = leaves.occupied == occupied
    return Voxels.filled(leaves.centres_world[chosen], leaves.size_m[chosen], octree.resolution_m)


def _centres(voxels: Voxels) -> Array:
    return voxels.origin + (np.argwhere(voxels.solid) + 0.5) * voxels.edge_m


def _near(m: Measured, places: Array, cell_m: float) -> tuple[int, int]:
    """Vertices of the mesh and points of the cloud of a map in cells with the given centres."""
    stage, tree = m.folder.stage("fuse"), cKDTree(places)
    mesh, cloud = read_mesh(stage / "mesh.ply").vertices_world, read_cloud(stage / "cloud.ply")
    parts = (m.truly(points.astype(float)) for points in (mesh, cloud.points_world))
    mesh_count, cloud_count = (
        int((tree.query(part, p=np.inf)[0] <= cell_m / 2).sum()) for part in parts
    )
    return mesh_count, cloud_count


if __name__ == "__main__":
    sys.exit(main())

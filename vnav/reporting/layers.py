"""A layer of a map's 3D view, and the two that have most numbers: its cloud and its surface.

Arrays are little-endian numbers: base64 in a page's text, as they are beside it. Points have 16
bits a coordinate.
"""

import json
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vnav.core.point_cloud import Mesh, PointCloud
from vnav.io.store.artifacts import load_cloud, load_mesh
from vnav.io.store.map_folder import MapFolder

STEPS = 65535  # of a coordinate, over the side of the points' box
DENSE = 1.5  # how much larger points are drawn than their distance: surfaces look closed
LARGE = {"cloud": ("cloud", "#90a4ae"), "mesh": ("surface", "#a1887f")}  # label and colour


@dataclass(frozen=True)
class Layer:
    """A part of the view that can be switched: its label, colour, and values for view.js.

    ``values`` may hold arrays, and lists of them.
    """

    label: str
    color: str
    values: dict[str, Any]
    is_shown: bool = True

    def packed(self) -> bytes:
        """Numbers and arrays in one: the length of a JSON object (4 bytes), that, and the arrays.

        "arrays" in it says where each begins and ends, in bytes.
        """
        arrays = {k: v.tobytes() for k, v in self.values.items() if isinstance(v, np.ndarray)}
        ends = np.cumsum([len(data) for data in arrays.values()]).tolist()
        places = zip([0, *ends[:-1]], ends, strict=True)
        told = {k: v for k, v in self.values.items() if k not in arrays}
        head = json.dumps(told | {"arrays": dict(zip(arrays, places, strict=True))}).encode()
        return b"".join([np.array(len(head), "<u4").tobytes(), head, *arrays.values()])


def large_layer(folder: MapFolder, name: str) -> Layer | None:
    """The whole cloud or the surface of a map, "cloud" or "mesh"; None where it is empty."""
    if name == "mesh":
        return mesh_layer(load_mesh(folder))
    return cloud_layer(load_cloud(folder), voxel_m(folder))


def cloud_layer(cloud: PointCloud, voxel_m: float, most: int | None = None) -> Layer | None:
    """Points of a cloud, ``most`` or all, such that the first of them are spread evenly, too.

    Every n-th point is, of a cloud by voxels. None of an empty one.
    """
    if not len(cloud):
        return None
    kept = np.linspace(0, len(cloud) - 1, min(len(cloud), most or len(cloud))).astype(int)
    kept = kept[_coarse_to_fine(len(kept))]
    values = {
        "kind": "cloud",
        "spacing_m": round(DENSE * voxel_m * float(np.sqrt(len(cloud) / len(kept))), 4),
        **_steps(cloud.points_world[kept]),
        "colors": cloud.colors[kept],
    }
    return Layer(*LARGE["cloud"], values)


def mesh_layer(mesh: Mesh) -> Layer | None:
    """The surface, not shown at first; None of an empty one."""
    if not len(mesh.triangles):
        return None
    number = "<u2" if len(mesh.vertices_world) <= STEPS + 1 else "<u4"
    values = {
        "kind": "mesh",
        **_steps(mesh.vertices_world),
        "colors": mesh.colors,
        "triangles": mesh.triangles.astype(number),
    }
    return Layer(*LARGE["mesh"], values, is_shown=False)


def _steps(points: ArrayLike) -> dict[str, Any]:
    """Points (N, 3), N > 0, as steps of their box's sides."""
    points = np.asarray(points, float)
    low, high = points.min(0), points.max(0)
    span = np.maximum(high - low, 1e-6)
    positions = np.rint((points - low) / span * STEPS).astype("<u2")
    return {"low": low.tolist(), "span": span.tolist(), "positions": positions}


def _coarse_to_fine(count: int) -> NDArray[np.integer]:
    """The numbers below ``count`` by their bits from behind: 0, 4, 2, 6, 1, 5, 3, 7."""
    bits = max(count - 1, 1).bit_length()
    numbers = np.arange(1 << bits)
    turned = np.zeros_like(numbers)
    for bit in range(bits):
        turned |= (numbers >> bit & 1) << bits - 1 - bit
    return turned[turned < count]


def voxel_m(folder: MapFolder) -> float:
    """How far the points of a map's cloud are apart."""
    return float(folder.settings("fuse")["fuse"]["voxel_m"])

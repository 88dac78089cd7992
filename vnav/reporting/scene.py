"""What the 3D view of a map draws: layers of points, lines and surfaces in the world.

Arrays are little-endian numbers: base64 in a page's text, as they are beside it. Points have 16
bits a coordinate. The same map gives the same bytes.
"""

import base64
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vnav.core import se3
from vnav.core.arrays import Array
from vnav.core.camera import Intrinsics
from vnav.core.mapping import LoopVerdict, Odometry
from vnav.core.point_cloud import Mesh, PointCloud
from vnav.io.store.artifacts import (
    load_cloud,
    load_loops,
    load_mesh,
    load_odometry,
    load_optimised,
    map_cameras,
)
from vnav.io.store.map_folder import MapFolder
from vnav.io.store.records import LocatedNote, PathNote, is_kind

MOST_POINTS = 200_000  # of the cloud in a page's text
STEPS = 65535  # of a coordinate, over the side of the points' box
DENSE = 1.5  # how much larger points are drawn than their distance: surfaces look closed
KEYFRAME_M, PHOTO_M = 0.12, 0.5  # how long cameras are drawn
LARGE = {"cloud": ("cloud", "#90a4ae"), "mesh": ("surface", "#a1887f")}  # label and colour
PATH_M = 0.05  # how high above the floor a path is
SQUARE_M, LARGE_SQUARE_M, LARGE_M = 1.0, 5.0, 30.0  # the floor's squares, and of maps so long


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


@dataclass(frozen=True)
class MapScene:
    """Layers by name, and two corners (3,) in metres of what is looked at."""

    low: Array
    high: Array
    layers: dict[str, Layer]

    def values(self) -> dict[str, Any]:
        """Plain values for view.js."""
        layers = {name: {"color": a.color, **_plain(a.values)} for name, a in self.layers.items()}
        return {"low": _rounded(self.low), "high": _rounded(self.high), "layers": layers}


def scene(folder: MapFolder) -> MapScene:
    """The view of a map whose stages up to fuse are finished, its cloud thinned."""
    cloud = load_cloud(folder)
    return _scene(folder, cloud, {"cloud": cloud_layer(cloud, _voxel_m(folder), MOST_POINTS)})


def scene_beside(folder: MapFolder, addresses: Mapping[str, str]) -> MapScene:
    """The view whose cloud and surface are not in the page: ``addresses`` of `large_layer`."""
    large = {
        name: Layer(*LARGE[name], {"kind": name, "address": address}, is_shown=name == "cloud")
        for name, address in addresses.items()
    }
    return _scene(folder, load_cloud(folder), large)


def large_layer(folder: MapFolder, name: str) -> Layer | None:
    """The whole cloud or the surface of a map, "cloud" or "mesh"; None where it is empty."""
    if name == "mesh":
        return mesh_layer(load_mesh(folder))
    return cloud_layer(load_cloud(folder), _voxel_m(folder))


def _scene(folder: MapFolder, cloud: PointCloud, large: Mapping[str, Layer | None]) -> MapScene:
    odometry, poses = load_odometry(folder), load_optimised(folder).T_world_camera
    cameras = map_cameras(folder)
    low, high = _box(np.concatenate([cloud.points_world, poses[:, :3, 3]]))
    layers = {
        **large,
        "trajectory": _trajectory(odometry, poses),
        "keyframes": _keyframes(odometry, poses, cameras),
        "loops": _loops(odometry, poses, load_loops(folder)),
        "photo": _photo(folder.current()),
        "photos": _photos(folder.photos()),
        "path": _path(folder.planned()),
        "squares": _squares(float(max(high[:2] - low[:2]))),
    }
    return MapScene(low, high, {name: layer for name, layer in layers.items() if layer})


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
    values = {
        "kind": "mesh",
        **_steps(mesh.vertices_world),
        "colors": mesh.colors,
        "triangles": mesh.triangles.astype("<u4"),
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


def _voxel_m(folder: MapFolder) -> float:
    return float(folder.settings("fuse")["fuse"]["voxel_m"])


def frusta(T_world_camera: Array, camera: Intrinsics, length_m: float) -> Array:
    """Pyramids (K, 5, 3): where cameras (K, 4, 4) are, and the corners of their images."""
    right, bottom = camera.width - 0.5, camera.height - 0.5
    corners = [(-0.5, -0.5), (right, -0.5), (right, bottom), (-0.5, bottom)]
    points = np.vstack([np.zeros(3), camera.unproject(corners, np.full(4, length_m))])
    return np.stack([se3.transform(T, points) for T in T_world_camera]).reshape(-1, 5, 3)


def _box(points: Array) -> tuple[Array, Array]:
    """Corners of the box of known points (N, 3), but for a hundredth that may be far off."""
    known = points[np.isfinite(points).all(1)]
    low, high = np.percentile(known, (1, 99), axis=0)
    return low, high


def _trajectory(odometry: Odometry, poses: Array) -> Layer:
    """A line a capture, NaN where a frame has no pose."""
    captures = odometry.frames.capture
    lines = [poses[captures == k, :3, 3].astype("<f4") for k in np.unique(captures)]
    return Layer("trajectory", "#1e88e5", {"kind": "lines", "lines": lines})


def _keyframes(odometry: Odometry, poses: Array, cameras: list[Intrinsics]) -> Layer:
    rows = odometry.keyframe_rows
    rows = rows[np.isfinite(poses[rows, 0, 0])]
    captures = odometry.frames.capture[rows]
    points = [
        frusta(poses[rows[captures == k]], cameras[k], KEYFRAME_M) for k in np.unique(captures)
    ]
    values = {"kind": "frusta", "width": 0.6, "points": np.concatenate(points).astype("<f4")}
    return Layer(f"keyframes ({len(rows)})", "#5c6bc0", values)


def _loops(odometry: Odometry, poses: Array, verdicts: tuple[LoopVerdict, ...]) -> Layer:
    ends = np.array([(v.i, v.j) for v in verdicts if v.accepted and v.is_loop], int).reshape(-1, 2)
    pairs = poses[odometry.keyframe_rows[ends], :3, 3]
    pairs = pairs[np.isfinite(pairs).all((1, 2))]
    values = {"kind": "pairs", "pairs": pairs.astype("<f4")}
    return Layer(f"loops ({len(pairs)})", "#ab47bc", values)


def _photo(current: dict[str, Any] | None) -> Layer | None:
    """The current place: where the last single photo was taken."""
    pyramid = _photo_frustum(current)
    if current is None or pyramid is None:
        return None
    values = {"kind": "frusta", "width": 2, "points": pyramid.astype("<f4")}
    return Layer(f"photo {Path(current['photo']).name}", "#fb8c00", values)


def _photos(located: list[dict[str, Any]]) -> Layer | None:
    """Where the photos were taken that were located last together."""
    points = [pyramid for pyramid in map(_photo_frustum, located) if pyramid is not None]
    if not points:
        return None
    values = {"kind": "frusta", "width": 1.2, "points": np.concatenate(points).astype("<f4")}
    return Layer(f"located photos ({len(points)})", "#f4511e", values)


def _photo_frustum(note: dict[str, Any] | None) -> Array | None:
    """The pyramid (1, 5, 3) of a photo; None where its note is none that `locate` wrote."""
    if note is None or not is_kind(note, LocatedNote):
        return None
    known = note["intrinsics"]
    camera = Intrinsics(*(known[key] for key in ("width", "height", "fx", "fy", "cx", "cy")))
    if not camera.is_possible:
        return None
    return frusta(np.array([note["T_world_camera"]], float), camera, PHOTO_M)


def _path(planned: dict[str, Any] | None) -> Layer | None:
    """The last path, a little above the floor."""
    if planned is None or not is_kind(planned, PathNote) or not planned["path_m"]:
        return None
    points = np.array(planned["path_m"], float)
    points[:, 2] = PATH_M  # in the place of yaw
    values = {"kind": "lines", "lines": [points.astype("<f4")]}
    return Layer(f"path, {planned['length_m']:.1f} m", "#43a047", values)


def _squares(size_m: float) -> Layer:
    step_m = SQUARE_M if size_m < LARGE_M else LARGE_SQUARE_M
    label = f"squares of {step_m:g} m at z = 0"
    return Layer(label, "#8a949b", {"kind": "squares", "step_m": step_m})


def _plain(value: Any) -> Any:
    """Values with base64 in the place of arrays."""
    if isinstance(value, dict):
        return {key: _plain(part) for key, part in value.items()}
    if isinstance(value, list):
        return [_plain(part) for part in value]
    if isinstance(value, np.ndarray):
        return base64.b64encode(value.tobytes()).decode()
    return value


def _rounded(values: Array) -> list[float]:
    return [round(float(value), 3) for value in values]

"""What the 3D view of a map draws: layers of points, lines and surfaces in the world.

The same map gives the same values.
"""

import base64
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from vnav.core import se3
from vnav.core.arrays import Array
from vnav.core.camera import Intrinsics
from vnav.core.mapping import LoopVerdict, Odometry
from vnav.core.point_cloud import PointCloud
from vnav.io.store.artifacts import (
    load_cloud,
    load_loops,
    load_mesh,
    load_odometry,
    load_optimised,
    map_cameras,
)
from vnav.io.store.map_folder import MapFolder
from vnav.io.store.records import located_camera, planned_points
from vnav.reporting.layers import LARGE, Layer, cloud_layer, mesh_layer, voxel_m

MOST_POINTS = 200_000  # of the cloud in a page's text
MOST_VERTICES = 50_000  # of the surface there
KEYFRAME_M, PHOTO_M = 0.12, 0.5  # how long cameras are drawn
SQUARE_M, LARGE_SQUARE_M, LARGE_M = 1.0, 5.0, 30.0  # the floor's squares, and of maps so long


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
    """The view of a map whose stages up to fuse are finished, its cloud and surface thinned."""
    from vnav.volumes.simplified import simplified

    cloud, mesh = load_cloud(folder), simplified(load_mesh(folder), MOST_VERTICES)
    thinned = cloud_layer(cloud, voxel_m(folder), MOST_POINTS)
    return _scene(folder, cloud, {"cloud": thinned, "mesh": mesh_layer(mesh)})


def scene_beside(folder: MapFolder, addresses: Mapping[str, str]) -> MapScene:
    """The view whose cloud and surface are not in the page: ``addresses`` of `large_layer`."""
    large = {
        name: Layer(*LARGE[name], {"kind": name, "address": address}, is_shown=name == "cloud")
        for name, address in addresses.items()
    }
    return _scene(folder, load_cloud(folder), large)


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
    """Lines from one interruption of a capture to the next, NaN where a frame has no pose."""
    frames, places = odometry.frames, poses[:, :3, 3].astype("<f4")
    lines = []
    for rows in frames.of_captures():
        last = np.flatnonzero(frames.interrupted(rows))
        lines += np.split(places[rows], last + 1)
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
    located = located_camera(note)
    return frusta(located[0][None], located[1], PHOTO_M) if located else None


def _path(planned: dict[str, Any] | None) -> Layer | None:
    points = planned_points(planned)
    if planned is None or points is None:
        return None
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

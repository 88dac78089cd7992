"""The arrays that mapping stages leave in the map folder, saved and loaded."""

import dataclasses
import re
import shutil
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, TypeVar

import cv2
import msgspec
import numpy as np
from numpy.typing import NDArray

from vnav.core.camera import Intrinsics
from vnav.core.descriptor_space import DescriptorSpace
from vnav.core.frame import Edge, Features, Frame
from vnav.core.grid import FREE, UNKNOWN, WALKED, Grid
from vnav.core.mapping import (
    EVEN_LIGHT,
    FrameFeatures,
    FrameTable,
    Landmarks,
    LoopVerdict,
    Odometry,
    OptimisedMap,
    World,
)
from vnav.core.point_cloud import Mesh, PointCloud
from vnav.core.reduced_frame import in_pixels
from vnav.core.trajectory import Trajectory
from vnav.errors import MEND, MapError
from vnav.io.files import write_text
from vnav.io.formats.arrays_file import Arrays, save_arrays
from vnav.io.formats.grid_files import read_grid, write_grid, write_walked
from vnav.io.formats.ply import read_cloud, read_mesh, write_cloud
from vnav.io.formats.trajectories import read_tum, write_tum
from vnav.io.store.map_folder import MapFolder, to_json
from vnav.io.store.records import read_json
from vnav.io.store.schemas import load_table

Kind = TypeVar("Kind")
MOST_M = 1e5  # from the origin
PNG_FILTER, NO_FILTER = 19, 8  # OpenCV 4.11 has no names for these, and filters
DEPTH_PNG = cv2.IMWRITE_PNG_COMPRESSION, 1, PNG_FILTER, NO_FILTER
DEPTH_UNITS_PER_METRE = 5000  # of the keyframes' depth images: 0.2 mm steps up to 13.1 m


def map_camera(folder: MapFolder, capture: int = 0) -> Intrinsics:
    """The undistorted colour camera that the frames of a capture of this map were seen by."""
    return _camera(folder, folder.captures[capture]["camera"])


def recorded_camera(folder: MapFolder, capture: int = 0) -> Intrinsics:
    """The colour camera of a capture of this map as it recorded, with its lens's distortion."""
    found = folder.captures[capture]
    return _camera(folder, found.get("recorded_camera", found["camera"]))


def _camera(folder: MapFolder, found: dict[str, Any]) -> Intrinsics:
    path = folder.root / "map.json"
    try:
        camera = msgspec.convert(found, Intrinsics)
    except msgspec.ValidationError as error:
        raise MapError(f"expected a camera in {path}, found: {error}; {MEND}") from error
    if not camera.is_possible:
        raise MapError(f"expected a camera in {path}, found none that can be: {camera}; {MEND}")
    return camera


def map_cameras(folder: MapFolder) -> list[Intrinsics]:
    """The camera of each capture of this map."""
    return [map_camera(folder, k) for k in range(len(folder.captures))]


def save_odometry(draft: Path, odometry: Odometry) -> None:
    """Write frames, edges and keyframes; trajectory and cloud of a filter's longest segment."""
    frames, before = odometry.frames, odometry.T_world_before
    save_arrays(
        draft / "frames.npz",
        **vars(frames),
        T_segment_camera=odometry.T_segment_camera,
        segment=odometry.segment,
        given=np.array(odometry.given),
        moving_share=odometry.moving_share,
        **({} if before is None else {"T_world_before": before}),
        **({} if odometry.has_scale else {"has_scale": np.array(False)}),
        **({} if (odometry.light == EVEN_LIGHT).all() else {"light": odometry.light}),
    )
    if len(odometry.landmarks):
        _save_filtered(draft, odometry)
    space = odometry.keyframes[0].features.space
    write_text(draft / "descriptor_space.json", to_json(vars(space)))
    write_text(draft / "lost.json", to_json({r: t for r, t in enumerate(odometry.reasons) if t}))
    save_arrays(draft / "edges.npz", **edges_to_arrays(odometry.edges))
    save_arrays(draft / "degenerate_edges.npz", **edges_to_arrays(odometry.degenerate_edges))
    save_arrays(draft / "alternatives.npz", **edges_to_arrays(odometry.alternatives))
    _save_keyframes(draft / "keyframes.npz", odometry.keyframes)


def _save_filtered(draft: Path, odometry: Odometry) -> None:
    """What a filter found, for people: nothing is made of it."""
    points = odometry.landmarks
    write_tum(draft / "trajectory.tum", odometry.trajectory)
    write_cloud(draft / "landmarks.ply", PointCloud(points, np.full(points.shape, 255, np.uint8)))


def load_odometry(folder: MapFolder, *, any_scale: bool = False) -> Odometry:
    """The result of the odometry stage; MapError where lengths are not in metres.

    Unless ``any_scale`` is allowed.
    """
    frames = _load(folder, "odometry", "frames")
    has_scale = bool(frames.get("has_scale", True))
    if not (has_scale or any_scale):
        raise MapError(
            f"expected odometry in metres in {folder.root}, found it without scale, for it used no"
            " depth: a map needs an RGB-D capture, and --config ekf in the place of mono"
        )
    lost, rows = _load_json(folder, "odometry", "lost", dict[str, str]), len(frames["index"])
    return Odometry(
        _frame_table(frames),
        frames["T_segment_camera"],
        frames["segment"],
        tuple(lost.get(str(row), "") for row in range(len(frames["index"]))),
        edges_from_arrays(_load(folder, "odometry", "edges", N=rows)),
        _load_keyframes(folder, rows),
        bool(frames.get("given", False)),
        frames.get("T_world_before"),
        edges_from_arrays(_load(folder, "odometry", "degenerate_edges", N=rows)),
        edges_from_arrays(_load(folder, "odometry", "alternatives", N=rows)),
        frames["moving_share"],
        has_scale,
        light=frames.get("light", np.repeat(EVEN_LIGHT, len(np.unique(frames["capture"])), 0)),
    )


def load_frame_table(folder: MapFolder) -> FrameTable:
    """Every frame of the map's captures."""
    return _frame_table(_load(folder, "odometry", "frames"))


def _frame_table(frames: Arrays) -> FrameTable:
    names = [field.name for field in dataclasses.fields(FrameTable)]
    return FrameTable(*(frames[name] for name in names))


def load_descriptor_space(folder: MapFolder) -> DescriptorSpace:
    """What the descriptors of the map's features are."""
    return _load_json(folder, "odometry", "descriptor_space", DescriptorSpace)


def save_keyframe(draft: Path, row: int, frame: Frame) -> None:
    """Keep a keyframe's colour (JPEG) and depth (16-bit PNG), undistorted and registered.

    And which pixels show nothing of the scene, where some do not.
    """
    depth = np.rint(np.minimum(frame.depth_m * DEPTH_UNITS_PER_METRE, 65535)).astype(np.uint16)
    color = cv2.cvtColor(np.asarray(frame.color), cv2.COLOR_RGB2BGR)
    path = draft / "keyframes"
    path.mkdir(exist_ok=True)
    _write_image(path / f"{row:06d}.jpg", color, cv2.IMWRITE_JPEG_QUALITY, 92)
    _write_image(path / f"{row:06d}.png", depth, *DEPTH_PNG)
    if frame.hidden is not None:
        _write_flags(path / f"{row:06d}.hidden.png", frame.hidden)


def save_keyframe_mask(draft: Path, row: int, moving: NDArray[np.bool_]) -> None:
    """Keep which blocks (h, w) of a keyframe move, beside its images."""
    _write_flags(draft / "keyframes" / f"{row:06d}.mask.png", moving)


def copy_keyframes(folder: MapFolder, draft: Path, first_row: int = 0) -> None:
    """Copy the keyframes' images of a map; ``first_row``: the row that its first frame gets."""
    (draft / "keyframes").mkdir(exist_ok=True)
    for name in folder.files("odometry"):
        if name.startswith("keyframes/"):
            row, _, kind = Path(name).name.partition(".")
            copy = draft / "keyframes" / f"{int(row) + first_row:06d}.{kind}"
            shutil.copyfile(folder.file("odometry", name), copy)


def _write_flags(path: Path, image: NDArray[np.bool_]) -> None:
    _write_image(path, image.astype(np.uint8) * 255, cv2.IMWRITE_PNG_BILEVEL, 1)


def _write_image(path: Path, image: NDArray[Any], *parameters: int) -> None:
    """Unlike cv2.imwrite, a full disk is an OSError."""
    _, data = cv2.imencode(path.suffix, image, parameters)
    path.write_bytes(data.tobytes())


def kept_rows(folder: MapFolder, frames: int) -> list[int]:
    """Rows, of so many frames, of those whose colour and depth the map keeps, ascending."""
    names = (re.fullmatch(r"keyframes/(\d{6})\.png", name) for name in folder.files("odometry"))
    rows = (int(name[1]) for name in names if name)
    return sorted(row for row in rows if row < frames)


def keyframe_rows(folder: MapFolder, frames: int) -> list[int]:
    """Rows of the keyframes among so many frames, by their numbers."""
    sizes = {"N": frames, "W": load_descriptor_space(folder).size}
    rows: list[int] = _load(folder, "odometry", "keyframes", **sizes)["row"].tolist()
    return rows


def load_keyframe(folder: MapFolder, row: int, frames: FrameTable, beside_px: int = 0) -> Frame:
    """A keyframe's colour and depth by its row in the frame table; MapError where missing.

    What moves is hidden and has no depth, nor has what is beside it; see `load_keyframe_depth`.
    """
    whole = load_whole_keyframe(folder, row, frames)
    moving = load_keyframe_mask(folder, row, whole.depth_m.shape)
    if not moving.any():
        return whole
    hidden = moving if whole.hidden is None else moving | whole.hidden
    depth_m = _without(whole.depth_m, moving, beside_px)
    return dataclasses.replace(whole, depth_m=depth_m, hidden=hidden)


def load_whole_keyframe(folder: MapFolder, row: int, frames: FrameTable) -> Frame:
    """A keyframe with what moves in it."""
    color, depth_m = load_keyframe_color(folder, row), _keyframe_depth(folder, row)
    key = int(frames.capture[row]), int(frames.index[row])
    stamp_s, camera = float(frames.stamp_s[row]), map_camera(folder, key[0])
    hidden = _keyframe_flags(folder, row, "hidden.png")
    return Frame(*key, stamp_s, color, depth_m, camera, hidden)


def load_keyframe_color(folder: MapFolder, row: int) -> NDArray[np.uint8]:
    """A keyframe's colour (H, W, 3), RGB; MapError where missing."""
    color: NDArray[np.uint8] = _keyframe_image(folder, row, "jpg", cv2.IMREAD_COLOR_RGB)
    return color


def load_keyframe_depth(folder: MapFolder, row: int, beside_px: int = 0) -> NDArray[np.float32]:
    """A keyframe's depth (H, W) in metres, 0 where there is none; MapError where missing.

    What moves has none, nor has what is beside it, by so many pixels: nothing that is made of the
    map's depth shows it.
    """
    depth_m = _keyframe_depth(folder, row)
    return _without(depth_m, load_keyframe_mask(folder, row, depth_m.shape), beside_px)


def _keyframe_depth(folder: MapFolder, row: int) -> NDArray[np.float32]:
    depth = _keyframe_image(folder, row, "png", cv2.IMREAD_UNCHANGED)
    return np.asarray(depth / np.float32(DEPTH_UNITS_PER_METRE))


def _without(
    depth_m: NDArray[np.float32], moving: NDArray[np.bool_], beside_px: int
) -> NDArray[np.float32]:
    """Depth without that of what moves, and of what is beside it."""
    if not moving.any():
        return depth_m
    beside = cv2.getStructuringElement(cv2.MORPH_CROSS, (2 * beside_px + 1, 2 * beside_px + 1))
    return np.where(cv2.dilate(moving.astype(np.uint8), beside) > 0, np.float32(0), depth_m)


def load_keyframe_mask(folder: MapFolder, row: int, shape: tuple[int, ...]) -> NDArray[np.bool_]:
    """Which pixels of a keyframe, of that height and width, move."""
    blocks = load_keyframe_blocks(folder, row)
    return np.zeros(shape, bool) if blocks is None else in_pixels(blocks, shape)


def load_keyframe_blocks(folder: MapFolder, row: int) -> NDArray[np.bool_] | None:
    """Which blocks (h, w) of a keyframe move, as they are saved; None where none does."""
    return _keyframe_flags(folder, row, "mask.png")


def _keyframe_flags(folder: MapFolder, row: int, kind: str) -> NDArray[np.bool_] | None:
    """What `_write_flags` wrote, None where it did not."""
    if f"keyframes/{row:06d}.{kind}" not in folder.files("odometry"):
        return None
    return np.asarray(_keyframe_image(folder, row, kind, cv2.IMREAD_UNCHANGED) > 0)


def _keyframe_image(folder: MapFolder, row: int, kind: str, flags: int) -> Any:
    path = folder.file("odometry", f"keyframes/{row:06d}.{kind}")
    image = cv2.imdecode(np.fromfile(path, np.uint8), flags)
    if image is None:
        raise MapError(
            f"expected a keyframe's image in {path}, found none that can be read; {MEND}"
        )
    return image


def save_loops(
    draft: Path,
    verdicts: Iterable[LoopVerdict],
    edges: Iterable[Edge],
    matches: NDArray[np.int32],
) -> None:
    """Write every verdict, the accepted edges, and the matches (M, 4) that hold them."""
    save_verdicts(draft, verdicts)
    save_arrays(draft / "edges.npz", **edges_to_arrays(edges))
    save_arrays(draft / "matches.npz", matches=matches)


def save_verdicts(draft: Path, verdicts: Iterable[LoopVerdict]) -> None:
    """Write what became of every loop candidate."""
    write_text(draft / "verdicts.json", to_json([vars(v) for v in verdicts]))


def load_loops(folder: MapFolder, stage: str | None = None) -> tuple[LoopVerdict, ...]:
    """Every loop candidate and what became of it, by the last stage that judged it.

    "loops" judges by matches, "optimise" by the pose graph as well.
    """
    stage = stage or ("optimise" if folder.has("optimise") else "loops")
    return _load_json(folder, stage, "verdicts", tuple[LoopVerdict, ...])


def load_loop_edges(folder: MapFolder) -> tuple[tuple[Edge, ...], NDArray[np.int32]]:
    """Accepted edges between rows of the frame table, and their matches (M, 4).

    A match names keyframe and feature, keyframe and feature.
    """
    edges = edges_from_arrays(_load(folder, "loops", "edges", N=_frames(folder)))
    return edges, _load(folder, "loops", "matches")["matches"]


def require_features(
    odometry: Odometry, keyframe: NDArray[np.integer], feature: NDArray[np.integer], where: Path
) -> None:
    """MapError where a file names features (M,) that their keyframes (M,) do not have."""
    counts = np.array([len(k.features) for k in odometry.keyframes], np.int64)
    known = keyframe < len(counts)
    if not known.all() or (feature >= counts[keyframe]).any():
        raise MapError(f"expected features that keyframes have in {where}, found others; {MEND}")


def save_optimised(draft: Path, result: OptimisedMap) -> None:
    """Write poses, covariances, landmarks and the world."""
    save_arrays(
        draft / "map.npz",
        T_world_camera=result.T_world_camera,
        keyframe_covariance=result.keyframe_covariance,
        depth_delay_s=result.depth_delay_s,
        **vars(result.landmarks),
    )
    write_text(draft / "world.json", to_json(vars(result.world)))


def load_optimised(folder: MapFolder) -> OptimisedMap:
    """The result of the optimise stage."""
    arrays = _load(folder, "optimise", "map", N=_frames(folder))
    poses, covariance = arrays.pop("T_world_camera"), arrays.pop("keyframe_covariance")
    delay_s = arrays.pop("depth_delay_s")
    world = _load_json(folder, "optimise", "world", World)
    return OptimisedMap(poses, covariance, Landmarks(**arrays), world, delay_s)


def save_departed(draft: Path, landmarks: NDArray[np.bool_]) -> None:
    """Write which landmarks (L,) of the map have departed."""
    save_arrays(draft / "departed.npz", landmarks=landmarks)


def load_departed(folder: MapFolder, landmarks: int) -> NDArray[np.bool_]:
    """Which landmarks (L,) of the map have departed, by the fuse stage; there are so many."""
    return _load(folder, "fuse", "departed", L=landmarks)["landmarks"]


def save_mended_edges(draft: Path, edges: Iterable[Edge]) -> None:
    """Write odometry's edges as they are after the optimisation has mended them."""
    save_arrays(draft / "edges.npz", **edges_to_arrays(edges))


def load_mended_edges(folder: MapFolder) -> tuple[Edge, ...]:
    """Odometry's edges that the poses of the optimise stage stand on."""
    return edges_from_arrays(_load(folder, "optimise", "edges", N=_frames(folder)))


def edges_to_arrays(edges: Iterable[Edge]) -> Arrays:
    """Edges as arrays i, j, probability (E,), T_i_j (E, 4, 4), information (E, 6, 6)."""
    edges = list(edges)
    return {
        "i": np.array([e.i for e in edges], np.int32),
        "j": np.array([e.j for e in edges], np.int32),
        "T_i_j": np.array([e.T_i_j for e in edges]).reshape(-1, 4, 4),
        "information": np.array([e.information for e in edges]).reshape(-1, 6, 6),
        "probability": np.array([e.probability for e in edges]),
    }


def edges_from_arrays(arrays: Arrays) -> tuple[Edge, ...]:
    """The inverse of `edges_to_arrays`."""
    names = ("i", "j", "T_i_j", "information", "probability")
    rows = zip(*(arrays[name] for name in names), strict=True)
    return tuple(Edge(int(i), int(j), T, L, float(p)) for i, j, T, L, p in rows)


def _save_keyframes(path: Path, keyframes: Sequence[FrameFeatures]) -> None:
    fields = ("keypoints_px", "descriptors", "scores", "scales_px", "angles_rad")
    columns = {name: [getattr(k.features, name) for k in keyframes] for name in fields}
    columns["descriptors"] = [part.view(np.uint8) for part in columns["descriptors"]]
    save_arrays(
        path,
        **columns,
        row=np.array([k.row for k in keyframes], np.int32),
        count=np.array([len(k.features) for k in keyframes], np.int32),
        points_camera=[k.points_camera for k in keyframes],
    )


def _load_keyframes(folder: MapFolder, frames: int) -> tuple[FrameFeatures, ...]:
    space = load_descriptor_space(folder)
    arrays = _load(folder, "odometry", "keyframes", N=frames, W=space.size)
    arrays["descriptors"] = arrays["descriptors"].view(space.dtype)
    ends = np.cumsum(arrays["count"])
    fields = ("keypoints_px", "descriptors", "scores", "scales_px", "angles_rad")
    keyframes = []
    for row, begin, end in zip(arrays["row"], ends - arrays["count"], ends, strict=True):
        columns = {name: arrays[name][begin:end] for name in fields}
        features = Features(**columns, space=space)
        keyframes.append(FrameFeatures(int(row), features, arrays["points_camera"][begin:end]))
    return tuple(keyframes)


def load_trajectory(folder: MapFolder, capture: int = 0) -> Trajectory:
    """Final poses of a capture's tracked frames."""
    return read_tum(folder.file("optimise", f"trajectory_{capture}.tum"))


def save_grid(draft: Path, grid: Grid) -> None:
    """Write grid.pgm and .yaml, whose walked cells are unknown, and walked.pgm and .yaml."""
    write_grid(draft, grid)
    write_walked(draft, grid)


def load_grid(folder: MapFolder) -> Grid:
    """The grid of free, occupied, unknown and walked floor."""
    grid, walked = _load_grid(folder, "grid"), _load_grid(folder, "walked")
    is_walked = walked.cells == FREE
    places = ((g.origin, g.resolution_m, g.cells.shape) for g in (grid, walked))
    if len(set(places)) > 1 or (np.where(is_walked, grid.cells, walked.cells) != UNKNOWN).any():
        raise MapError(
            f"expected {folder.root / 'fuse' / 'walked.yaml'} to be a part of what is unknown in"
            " grid.yaml, found another grid; run 'vnav fuse' again"
        )
    return dataclasses.replace(grid, cells=np.where(is_walked, np.uint8(WALKED), grid.cells))


def _load_grid(folder: MapFolder, name: str) -> Grid:
    folder.file("fuse", f"{name}.pgm")  # which the other names
    return read_grid(folder.file("fuse", f"{name}.yaml"))


def load_cloud(folder: MapFolder) -> PointCloud:
    """The filtered, coloured cloud; MapError where a point is none that a map can have."""
    path = folder.file("fuse", "cloud.ply")
    cloud = read_cloud(path)
    _require_near(cloud.points_world, path, folder)
    return cloud


def load_mesh(folder: MapFolder) -> Mesh:
    """The coloured surface; MapError where a corner is none that a map can have."""
    path = folder.file("fuse", "mesh.ply")
    mesh = read_mesh(path)
    _require_near(mesh.vertices_world, path, folder)
    rows = mesh.triangles
    if ((rows < 0) | (rows >= len(mesh.vertices_world))).any():
        raise MapError(
            f"expected triangles between the corners of {path}, found others; run 'vnav fuse --map"
            f" {folder.root}' again"
        )
    return mesh


def _require_near(points_world: NDArray[np.float32], path: Path, folder: MapFolder) -> None:
    if not (np.abs(points_world) < MOST_M).all():
        raise MapError(
            f"expected points within {MOST_M:g} m of the origin in {path}, found others; run 'vnav"
            f" fuse --map {folder.root}' again"
        )


def _frames(folder: MapFolder) -> int:
    return len(_load(folder, "odometry", "frames")["index"])


def _load(folder: MapFolder, stage: str, name: str, **sizes: int) -> Arrays:
    return load_table(folder, stage, name, MEND, sizes)


def _load_json(folder: MapFolder, stage: str, name: str, kind: type[Kind]) -> Kind:
    path = folder.file(stage, f"{name}.json")
    try:
        return read_json(path, kind)
    except (OSError, ValueError) as error:
        raise MapError(f"expected JSON of a {stage} in {path}, found: {error}; {MEND}") from error

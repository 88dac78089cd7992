"""What stages leave in the map is loaded as it was saved, or its damage is told."""

import dataclasses
import shutil
from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from vnav.core import se3
from vnav.core.camera import Intrinsics
from vnav.core.frame import Edge, Features, Frame
from vnav.core.grid import FREE, OCCUPIED, UNKNOWN, WALKED, Grid
from vnav.core.mapping import (
    LOST,
    FrameFeatures,
    FrameTable,
    Landmarks,
    LoopVerdict,
    Odometry,
    OptimisedMap,
    World,
)
from vnav.core.point_cloud import Mesh, PointCloud
from vnav.errors import MapError, StaleArtifact
from vnav.features.sift import SPACE
from vnav.io.formats.grid_files import write_grid, write_walked
from vnav.io.formats.ply import write_cloud, write_mesh
from vnav.io.store import artifacts
from vnav.io.store.map_folder import MapFolder
from vnav.io.store.records import MappedCapture

Altering = Callable[[MapFolder, str], AbstractContextManager[Path]]

RNG = np.random.default_rng(0)


@pytest.fixture
def folder(tmp_path: Path) -> MapFolder:
    return MapFolder.create(tmp_path / "map")


def saved(folder: MapFolder, stage: str, save: Callable[[Path], None]) -> MapFolder:
    with folder.writing(stage, {}, {}) as draft:
        save(draft)
    return folder


def keyframe(row: int, count: int) -> FrameFeatures:
    features = Features(
        RNG.uniform(0, 99, (count, 2)),
        RNG.integers(0, 256, (count, 128)).astype(np.uint8),
        RNG.random(count),
        RNG.random(count),
        RNG.random(count),
        SPACE,
    )
    points = RNG.random((count, 3)).astype(np.float32)
    points[::3] = np.nan
    return FrameFeatures(row, features, points)


def edges(count: int) -> tuple[Edge, ...]:
    return tuple(
        Edge(k, k + 1, se3.exp(RNG.standard_normal(6)), RNG.random((6, 6))) for k in range(count)
    )


def odometry(keyframes: int = 2, edge_count: int = 2) -> Odometry:
    poses = se3.exp(RNG.standard_normal((4, 6)))
    poses[2] = np.nan
    return Odometry(
        FrameTable(
            np.array([0, 0, 0, 1]),
            np.array([0, 1, 2, 0]),
            np.array([1.0, 1.1, 1.2, 1.0]),
            np.array([0.0, 0.01, 0.02, 0.0]),
        ),
        poses,
        np.array([0, 0, LOST, 1], np.int32),
        ("", "", "expected an image in 'rgb/2.png', found none", ""),
        edges(edge_count),
        tuple(keyframe(row, 7 - row) for row in range(keyframes)),
        light=np.array([[1, 0, 0], [0.3, 0.01, 2.5]], np.float32),
    )


def assert_same(a: object, b: object) -> None:
    """Equal, array for array and type for type."""
    if isinstance(a, np.ndarray):
        np.testing.assert_array_equal(a, b)
        assert a.dtype == b.dtype  # type: ignore[attr-defined]
    elif isinstance(a, tuple):
        for x, y in zip(a, b, strict=True):  # type: ignore[call-overload]
            assert_same(x, y)
    elif hasattr(a, "__dataclass_fields__"):
        fields = a.__dataclass_fields__
        assert_same(*(tuple(getattr(x, name) for name in fields) for x in (a, b)))
    else:
        assert a == b


def test_odometry_is_loaded_as_it_was_saved(folder: MapFolder) -> None:
    result = odometry()
    saved(folder, "odometry", lambda draft: artifacts.save_odometry(draft, result))
    assert_same(result, artifacts.load_odometry(folder))


def test_the_poses_of_a_map_before_it_was_extended_are_kept(folder: MapFolder) -> None:
    result = dataclasses.replace(odometry(), T_world_before=se3.exp(RNG.standard_normal((4, 6))))
    saved(folder, "odometry", lambda draft: artifacts.save_odometry(draft, result))
    assert_same(result, artifacts.load_odometry(folder))


def test_keyframes_of_another_odometry_follow_on_the_rows_before(
    folder: MapFolder, tmp_path: Path
) -> None:
    def keep(draft: Path) -> None:
        (draft / "keyframes").mkdir()
        for name in ("000000.jpg", "000012.png", "000012.mask.png"):
            (draft / "keyframes" / name).write_text(name)

    saved(folder, "odometry", keep)
    (tmp_path / "whole" / "keyframes").mkdir(parents=True)
    (tmp_path / "whole" / "keyframes" / "000007.jpg").touch()
    artifacts.copy_keyframes(folder, tmp_path / "whole", 8)
    images = sorted((tmp_path / "whole" / "keyframes").iterdir())
    names = ["000007.jpg", "000008.jpg", "000020.mask.png", "000020.png"]
    assert [path.name for path in images] == names
    assert images[-1].read_text() == "000012.png"


def test_odometry_of_one_keyframe_and_no_edge_is_legal(folder: MapFolder) -> None:
    result = odometry(keyframes=1, edge_count=0)
    saved(folder, "odometry", lambda draft: artifacts.save_odometry(draft, result))
    assert_same(result, artifacts.load_odometry(folder))


def test_loops_are_loaded_as_they_were_saved(folder: MapFolder) -> None:
    verdicts = (
        LoopVerdict(0, 5, "appearance", 0.25, True, "", 80, 60),
        LoopVerdict(1, 7, "proximity", 0.5, False, "too few matches", 3, 0),
    )
    accepted, matches = edges(1), RNG.integers(0, 9, (60, 4)).astype(np.int32)
    saved(folder, "odometry", lambda draft: artifacts.save_odometry(draft, odometry()))
    saved(folder, "loops", lambda draft: artifacts.save_loops(draft, verdicts, accepted, matches))
    assert artifacts.load_loops(folder) == verdicts
    assert_same((accepted, matches), artifacts.load_loop_edges(folder))


def test_no_loops_are_legal(folder: MapFolder) -> None:
    none = np.zeros((0, 4), np.int32)
    saved(folder, "odometry", lambda draft: artifacts.save_odometry(draft, odometry()))
    saved(folder, "loops", lambda draft: artifacts.save_loops(draft, [], [], none))
    assert artifacts.load_loops(folder) == ()
    assert_same(((), none), artifacts.load_loop_edges(folder))


@pytest.mark.parametrize("world", [World("floor", 900, 0.01), World("cameras", 0, None)])
def test_the_optimised_map_is_loaded_as_it_was_saved(folder: MapFolder, world: World) -> None:
    landmarks = Landmarks(RNG.random((3, 3)), RNG.random(3), [0, 0, 2], [0, 1, 1], [4, 2, 0])
    saved(folder, "odometry", lambda draft: artifacts.save_odometry(draft, odometry()))
    poses = se3.exp(RNG.standard_normal((4, 6)))
    result = OptimisedMap(
        poses, RNG.random((2, 6, 6)), landmarks, world, np.array([0.02, 0.01, 0.02, 0.0])
    )
    saved(folder, "optimise", lambda draft: artifacts.save_optimised(draft, result))
    assert_same(result, artifacts.load_optimised(folder))


def mapped(camera: dict[str, Any]) -> MappedCapture:
    return MappedCapture(id=0, name="house", fingerprint="", camera=camera)


def test_a_keyframes_images_are_kept(folder: MapFolder) -> None:
    # JPEG of a smooth image is off by little; depth is stored in steps of 0.2 mm.
    ramp = np.linspace(0, 255, 64 * 48).reshape(48, 64)
    color = np.stack([ramp, 255 - ramp, ramp / 2], -1).astype(np.uint8)
    depth = RNG.uniform(0.3, 13, (48, 64)).astype(np.float32)
    depth[:5] = 0
    camera = Intrinsics(64, 48, 50.0, 51.0, 31.5, 23.5)
    frame = Frame(1, 0, 1.0, color, depth, camera)
    frames = odometry().frames
    folder.set_captures([mapped({}), mapped(vars(camera))])
    saved(folder, "odometry", lambda draft: artifacts.save_keyframe(draft, 3, frame))
    kept = artifacts.load_keyframe(folder, 3, frames)
    assert (kept.capture, kept.index, kept.stamp_s) == (1, 0, 1.0)
    assert kept.intrinsics == camera
    assert np.abs(kept.color.astype(int) - color).mean() < 3
    assert np.abs(kept.depth_m - depth).max() <= 1.01e-4
    assert not kept.depth_m[:5].any()


def test_depth_beyond_what_is_stored_is_not_wrapped_to_near(folder: MapFolder) -> None:
    camera = Intrinsics(8, 8, 9.0, 9.0, 3.5, 3.5)
    frame = Frame(0, 0, 1.0, np.zeros((8, 8, 3)), np.full((8, 8), 20.0), camera)
    saved(folder, "odometry", lambda draft: artifacts.save_keyframe(draft, 0, frame))
    assert artifacts.load_keyframe_depth(folder, 0).min() > 13


@pytest.mark.parametrize(
    ("beside_px", "hidden"),
    [
        (0, [[0, 0, 0, 0, 0], [0, 0, 1, 0, 0], [0, 0, 0, 0, 0]]),
        (4, [[0, 0, 1, 0, 0], [0, 1, 1, 1, 0], [0, 0, 1, 0, 0]]),
    ],
)
def test_what_moves_has_no_depth_nor_has_what_is_beside_it(
    folder: MapFolder, beside_px: int, hidden: list[list[int]]
) -> None:
    camera = Intrinsics(20, 12, 9.0, 9.0, 9.5, 5.5)
    frame = Frame(0, 0, 1.0, np.zeros((12, 20, 3)), np.full((12, 20), 2.0), camera)
    moving = np.zeros((3, 5), bool)
    moving[1, 2] = True

    def write(draft: Path) -> None:
        artifacts.save_keyframe(draft, 0, frame)
        artifacts.save_keyframe_mask(draft, 0, moving)

    saved(folder, "odometry", write)
    no_depth = artifacts.load_keyframe_depth(folder, 0, beside_px) == 0
    np.testing.assert_array_equal(no_depth, np.kron(hidden, np.ones((4, 4))) > 0)


def test_what_moves_and_what_is_not_of_the_scene_is_hidden_in_a_keyframe(
    folder: MapFolder,
) -> None:
    camera = Intrinsics(20, 12, 9.0, 9.0, 9.5, 5.5)
    text, moving = np.zeros((12, 20), bool), np.zeros((3, 5), bool)
    text[0, 3:9] = moving[1, 2] = True
    shown = Frame(0, 0, 1.0, np.zeros((12, 20, 3)), np.full((12, 20), 2.0), camera)

    def write(draft: Path) -> None:
        artifacts.save_odometry(draft, odometry())
        artifacts.save_keyframe(draft, 0, dataclasses.replace(shown, hidden=text))
        artifacts.save_keyframe(draft, 1, shown)
        artifacts.save_keyframe_mask(draft, 0, moving)
        artifacts.save_keyframe_mask(draft, 1, np.zeros_like(moving))

    folder.set_captures([mapped(vars(camera)), mapped(vars(camera))])
    saved(folder, "odometry", write)
    hidden = [artifacts.load_keyframe(folder, k, odometry().frames).hidden for k in range(2)]
    np.testing.assert_array_equal(hidden[0], text | (np.kron(moving, np.ones((4, 4))) > 0))
    assert hidden[1] is None


def test_a_missing_keyframe_image_is_named(folder: MapFolder) -> None:
    saved(folder, "odometry", lambda draft: artifacts.save_odometry(draft, odometry()))
    with pytest.raises(StaleArtifact, match=r"expected .*000002\.jpg as .* wrote it, found none"):
        artifacts.load_keyframe(folder, 2, odometry().frames)


def test_the_camera_of_the_map_is_undistorted_and_whole(folder: MapFolder) -> None:
    camera = {"width": 64, "height": 48, "fx": 50.0, "fy": 51.0, "cx": 31.5, "cy": 23.5}
    folder.set_captures([mapped(camera), mapped(camera | {"fx": 60.0})])
    assert artifacts.map_camera(folder).size == (64, 48)
    assert artifacts.map_camera(folder, 1).fx == 60.0
    assert artifacts.map_camera(folder).distortion == ()
    assert artifacts.recorded_camera(folder, 1) == artifacts.map_camera(folder, 1)


def test_the_camera_that_recorded_may_have_a_lens(folder: MapFolder) -> None:
    camera = {"width": 64, "height": 48, "fx": 50.0, "fy": 51.0, "cx": 31.5, "cy": 23.5}
    bent = camera | {"distortion": [0.2, -0.1, 0.0, 0.0]}
    entry = mapped(camera)
    entry["recorded_camera"] = bent
    folder.set_captures([entry])
    assert artifacts.map_camera(folder).distortion == ()
    assert artifacts.recorded_camera(folder).distortion == (0.2, -0.1, 0.0, 0.0)


@pytest.mark.parametrize(
    "change",
    [{"width": 0}, {"height": 10**9}, {"fx": 0.0}, {"fy": -50.0}, {"fx": 1e-320}, {"cx": 1e300}],
)
def test_a_crafted_camera_that_cannot_be_is_named(
    folder: MapFolder, change: dict[str, Any]
) -> None:
    camera = {"width": 64, "height": 48, "fx": 50.0, "fy": 51.0, "cx": 31.5, "cy": 23.5}
    folder.set_captures([mapped(camera | change)])
    with pytest.raises(MapError, match=r"expected a camera in .*map\.json, found none that can"):
        artifacts.map_camera(folder)


@pytest.mark.parametrize(("keyframe", "feature"), [(2, 0), (0, 7), (1, 6)])
def test_features_that_keyframes_do_not_have_are_named(keyframe: int, feature: int) -> None:
    tracked = odometry()  # two keyframes, of 7 and 6 features
    right = np.array([0, 1]), np.array([6, 5])
    artifacts.require_features(tracked, *right, Path("matches.npz"))
    wrong = np.array([0, keyframe]), np.array([6, feature])
    with pytest.raises(MapError, match=r"features that keyframes have in matches\.npz"):
        artifacts.require_features(tracked, *wrong, Path("matches.npz"))


def cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-30])


def emptied(path: Path) -> None:
    path.write_bytes(b"")


def altered(path: Path) -> None:
    path.write_bytes(path.read_bytes().replace(b"NUMPY", b"NUMPI", 1))


def other(path: Path) -> None:
    path.write_bytes(b"neither arrays nor JSON")


@pytest.mark.parametrize("damage", [cut, emptied, altered, other, Path.unlink])
@pytest.mark.parametrize("name", ["frames.npz", "keyframes.npz", "edges.npz"])
def test_damaged_arrays_are_named(
    folder: MapFolder, name: str, damage: Callable[[Path], None]
) -> None:
    saved(folder, "odometry", lambda draft: artifacts.save_odometry(draft, odometry()))
    damage(folder.root / "odometry" / name)
    with pytest.raises(StaleArtifact, match=f"expected .*{name} as the stage 'odometry' wrote it"):
        artifacts.load_odometry(folder)


@pytest.mark.parametrize("damage", [cut, emptied, other, Path.unlink])
def test_a_damaged_table_is_named(folder: MapFolder, damage: Callable[[Path], None]) -> None:
    saved(folder, "odometry", lambda draft: artifacts.save_odometry(draft, odometry()))
    damage(folder.root / "odometry" / "lost.json")
    with pytest.raises(StaleArtifact, match=r"expected .*lost\.json as the stage .* wrote it"):
        artifacts.load_odometry(folder)


def test_a_grid_is_loaded_with_its_walked_cells(folder: MapFolder) -> None:
    grid = Grid((-1.0, 2.0), 0.05, np.array([[FREE, WALKED, OCCUPIED], [UNKNOWN, WALKED, FREE]]))
    found = artifacts.load_grid(
        saved(folder, "fuse", lambda draft: artifacts.save_grid(draft, grid))
    )
    assert (found.origin, found.resolution_m) == (grid.origin, grid.resolution_m)
    np.testing.assert_array_equal(found.cells, grid.cells)


@pytest.mark.parametrize(
    "other",
    [
        Grid((-1.0, 2.0), 0.05, np.array([[WALKED, UNKNOWN]])),
        Grid((-1.0, 2.0), 0.05, np.array([[FREE, WALKED, WALKED]])),
        Grid((-1.0, 2.1), 0.05, np.array([[FREE, WALKED]])),
        Grid((-1.0, 2.0), 0.10, np.array([[FREE, WALKED]])),
    ],
    ids=["over seen floor", "another size", "another place", "another resolution"],
)
def test_a_corridor_that_is_no_part_of_the_unknown_is_refused(
    folder: MapFolder, other: Grid
) -> None:
    def save(draft: Path) -> None:
        write_grid(draft, Grid((-1.0, 2.0), 0.05, np.array([[FREE, UNKNOWN]])))
        write_walked(draft, other)

    with pytest.raises(MapError, match=r"walked\.yaml to be a part of what is unknown.*vnav fuse"):
        artifacts.load_grid(saved(folder, "fuse", save))


@pytest.mark.parametrize("wrong", [np.inf, np.nan, 1e6])
def test_points_that_no_map_has_are_an_error(
    fused_map: Path, tmp_path: Path, altering: Altering, wrong: float
) -> None:
    other = MapFolder(shutil.copytree(fused_map, tmp_path / "map"))
    points = np.array([[0.0, 0.0, wrong]] * 3, np.float32)
    colors = np.zeros((3, 3), np.uint8)
    with altering(other, "fuse") as draft:
        write_cloud(draft / "cloud.ply", PointCloud(points, colors))
        write_mesh(draft / "mesh.ply", Mesh(points, points, colors, np.array([[0, 1, 2]])))
    for load in (artifacts.load_cloud, artifacts.load_mesh):
        with pytest.raises(MapError, match="expected points within 100000 m .* run 'vnav fuse"):
            load(other)


@pytest.mark.parametrize("wrong", [-1, 3])
def test_triangles_between_corners_that_are_not_there_are_an_error(
    fused_map: Path, tmp_path: Path, altering: Altering, wrong: int
) -> None:
    other = MapFolder(shutil.copytree(fused_map, tmp_path / "map"))
    points, colors = np.zeros((3, 3)), np.zeros((3, 3))
    with altering(other, "fuse") as draft:
        write_mesh(draft / "mesh.ply", Mesh(points, points, colors, np.array([[0, 1, wrong]])))
    with pytest.raises(MapError, match="expected triangles .* run 'vnav fuse"):
        artifacts.load_mesh(other)

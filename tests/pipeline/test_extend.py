"""A room's map extended by another camera's walk in it, and by what does not belong there."""

import dataclasses
import hashlib
import shutil
from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path

import numpy as np
import pytest

from vnav.config import CaptureConfig, Config, FeaturesConfig, SiftConfig
from vnav.core import se3
from vnav.errors import CaptureError, ConfigError, MapError, StaleArtifact
from vnav.io.formats.trajectories import read_photo_poses, read_tum
from vnav.io.sources.capture import Capture
from vnav.io.sources.open_capture import open_capture
from vnav.io.store.artifacts import load_odometry, load_optimised, save_odometry
from vnav.io.store.map_folder import STAGES, MapFolder, to_json
from vnav.pipeline import extend, joining
from vnav.pipeline.connection import Connection, require_connection
from vnav.stages import fuse, index, loops, optimise, vocabulary
from vnav.stages.locate import Locator
from vnav.stages.odometry import SECTIONS

pytestmark = pytest.mark.slow

FRAMES, MORE = 60, 24


@pytest.fixture
def folder(whole_map: Path, tmp_path: Path) -> MapFolder:
    """The map before it is extended, in a folder of its own."""
    shutil.copytree(whole_map, tmp_path / "place" / "map")
    return MapFolder(tmp_path / "place" / "map")


@pytest.fixture(scope="module")
def other(other_capture: Path) -> Capture:
    return open_capture(other_capture, CaptureConfig())


@pytest.fixture(scope="module")
def extended(extended_map: Path) -> MapFolder:
    return MapFolder(extended_map)


@pytest.fixture(scope="module")
def truth(tiny_capture: Path, other_capture: Path) -> np.ndarray:
    """True poses of all frames, which are of one world."""
    captures = tiny_capture, other_capture
    return np.concatenate([read_tum(c / "groundtruth.txt").T_world_camera for c in captures])


def content(root: Path, *without: str) -> dict[str, str]:
    """Hashes of all files but those of some folders."""
    return {
        path.relative_to(root).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(root.rglob("*"))
        if path.is_file() and path.relative_to(root).parts[0] not in without
    }


def extend_by(folder: MapFolder, capture: Capture, config: Config | None = None) -> None:
    extend.extend(folder, capture, config or extend.made_with(folder))


def assert_refused(
    folder: MapFolder, capture: Capture, error: type[Exception], why: str, **changes: object
) -> None:
    """The map stays as it was, byte for byte, and nothing is left beside it."""
    before = content(folder.root)
    config = dataclasses.replace(extend.made_with(folder), **changes)  # type: ignore[arg-type]
    with pytest.raises(error, match=why):
        extend_by(folder, capture, config)
    assert content(folder.root) == before
    assert [path.name for path in folder.root.parent.iterdir()] == ["map"]


def test_frames_of_both_captures_are_where_they_were_taken(
    extended: MapFolder, truth: np.ndarray
) -> None:
    # A keyframe is held by 300 matches of a pixel each, 8 mm at 2 m: half a millimetre; a few of
    # those add up from one end of the room to the other.
    found = load_optimised(extended).T_world_camera
    assert np.isfinite(found).all()
    T_truth_world = se3.align(truth[:, :3, 3], found[:, :3, 3])
    off = np.linalg.norm((T_truth_world @ found)[:, :3, 3] - truth[:, :3, 3], axis=1)
    assert np.sqrt((off**2).mean()) < 0.003
    turned = se3.rotation_angle(se3.inverse(T_truth_world @ found) @ truth)
    assert np.rad2deg(turned).max() < 0.3


def test_what_was_mapped_before_keeps_its_place(extended: MapFolder, whole_map: Path) -> None:
    # Both maps err by about a millimetre.
    before, now = load_optimised(MapFolder(whole_map)), load_optimised(extended)
    moved = now.T_world_camera[:FRAMES, :3, 3] - before.T_world_camera[:, :3, 3]
    assert np.linalg.norm(moved, axis=1).max() < 0.005
    assert now.world.source == "kept"
    assert now.world.floor_z_m == pytest.approx(0, abs=0.005)
    assert now.world.floor_tilt_deg == pytest.approx(0, abs=0.2)
    assert now.world.doubt == ""


def test_the_pose_located_last_is_remembered(extended: MapFolder) -> None:
    assert extended.current() == {"photo": "photo.jpg"}


def test_what_was_mapped_before_is_not_tracked_again(extended: MapFolder, whole_map: Path) -> None:
    old, both = load_odometry(MapFolder(whole_map)), load_odometry(extended)
    np.testing.assert_array_equal(both.T_segment_camera[:FRAMES], old.T_segment_camera)
    assert [e.T_i_j.tobytes() for e in both.edges[: len(old.edges)]] == [
        e.T_i_j.tobytes() for e in old.edges
    ]
    was = content(whole_map / "odometry" / "keyframes")
    images = content(extended.root / "odometry" / "keyframes")
    assert {name: images[name] for name in was} == was
    assert len(images) == 2 * len(both.keyframes)


def test_frames_are_named_by_capture(extended: MapFolder) -> None:
    both = load_odometry(extended)
    assert both.frames.capture.tolist() == [0] * FRAMES + [1] * MORE
    assert both.frames.index.tolist() == [*range(FRAMES), *range(MORE)]
    assert [capture["id"] for capture in extended.captures] == [0, 1]
    assert extended.captures[1]["name"] == "other"
    for number, count in enumerate((FRAMES, MORE)):
        trajectory = read_tum(extended.stage("optimise") / f"trajectory_{number}.tum")
        assert len(trajectory.stamps_s) == count


def test_each_frame_keeps_the_time_that_its_depth_is_stamped_later(
    extended: MapFolder, tiny_capture: Path, other_capture: Path
) -> None:
    captures = [open_capture(path, CaptureConfig()) for path in (tiny_capture, other_capture)]
    offsets_s = np.concatenate([capture.files.offsets_s for capture in captures])
    assert offsets_s.all()
    np.testing.assert_allclose(load_odometry(extended).frames.depth_after_s, offsets_s)


def test_edges_join_frames_of_one_capture(extended: MapFolder, other: Capture) -> None:
    both = load_odometry(extended)
    assert all((e.i < FRAMES) == (e.j < FRAMES) for e in both.edges)
    assert max(e.j for e in both.edges) == FRAMES + MORE - 1
    assert all(k.row < FRAMES + MORE for k in both.keyframes)


def test_every_stage_is_up_to_date_afterwards(extended: MapFolder) -> None:
    config = extend.made_with(extended)
    for stage in (vocabulary, loops, optimise, fuse, index):
        assert stage.run(extended, config).reused


def test_photos_are_located_by_what_the_other_camera_saw(
    extended: MapFolder, other_capture: Path, truth: np.ndarray
) -> None:
    photo = other_capture / "photos" / "000.jpg"
    best = Locator.open(extended, Config()).locate(photo).best
    assert best is not None
    found = load_optimised(extended).T_world_camera
    T_truth_world = se3.align(truth[:, :3, 3], found[:, :3, 3])
    true = read_photo_poses(other_capture / "photos" / "groundtruth.txt")["000.jpg"]
    assert np.linalg.norm((T_truth_world @ best.view.T_world_camera - true)[:3, 3]) < 0.05


def test_the_report_tells_what_was_joined(extended: MapFolder) -> None:
    found = extended.report("map")["values"]["connection"]
    assert found["frames"] == found["posed"] == MORE
    assert found["located"] >= 3
    assert found["closures"] >= found["agreeing"] >= 3


def test_broken_off_it_goes_on_to_the_same_map(
    folder: MapFolder, other: Capture, extended: MapFolder, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupt(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    before, config = content(folder.root), extend.made_with(extended)
    with monkeypatch.context() as patch:
        patch.setattr(loops, "run", interrupt)
        with pytest.raises(KeyboardInterrupt):
            extend_by(folder, other, config)
    assert content(folder.root) == before
    monkeypatch.setattr(joining, "track_alone", interrupt)  # it is not tracked again, either
    extend_by(folder, other, config)
    assert content(folder.root, "reports", "state") == content(extended.root, "reports", "state")


def test_an_extended_map_records_all_that_it_was_tracked_with(extended: MapFolder) -> None:
    assert {*SECTIONS} < {*extended.settings("odometry")}


def test_a_capture_of_another_place_is_refused(folder: MapFolder, elsewhere: Path) -> None:
    capture = open_capture(elsewhere, CaptureConfig())
    why = r"expected elsewhere to show the place of .*map, found 0 of \d+ keyframes in it.*best"
    assert_refused(folder, capture, CaptureError, why)


@pytest.mark.parametrize(("posed", "agreeing"), [(0, 9), (24, 2)])
def test_a_capture_that_no_loop_joins_where_it_was_located_is_refused(
    folder: MapFolder, posed: int, agreeing: int
) -> None:
    found = Connection(frames=24, posed=posed, tried=8, located=7, closures=9, agreeing=agreeing)
    why = f"where 7 of its keyframes were located, found 9, of which {agreeing} agree with that"
    with pytest.raises(CaptureError, match=f"expected loops that join other to the map .* {why}"):
        require_connection(found, "other", folder)
    require_connection(dataclasses.replace(found, posed=1, agreeing=3), "other", folder)


def test_a_capture_that_is_in_the_map_is_refused(folder: MapFolder, tiny_capture: Path) -> None:
    again = open_capture(tiny_capture, CaptureConfig())
    assert_refused(folder, again, CaptureError, "found miniature, which is its capture 0")


def test_a_capture_of_wrong_units_is_refused(folder: MapFolder, other_capture: Path) -> None:
    wrong = open_capture(other_capture, CaptureConfig(units_per_metre=1000.0))
    assert_refused(folder, wrong, CaptureError, "units_per_metre")


def test_features_of_another_kind_are_refused(folder: MapFolder, other: Capture) -> None:
    changes = {"features": FeaturesConfig(sift=SiftConfig(root_sift=False))}
    assert_refused(folder, other, ConfigError, r"other settings of \[features\]", **changes)


def test_a_map_at_given_poses_is_refused(
    folder: MapFolder,
    other: Capture,
    altering: Callable[[MapFolder, str], AbstractContextManager[Path]],
) -> None:
    odometry = dataclasses.replace(load_odometry(folder), given=True)
    with altering(folder, "odometry") as draft:
        save_odometry(draft, odometry)
    assert_refused(folder, other, MapError, "found one built on given poses")


def test_a_map_that_is_not_finished_is_refused(folder: MapFolder) -> None:
    shutil.rmtree(folder.root / "index")
    with pytest.raises(StaleArtifact, match="'vnav index --map"):
        extend.made_with(folder)


def test_settings_are_those_of_the_map_but_how_its_capture_was_read(tmp_path: Path) -> None:
    folder, changed = MapFolder.create(tmp_path), {"seed": 7, "loops": {"candidates": 9}}
    capture = {"capture": {"preset_camera": "tum_fr1"}, "fuse": {"voxel_m": 0.04}}
    for stage in STAGES:
        with folder.writing(stage, changed if stage == "loops" else capture, {}):
            pass
    config = extend.made_with(folder)
    assert (config.seed, config.loops.candidates, config.fuse.voxel_m) == (7, 9, 0.04)
    assert config.capture == CaptureConfig()


def test_a_setting_that_is_not_known_any_more_is_named(tmp_path: Path) -> None:
    folder = MapFolder.create(tmp_path)
    for stage in STAGES:
        with folder.writing(stage, {"loops": {"cadence": 1}}, {}):
            pass
    with pytest.raises(ConfigError, match="unknown setting 'loops.cadence' in the stages"):
        extend.made_with(folder)
    assert "cadence" in to_json(folder.settings("loops"))

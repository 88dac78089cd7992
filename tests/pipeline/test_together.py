"""Several captures that are one map: a room by two cameras, and what does not belong there."""

import dataclasses
import hashlib
import shutil
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vnav
from vnav import batch
from vnav.config import CaptureConfig, Config, FeaturesConfig, FuseConfig
from vnav.core import se3
from vnav.core.progress import Progress, silent
from vnav.core.report import Failed, Report
from vnav.errors import CaptureError, MapError
from vnav.io.formats.trajectories import read_tum
from vnav.io.sources.capture import Capture
from vnav.io.sources.open_capture import open_capture
from vnav.io.sources.subset import Subset
from vnav.io.store.artifacts import (
    copy_keyframes,
    load_odometry,
    load_optimised,
    save_odometry,
)
from vnav.io.store.map_folder import PARTS, STAGES, MapFolder
from vnav.io.store.overview import overview
from vnav.pipeline.build import build
from vnav.pipeline.extend import extend, made_with
from vnav.pipeline.joining import TrackTask, in_turn, track_alone, track_together
from vnav.stages.odometry import described

pytestmark = pytest.mark.slow

CONFIG = Config(
    features=FeaturesConfig(max_features=700),
    fuse=FuseConfig(voxel_m=0.05, octree_m=0.1, mesh_voxel_m=0.1),  # quick
)
FRAMES, OTHERS = 60, 24


class Renamed(Subset):
    """Some frames of a capture, called otherwise."""

    def __init__(self, capture: Capture, rows: Sequence[int], name: str) -> None:
        super().__init__(capture, rows)
        self._name = name

    @property
    def name(self) -> str:
        return self._name


def opened(folder: Path) -> Capture:
    return open_capture(folder, CaptureConfig())


@pytest.fixture(scope="module")
def captures(elsewhere: Path, tiny_capture: Path, other_capture: Path) -> list[Path]:
    """The first is of another place."""
    return [elsewhere, tiny_capture, other_capture]


@pytest.fixture(scope="module")
def made(captures: list[Path], tmp_path_factory: pytest.TempPathFactory) -> vnav.Map:
    return vnav.build_map(captures, tmp_path_factory.mktemp("together") / "map", config=CONFIG)


def poses_of(folder: MapFolder, number: int) -> np.ndarray:
    """Of the frames of a capture."""
    frames = load_odometry(folder).frames
    return load_optimised(folder).T_world_camera[frames.capture == number]


def test_frames_of_captures_that_loops_join_are_where_they_were_taken(
    made: vnav.Map, captures: list[Path]
) -> None:
    folder = MapFolder(made.root)
    truth = [read_tum(c / "groundtruth.txt").T_world_camera for c in captures[1:]]
    found = np.concatenate([poses_of(folder, k) for k in (1, 2)])
    assert np.isfinite(found).all()
    true_m, found_m = (poses[:, :3, 3] for poses in (np.concatenate(truth), found))
    off_m = np.linalg.norm(se3.transform(se3.align(true_m, found_m), found_m) - true_m, axis=1)
    assert np.sqrt((off_m**2).mean()) < 0.003  # as of the map that is extended by the other


def test_a_capture_that_nothing_joins_is_named_and_kept_as_a_part(made: vnav.Map) -> None:
    folder = MapFolder(made.root)
    assert np.isnan(poses_of(folder, 0)).all()
    report = folder.report("map")
    assert [(c["name"], c["frames"], c["posed"]) for c in report["values"]["captures"]] == [
        ("elsewhere", OTHERS, 0),
        ("miniature", FRAMES, FRAMES),
        ("other", OTHERS, OTHERS),
    ]
    assert report["values"]["captures"][0]["closures"] == 0
    assert report["values"]["captures"][1]["closures"] >= 3
    (warning,) = report["warnings"]
    assert warning.startswith("elsewhere is kept as a part of its own")
    assert (folder.root / "optimise" / "part_2" / "trajectory_0.tum").is_file()


def test_nothing_is_left_of_the_folders_that_captures_were_tracked_in(made: vnav.Map) -> None:
    assert not (made.root / PARTS).exists()
    assert not list(made.root.glob(".*"))


def test_a_run_that_finds_odometry_finished_removes_what_an_interruption_left(
    made: vnav.Map, captures: list[Path]
) -> None:
    (made.root / PARTS / "000").mkdir(parents=True)
    vnav.build_map(captures, made.root, config=CONFIG)
    assert not (made.root / PARTS).exists()


def test_one_capture_in_a_folder_of_several_that_were_interrupted_leaves_nothing_of_them(
    captures: list[Path], tmp_path: Path
) -> None:
    (tmp_path / "map" / PARTS / "000").mkdir(parents=True)
    few = Subset(opened(captures[-1]), range(12))
    vnav.build_map(few, tmp_path / "map", config=CONFIG)
    assert not (tmp_path / "map" / PARTS).exists()


def test_it_is_up_to_date_until_the_captures_are_others(
    made: vnav.Map, captures: list[Path], tmp_path: Path
) -> None:
    shutil.copytree(made.root, tmp_path / "map")
    again = vnav.build_map(captures, tmp_path / "map", config=CONFIG)
    assert again.built is not None
    assert all(report.reused for report in again.built.reports)
    with pytest.raises(MapError, match="of which the map .* was made, found miniature, other"):
        vnav.build_map(captures[1:], tmp_path / "map", config=CONFIG)


def hashes(root: Path) -> dict[str, str]:
    """Of the stages' files."""
    files = (path for stage in STAGES for path in sorted((root / stage).rglob("*")))
    return {
        path.relative_to(root).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in files
        if path.is_file()
    }


def test_a_cluster_and_processes_track_to_the_same_bytes(
    other_capture: Path, tmp_path: Path, cluster: Any
) -> None:
    ways = {
        "here": {},
        "processes": {"jobs": 2},
        "cluster": {"scheduler": cluster.scheduler_address},
    }
    made = []
    for name, way in ways.items():
        task = TrackTask(opened(other_capture), tmp_path / name, CONFIG)
        ((_, report),) = batch.run(track_alone, [task], **way)
        assert isinstance(report, Report)
        made.append(hashes(tmp_path / name))
    assert made[0]
    assert made == [made[0]] * 3


def test_what_was_tracked_before_a_capture_failed_is_kept(
    other_capture: Path, elsewhere: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    tracked: list[str] = []
    breaks = {"elsewhere"}

    def noted(task: TrackTask, progress: Progress = silent) -> Report:
        if task.name in breaks:
            raise CaptureError("expected light, found none")
        report = track_alone(task, progress)
        tracked.append(f"{task.name} {report.reused}")
        return report

    def track_all(tasks: Sequence[TrackTask]) -> Iterator[tuple[int, Report | Failed]]:
        for k, task in enumerate(tasks):
            try:
                yield k, noted(task)
            except CaptureError as error:
                yield k, Failed(str(error))

    both = [opened(elsewhere), opened(other_capture)]
    with pytest.raises(CaptureError, match="elsewhere: expected light, found none"):
        build(both, tmp_path / "map", CONFIG, track_all)
    breaks.clear()
    monkeypatch.setattr("vnav.pipeline.build.run_stages", stopped)
    with pytest.raises(KeyboardInterrupt):
        build(both, tmp_path / "map", CONFIG, track_all)
    assert tracked == ["other False", "elsewhere False", "other True"]
    assert MapFolder.open(tmp_path / "map").has("odometry")


def stopped(*_arguments: object) -> list[Report]:
    raise KeyboardInterrupt


def test_the_same_capture_twice_is_refused(other_capture: Path, tmp_path: Path) -> None:
    with pytest.raises(CaptureError, match=r"of different frames.*name each once"):
        vnav.build_map([other_capture, other_capture], tmp_path / "map", config=CONFIG)


def test_no_capture_and_poses_for_several_are_refused(other_capture: Path, tmp_path: Path) -> None:
    with pytest.raises(CaptureError, match="expected a capture to make a map of, found none"):
        vnav.build_map([], tmp_path / "map")
    poses = other_capture / "groundtruth.txt"
    with pytest.raises(CaptureError, match="expected one capture with a trajectory, found 2"):
        vnav.build_map([other_capture] * 2, tmp_path / "map", trajectory=poses)


def test_a_capture_that_bridges_two_joins_both(tiny_capture: Path, tmp_path: Path) -> None:
    whole = opened(tiny_capture)
    ends = [Renamed(whole, range(16), "left"), Renamed(whole, range(30, 46), "right")]
    folder = MapFolder(tmp_path / "map")
    built = build(ends, folder.root, CONFIG, in_turn(silent))
    assert any("is kept as a part of its own" in w for w in built.reports[-2].warnings)
    extend(folder, Renamed(whole, range(8, 40), "bridge"), made_with(folder))
    assert np.isfinite(load_optimised(folder).T_world_camera).all()


def test_the_light_of_each_capture_is_told_of(
    tiny_map: Path, tiny_capture: Path, tmp_path: Path
) -> None:
    before, capture = load_odometry(MapFolder(tiny_map)), opened(tiny_capture)
    lights = np.array([[1, 0, 0], [0.3, 0.01, 2.5]], np.float32)

    def track_all(tasks: Sequence[TrackTask]) -> Iterator[tuple[int, Report]]:
        for k, task in enumerate(tasks):
            folder = MapFolder.create(task.place)
            with folder.writing("odometry", {}, {}) as draft:
                save_odometry(draft, dataclasses.replace(before, light=lights[k : k + 1]))
                copy_keyframes(MapFolder(tiny_map), draft)
            folder.set_captures([described(0, task.capture)])
            yield k, Report("odometry", {})

    folder = MapFolder.create(tmp_path / "map")
    entries = [described(k, capture) for k in range(2)]
    report = track_together(folder, [capture] * 2, entries, CONFIG, track_all)
    told = {"capture": 1, "corners": 0.3, "sigma": 0.01, "bands": 2.5}
    assert report.values["light"] == [told]
    assert "capture 1: brightness falls to 30% at the corners: taken off" in report.lines
    assert "capture 1: lamps flicker, 2.5 bands of light to an image: taken off" in report.lines
    np.testing.assert_array_equal(load_odometry(folder).light, lights)
    assert overview(folder)["light"] == report.values["light"]

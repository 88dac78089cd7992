"""The tiny capture followed by the filter, with depth and without."""

import shutil
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from vnav.api.building import build_map, extend_map, run_stage, track_capture
from vnav.api.judging import score
from vnav.cli.check import check
from vnav.config import load
from vnav.errors import CaptureError, ConfigError, MapError
from vnav.io.formats.ply import read_cloud
from vnav.io.formats.trajectories import read_tum
from vnav.io.store.overview import overview

pytestmark = pytest.mark.slow

QUICK = ("features.max_features=300",)


@pytest.fixture(scope="module")
def colors(tiny_capture: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The tiny capture without depth, and a camera that says nothing of depth."""
    folder = tmp_path_factory.mktemp("captures") / "colors"
    folder.mkdir()
    shutil.copytree(tiny_capture / "rgb", folder / "rgb")
    for name in ("rgb.txt", "groundtruth.txt"):
        shutil.copy(tiny_capture / name, folder / name)
    camera = (tiny_capture / "camera.toml").read_text("utf-8").partition("[depth]")[0]
    (folder / "camera.toml").write_text(camera, "utf-8")
    return folder


@pytest.fixture(scope="module")
def mono(colors: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Its map, which is odometry alone."""
    root = tmp_path_factory.mktemp("maps") / "mono"
    track_capture(colors, root, config=load("mono", QUICK))
    return root


def test_a_capture_of_colour_gives_a_trajectory_up_to_scale(mono: Path, colors: Path) -> None:
    file = mono / "odometry" / "trajectory.tum"
    assert len(read_tum(file)) >= 0.9 * 60
    found = score(file, colors / "groundtruth.txt", align="sim3")
    # 5 frames a second of 320 x 240: the way is 3.6 m, a tenth of it tells it from any other
    assert found.ate.translation_m.rmse < 0.1 * found.paths_m[0]


def test_it_gives_sparse_landmarks(mono: Path) -> None:
    points = read_cloud(mono / "odometry" / "landmarks.ply").points_world
    assert len(points) > 30
    assert np.isfinite(points).all()


def test_what_was_tracked_is_told(mono: Path) -> None:
    from vnav.io.store.map_folder import MapFolder

    assert overview(MapFolder.open(mono))["frames"] == 60


@pytest.mark.parametrize("stage", ["vocabulary", "loops", "optimise", "fuse", "index"])
def test_later_stages_refuse_a_map_without_scale(mono: Path, stage: str) -> None:
    before = sorted(mono.rglob("*"))
    with pytest.raises(MapError, match=r"without scale|expected"):
        run_stage(stage, mono)
    assert sorted(mono.rglob("*")) == before


def test_a_map_is_refused_before_work_begins(
    tiny_capture: Path, tiny_map: Path, colors: Path, tmp_path: Path
) -> None:
    with pytest.raises(ConfigError, match=r"tracking\.ekf\.depth = false.*needs depth"):
        build_map(tiny_capture, tmp_path / "map", config=load("mono"))
    with pytest.raises(CaptureError, match="colour only.*--config mono"):
        build_map(colors, tmp_path / "map", config=load("ekf"))
    with pytest.raises(CaptureError, match="colour only"):
        track_capture(colors, tmp_path / "map", config=load("ekf"))
    assert not (tmp_path / "map" / "odometry").exists()
    with pytest.raises(ConfigError, match="needs depth"):
        extend_map(tiny_map, tiny_capture, config=load("mono"))


def test_check_says_what_works_without_depth(colors: Path) -> None:
    told = CliRunner().invoke(check, [str(colors)], catch_exceptions=False, standalone_mode=False)
    assert told.return_value == 1
    assert "depth none" in told.output
    assert "only 'vnav odometry CAPTURE --config mono' works" in told.output


def test_with_depth_the_way_is_in_metres(tiny_capture: Path, tmp_path: Path) -> None:
    report = track_capture(tiny_capture, tmp_path / "map", config=load("ekf", QUICK))
    assert report.values["tracked"] >= 0.9 * 60
    file = tmp_path / "map" / "odometry" / "trajectory.tum"
    found = score(file, tiny_capture / "groundtruth.txt")
    assert found.ate.translation_m.rmse < 0.03 * found.paths_m[0]
    assert found.scale == pytest.approx(1, abs=0.05)

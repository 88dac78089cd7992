"""Recorders that make drawn recordings anew, with faults of their own."""

from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import cv2
import numpy as np
import pytest

import vnav
from vnav.core import se3
from vnav.core.arrays import Array
from vnav.io.formats.trajectories import read_tum

ROW, SEED = 2, 5


@pytest.fixture(scope="module")
def spoilt_walks(script: Callable[[str], ModuleType]) -> ModuleType:
    return script("spoilt_walks")


@pytest.fixture
def recorder(spoilt_walks: ModuleType, tiny_capture: Path) -> Callable[..., Any]:
    def with_faults(*faults: str, seed: int = SEED) -> Any:
        made = spoilt_walks.Recorder(spoilt_walks.Source.open(tiny_capture), seed)
        vars(made)["faults"] = faults  # as if the seed had drawn these
        return made

    return with_faults


def images_of(made: Any) -> tuple[Array, Array]:
    """Of one frame, as that recorder makes them: colour, and depth in metres."""
    pair = made.source.frames[ROW]
    color, depth = (cv2.imread(str(f.path), cv2.IMREAD_UNCHANGED) for f in (pair.color, pair.depth))
    units = made.source.camera.units_per_metre
    return made.color(ROW, color).astype(float), made.depth(ROW, depth) / units


def test_a_seed_draws_one_recorder_and_every_fault_is_drawn(
    spoilt_walks: ModuleType, tiny_capture: Path
) -> None:
    source = spoilt_walks.Source.open(tiny_capture)
    drawn = [spoilt_walks.Recorder(source, seed).faults for seed in range(30)]
    assert drawn == [spoilt_walks.Recorder(source, seed).faults for seed in range(30)]
    assert {fault for faults in drawn for fault in faults} == set(spoilt_walks.FAULTS)
    assert all(drawn)


def test_a_recorder_without_faults_changes_nothing(recorder: Callable[..., Any]) -> None:
    made = recorder()
    color, depth_m = images_of(made)
    pair = made.source.frames[ROW]
    np.testing.assert_array_equal(color, cv2.imread(str(pair.color.path)))
    units = made.source.camera.units_per_metre
    rendered = cv2.imread(str(pair.depth.path), cv2.IMREAD_UNCHANGED) / units
    np.testing.assert_allclose(depth_m, rendered, atol=1.01 / units)
    assert made.rows == list(range(len(made.source.frames)))


@pytest.mark.parametrize("faults", [("hand",), ("lens",), ("hand", "lens")])
def test_what_a_turned_or_bent_image_shows_stays_where_it_is(
    recorder: Callable[..., Any], faults: tuple[str, ...]
) -> None:
    """Its points, turned back, project to the rendered depth; but at edges, half a pixel off."""
    made = recorder(*faults)
    _, depth_m = images_of(made)
    points = (made.rays * depth_m[..., None])[depth_m > 0] @ made.turns[ROW].T
    rendered = recorder()
    _, rendered_m = images_of(rendered)
    camera = rendered.source.camera.color
    u = np.rint(camera.fx * points[:, 0] / points[:, 2] + camera.cx).astype(int)
    v = np.rint(camera.fy * points[:, 1] / points[:, 2] + camera.cy).astype(int)
    off_m = np.abs(rendered_m[v, u] - points[:, 2])
    assert len(points) > 0.5 * depth_m.size
    assert np.percentile(off_m, 90) < 0.01


@pytest.mark.parametrize("fault", ["corners", "balance", "bands"])
def test_light_changes_the_brightness_alone(recorder: Callable[..., Any], fault: str) -> None:
    (color, depth_m), (before, before_m) = images_of(recorder(fault)), images_of(recorder())
    assert 1 < np.abs(color - before).mean() < 60
    np.testing.assert_array_equal(depth_m, before_m)


@pytest.mark.parametrize("fault", ["steps", "flying"])
def test_a_sensor_changes_some_depth_alone(recorder: Callable[..., Any], fault: str) -> None:
    (color, depth_m), (before, before_m) = images_of(recorder(fault)), images_of(recorder())
    np.testing.assert_array_equal(color, before)
    np.testing.assert_array_equal(depth_m > 0, before_m > 0)
    assert (depth_m != before_m).any()
    assert np.median(np.abs(depth_m - before_m)) < 0.02


def test_a_spoilt_capture_has_the_poses_and_the_camera_of_its_recorder(
    spoilt_walks: ModuleType, tiny_capture: Path, tmp_path: Path
) -> None:
    made = spoilt_walks.spoilt(tiny_capture, SEED, tmp_path / "spoilt")
    capture = vnav.open_capture(tmp_path / "spoilt")
    assert len(capture) == len(made.rows)
    assert capture.camera.color.distortion == pytest.approx(made.camera.distortion)
    true, turned = (
        read_tum(folder / "groundtruth.txt") for folder in (tiny_capture, tmp_path / "spoilt")
    )
    T = se3.inverse(true.T_world_camera) @ turned.T_world_camera
    frame = np.abs(true.stamps_s[:, None] - made.source.stamps_s).argmin(1)
    np.testing.assert_allclose(T[:, :3, :3], made.turns[frame], atol=1e-6)
    np.testing.assert_allclose(T[:, :3, 3], 0, atol=1e-6)

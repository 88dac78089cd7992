"""Recorders that make drawn recordings anew, with faults of their own."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any

import cv2
import numpy as np
import pytest

import vnav
from vnav.core.arrays import Array
from vnav.synthetic import MINIATURE

ROW, SEED = 2, 5


@pytest.fixture(scope="module")
def spoilt_walks(script: Callable[[str], ModuleType]) -> ModuleType:
    return script("spoilt_walks")


@pytest.fixture
def recorder(spoilt_walks: ModuleType, tiny_capture: Path) -> Callable[..., Any]:
    def with_faults(*faults: str, seed: int = SEED) -> Any:
        return spoilt_walks.Recorder(spoilt_walks.Source.open(tiny_capture), seed, faults)

    return with_faults


def images_of(made: Any) -> tuple[Array, Array]:
    """Of one frame, as that recorder makes them: colour, and depth in metres."""
    pair = made.source.frames[ROW]
    color, depth = (cv2.imread(str(f.path), cv2.IMREAD_UNCHANGED) for f in (pair.color, pair.depth))
    units = made.source.camera.units_per_metre
    return made.color(ROW, color).astype(float), made.depth(ROW, depth) / units


def test_a_seed_draws_one_recorder_and_every_fault_is_drawn(spoilt_walks: ModuleType) -> None:
    drawn = [spoilt_walks.faults_of(seed) for seed in range(30)]
    assert drawn == [spoilt_walks.faults_of(seed) for seed in range(30)]
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


def test_what_a_bent_image_shows_stays_where_it_is(recorder: Callable[..., Any]) -> None:
    """Its points project to the rendered depth; but at edges, half a pixel off."""
    made = recorder("lens")
    _, depth_m = images_of(made)
    points = (made.rays * depth_m[..., None])[depth_m > 0]
    rendered = recorder()
    _, rendered_m = images_of(rendered)
    u, v = np.rint(rendered.source.camera.color.project(points)).astype(int).T
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


def test_a_spoilt_capture_has_the_camera_and_the_frames_of_its_recorder(
    recorder: Callable[..., Any], spoilt_walks: ModuleType, tmp_path: Path
) -> None:
    made = recorder("lens", "lost")
    capture = vnav.open_capture(spoilt_walks.spoilt(made, tmp_path / "spoilt"))
    assert len(capture) == len(made.rows) < len(made.source.frames)
    assert capture.camera.color.distortion == pytest.approx(made.camera.distortion)


def test_a_hand_is_drawn_by_the_seed_of_the_recording(spoilt_walks: ModuleType) -> None:
    held = [spoilt_walks.trembling(replace(MINIATURE, seed=seed)) for seed in range(10)]
    assert held == [spoilt_walks.trembling(replace(MINIATURE, seed=seed)) for seed in range(10)]
    assert len({spec.tremor_deg for spec in held}) == len(held)
    assert min(spec.tremor_deg for spec in held) > 0

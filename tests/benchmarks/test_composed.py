"""Walkers composed into a recording, here a rendered one."""

from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import cv2
import numpy as np
import pytest

import vnav
from vnav.core.arrays import Array
from vnav.io.formats.trajectories import read_tum
from vnav.synthetic.figure import dressed
from vnav.synthetic.masks import MASKS
from vnav.synthetic.people import Walker
from vnav.synthetic.strolls import Stroll

AHEAD_M = 1.2


@pytest.fixture(scope="module")
def composed(script: Callable[[str], ModuleType]) -> ModuleType:
    return script("composed")


def standing_before(pose: Array) -> Walker:
    """Somebody who stands before a camera at a pose."""
    ahead = pose[:2, 2] / np.linalg.norm(pose[:2, 2])
    knot = [*(pose[:2, 3] + AHEAD_M * ahead), 0.0, 0.0]
    return Walker(dressed(np.random.default_rng(0), (0,)), Stroll(np.array([knot] * 20)))


def test_walkers_are_drawn_before_the_room_and_nothing_else_changes(
    composed: ModuleType, tiny_capture: Path
) -> None:
    recording = composed.Recording.of(tiny_capture)
    before = recording.capture.read(5)
    walker = standing_before(recording.pose(before.stamp_s))
    frame, owner = composed.Composer(recording, [walker], 0).frame(5)
    on = owner == 1
    assert 0.05 < on.mean() < 0.6
    inner = cv2.erode(on.astype(np.uint8), np.ones((3, 3))) > 0
    measured = inner & (frame.depth_m > 0)
    assert measured.sum() > inner.sum() / 2
    assert abs(np.median(frame.depth_m[measured]) - AHEAD_M) < 0.3  # a body is half a metre deep
    off = cv2.dilate(on.astype(np.uint8), np.ones((7, 7))) == 0
    assert np.array_equal(frame.color[off], before.color[off])
    kept = off & (frame.depth_m > 0)
    assert np.array_equal(frame.depth_m[kept], before.depth_m[kept])


def test_who_stands_behind_what_was_measured_is_not_seen(
    composed: ModuleType, tiny_capture: Path
) -> None:
    recording = composed.Recording.of(tiny_capture)
    pose = recording.pose(recording.capture.read(5).stamp_s)
    pose[:3, 3] += 20 * pose[:3, 2]
    _, owner = composed.Composer(recording, [standing_before(pose)], 0).frame(5)
    assert not owner.any()


def test_the_room_is_as_far_as_measured_and_as_the_nearest_pixel_elsewhere(
    composed: ModuleType, tiny_capture: Path
) -> None:
    frame = composed.Recording.of(tiny_capture).capture.read(5)
    known, room_m = frame.depth_m > 0, composed.room_of(frame)
    assert np.array_equal(room_m[known], frame.depth_m[known])
    assert (room_m > 0).all()


def test_a_recording_is_written_with_its_truth_and_masks(
    composed: ModuleType, tiny_capture: Path, tmp_path: Path
) -> None:
    recording = composed.Recording.of(tiny_capture)
    walker = standing_before(recording.pose(recording.capture.stamps_s[5]))
    composed.write(tmp_path / "made", recording, [walker], 0)
    made = vnav.open_capture(tmp_path / "made")
    assert len(made) == len(recording.capture)
    np.testing.assert_allclose(made.stamps_s, recording.capture.stamps_s, atol=1e-6)
    poses = read_tum(tmp_path / "made" / "groundtruth.txt").T_world_camera
    np.testing.assert_allclose(poses, recording.truth.T_world_camera, atol=1e-8)
    mask = cv2.imread(str(tmp_path / "made/truth" / MASKS / "000005.png"), cv2.IMREAD_UNCHANGED)
    assert mask.any()


def test_a_shadow_is_as_wide_as_the_disparity_of_what_throws_it(composed: ModuleType) -> None:
    depth_m = np.full((40, 200), 3.0, np.float32)
    depth_m[:, 80:120] = 1.0
    shadow = composed.in_shadow(depth_m)
    wide = composed.SENSOR.focal_baseline_px_m * (1 - 1 / 3)
    assert not shadow[:, 80:120].any()
    assert shadow.sum(1) == pytest.approx(wide, abs=3)  # a pixel of rounding, one of either side

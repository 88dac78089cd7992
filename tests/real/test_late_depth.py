"""A desk in which nothing moves, at the poses of motion capture: its depth is 22 ms early."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

pytestmark = pytest.mark.real

MEAN_SHARE, MOST_SHARE = 0.01, 0.10  # of the pixels, that may be masked


def test_what_stands_still_is_not_masked_at_poses_of_motion_capture(
    captures: Path,
    vnav: Callable[..., Any],
    figures: Callable[[str, str, str], None],
    tmp_path: Path,
) -> None:
    desk = captures / "fr1_desk"
    truth = desk / "groundtruth.txt"
    vnav("odometry", desk, "--map", tmp_path, "--trajectory", truth)
    report = (tmp_path / "reports" / "odometry.json").read_text("utf-8")
    moving = json.loads(report)["values"]["moving"]
    figures("desk, true poses: masked", f"{moving['mean']:.2%}", f"{MEAN_SHARE:.0%}")
    figures("desk, true poses: masked, most", f"{moving['most']:.1%}", f"{MOST_SHARE:.0%}")
    assert moving["mean"] <= MEAN_SHARE
    assert moving["most"] <= MOST_SHARE
    assert moving["frames_without_mask"] == []

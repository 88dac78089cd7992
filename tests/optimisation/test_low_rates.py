"""A hand-held camera that saves few frames a second: its shutter rolls, and its depth is late."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

import vnav
from vnav.synthetic import HANDHELD, write_capture

pytestmark = pytest.mark.slow


def test_what_a_camera_of_five_frames_a_second_sees_late_is_found(tmp_path: Path) -> None:
    """Over two steps of 0.2 s, a pan of 2 s is 6.5 % slower than at its moment."""
    camera = HANDHELD.camera.scaled(320, 240)
    spec = replace(HANDHELD, camera=camera, frames=40, rate_hz=5.0, photos=0)
    write_capture(tmp_path / "capture", spec)

    vnav.build_map(tmp_path / "capture", tmp_path / "map")

    told = json.loads((tmp_path / "map" / "reports" / "optimise.json").read_text())
    (sensor,) = told["values"]["sensors"]
    assert sensor["depth_delay_s"] == pytest.approx(HANDHELD.sensor.depth_delay_s, rel=0.1)
    assert sensor["line_delay_s"] == pytest.approx(HANDHELD.sensor.line_delay_s, rel=0.1)

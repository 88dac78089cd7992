import os
import shutil
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from vnav.config import CaptureConfig
from vnav.core import se3
from vnav.io.formats.camera_file import read_camera
from vnav.io.sources.open_capture import open_capture


@pytest.fixture(scope="module")
def speed(script: Callable[[str], ModuleType]) -> ModuleType:
    return script("speed")


def test_the_first_half_of_a_capture_is_a_capture(
    speed: ModuleType, tiny_capture: Path, tmp_path: Path
) -> None:
    whole = open_capture(tiny_capture, CaptureConfig())
    half = open_capture(speed.first_half(tiny_capture, tmp_path / "half"), CaptureConfig())
    assert len(half) == len(whole) // 2
    np.testing.assert_array_equal(half.read(7).depth_m, whole.read(7).depth_m)


def test_what_is_asked_for_is_measured(speed: ModuleType) -> None:
    assert speed.captures(["a", "b"]) == [Path("a"), Path("b")]


def test_a_call_on_all_cores_is_timed_without_its_first_calls(speed: ModuleType) -> None:
    seen: list[int] = []

    def sleep(image: np.ndarray) -> None:
        time.sleep(0.02)
        seen.append(len(image))

    wall_ms, cpu_ms = speed.ms_a_frame(sleep, [np.zeros(3)] * 20)
    assert len(seen) == 28
    assert wall_ms * (os.cpu_count() or 1) > 19 > cpu_ms


def test_times_of_stages_are_added_up(speed: ModuleType) -> None:
    reports = {"a": {"seconds": 1.0, "cpu_seconds": 2.0}, "b": {"seconds": 3.0, "cpu_seconds": 4.0}}
    assert speed.stage_ms(reports, ["a", "b"], 100).tolist() == [40.0, 60.0]


def test_ratios_are_medians_of_those_of_each_run(speed: ModuleType) -> None:
    runs = [{speed.SIFT: np.array([2.0, 4.0]), "all": np.array([a, 8.0])} for a in (2.0, 20.0, 6.0)]
    found = {(m.what, m.quantity): m for m in speed.compared("house", runs)}
    assert found["all", "wall time, ratio"].value == 3.0
    assert found["all", "wall time, ratio"].wanted == "at most 1.6"
    assert found["all", "CPU time, ratio"].value == 2.0


def test_the_preset_is_held_against_the_peer_where_there_is_one(speed: ModuleType) -> None:
    what = f"{speed.FAST}, all"
    run = {speed.SIFT: np.ones(2), speed.PEER: np.array([4.0, 5.0]), what: np.array([6.0, 5.0])}
    (wall,) = [
        m
        for m in speed.compared("fr1_desk", [run])
        if m.peer == speed.PEER and "wall" in m.quantity
    ]
    assert (wall.value, wall.wanted) == (1.5, "at most 1.8")


def test_the_peer_is_run_at_the_captures_rate_and_tells_its_times(
    speed: ModuleType, tiny_capture: Path, tmp_path: Path
) -> None:
    python = tmp_path / "python"
    python.write_text(
        '#!/bin/sh\necho "$@" > ' + f"{tmp_path}/asked\n"
        'echo "tiny: tracked 60/60, ATE 0.1 m over 60 poses, 12.5 ms/frame wall, 20.0 CPU"\n'
    )
    python.chmod(0o755)
    times = speed.orb_slam3_ms([str(python), "words.txt"], tiny_capture, tmp_path)
    assert times.tolist() == [12.5, 20.0]
    stamps = open_capture(tiny_capture, CaptureConfig()).stamps_s
    assert f"--fps {round(1 / float(stamps[1] - stamps[0]))}" in (tmp_path / "asked").read_text()


def test_a_peer_reads_depth_where_colour_is(
    speed: ModuleType, tiny_capture: Path, tmp_path: Path
) -> None:
    apart = tmp_path / "apart"
    shutil.copytree(tiny_capture, apart)
    camera = read_camera(apart / "camera.toml")
    beside = se3.make(np.eye(3), np.array([0.02, 0.0, 0.0])).tolist()
    camera = replace(camera, depth=camera.color, T_color_depth=beside)
    speed.write_camera(apart / "camera.toml", camera)
    together = open_capture(speed.registered(apart, tmp_path / "together"), CaptureConfig())
    source = open_capture(apart, CaptureConfig())
    assert together.camera.is_registered
    step_m = 0.5 / together.camera.units_per_metre
    read, true = together.read(5).depth_m, source.read(5).depth_m
    both = (read > 0) & (true > 0)
    assert ((read > 0) != (true > 0)).mean() < 0.005  # specks that registration makes
    np.testing.assert_allclose(read[both], true[both], atol=1.01 * step_m)
    np.testing.assert_array_equal(together.read(5).color, source.read(5).color)

"""vnav import, on a bag of a rendered capture."""

from collections.abc import Callable
from pathlib import Path

import pytest

from tests.io.recordings.bags import COLOR, COLOR_INFO, DEPTH, WRITERS, recorded

FRAMES = 3

Vnav = Callable[..., tuple[int, str, str]]


@pytest.fixture
def bag(tiny_capture: Path, tmp_path: Path) -> Path:
    return WRITERS["ros1"](tmp_path / "kitchen", recorded(tiny_capture, FRAMES))


def test_what_was_found_and_where_it_is_are_printed(vnav: Vnav, bag: Path, tmp_path: Path) -> None:
    code, out, err = vnav("import", bag, tmp_path / "kitchen")
    assert code == 0
    assert out.splitlines() == [
        f"colour   {FRAMES} of {COLOR}/compressed, 320 x 240",
        f"depth    {FRAMES} of {DEPTH}, 320 x 240, registered",
        f"camera   {COLOR_INFO}",
        f"capture  {tmp_path / 'kitchen'}",
    ]
    assert f"import kitchen.bag: {2 * FRAMES}/{2 * FRAMES}" in err


def test_a_second_time_the_folder_is_refused_in_one_line(
    vnav: Vnav, bag: Path, tmp_path: Path
) -> None:
    vnav("import", bag, tmp_path / "kitchen")
    code, out, err = vnav("import", bag, tmp_path / "kitchen")
    assert (code, out, len(err.splitlines())) == (1, "", 1)
    assert "found that it is there already; remove it or name another" in err


def test_a_damaged_bag_is_one_line(vnav: Vnav, bag: Path, tmp_path: Path) -> None:
    bag.write_bytes(bag.read_bytes()[:-100])
    code, out, err = vnav("import", bag, tmp_path / "kitchen")
    assert (code, out, len(err.splitlines())) == (1, "", 1)
    assert err.startswith(f"vnav: expected a whole recording in {bag}, found: ")


@pytest.mark.parametrize("command", [("build-map",), ("check",), ("odometry",)])
def test_a_bag_in_the_place_of_a_capture_is_told_the_command(
    command: tuple[str, ...], vnav: Vnav, bag: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    code, out, err = vnav(*command, bag)
    assert (code, out, len(err.splitlines())) == (1, "", 1)
    assert f"'vnav import {bag} FOLDER'" in err


def test_a_folder_of_ros_2_in_the_place_of_a_capture_is_told_the_command(
    vnav: Vnav, tiny_capture: Path, tmp_path: Path
) -> None:
    bag = WRITERS["sqlite"](tmp_path / "bag", recorded(tiny_capture, 1))
    assert f"'vnav import {bag} FOLDER'" in vnav("check", bag)[2]

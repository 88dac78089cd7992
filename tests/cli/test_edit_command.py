"""vnav edit as a user calls it."""

import shutil
from pathlib import Path

import click
import numpy as np
import pytest
from click.testing import CliRunner, Result

from vnav.cli.main import cli
from vnav.core.grid import FREE, OCCUPIED
from vnav.io.formats.grid_files import read_grid


@pytest.fixture
def edited(fused_map: Path, tmp_path: Path) -> Path:
    return shutil.copytree(fused_map, tmp_path / "map")


def run(*arguments: object) -> Result:
    return CliRunner().invoke(
        cli, [str(a) for a in arguments], standalone_mode=False, catch_exceptions=False
    )


def test_places_are_named_listed_and_removed(edited: Path) -> None:
    told = [
        run("edit", edited, "add-goal", "desk", "-1.5,2").stdout,
        run("edit", edited, "keep-out", "stairs", "-1,1", "2,1", "2,3").stdout,
        run("edit", edited, "one-way", "aisle", "-1,1", "2,1", "2,3", "--heading", "-90").stdout,
    ]
    assert told[0].split() == ["desk", "goal", "(-1.50,", "2.00)"]
    assert run("edit", edited, "list").stdout == "".join(told)
    assert told[2].endswith("leads -90 deg\n")
    run("edit", edited, "remove", "desk")
    run("edit", edited, "remove", "aisle")
    assert run("edit", edited, "list").stdout == told[1]


@pytest.mark.parametrize("command", ["add-goal", "keep-out", "one-way", "list", "remove"])
def test_help_needs_no_map_and_shows_an_example(command: str) -> None:
    told = run("edit", "no-map", command, "--help").stdout
    assert f"  vnav edit my-map {command}" in told


def test_a_corner_that_is_no_point_is_a_usage_error(edited: Path) -> None:
    with pytest.raises(click.UsageError, match="found '2;1'"):
        run("edit", edited, "keep-out", "stairs", "1,1", "2;1", "2,3")
    assert not (edited / "places.toml").exists()


@pytest.mark.parametrize(
    ("heading", "said"),
    [((), "heading"), (("--heading", "north"), "north"), (("--heading", "400"), "400")],
)
def test_a_one_way_has_a_heading(edited: Path, heading: tuple[str, ...], said: str) -> None:
    with pytest.raises(click.UsageError, match=said):
        run("edit", edited, "one-way", "aisle", "1,1", "2,1", "2,3", *heading)


def test_the_keepout_mask_is_occupied_where_the_keep_outs_are(edited: Path, tmp_path: Path) -> None:
    run("edit", edited, "keep-out", "rug", "0.5,0.5", "1.5,0.5", "1.5,1.5", "0.5,1.5")
    run("export", edited, "--keepout", "pgm", "--out", tmp_path / "out")
    mask, grid = read_grid(tmp_path / "out" / "keepout.yaml"), read_grid(edited / "fuse/grid.yaml")
    assert (mask.origin, mask.resolution_m) == (grid.origin, grid.resolution_m)
    assert mask.cells.shape == grid.cells.shape
    assert set(np.unique(mask.cells)) == {FREE, OCCUPIED}
    # every cell that it touches, so up to a cell more on each side
    assert 1.0 <= mask.area_m2(OCCUPIED) <= (1 + 2 * mask.resolution_m) ** 2
    row, column = mask.cells_at([1.0, 1.0])
    assert mask.cells[row, column] == OCCUPIED

"""The house recorded in three pieces, and a kitchen that is none of it: one map."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

pytestmark = [pytest.mark.real, pytest.mark.long]  # one build

PIECES = (0, 184), (184, 368), (368, None)  # of 551 frames: no frame is in two
KITCHEN = 0, 150


@pytest.fixture(scope="module")
def building(
    part_of: Callable[..., Path], vnav: Callable[..., Any], tmp_path_factory: pytest.TempPathFactory
) -> Path:
    """The map of all four."""
    pieces = [part_of("house", *frames) for frames in PIECES]
    map_dir = tmp_path_factory.mktemp("maps") / "building"
    vnav("build-map", part_of("redkitchen01", *KITCHEN), *pieces, "--map", map_dir)
    return map_dir


def test_pieces_of_the_house_are_one_map_as_true_as_that_of_the_whole(
    building: Path,
    captures: Path,
    vnav: Callable[..., Any],
    figures: Callable[[str, str, str], None],
    tmp_path: Path,
) -> None:
    found = [building / "optimise" / f"trajectory_{k}.tum" for k in (1, 2, 3)]
    (tmp_path / "whole.tum").write_text("".join(path.read_text() for path in found))
    truth = captures / "house" / "groundtruth.txt"
    score = json.loads(vnav("score", tmp_path / "whole.tum", truth, "--json").stdout)
    figures("house in three pieces: frames with a pose", f"{score['pairs']} of 551", "all")
    figures("house in three pieces: ATE RMSE", f"{score['ate_m']['rmse']:.4f} m", "0.015 m")
    assert score["pairs"] == 551
    assert score["ate_m"]["rmse"] <= 0.015


def test_the_kitchen_is_named_as_what_nothing_joins(building: Path) -> None:
    report = json.loads((building / "reports" / "map.json").read_text())
    kitchen, *pieces = report["values"]["captures"]
    assert (kitchen["posed"], kitchen["closures"]) == (0, 0)
    assert all(piece["closures"] >= 3 for piece in pieces)
    assert [warning.split(" is kept")[0] for warning in report["warnings"]] == [kitchen["name"]]

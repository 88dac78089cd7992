"""The house mapped in two halves, the second joined to the first; the kitchen is not its place."""

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

pytestmark = [pytest.mark.real, pytest.mark.long]  # a build in two parts, a refusal

HALF = 275  # of 551 frames: the halves share views at the seam and where the walk ends, no frame


@pytest.fixture(scope="module")
def first_half(
    part_of: Callable[..., Path], vnav: Callable[..., Any], tmp_path_factory: pytest.TempPathFactory
) -> Path:
    """The map of the first half."""
    map_dir = tmp_path_factory.mktemp("maps") / "half"
    vnav("build-map", part_of("house", 0, HALF), "--map", map_dir)
    return map_dir


def test_another_place_is_refused_and_the_map_stays_as_it_was(
    first_half: Path,
    captures: Path,
    vnav: Callable[..., Any],
    content_of: Callable[[Path], dict[str, str]],
    figures: Callable[[str, str, str], None],
) -> None:
    before = content_of(first_half)
    said = vnav("extend", first_half, captures / "redkitchen01", expected=(1,)).stderr
    located = re.search(r"found (\d+) of (\d+) keyframes in it", said)
    assert located is not None, said
    what = "half of house extended by the kitchen: keyframes located"
    figures(what, f"{located[1]} of {located[2]}", "refused")
    assert content_of(first_half) == before
    assert [path.name for path in first_half.parent.iterdir()] == ["half"]


def test_two_halves_are_one_map_as_true_as_that_of_the_whole(
    first_half: Path,
    captures: Path,
    part_of: Callable[..., Path],
    vnav: Callable[..., Any],
    figures: Callable[[str, str, str], None],
    tmp_path: Path,
) -> None:
    vnav("extend", first_half, part_of("house", HALF, None))
    found = [first_half / "optimise" / f"trajectory_{k}.tum" for k in range(2)]
    (tmp_path / "whole.tum").write_text("".join(path.read_text() for path in found))
    truth = captures / "house" / "groundtruth.txt"
    score = json.loads(vnav("score", tmp_path / "whole.tum", truth, "--json").stdout)
    values = json.loads((first_half / "reports" / "map.json").read_text())["values"]
    figures("house in two halves: frames with a pose", f"{score['pairs']} of 551", "all")
    figures("house in two halves: ATE RMSE", f"{score['ate_m']['rmse']:.4f} m", "0.015 m")
    figures("house in two halves: loops between them", str(values["connection"]["closures"]), "")
    assert score["pairs"] == 551
    assert score["ate_m"]["rmse"] <= 0.015

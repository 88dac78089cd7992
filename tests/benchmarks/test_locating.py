from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from vnav.config import Config
from vnav.io.store.map_folder import MapFolder
from vnav.stages.locate import Locator


@pytest.fixture(scope="module")
def locating(script: Callable[[str], ModuleType]) -> ModuleType:
    return script("locating")


@pytest.fixture(scope="module")
def case(script: Callable[[str], ModuleType], whole_map: Path, tiny_capture: Path):  # type: ignore[no-untyped-def]
    """The small room and its photos."""
    cases = script("photo_cases")
    folder = MapFolder.open(whole_map)
    truth = cases.true_poses(folder, tiny_capture)
    return cases.Case("room", folder, cases.photos_of(tiny_capture), None, truth)


def test_the_parts_of_finding_a_photo_add_up(locating: ModuleType, case) -> None:  # type: ignore[no-untyped-def]
    before = locating.localise.search
    answer, spent, clock = locating.asked(Locator.open(case.folder, Config()), case.photos[0])
    assert locating.localise.search is before
    assert answer.best is not None
    parts = [name for name in spent if name not in (locating.SIFT, locating.ALL)]
    assert {"search", "hypotheses", "verification", "verdict", locating.REST} == set(parts)
    assert min(spent[part].min() for part in parts) > 0
    np.testing.assert_allclose(sum(spent[part] for part in parts), spent[locating.ALL])
    told_s = answer.seconds["features"], answer.seconds["search_and_pose"]
    for part, most_s in zip((locating.SIFT, locating.ALL), told_s, strict=True):
        assert 0 < spent[part][0] <= most_s + 1e-4  # it is told rounded
    matched, prior, _, ours = clock.solved
    assert prior.intrinsics == answer.photo.intrinsics
    assert len(matched.px) >= 5
    assert ours[0] > 0


def test_exhaustive_matching_finds_photos_too(locating: ModuleType, case) -> None:  # type: ignore[no-untyped-def]
    locator, exhaustive = Locator.open(case.folder, Config()), locating.Exhaustive(case.folder)
    poses = [exhaustive.locate(locator.locate(photo), Config()) for photo in case.photos]
    right = [
        locating.is_right(T, case.truth[p.name]) for T, p in zip(poses, case.photos, strict=True)
    ]
    assert sum(right) >= len(right) - 1


def test_a_pose_is_right_within_5_cm_and_5_degrees(locating: ModuleType) -> None:
    off = locating.se3.exp([0.05, 0, 0, 0.03, 0, 0])
    assert locating.is_right(off, np.eye(4))
    assert not locating.is_right(off @ off, np.eye(4))
    assert not locating.is_right(None, np.eye(4))


def test_a_photo_on_stdin_is_held_against_its_sift(locating: ModuleType, case) -> None:  # type: ignore[no-untyped-def]
    wall, ratio = locating.stream(case, len(case.photos))
    assert (wall.quantity, ratio.quantity) == ("wall time", "wall time, ratio")
    assert ratio.value > 0
    assert ratio.wanted == "at most 1.4"


def test_solvers_that_are_not_installed_are_left_out_and_named(  # type: ignore[no-untyped-def]
    locating: ModuleType,
    case,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(locating, "optional", lambda name: None)
    for name in ("cold", "stream", "growth", "busy"):
        monkeypatch.setattr(locating, name, lambda *cases: [])
    monkeypatch.setattr(locating, "cases", lambda out: [case])
    monkeypatch.setattr(locating, "building", lambda out, rooms: case)
    locating.main([])
    said = capsys.readouterr().out
    assert "the first RANSAC, by vnav" in said
    assert "the same by" not in said
    assert "poselib is not installed" in said
    assert "pycolmap is not installed" in said


def test_ratios_are_medians_of_each_photos_own(locating: ModuleType) -> None:
    times = ((1, 2), (2, 2), (4, 1))
    rows = [{locating.SIFT: np.full(2, s), locating.ALL: np.full(2, t)} for s, t in times]
    (ratio,) = [
        m.value
        for m in locating.times_of("room", rows)
        if (m.what, m.quantity) == (locating.ALL, "wall time, ratio")
    ]
    assert ratio == 1.0

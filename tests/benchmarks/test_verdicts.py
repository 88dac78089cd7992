from collections.abc import Callable
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from vnav.core import se3
from vnav.core.mapping import Odometry


@pytest.fixture(scope="module")
def verdicts(script: Callable[[str], ModuleType]) -> ModuleType:
    return script("verdicts")


def test_frames_from_one_on_are_shifted_and_all_edges_agree_on_it(
    verdicts: ModuleType, odometry: Odometry
) -> None:
    changed = verdicts.broken_across(odometry, np.random.default_rng(0))
    off_m = np.linalg.norm((changed.T_segment_camera - odometry.T_segment_camera)[:, :3, 3], axis=1)
    first = int((off_m > 0).argmax())
    assert 0 < first < len(off_m) - 1
    assert (off_m[:first] == 0).all()
    np.testing.assert_allclose(off_m[first:], off_m[first])
    assert 0.05 <= off_m[first] <= 0.30
    for before, after in zip(odometry.edges, changed.edges, strict=True):
        moved = [
            se3.inverse(o.T_segment_camera[e.i]) @ o.T_segment_camera[e.j]
            for o, e in ((odometry, before), (changed, after))
        ]
        error = se3.inverse(moved[0]) @ before.T_i_j
        np.testing.assert_allclose(after.T_i_j, moved[1] @ error, atol=1e-9)


def test_maps_are_counted_by_their_errors_and_verdicts(
    verdicts: ModuleType, missed: Callable[..., Any]
) -> None:
    off = [0.0005, 0.0005, 0.002, 0.002, 0.006, 0.006]
    doubtful = [False, True, False, True, False, True]
    found = verdicts.counted("maps", "all", np.array([off, doubtful]).T, most_alarms=0)
    assert [m.value for m in found] == [6, 2, 1, 2, 1]
    assert [m.quantity for m in missed(found)] == ["wrong, called good", "right, called doubtful"]


def test_a_scene_that_took_no_part_in_fitting_is_asked_by_default(verdicts: ModuleType) -> None:
    reported = verdicts.cases(range(3, 8), "building_2")
    fitted = verdicts.cases(range(3), "apartment")
    assert len(reported) == 40
    assert not {c.scene for c in reported if c.scene == "building_2"} & {c.scene for c in fitted}
    assert len({case.name for case in reported}) == 40


def test_people_are_not_masked(verdicts: ModuleType) -> None:
    with_people = [case for case in verdicts.cases([3], "building_2") if "people" in case.kind]
    assert len(with_people) == 2
    for case in with_people:
        assert verdicts.spec_of(case).walkers > 0
        assert verdicts.config_of(case).masking.method == "none"


@pytest.mark.parametrize(("doubtful", "ate_m"), [(False, 0.002), (True, 3.0)])
def test_a_map_that_is_right_or_called_doubtful_is_not_silent(
    verdicts: ModuleType, missed: Callable[..., Any], doubtful: bool, ate_m: float
) -> None:
    assert not missed(verdicts.of_verdict("a", "vnav", ate_m, 0.01, doubtful))
    silent = missed(verdicts.of_verdict("a", "vnav", 3.0, 0.01, False))
    assert [m.quantity for m in silent] == ["wrong and called good"]

"""Which of several motions all pixels bear out, where what repeats or moves agrees with itself."""

import numpy as np
import pytest

from tests.registration.plane_views import Plane, periodic, plain, speckle, view
from vnav.config import RegistrationConfig
from vnav.core import se3
from vnav.core.reduced_frame import reduced
from vnav.registration.judge import PixelEvidence, are_same, judge

CONFIG = RegistrationConfig()
PERIOD_M = 0.2
STEP_M = 0.05


def shift(x: float, y: float = 0.0) -> np.ndarray:
    return se3.make(np.eye(3), [x, y, 0.0])


def evidence(before: list[Plane], after: list[Plane], *candidates: np.ndarray) -> PixelEvidence:
    a, b = view(before, 0, seed=0), view(after, STEP_M, seed=1)
    return judge(reduced(a), reduced(b), candidates, CONFIG)


SHELVES = Plane(1.5, periodic(speckle(1), PERIOD_M))
PAINTING = Plane(1.499, speckle(2), (0.3, 0.0), (0.55, 0.4))  # 5 % of the view


def test_a_wall_that_repeats_leaves_it_open_how_many_periods_the_camera_moved() -> None:
    wall = [SHELVES]
    found = evidence(wall, wall, shift(STEP_M), shift(STEP_M - PERIOD_M)).probabilities
    assert found.min() > 0.1
    assert found.sum() > 0.99


@pytest.mark.parametrize("periods", [-2, -1, 1, 2])
def test_a_twentieth_of_the_view_that_is_unique_decides(periods: int) -> None:
    wall = [SHELVES, PAINTING]
    found = evidence(wall, wall, shift(STEP_M + periods * PERIOD_M), shift(STEP_M)).probabilities
    assert found[1] > 0.95


@pytest.mark.parametrize("step_m", [0.1, -0.1])
def test_a_wall_with_few_marks_wins_over_a_textured_thing_that_moves(step_m: float) -> None:
    marks = [Plane(3.0, plain(90), (x, y), (x + 0.12, y + 0.12)) for x, y in MARKS]
    person = Plane(2.0, speckle(3), (-0.4, -0.8), (0.4, 0.9))  # 30 % of the view
    before = [Plane(3.001, plain(160)), *marks, person]
    after = [*before[:-1], person.moved(step_m)]
    found = evidence(before, after, shift(STEP_M - step_m), shift(STEP_M)).probabilities
    assert found[1] > 0.8


def test_a_box_that_hides_what_is_seen_speaks_against_a_motion_that_looks_as_good() -> None:
    room = [Plane(3.0, plain(120)), Plane(1.5, plain(120), (-0.5, -2.0), (0.3, 2.0))]
    found = evidence(room, room, shift(STEP_M + 0.2), shift(STEP_M)).probabilities
    assert found[1] > 0.95


def test_a_motion_that_pixels_contradict_is_improbable_without_a_better_one() -> None:
    room = [Plane(3.0, speckle(5)), Plane(1.5, speckle(6), (-0.5, -2.0), (0.3, 2.0))]
    right, wrong = shift(STEP_M), shift(STEP_M + 0.3, 0.2) @ se3.exp([0, 0, 0, 0, 0, 0.3])
    assert evidence(room, room, right).probabilities[0] > 0.99
    assert evidence(room, room, wrong).probabilities[0] < 0.05


def test_exposure_changes_nothing() -> None:
    wall = [SHELVES, PAINTING]
    bright = [Plane(p.z, lambda x, y, p=p: 0.8 * p.texture(x, y) + 10, p.low, p.high) for p in wall]
    found = evidence(wall, bright, shift(STEP_M - PERIOD_M), shift(STEP_M)).probabilities
    assert found[1] > 0.95


def test_views_that_do_not_overlap_prefer_nothing() -> None:
    wall = [Plane(2.0, speckle(7))]
    found = evidence(wall, wall, shift(30.0), shift(-30.0)).probabilities
    np.testing.assert_allclose(found, 1 / 3)


def test_evidence_of_two_pairs_of_frames_is_stronger_than_that_of_one() -> None:
    wall = [SHELVES, PAINTING]
    one = evidence(wall, wall, shift(STEP_M - PERIOD_M), shift(STEP_M))
    assert (one + one).probabilities[1] > one.probabilities[1]


def test_motions_are_the_same_that_pixels_cannot_tell_apart() -> None:
    a = reduced(view([Plane(2.0, speckle(8))], 0, seed=0))
    assert are_same(a, shift(0.05), shift(0.052), CONFIG)
    assert not are_same(a, shift(0.05), shift(0.15), CONFIG)


MARKS = np.random.default_rng(4).uniform((-1.8, -1.3), (1.8, 1.3), (40, 2))

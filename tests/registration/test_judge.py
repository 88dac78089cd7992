"""Which of several motions all pixels bear out, where what repeats or moves agrees with itself."""

from dataclasses import replace

import numpy as np
import pytest

from tests.registration.plane_views import CAMERA, Plane, periodic, plain, speckle, view
from vnav.config import RegistrationConfig
from vnav.core import se3
from vnav.core.frame import Frame
from vnav.registration.judge import CLEAR, WRONG, PixelEvidence, are_same, judge, refuted
from vnav.registration.pixel_evidence import log_likelihoods
from vnav.registration.reduction import reduced

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


def test_a_prior_decides_what_pixels_leave_open_and_nothing_else() -> None:
    tie = PixelEvidence(np.zeros((3, 3)), np.ones((3, 3)), np.zeros(2))
    favour = np.array([[0, 20, 20], [-20, 0, 0], [-20, 0, 0.0]])
    clear = PixelEvidence(favour, np.ones((3, 3)), np.zeros(2))
    prior = np.array([-3.0, 0.0])
    np.testing.assert_allclose(tie.probabilities, 1 / 3)
    assert tie.posterior(prior)[1] > 9 * tie.posterior(prior)[0]
    assert clear.posterior(prior)[0] > 0.99


def test_motions_are_the_same_that_pixels_cannot_tell_apart() -> None:
    a = reduced(view([Plane(2.0, speckle(8))], 0, seed=0))
    assert are_same(a, shift(0.05), shift(0.052), CONFIG)
    assert not are_same(a, shift(0.05), shift(0.15), CONFIG)


LATE_S, LINE_S = 0.02, 5e-5  # what delays may be without anybody's knowledge
ROOM = [Plane(2.5, speckle(10)), Plane(1.2, speckle(11), (-0.5, -2.0), (0.3, 2.0))]
ROWS_S = LINE_S * (np.arange(CAMERA.height) - (CAMERA.height - 1) / 2)[:, None]


def probability(a: Frame, b: Frame, motion: np.ndarray, twist: list[float]) -> float:
    """Of a motion from a camera at rest to one that moves by a twist."""
    after = reduced(b).moving(np.array(twist))
    return float(judge(reduced(a), after, [motion], CONFIG).probabilities[0])


def test_depth_that_is_late_contradicts_no_motion_while_the_camera_moves() -> None:
    speed = 1.5
    later = [replace(p, z=p.z - 2 * LATE_S * speed) for p in ROOM]
    a, b = view(ROOM, 0, seed=0), view(ROOM, STEP_M, seed=1)
    late = replace(b, depth_m=view(later, STEP_M, seed=1).depth_m)
    assert probability(a, late, shift(STEP_M), [0, 0, 0, 0, 0, 0]) < 0.05
    assert probability(a, late, shift(STEP_M), [0, 0, 0, 0, 0, speed]) > 0.95


def test_rows_that_are_late_contradict_no_motion_while_the_camera_moves() -> None:
    speed, wall = 8.0, [Plane(2.0, speckle(12, grain_m=0.03))]  # 20 px at the image's rims
    a, b = view(wall, 0, seed=0), view(wall, STEP_M, seed=1)
    skewed = replace(b, color=view(wall, STEP_M + 2 * speed * ROWS_S, seed=1).color)
    at_rest, moving = ([0, 0, 0, v, 0, 0] for v in (0.0, speed))
    assert probability(a, skewed, shift(STEP_M), at_rest) < 0.4
    assert probability(a, skewed, shift(STEP_M), moving) > 0.8


def test_a_wrong_motion_stays_improbable_while_the_camera_moves() -> None:
    a, b = view(ROOM, 0, seed=0), view(ROOM, STEP_M, seed=1)
    wrong = shift(STEP_M + 0.3, 0.2) @ se3.exp([0, 0, 0, 0, 0, 0.3])
    assert probability(a, b, wrong, [0, 0, 0, 1.0, 0, 1.0]) < 0.05


@pytest.mark.parametrize("off_sigmas", [0.0, 1.0, 4.0])
def test_what_delays_may_do_explains_a_residual_and_makes_none_less_likely(
    off_sigmas: float,
) -> None:
    # Depth alone. Were every pixel to pay for what a delay may do, motions
    # that show less of it would win, however small the residuals.
    noise, late, chance = 0.01, 0.04, np.array([0.3, 50.0])
    at_rest, moving = (
        log_likelihoods(
            np.array([[off_sigmas * noise, np.nan, noise, 1.0, by_delays, 0.0]]),
            np.zeros(1),
            (1.0, 0.0),
            chance,
            WRONG,
        )
        for by_delays in (0.0, late)
    )
    assert moving >= at_rest
    assert moving - at_rest > 3 or off_sigmas < 2


def test_motions_are_the_same_that_are_apart_by_what_the_camera_moves_meanwhile() -> None:
    a = reduced(view([Plane(2.0, speckle(8))], 0, seed=0)).moving(np.array([0, 0, 0, 1.0, 0, 0]))
    assert are_same(a, shift(0.05), shift(0.08), CONFIG, delay_s=0.04)
    assert not are_same(a, shift(0.05), shift(0.08), CONFIG)
    assert not are_same(a, shift(0.05), shift(0.15), CONFIG, delay_s=0.04)


MARKS = np.random.default_rng(4).uniform((-1.8, -1.3), (1.8, 1.3), (40, 2))


SKIRTING = [Plane(3.0, plain(120)), Plane(1.0, plain(90), (-2.0, 0.2), (2.0, 2.0))]
POSTERS = [
    Plane(2.99, speckle(20 + k), (x, -0.9), (x + 0.4, -0.3)) for k, x in enumerate((-1.0, 0.2))
]
FLOOR_ALONE = [*SKIRTING, *POSTERS]  # a bare floor near by, and posters on a wall far behind it


def far_evidence(candidates: list[np.ndarray], range_m: float) -> PixelEvidence:
    """Of two views 5 cm apart, without the depth of what is farther than the sensor's range."""
    a, b = (view(FLOOR_ALONE, x, seed=k) for k, x in enumerate((0.0, STEP_M)))
    near = (replace(f, depth_m=np.where(f.depth_m < range_m, f.depth_m, 0)) for f in (a, b))
    return judge(*(reduced(f) for f in near), candidates, CONFIG)


TURNED = shift(STEP_M) @ se3.exp([0, 0.03, 0, 0, 0, 0])


@pytest.mark.parametrize("range_m", [1.5, 5.0])
def test_what_has_no_depth_tells_a_turn_that_a_bare_floor_does_not(range_m: float) -> None:
    found = far_evidence([TURNED, shift(STEP_M)], range_m)
    assert found.probabilities[1] > 0.99
    assert found.log_odds[1, -1] > CLEAR


@pytest.mark.parametrize("step_m", [0.0, 2 * STEP_M])
def test_a_motion_that_takes_less_parallax_is_no_likelier_for_what_has_no_depth(
    step_m: float,
) -> None:
    """The wall is 3 m away, so that its 4 pixels between the views may as well be a turn."""
    turn = (STEP_M - step_m) / 3.0
    as_good_for_the_wall = shift(step_m) @ se3.exp([0, turn, 0, 0, 0, 0])
    found = far_evidence([as_good_for_the_wall, shift(STEP_M)], 1.5)
    assert found.log_odds[0, 1] < CLEAR


def test_what_moves_tells_nothing_by_its_brightness_either() -> None:
    """Whatever stands in the mask in the other view."""
    person = Plane(2.9, speckle(30), (-1.5, -1.2), (1.5, 0.15))
    stranger = replace(person, texture=speckle(31))
    found: dict[bool, list[float]] = {False: [], True: []}
    for other in (person, stranger):
        pair = (view([*SKIRTING, p], x, seed=0) for p, x in ((person, 0.0), (other, STEP_M)))
        near = (replace(f, depth_m=np.where(f.depth_m < 1.5, f.depth_m, 0)) for f in pair)
        a, b = (reduced(f) for f in near)
        moving = np.broadcast_to(np.arange(len(a.grey))[:, None] < 0.6 * len(a.grey), a.grey.shape)
        for is_masked in found:
            seen = [f.without(moving) if is_masked else f for f in (a, b)]
            evidence = judge(*seen, [shift(STEP_M), TURNED], CONFIG)
            found[is_masked].append(float(evidence.log_odds[0, 1]))
    assert abs(np.subtract(*found[False])) > CLEAR
    assert abs(np.subtract(*found[True])) < 0.1


AWAY_M = 0.1
BEFORE_WALL = Plane(1.8, speckle(3, grain_m=0.02), (-0.4, -0.8), (0.4, 0.9))  # 37 % of the view
FAINT_WALL = Plane(3.0, speckle(2, contrast=3.0, grain_m=0.08))


def test_what_stands_still_refutes_the_motion_of_who_walks_away() -> None:
    away = replace(BEFORE_WALL, z=BEFORE_WALL.z + AWAY_M)
    a = reduced(view([FAINT_WALL, BEFORE_WALL], 0, seed=0))
    b = reduced(view([FAINT_WALL, away], STEP_M, seed=1))
    follows = se3.make(np.eye(3), [STEP_M, 0, -AWAY_M])
    wall, person = b.inverse_depth < 0.4, b.inverse_depth > 0.45
    on_wall, on_person = (refuted(a, b, T, CONFIG) for T in (follows, shift(STEP_M)))
    assert on_wall[wall].mean() > 0.8
    assert on_wall[person].mean() < 0.1
    assert on_person[wall].mean() < 0.1
    assert judge(a, b, [follows], CONFIG).refuting[0] > 0.5


def test_nothing_refutes_the_motion_past_what_stands_still() -> None:
    scene = [FAINT_WALL, BEFORE_WALL]
    assert evidence(scene, scene, shift(STEP_M)).refuting[0] < 0.02

"""Keyframes that see one place again."""

import numpy as np
import pytest

from tests.registration.plane_views import Plane, speckle, view
from vnav.config import RegistrationConfig
from vnav.core import se3
from vnav.core.camera import Intrinsics
from vnav.core.reduced_frame import ReducedFrame
from vnav.registration.reduction import reduced
from vnav.registration.surface_agreement import (
    MEDIAN_SIGMAS,
    Agreement,
    agreement,
    borne_out,
    disagreeing,
)

CONFIG = RegistrationConfig()
CAMERA = Intrinsics(80, 60, 65.0, 65.0, 39.5, 29.5)
WALL_M = 2.0


def wall(distance_m: float, seed: int) -> ReducedFrame:
    """A wall across the view, its depth the mean of 16 pixels."""
    noise = CONFIG.depth_sigma_per_m2 / 4 * np.random.default_rng(seed).standard_normal((60, 80))
    return ReducedFrame(0.0, np.full((60, 80), 100.0), 1 / distance_m + noise, CAMERA)


def forward(metres: float) -> np.ndarray:
    return se3.make(np.eye(3), [0.0, 0.0, metres])


def found(a: ReducedFrame, b: ReducedFrame, T_a_b: np.ndarray) -> Agreement:
    both = agreement((0, 1), (a, b), T_a_b, CONFIG)
    assert both is not None
    return both


def never(_: Agreement) -> bool:
    return False


def test_two_views_of_a_wall_at_their_true_poses_differ_by_noise_alone() -> None:
    both = found(wall(WALL_M, 0), wall(WALL_M - 0.3, 1), forward(0.3))
    least = MEDIAN_SIGMAS * np.sqrt((1 + 4 / 9) / 2)  # interpolation evens out one frame's noise
    assert 0.95 * least < both.off_sigmas < 1.05 * MEDIAN_SIGMAS  # 2400 points: 3 % of scatter
    assert both.seen_through == 0.0


def test_a_pose_that_is_wrong_by_some_sigmas_shows_as_so_many() -> None:
    sigma_m = np.sqrt(2) * CONFIG.depth_sigma_per_m2 * WALL_M**2  # of two measurements
    both = found(wall(WALL_M, 0), wall(WALL_M, 1), forward(2 * sigma_m))
    assert both.off_sigmas == pytest.approx(2.0, rel=0.1)  # noise: 2 %


def test_a_pose_that_is_wrong_by_far_makes_points_that_are_seen_through() -> None:
    both = found(wall(WALL_M, 0), wall(WALL_M, 1), forward(0.2))
    assert both.seen_through > 0.9


def test_keyframes_that_share_hardly_anything_tell_nothing() -> None:
    aside = se3.make(np.eye(3), [2.3, 0.0, 0.0])  # of 2.46 m that a view is wide
    assert agreement((0, 1), (wall(WALL_M, 0), wall(WALL_M, 1)), aside, CONFIG) is None


def test_revisits_are_measured_by_what_is_usual_of_the_sensor() -> None:
    """A sensor whose depth errs by two sigmas everywhere does not make a map doubtful."""
    neighbours = [Agreement(k, k + 1, 2.0, 0.05) for k in range(10)]
    alike, off = Agreement(0, 90, 2.5, 0.08), Agreement(1, 91, 4.5, 0.08)
    through = Agreement(2, 92, 2.0, 0.30)

    assert disagreeing([alike, off, through], neighbours, never) == [off, through]


def test_what_is_seen_through_disagrees_only_where_images_do_not_bear_the_poses_out() -> None:
    neighbours = [Agreement(k, k + 1, 0.2, 0.05) for k in range(10)]
    off, through = Agreement(1, 91, 4.5, 0.08), Agreement(2, 92, 0.2, 0.30)

    assert disagreeing([off, through], neighbours, lambda _: True) == [off]


def test_without_neighbours_nothing_is_unusual() -> None:
    assert disagreeing([Agreement(0, 90, 50.0, 0.9)], [], never) == []


ROOM = [Plane(3.0, speckle(5)), Plane(2.5, speckle(6), (-0.9, -2.0), (-0.3, 2.0))]
SOMEBODY = Plane(1.5, speckle(3), (0.2, -0.8), (0.6, 0.9))  # 25 % of the view
RIGHT = se3.make(np.eye(3), [0.05, 0.0, 0.0])


def bears_out(off: np.ndarray) -> tuple[bool, Agreement]:
    """Whether a pose that is ``off`` is borne out where somebody came, and how surfaces agree."""
    a = reduced(view(ROOM, 0, seed=0))
    b = reduced(view([*ROOM, SOMEBODY], RIGHT[0, 3], seed=1))
    return borne_out(a, b, RIGHT @ off, CONFIG), found(a, b, RIGHT @ off)


def test_the_right_pose_is_borne_out_though_somebody_came() -> None:
    is_borne_out, both = bears_out(np.eye(4))
    assert both.seen_through > 0.1
    assert is_borne_out


@pytest.mark.parametrize("metres", [0.05, 0.1, 1.0])  # near enough to be found, and not
def test_a_wrong_pose_is_not_borne_out(metres: float) -> None:
    assert not bears_out(se3.make(np.eye(3), [metres, 0.0, 0.0]))[0]

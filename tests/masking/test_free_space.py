"""Votes of views on a surface, on a bare wall and a box before it."""

from dataclasses import replace

import numpy as np
import pytest

from tests.masking.moving_box import CAMERA, walk
from vnav.core.arrays import Array
from vnav.masking.free_space import count_votes
from vnav.masking.view import PosedView

SIGMA, MARGIN_M = 0.0014, 0.07
INNER = slice(8, 72)  # columns that views a step aside see, too


def views(*places: float | None) -> list[PosedView]:
    """The same view of the wall, with the box at these places."""
    frames = [walk(0.1, None if p is None else lambda _, p=p: p).frames[0] for p in places]
    return [PosedView(frame, np.eye(4), np.zeros(frame.grey.shape, bool)) for frame in frames]


def test_a_surface_that_all_see_has_their_votes() -> None:
    view, *others = views(None, None, None, None)
    votes = count_votes(view, others, SIGMA, MARGIN_M)
    assert (votes.same[:, INNER] == 3).all()
    assert (votes.free == 0).all()


def test_a_box_that_others_do_not_see_is_seen_through() -> None:
    view, *others = views(0.0, None, None)
    votes = count_votes(view, others, SIGMA, MARGIN_M)
    on_box = np.isclose(view.frame.inverse_depth, 1 / 2, atol=0.01)
    assert (votes.free[on_box] > 1.5).all()
    assert (votes.free[~on_box] == 0).all()


def test_a_view_counts_for_one_within_what_a_real_sensor_is_off_and_for_less_beyond() -> None:
    view, other = views(0.0, None)
    on_box = np.isclose(view.frame.inverse_depth, 1 / 2, atol=0.01)
    # at the wall that makes 0.0033 and 0.0111 in inverse depth: 1.7 and 5.6 times the noise of two
    # depths, of which the median difference is 0.6745
    slightly, farther = (replace(other, T_track_camera=ahead(m)) for m in (0.03, 0.1))
    fit, also_fit, unfit = (
        count_votes(view, [o], SIGMA, MARGIN_M).free[on_box] for o in (other, slightly, farther)
    )
    share = (3 * np.sqrt(2) * SIGMA / (0.1 / 9 / 0.6745)) ** 2
    assert (fit == 1).all()
    assert also_fit.max() == 1
    assert unfit.max() == pytest.approx(share, rel=0.2)


def test_a_view_fits_though_two_fifths_of_it_move_a_little() -> None:
    view, other = views(0.0, None)
    on_box = np.isclose(view.frame.inverse_depth, 1 / 2, atol=0.01)
    depths = other.frame.inverse_depth.copy()
    depths[:, : 2 * CAMERA.width // 5] = 1 / 2.88  # 12 cm before the wall: less than what is seen
    slow = replace(other, frame=replace(other.frame, inverse_depth=depths))
    assert (count_votes(view, [slow], SIGMA, MARGIN_M).free[on_box] == 1).all()


def ahead(metres: float) -> Array:
    """A pose before another."""
    pose = np.eye(4)
    pose[2, 3] = metres
    return pose


def turning(view: PosedView, rad_s: float) -> PosedView:
    """The same of a camera that turns about its y, so that what it sees goes sideways."""
    return replace(view, frame=view.frame.moving(np.array([0, rad_s, 0, 0, 0, 0])))


def at(view: PosedView, stamp_s: float) -> PosedView:
    """The same, at another time."""
    return replace(view, frame=replace(view.frame, stamp_s=stamp_s))


@pytest.mark.parametrize(("rad_s", "other_rad_s", "blocks"), [(1, -1, 0), (0, 0, 2), (1, 1, 2)])
def test_what_late_depth_displaces_is_seen_through_only_where_cameras_turn_alike(
    rad_s: float, other_rad_s: float, blocks: int
) -> None:
    """Cameras that turn by 2 rad/s apart show depth 30 ms late 4 blocks beside."""
    shift_m = 4 / CAMERA.fx * 2.0  # of the box, at 2 m
    view, other = views(0.0, shift_m)
    votes = count_votes(turning(view, rad_s), [turning(other, other_rad_s)], SIGMA, MARGIN_M)
    centre = CAMERA.height // 2
    # of 4, one has no depth and one is a misalignment
    assert votes.free[centre].sum() == blocks


def test_a_thing_that_is_gone_is_seen_through_by_cameras_that_turn() -> None:
    view, other = views(0.0, None)
    votes = count_votes(turning(view, 1.0), [turning(other, -1.0)], SIGMA, MARGIN_M)
    on_box = np.isclose(view.frame.inverse_depth, 1 / 2, atol=0.01)
    assert (votes.free[on_box] == 1).all()


def test_what_others_see_as_near_as_they_fit_is_not_seen_through() -> None:
    view, other = views(0.0, 0.0)
    votes = count_votes(view, [replace(other, T_track_camera=ahead(0.05))], SIGMA, MARGIN_M)
    assert (votes.free == 0).all()


def test_a_view_at_a_wrong_pose_has_no_vote_where_most_have() -> None:
    """Half a metre nearer it expects the wall half a metre before where it sees it."""
    view, other = views(0.0, 0.0)
    astray = replace(other, T_track_camera=ahead(0.5))
    alone, among_others = (
        count_votes(view, others, SIGMA, MARGIN_M) for others in ([astray], [astray, other, other])
    )
    assert (alone.free > 0).mean() > 0.5
    assert (among_others.free == 0).all()


def test_views_of_elsewhere_do_not_say_whose_pose_is_wrong() -> None:
    view, other = views(0.0, 0.0)
    astray = replace(other, T_track_camera=ahead(0.5))
    away = replace(other, T_track_camera=np.diag([-1.0, 1, -1, 1]))
    votes = count_votes(view, [*[away] * 6, astray, other], SIGMA, MARGIN_M)
    assert (votes.free == 0).all()


def test_views_beyond_a_wrong_step_have_no_vote_though_they_are_more() -> None:
    """Of a view that fits those before, or those after, the pose is right."""
    view, other = views(0.0, 0.0)
    before = [at(other, -0.1 * k) for k in range(3, 0, -1)]
    after = [replace(at(other, 0.1 * k), T_track_camera=ahead(0.5)) for k in range(1, 9)]
    assert (count_votes(view, [*before, *after], SIGMA, MARGIN_M).free == 0).all()


def test_all_views_have_a_vote_where_a_view_fits_neither_those_before_nor_those_after() -> None:
    view, other = views(0.0, 0.0)
    fitting = [at(other, -0.4), at(other, 0.4)]
    astray = [replace(at(other, t), T_track_camera=ahead(0.5)) for t in (-0.2, -0.1, 0.1, 0.2)]
    assert (count_votes(view, [*fitting, *astray], SIGMA, MARGIN_M).free > 0).mean() > 0.5


def test_what_is_hidden_has_no_vote() -> None:
    view, other = views(None, 0.0)
    votes = count_votes(view, [other], SIGMA, MARGIN_M)
    centre = CAMERA.height // 2, CAMERA.width // 2
    assert votes.same[centre] == 0
    assert votes.free[centre] == 0


def test_a_view_from_elsewhere_votes_where_the_surface_falls() -> None:
    near, far = walk(1.1, None).frames[0], walk(1.1, None).frames[10]
    still = np.zeros(near.grey.shape, bool)
    aside = np.eye(4)
    aside[0, 3] = 0.1
    votes = count_votes(
        PosedView(near, np.eye(4), still), [PosedView(far, aside, still)], SIGMA, MARGIN_M
    )
    assert (votes.same[:, INNER] == 1).all()


def test_without_other_views_there_are_no_votes() -> None:
    (view,) = views(None)
    votes = count_votes(view, [], SIGMA, MARGIN_M)
    assert not votes.same.any()
    assert not votes.free.any()

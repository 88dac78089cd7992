"""Votes of views on a surface, on a bare wall and a box before it."""

from dataclasses import replace

import numpy as np
import pytest

from tests.masking.moving_box import CAMERA, walk
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


def test_a_view_whose_surfaces_do_not_fit_counts_for_less_than_one() -> None:
    view, other = views(0.0, None)
    ahead = np.eye(4)
    ahead[2, 3] = 0.04  # of its pose, at the wall: 0.04 / 3^2 in inverse depth, twice the noise
    astray = replace(other, T_track_camera=ahead)
    on_box = np.isclose(view.frame.inverse_depth, 1 / 2, atol=0.01)
    fits, does_not = (count_votes(view, [o], SIGMA, MARGIN_M).free[on_box] for o in (other, astray))
    share = (2 * np.sqrt(2) * SIGMA / (np.sqrt(np.pi / 2) * 0.04 / 9)) ** 2
    assert (fits == 1).all()
    assert does_not.max() == pytest.approx(share, rel=0.2)


def test_what_others_see_as_near_as_they_fit_is_not_seen_through() -> None:
    view, other = views(0.0, 0.0)
    ahead = np.eye(4)
    ahead[2, 3] = 0.05
    votes = count_votes(view, [replace(other, T_track_camera=ahead)], SIGMA, MARGIN_M)
    assert (votes.free == 0).all()


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

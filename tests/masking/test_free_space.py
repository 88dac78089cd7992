"""Votes of views on a surface, on a bare wall and a box before it."""

import numpy as np

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
    assert (votes.free_run == 0).all()


def test_a_box_that_others_do_not_see_is_seen_through() -> None:
    view, *others = views(0.0, None, None)
    votes = count_votes(view, others, SIGMA, MARGIN_M)
    on_box = np.isclose(view.frame.inverse_depth, 1 / 2, atol=0.01)
    assert (votes.free_run[on_box] == 2).all()
    assert (votes.free_run[~on_box] == 0).all()


def test_a_view_that_sees_the_surface_ends_a_run() -> None:
    view, *others = views(0.0, None, None, 0.0, None, None, None)
    centre = CAMERA.height // 2, CAMERA.width // 2
    votes = count_votes(view, others, SIGMA, MARGIN_M)
    assert votes.free_run[centre] == 3
    assert votes.same[centre] == 1


def test_what_is_hidden_has_no_vote() -> None:
    view, other = views(None, 0.0)
    votes = count_votes(view, [other], SIGMA, MARGIN_M)
    centre = CAMERA.height // 2, CAMERA.width // 2
    assert votes.same[centre] == 0
    assert votes.free_run[centre] == 0


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
    assert not votes.free_run.any()

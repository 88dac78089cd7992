"""Motions of frames that follow each other, chosen together."""

import numpy as np
import pytest

from vnav.core import se3
from vnav.core.frame import Edge, PoseEstimate
from vnav.tracking.joint_choice import chosen_together
from vnav.tracking.pose_choice import Rivals

FRAMES, STEP_S = 12, 0.1
STAMPS_S = STEP_S * np.arange(FRAMES)
BOOK_M = 0.17
TURN = se3.exp([0.0, 0.05, 0.0, 0.0, 0.0, 0.0])
SLIDE = TURN @ se3.make(np.eye(3), [BOOK_M, 0.0, 0.0])
# From a rest to a book in 0.1 s and back: each costs log(1 + (0.17 / 0.023) ** 2) = 4.0 nats, for
# an acceleration of 2 m/s2 moves by 0.02 m, and 0.003 m are the noise of a step.
NATS = 4.0


def rivals_of(row: int, taken: np.ndarray, *others: tuple[np.ndarray, float]) -> Rivals:
    """Motions from the frame before, and what pixels say of others than the one taken."""
    estimates = [
        PoseEstimate(T, np.eye(6), np.zeros((100, 2), np.int32), 120)
        for T in (taken, *(T for T, _ in others))
    ]
    return Rivals(row - 1, tuple(estimates), np.array([0.0, *(odds for _, odds in others)]))


def turning(slides: range, log_odds: float = 0.0) -> dict[int, Rivals | None]:
    """A camera that turns, by a track that slides in some frames; pixels leave it about open."""
    return {
        row: rivals_of(row, SLIDE, (TURN, log_odds)) if row in slides else rivals_of(row, TURN)
        for row in range(1, FRAMES)
    }


def edges_of(rivals: dict[int, Rivals | None]) -> dict[int, list[Edge]]:
    """The edges that were taken."""
    return {
        row: [Edge(found.target, row, found.estimates[0].T_a_b, np.eye(6), 0.7)]
        for row, found in rivals.items()
        if found
    }


def slid(edges: dict[int, list[Edge]]) -> list[int]:
    """The frames whose edges slide."""
    return [row for row, found in edges.items() if np.allclose(found[0].T_i_j, SLIDE)]


def together(rivals: dict[int, Rivals | None]) -> list[int]:
    """The frames that slide when all is known."""
    return slid(chosen_together(rivals, edges_of(rivals), {}, STAMPS_S)[0])


@pytest.mark.parametrize("slides", [range(4, 5), range(4, 8), range(1, 3)])
def test_a_slide_that_stops_is_taken_back(slides: range) -> None:
    """It starts and stops, or at the first frames stops, by an acceleration that none has."""
    log_odds = -1.0 if slides.start > 1 else 2.0
    assert together(turning(slides, log_odds / len(slides))) == []


def test_a_slide_that_pixels_clearly_prefer_stays() -> None:
    """By as much as both accelerations cost, but for what is no clear difference."""
    assert together(turning(range(4, 6), -NATS)) == [4, 5]


def test_a_slide_that_goes_on_to_the_end_stays() -> None:
    """It may be the camera's: no motion tells that it was not."""
    assert together(turning(range(8, FRAMES))) == list(range(8, FRAMES))


def test_what_is_about_as_likely_together_stays() -> None:
    """A single acceleration costs less than 99 to 1."""
    assert np.log(99) > NATS
    rivals = turning(range(1, 3))
    assert together(rivals) == [1, 2]


def test_where_nothing_is_unique_all_stays() -> None:
    """To slide in all frames is as likely as in none: which it was, no frame tells."""
    rivals: dict[int, Rivals | None] = {
        row: rivals_of(row, SLIDE, (TURN, 0.0))
        if row in (4, 5)
        else rivals_of(row, TURN, (SLIDE, 0.0))
        for row in range(1, FRAMES)
    }
    assert together(rivals) == [4, 5]


def test_a_frame_that_is_not_tracked_from_the_one_before_ends_a_slide() -> None:
    rivals = turning(range(4, 6))
    rivals[6] = None
    assert together(rivals) == [4, 5]


def test_the_slide_becomes_the_alternative() -> None:
    rivals = turning(range(4, 5))
    edges, alternatives = chosen_together(rivals, edges_of(rivals), {}, STAMPS_S)
    (chosen,), (slide,) = edges[4], alternatives[4]
    np.testing.assert_allclose(slide.T_i_j, SLIDE)
    assert chosen.probability > 0.99
    assert chosen.probability + slide.probability == 1.0
    assert (chosen.i, chosen.j) == (slide.i, slide.j) == (3, 4)


def test_edges_that_lead_past_it_are_dropped_where_there_are_others() -> None:
    rivals = turning(range(4, 5))
    edges = edges_of(rivals)
    past, beside = Edge(2, 5, SLIDE, np.eye(6)), Edge(4, 6, TURN @ TURN, np.eye(6))
    edges[5].append(past)
    edges[6].append(beside)
    edges[7] = [Edge(2, 7, SLIDE, np.eye(6))]
    found, _ = chosen_together(rivals, edges, {}, STAMPS_S)
    assert found[5] == edges[5][:1]
    assert found[6] == edges[6]
    assert found[7] == edges[7]


def test_without_rivals_all_stays() -> None:
    rivals = turning(range(0))
    edges = edges_of(rivals)
    assert chosen_together(rivals, edges, {}, STAMPS_S) == (edges, {})

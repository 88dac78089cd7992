"""Gaps of odometry: segments that only contested edges join, and which of these is right."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vnav.core import se3
from vnav.core.arrays import Array
from vnav.core.frame import Edge
from vnav.core.mapping import LOST, Odometry
from vnav.optimisation.contradictions import NEAR
from vnav.optimisation.pose_graph import MAX_COST
from vnav.optimisation.second_look import SecondLook
from vnav.registration.judge import CLEAR


@dataclass(frozen=True)
class Gap:
    """Two segments, by number, and the contested edges between them."""

    before: int
    after: int
    edges: tuple[Edge, ...]


def find_gaps(contested: Sequence[Edge], odometry: Odometry) -> list[Gap]:
    """The segments of odometry that contested edges would join, in order; no lost frames."""
    between: dict[tuple[int, int], list[Edge]] = {}
    for e in contested:
        before, after = sorted((int(odometry.segment[e.i]), int(odometry.segment[e.j])))
        if before != LOST:
            between.setdefault((before, after), []).append(e)
    return [Gap(*pair, tuple(edges)) for pair, edges in sorted(between.items())]


def right_edge(
    gap: Gap, odometry: Odometry, closures: Sequence[Edge], look: SecondLook | None = None
) -> Edge | None:
    """The edge that closures across the gap and the pixels bear out; None where nothing decides.

    Each edge is an explanation, and that none is right is another. One that is `CLEAR` of all
    others counts, by the costs of the closures there and the evidence of all pixels.
    """
    crossing = [e for e in closures if _is_across(e, gap, odometry)]
    costs = [*(_cost(e, odometry, crossing) for e in gap.edges), MAX_COST * len(crossing)]
    log_odds = np.array(costs) - np.array(costs)[:, None]
    if look is not None:
        i, j = _nearest_keyframes(gap, odometry)
        log_odds += look.log_odds(i, j, [_motion(e, i, j, odometry) for e in gap.edges])
    np.fill_diagonal(log_odds, np.inf)
    against_best = log_odds[:-1].min(1)
    best = int(against_best.argmax())
    return gap.edges[best] if against_best[best] > CLEAR else None


def _is_across(closure: Edge, gap: Gap, odometry: Odometry) -> bool:
    """Whether a closure joins the segments near the gap, where odometry has not drifted."""
    segment = odometry.segment
    first, last = np.searchsorted(odometry.keyframe_rows, [closure.i, closure.j])
    sides = {int(segment[closure.i]), int(segment[closure.j])}
    return sides == {gap.before, gap.after} and bool(last - first <= NEAR)


def _nearest_keyframes(gap: Gap, odometry: Odometry) -> tuple[int, int]:
    """Rows of the keyframes nearest to each other, of either segment."""
    rows, segment = odometry.keyframe_rows, odometry.segment[odometry.keyframe_rows]
    before, after = rows[segment == gap.before], rows[segment == gap.after]
    i, j = np.unravel_index(np.abs(before[:, None] - after).argmin(), (len(before), len(after)))
    return int(before[i]), int(after[j])


def _cost(edge: Edge, odometry: Odometry, crossing: Sequence[Edge]) -> float:
    """Truncated least squares of the closures where the edge joins the segments."""
    cost = 0.0
    for e in crossing:
        off = se3.inverse(e.T_i_j) @ _motion(edge, e.i, e.j, odometry)
        xi = se3.deviation(off)
        cost += min(float(xi @ e.information @ xi) / 2, MAX_COST)
    return cost


def _motion(edge: Edge, i: int, j: int, odometry: Odometry) -> Array:
    """The motion between frames of two segments where an edge joins these."""
    T = odometry.T_segment_camera
    across = T[edge.i] @ edge.T_i_j @ se3.inverse(T[edge.j])
    if odometry.segment[i] != odometry.segment[edge.i]:
        across = se3.inverse(across)
    return np.asarray(se3.inverse(T[i]) @ across @ T[j])

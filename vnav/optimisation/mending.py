"""Odometry whose edges contradict each other: wrong ones are left out, or what they hold is cut."""

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import compress

import numpy as np
from numpy.typing import NDArray

from vnav.config import OptimiseConfig
from vnav.core.frame import Edge
from vnav.core.graph import chain
from vnav.core.jumps import jumps
from vnav.core.mapping import LOST, Odometry
from vnav.optimisation.contested import agreement
from vnav.optimisation.cycles import noise_factor, suspects
from vnav.optimisation.gaps import find_gaps, right_edge
from vnav.optimisation.second_look import Correction, SecondLook

REASON = "its edges contradict each other"
TOO_FAST = "its motion is faster than a camera is carried"
INTERRUPTED = "the camera was not followed before it, and may be in another place"
ALIKE = "other places look like the one of the join"
LEFT_OUT, REGISTERED_AGAIN, CUT = "left out", "registered again", "cut"
TAKEN = "taken for the likeliest"
FOUND_AGAIN_S = 1.0  # an edge from a frame so long ago is one to a place that was found again


@dataclass(frozen=True)
class Mend:
    """Frames ``first`` to ``last``, by row, that have edges which contradict others.

    ``how``: `LEFT_OUT` where other edges hold the frames, `REGISTERED_AGAIN` where a new one does,
    `CUT` where none does, `TAKEN` where one does that others are as good as. ``closures``: that
    contradict them, 0 where other edges alone do.
    ``why``, where it is neither of these: `TOO_FAST`, `INTERRUPTED` or `ALIKE`.
    """

    first: int
    last: int
    how: str
    closures: int = 0
    why: str = ""


@dataclass(frozen=True)
class Mended:
    """Odometry whose edges agree, and how it was made so."""

    odometry: Odometry
    mends: tuple[Mend, ...] = ()


def mend(
    odometry: Odometry,
    corrections: Sequence[Correction],
    closures: Sequence[Edge],
    config: OptimiseConfig,
    look: SecondLook | None = None,
) -> Mended:
    """Odometry with the corrections, and without edges that its jumps and cycles show to be wrong.

    Alternatives stand in where they agree. Where cycles leave open which edge joins two segments,
    closures and pixels decide. What nothing decides is cut.
    """
    corrected = _corrected(odometry, corrections)
    odometry = _without_leaps(corrected)
    mends = [*map(_mend_of, corrections), *mends_of(corrected, odometry, TOO_FAST)]
    suspect = suspects(odometry.edges, config.max_closure_sigmas)
    if not suspect.any():
        return Mended(odometry, tuple(mends))
    trusted = list(compress(odometry.edges, ~suspect))
    doubtful = [*compress(odometry.edges, suspect), *_alternatives(odometry, suspect)]
    agrees, contested = _agreement(odometry, trusted, doubtful, config.max_closure_sigmas)
    settled = with_edges(odometry, [*trusted, *compress(doubtful, agrees)])
    gaps = find_gaps(list(compress(doubtful, contested)), settled)
    right = [right_edge(gap, settled, closures, look) for gap in gaps]
    mended = with_edges(odometry, [*settled.edges, *(e for e in right if e is not None)])
    return Mended(mended, (*mends, *mends_of(odometry, mended)))


def _corrected(odometry: Odometry, corrections: Sequence[Correction]) -> Odometry:
    """Odometry cut at each stretch's weakest frame, and joined by the correction's edge, if any."""
    if not corrections:
        return odometry
    edges, degenerate = odometry.edges, odometry.degenerate_edges
    for c in corrections:
        row, _ = c.stretch.weakest(odometry.edges)
        new = () if c.edge is None else (c.edge,)
        edges = (*(e for e in edges if not _is_across(e, row)), *new)
        degenerate = tuple(e for e in degenerate if not _is_across(e, row))
    return dataclasses.replace(with_edges(odometry, edges), degenerate_edges=degenerate)


def _is_across(edge: Edge, row: int) -> bool:
    """Whether an edge leads from before a frame to it or beyond."""
    return min(edge.i, edge.j) < row <= max(edge.i, edge.j)


def _mend_of(correction: Correction) -> Mend:
    stretch = correction.stretch
    how = CUT if correction.edge is None else REGISTERED_AGAIN
    return Mend(stretch.i, stretch.j, how, stretch.closures)


def _without_leaps(odometry: Odometry) -> Odometry:
    """Odometry without edges by which a frame was found again, but far from the frame before.

    So is one that another place looks like.
    """
    frames, segment = odometry.frames, odometry.segment
    jumped = {row for _, row in jumps(frames, odometry.T_segment_camera, segment)}
    edges = [
        e
        for e in odometry.edges
        if e.j not in jumped or frames.stamp_s[e.j] - frames.stamp_s[e.i] < FOUND_AGAIN_S
    ]
    return odometry if len(edges) == len(odometry.edges) else with_edges(odometry, edges, TOO_FAST)


def _agreement(
    odometry: Odometry, trusted: Sequence[Edge], doubtful: Sequence[Edge], max_sigmas: float
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Doubtful edges that agree, and those that are contested, by noise as cycles show it."""
    factor = noise_factor(odometry.edges)
    weakened = [dataclasses.replace(e, information=e.information / factor**2) for e in doubtful]
    return agreement(odometry.T_segment_camera, trusted, weakened, max_sigmas)


def _alternatives(odometry: Odometry, suspect: NDArray[np.bool_]) -> list[Edge]:
    """Other motions between the ends of suspects."""
    ends = {(e.i, e.j) for e in compress(odometry.edges, suspect)}
    return [e for e in odometry.alternatives if (e.i, e.j) in ends]


def too_fast(rows: NDArray[np.intp]) -> tuple[Mend, ...]:
    """Of frames that are left out because they jump."""
    return _neighbours_as_one(dict.fromkeys(rows.tolist(), CUT), TOO_FAST)


def without(odometry: Odometry, rows: NDArray[np.intp], reason: str) -> Odometry:
    """Odometry without any edge of these frames, which are lost for a reason."""
    left_out = set(rows.tolist())
    edges, degenerate = (
        tuple(e for e in edges if not {e.i, e.j} & left_out)
        for edges in (odometry.edges, odometry.degenerate_edges)
    )
    fewer = with_edges(odometry, edges, reason)
    return dataclasses.replace(fewer, degenerate_edges=degenerate)


def with_edges(odometry: Odometry, edges: Sequence[Edge], reason: str = REASON) -> Odometry:
    """Odometry of these edges alone, its segments and poses by them; frames they miss are lost."""
    rows = odometry.keyframe_rows.tolist()
    poses, segment = chain(len(odometry.frames), edges, rows)
    edges = tuple(e for e in edges if segment[e.i] != LOST)
    cut = (segment == LOST) & (odometry.segment != LOST)
    reasons = tuple(reason if c else r for c, r in zip(cut, odometry.reasons, strict=True))
    return dataclasses.replace(
        odometry, T_segment_camera=poses, segment=segment, reasons=reasons, edges=edges
    )


def mends_of(before: Odometry, after: Odometry, why: str = "") -> tuple[Mend, ...]:
    """What became of the edges that odometry has no more, in order."""
    kept = {id(e) for e in after.edges}
    how = dict(_outcome(e, after.segment) for e in before.edges if id(e) not in kept)
    return _neighbours_as_one(how, why)


def _neighbours_as_one(how: Mapping[int, str], why: str) -> tuple[Mend, ...]:
    """Frames, by row, as mends in order: one for neighbours of which the same became."""
    found: list[Mend] = []
    for row in sorted(how):
        if found and found[-1].last == row - 1 and found[-1].how == how[row]:
            found[-1] = dataclasses.replace(found[-1], last=row)
        else:
            found.append(Mend(row, row, how[row], why=why))
    return tuple(found)


def _outcome(edge: Edge, segment: NDArray[np.int32]) -> tuple[int, str]:
    """The frame, by row, that an edge held or would have held, and whether others hold it."""
    if segment[edge.i] == LOST:
        return edge.i, CUT
    return edge.j, LEFT_OUT if segment[edge.i] == segment[edge.j] else CUT

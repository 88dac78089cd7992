"""Times for which odometry did not follow the camera: an edge across one is a claim, as a loop is.

After one a hand may be anywhere, and what it sees then may be seen from other places, too.
"""

from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import compress, pairwise

import numpy as np
from numpy.typing import NDArray

from vnav.core.arrays import Array
from vnav.core.graph import chain, ends_of
from vnav.core.mapping import LOST, FrameTable, Odometry
from vnav.optimisation.segments import SAME_POSE_M, Inside

VELOCITY_S = 0.3  # over which a motion is told that goes on
TIMES_FARTHEST = 1.25  # as far from there as elsewhere at most; what is farther is hardly true


def claims(odometry: Odometry) -> NDArray[np.bool_]:
    """Which of odometry's edges (E,) lead across an interruption.

    Those to frames that no other edge joins to a keyframe are none: nothing else holds these.
    """
    frames, segment, ends = odometry.frames, odometry.segment, ends_of(odometry.edges)
    across = np.zeros(len(ends), bool)
    for each in np.unique(segment[segment != LOST]):
        rows = np.flatnonzero(segment == each)
        first = rows[1:][frames.interrupted(rows)]
        inside = segment[ends[:, 0]] == each
        across |= inside & (np.diff(np.searchsorted(first, ends, side="right"))[:, 0] != 0)
    if not across.any():
        return across
    followed = list(compress(odometry.edges, ~across))
    _, held = chain(len(frames), followed, odometry.keyframe_rows.tolist())
    return np.asarray(across & (held[ends] != LOST).all(1))


@dataclass(frozen=True)
class Passage:
    """How a camera comes from frame ``i`` to ``j``, by rows, after an interruption.

    ``at_m`` (3,): where it is then; ``off_m``: how far from where it would have gone on;
    ``most_m``: how far it may be, by what it does elsewhere in such a time.
    """

    i: int
    j: int
    at_m: Array
    off_m: float
    most_m: float

    @property
    def is_usual(self) -> bool:
        """Whether it does so elsewhere."""
        return self.off_m <= self.most_m


def passages(frames: FrameTable, poses: Array, a: Inside, b: Inside) -> list[Passage]:
    """From one set of frames (N,) to another, in time, by poses (N, 4, 4).

    Frames of different captures tell nothing, nor do sets that took less time.
    """
    found, at_m, stamp_s = [], poses[:, :3, 3], frames.stamp_s
    for track in _tracks(frames, a | b):
        sets, velocity = [track[inside[track]] for inside in (a, b)], np.zeros_like(at_m)
        for rows in sets:
            velocity[rows] = _velocities(at_m[rows], stamp_s[rows])
        for i, j in pairwise(track.tolist()):
            if a[i] == a[j]:
                continue
            took_s = stamp_s[j] - stamp_s[i]
            off_m = float(np.linalg.norm(at_m[i] + took_s * velocity[i] - at_m[j]))
            of_sets = ((at_m[rows], velocity[rows], stamp_s[rows]) for rows in sets)
            most_m = _most(_unforeseen(*of_set, took_s) for of_set in of_sets)
            found.append(Passage(i, j, at_m[j], off_m, most_m))
    return found


def _tracks(frames: FrameTable, inside: Inside) -> Iterator[NDArray[np.intp]]:
    """Rows of the frames of a set (N,), of each capture, in time."""
    for capture in np.unique(frames.capture[inside]):
        yield np.flatnonzero(inside & (frames.capture == capture))


def _most(unforeseen_m: Iterable[float]) -> float:
    """How far off a camera may be where it was as far elsewhere; any far where it never was."""
    farthest_m = TIMES_FARTHEST * max(unforeseen_m)
    return max(farthest_m, SAME_POSE_M) if farthest_m else np.inf


def _unforeseen(at_m: Array, velocity: Array, stamp_s: Array, took_s: float) -> float:
    """How far a camera came at most from where it would have gone on in such a time.

    By places and velocities (N, 3); 0 where it was never followed for so long.
    """
    later = np.searchsorted(stamp_s, stamp_s + took_s)
    known = later < len(later)
    later = later[known]
    ahead_s = (stamp_s[later] - stamp_s[known])[:, None]
    goes_on = at_m[known] + ahead_s * velocity[known]
    return float(np.linalg.norm(at_m[later] - goes_on, axis=1).max(initial=0.0))


def _velocities(at_m: Array, stamp_s: Array) -> Array:
    """Of a camera (N, 3), by its places before; 0 of the first."""
    before = np.searchsorted(stamp_s, stamp_s - VELOCITY_S)
    took_s = np.maximum(stamp_s - stamp_s[before], 1e-9)[:, None]
    return np.asarray((at_m - at_m[before]) / took_s)


def lie_apart(ways: Collection[Sequence[Passage]]) -> bool:
    """Whether several ways to pass an interruption end farther apart than two usual ones may.

    Then what looks alike lies so far apart, and only one of these places can be the camera's.
    """
    ends = [each for passed in ways for each in passed]
    if len(ends) < 2 or len(ends) != len(ways):
        return False
    at_m = np.stack([end.at_m for end in ends])
    apart_m = np.linalg.norm(at_m[:, None] - at_m, axis=-1)[~np.eye(len(ends), dtype=bool)]
    return bool((apart_m > 2 * max(end.most_m for end in ends)).all())

"""Which of several ways to join two sets of frames is right, by what their keyframes see."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import compress

import numpy as np

from vnav.core.arrays import Array
from vnav.core.frame import Edge
from vnav.core.graph import ends_of, off_edges
from vnav.core.mapping import Odometry
from vnav.optimisation import pose_graph
from vnav.optimisation.cycles import are_wrong
from vnav.optimisation.interruptions import Passage, lie_apart, passages
from vnav.optimisation.mending import ALIKE, INTERRUPTED, TAKEN, Mend
from vnav.optimisation.second_look import MOST_GONE, SecondLook
from vnav.optimisation.segments import Inside, same_pose
from vnav.registration.judge import CLEAR

MOST_PLACES = 4  # a book or two apart, of an alignment
CLEARLY = 0.1  # by so much larger a share of keyframes shows something else than at the right one
ALONE = 0.8  # share of the votes of places that a place has which nothing contradicts


@dataclass(frozen=True)
class _Place:
    """Where two sets of frames are to each other: poses (N, 4, 4) without drift.

    ``is_clear``: whether images tell it from places a book apart that were proposed, too;
    ``passed``: the interruptions between the sets.
    """

    poses: Array
    is_clear: bool
    passed: Sequence[Passage]


class Joins:
    """Alignments of sets of frames, tested by what their keyframes see.

    ``refused``: candidates (C,), closures and claims of odometry, of alignments that are wrong;
    ``unsure``: where sets were joined, though they may be in another place.
    """

    def __init__(
        self,
        odometry: Odometry,
        candidates: Sequence[Edge],
        max_sigmas: float,
        look: SecondLook | None,
    ) -> None:
        """``odometry``: its edges are trusted; ``look`` None takes the first alignment."""
        self._odometry, self._candidates = odometry, candidates
        self._max_sigmas, self._look = max_sigmas, look
        self._ends = ends_of(candidates)
        self.refused = np.zeros(len(candidates), bool)
        self.unsure: list[Mend] = []

    def right(self, alignments: Sequence[Array], a: Inside, b: Inside) -> int | None:
        """The number of the alignment, poses (N, 4, 4), that is right for two sets of frames (N,).

        Of those that images bear out; None where several may be right, or none is. What was refused
        stays so. Of alignments that are not right, candidates are refused that agree with no right
        one.
        """
        look = self._look
        if look is None:
            return 0
        agreeing = np.stack([self._agreeing(poses, a, b) for poses in alignments])
        placed = {
            n: self._placed(alignments[n], a, b, across, look)
            for n, across in enumerate(agreeing)
            if not self.refused[across].all()
        }
        found, is_unchanged = _borne_out(placed, partial(look.is_borne_out, a=a, b=b))
        passed = {n: place.passed for n, place in found.items()}
        is_alone = agreeing[list(found)].sum() >= ALONE * agreeing.sum()
        right, is_certain = _likely(
            passed,
            is_alone,
            lambda n: look.is_sure(found[n].poses, a, b),
            lambda n: look.unlike(found[n].poses, a, b),
        )
        for n in right:
            if not (is_certain and is_unchanged and found[n].is_clear):
                self.unsure += _unsure(found[n].passed, b)
        agrees = [self._agreeing(placed[n].poses, a, b) for n in right or found]
        self.refused |= agreeing[list(placed)].any(0) & ~np.any(agrees, axis=0)
        return right[0] if right else None

    def _placed(
        self, poses: Array, a: Inside, b: Inside, across: Inside, look: SecondLook
    ) -> _Place:
        """Where the candidates across put the sets that agree with poses (N, 4, 4).

        Where these agree on several places, a book apart, images tell which, and the candidates of
        the others are refused.
        """
        places = list(self._places(poses, a, b, across & ~self.refused))
        log_odds = look.log_odds_across([fitted for fitted, _ in places], a, b)
        np.fill_diagonal(log_odds, np.inf)
        best = int(log_odds.min(1).argmax())
        (fitted, kept), is_clear = places[best], bool(log_odds[best].min() > CLEAR)
        self.refused |= np.any([others for _, others in places], axis=0) & ~kept
        return _Place(fitted, is_clear, passages(self._odometry.frames, fitted, a, b))

    def _places(
        self, poses: Array, a: Inside, b: Inside, across: Inside
    ) -> Iterator[tuple[Array, Inside]]:
        """Poses (N, 4, 4) that candidates across (C,) fit, and which: most first.

        Those that do not fit are asked for another place, and those again.
        """
        poses = np.where((a | b)[:, None, None], poses, np.nan)
        inside = [e for e in self._odometry.edges if (a | b)[e.i] and (a | b)[e.j]]
        within = (a[self._ends].all(1) | b[self._ends].all(1)) & ~self.refused
        for number in range(MOST_PLACES):
            used = across | within
            graph = pose_graph.optimise(
                poses, inside, list(compress(self._candidates, used)), self._max_sigmas
            )
            kept = np.zeros(len(used), bool)
            kept[used] = graph.kept
            if number and not (across & kept).any():
                return
            yield graph.T_world_camera, across & kept
            across = across & ~kept & are_wrong(off_edges(graph.T_world_camera, self._candidates))
            if not across.any():
                return

    def _agreeing(self, poses: Array, a: Inside, b: Inside) -> Inside:
        """Which candidates (C,) between the two agree with poses."""
        i, j = self._ends.T
        across = (a[i] & b[j]) | (b[i] & a[j])
        return np.asarray(across & same_pose(off_edges(poses, self._candidates)))


def _borne_out(
    placed: Mapping[int, _Place], is_borne_out: Callable[..., bool]
) -> tuple[Mapping[int, _Place], bool]:
    """The places that images bear out, and whether nothing has changed there.

    During an interruption somebody may leave: of one place alone, with no other to be taken for,
    images may bear out less.
    """
    found = {n: place for n, place in placed.items() if is_borne_out(place.poses)}
    if found or len(placed) != 1:
        return found, True
    (place,) = placed.values()
    has_changed = bool(place.passed) and is_borne_out(place.poses, most_through=MOST_GONE)
    return (placed, False) if has_changed else (found, True)


def _unsure(passed: Sequence[Passage], b: Inside) -> Iterator[Mend]:
    """The interruptions that a set of frames (N,) was joined over, or all of it where none was."""
    for passage in passed:
        yield Mend(passage.i, passage.j, TAKEN, why=INTERRUPTED)
    if not passed:
        rows = np.flatnonzero(b)
        yield Mend(int(rows[0]), int(rows[-1]), TAKEN, why=ALIKE)


def _likely(
    passed: Mapping[int, Sequence[Passage]],
    is_alone: bool,
    is_sure: Callable[[int], bool],
    unlike: Callable[[int], float],
) -> tuple[list[int], bool]:
    """The number of the likely way to pass an interruption, and whether nothing speaks against it.

    ``passed``: of those that images bear out, by most votes; ``is_alone``: whether hardly any votes
    were for others; ``is_sure``: whether images bear one out in nearly all keyframes;
    ``unlike``: share of these that show something else. Several tell that things repeat themselves:
    then the pace counts, if there is one, and where images are sure of none or more than one,
    nothing is certain. No number where several are as likely.
    """
    usual = [n for n, each in passed.items() if all(passage.is_usual for passage in each)]
    if len(passed) < 2:
        return list(passed) if is_alone else usual, bool(usual)
    if lie_apart(passed.values()):
        return _only(usual), True
    sure, is_certain = _sure(passed, is_sure, unlike)
    if not any(passed.values()):
        return _only(sure) or list(passed)[:1], is_certain
    likely = set(sure or passed) & set(usual)
    return _only(sorted(likely)), is_certain


def _sure(
    numbers: Iterable[int], is_sure: Callable[[int], bool], unlike: Callable[[int], float]
) -> tuple[list[int], bool]:
    """The places that images are sure of, and whether this is one alone.

    Of several the one that shows less else than all others, if there is one.
    """
    sure = [n for n in numbers if is_sure(n)]
    if len(sure) < 2:
        return sure, len(sure) == 1
    shares = {n: unlike(n) for n in sure}
    least = min(shares.values())
    return _only([n for n in sure if shares[n] < least + CLEARLY]) or sure, False


def _only(numbers: list[int]) -> list[int]:
    """These where there is one alone, else none."""
    return numbers if len(numbers) == 1 else []

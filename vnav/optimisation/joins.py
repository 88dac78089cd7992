"""Which of several ways to join two sets of frames is right, by what their keyframes see."""

from collections.abc import Callable, Mapping, Sequence
from itertools import compress

import numpy as np

from vnav.core import se3
from vnav.core.arrays import Array
from vnav.core.frame import Edge
from vnav.core.graph import ends_of
from vnav.core.mapping import Odometry
from vnav.optimisation import pose_graph
from vnav.optimisation.interruptions import Passage, lie_apart, passages
from vnav.optimisation.second_look import SecondLook
from vnav.optimisation.segments import Inside, same_pose

ALONE = 0.8  # share of the votes of places that a place has which nothing contradicts


class Joins:
    """Alignments of sets of frames, tested by what their keyframes see.

    ``refused``: candidates (C,), closures and claims of odometry, of alignments that are wrong;
    ``unsure``: interruptions between sets that were joined, though other places look like that.
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
        self.unsure: list[Passage] = []

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
        fitted = {
            n: self._fitted(alignments[n], a, b, across)
            for n, across in enumerate(agreeing)
            if not self.refused[across].all()
        }
        found = {n: poses for n, poses in fitted.items() if look.is_borne_out(poses, a, b)}
        passed = {n: passages(self._odometry.frames, P, a, b) for n, P in found.items()}
        is_alone = agreeing[list(found)].sum() >= ALONE * agreeing.sum()
        right, is_certain = _likely(passed, is_alone, lambda n: look.is_sure(found[n], a, b))
        self.unsure += [each for n in right for each in passed[n] if not is_certain]
        agrees = [self._agreeing(fitted[n], a, b) for n in right or found]
        self.refused |= agreeing[list(fitted)].any(0) & ~np.any(agrees, axis=0)
        return right[0] if right else None

    def _fitted(self, poses: Array, a: Inside, b: Inside, across: Inside) -> Array:
        """Poses (N, 4, 4) without drift, by the candidates across that agree with them."""
        poses = np.where((a | b)[:, None, None], poses, np.nan)
        inside = [e for e in self._odometry.edges if (a | b)[e.i] and (a | b)[e.j]]
        within = (a[self._ends].all(1) | b[self._ends].all(1)) & ~self.refused
        used = list(compress(self._candidates, across | within))
        return pose_graph.optimise(poses, inside, used, self._max_sigmas).T_world_camera

    def _agreeing(self, poses: Array, a: Inside, b: Inside) -> Inside:
        """Which candidates (C,) between the two agree with poses."""
        i, j = self._ends.T
        T_i_j = np.stack([e.T_i_j for e in self._candidates])
        across = (a[i] & b[j]) | (b[i] & a[j])
        return np.asarray(across & same_pose(se3.inverse(poses[i] @ T_i_j) @ poses[j]))


def _likely(
    passed: Mapping[int, Sequence[Passage]], is_alone: bool, is_sure: Callable[[int], bool]
) -> tuple[list[int], bool]:
    """The number of the likely way to pass an interruption, and whether nothing speaks against it.

    ``passed``: of those that images bear out, by most votes; ``is_alone``: whether hardly any votes
    were for others; ``is_sure``: whether images bear one out in nearly all keyframes. Several tell
    that things repeat themselves: then the pace counts, and where images are sure of none or more
    than one, it alone tells. No number where several are as likely.
    """
    usual = [n for n, each in passed.items() if all(passage.is_usual for passage in each)]
    if len(passed) < 2:
        return list(passed) if is_alone else usual, bool(usual)
    if lie_apart(passed.values()):
        return _only(usual), True
    sure = [n for n in passed if is_sure(n)]
    if not any(passed.values()):
        return _only(sure) or list(passed)[:1], True
    likely = set(sure or passed) & set(usual)
    return _only(sorted(likely)), len(sure) == 1


def _only(numbers: list[int]) -> list[int]:
    """These where there is one alone, else none."""
    return numbers if len(numbers) == 1 else []

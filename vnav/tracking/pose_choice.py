"""Poses that one frame may have, and which of them all pixels bear out.

Motions from earlier frames to the current one imply poses of it in the track. Those that pixels
cannot tell apart are one, and each is judged against all the earlier frames at once: so the motions
to the best agree with each other.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import reduce
from math import sqrt
from operator import add

import numpy as np

from vnav.config import RegistrationConfig
from vnav.core import se3
from vnav.core.arrays import Array, Rows
from vnav.core.camera import Intrinsics
from vnav.core.frame import PoseEstimate
from vnav.core.mapping import FrameFeatures
from vnav.core.reduced_frame import ReducedFrame
from vnav.registration.judge import PixelEvidence, are_same, judge
from vnav.registration.pixel_evidence import DEPTH_DELAY_SIGMA_S

CLEAR = 0.95  # probability of a pose that needs no second look
UNSURE = 0.5  # probability, below which a pose is in doubt
DELAY_S = sqrt(2) * DEPTH_DELAY_SIGMA_S  # between two frames, each late by as much
MAX_POSES = 12  # that are judged
MUCH = 0.1  # share of an image that refutes a pose, where it is asked for another
MAX_LOG_ODDS = 10.0  # of the best pose over a rival by pixels: more, no motion after it makes up
MIN_ALTERNATIVE = 0.05  # probability of a pose that is kept beside the best
LogPrior = Callable[[Array], Array]  # how likely poses ``T_track_current`` (C, 4, 4) are
Motions = dict[int, PoseEstimate]  # to the current frame, by the row of the frame they are from


@dataclass(frozen=True)
class FollowedPoints:
    """Features that are those of an earlier frame, the ``source``: its ``rows`` (N,)."""

    source: FrameFeatures
    rows: Rows


@dataclass(frozen=True)
class TrackedFrame:
    """What tracking keeps of a frame: its features, and its pixels in blocks; its own camera.

    ``followed``: its features are those of an earlier frame, found again in this one.
    ``coarse``: those at half its size, of a frame that was described whole after them.
    ``is_new_view``: it was described whole since it sees enough else to become a keyframe.
    """

    features: FrameFeatures
    image: ReducedFrame
    camera: Intrinsics
    followed: FollowedPoints | None = None
    coarse: FrameFeatures | None = None
    is_new_view: bool = False

    @property
    def is_followed(self) -> bool:
        """Whether its features are those of an earlier frame."""
        return self.followed is not None

    @property
    def is_whole(self) -> bool:
        """Whether it has all features of its own."""
        return not (self.is_followed or self.features.is_coarse)

    def features_for(self, other: "TrackedFrame") -> FrameFeatures:
        """What another frame's features are held against: coarse ones against coarse ones."""
        return self.coarse or self.features if other.features.is_coarse else self.features

    def knowing(self, features: FrameFeatures) -> "TrackedFrame":
        """The frame with more told of its features, all or coarse ones."""
        if features.is_coarse and not self.features.is_coarse:
            return replace(self, coarse=features)
        return replace(self, features=features)


@dataclass(frozen=True)
class Target:
    """An earlier frame that the current one is registered against, at its pose in the track."""

    frame: TrackedFrame
    T_track_camera: Array

    @property
    def row(self) -> int:
        """In the frame table."""
        return self.frame.features.row

    def motion(self, T_track_current: Array) -> Array:
        """``T_a_b`` from this frame to a pose of the current one."""
        return np.asarray(se3.inverse(self.T_track_camera) @ T_track_current)

    def pose(self, T_a_b: Array) -> Array:
        """``T_track_current`` where a motion from this frame leads."""
        return np.asarray(self.T_track_camera @ T_a_b)


@dataclass(frozen=True)
class Rivals:
    """Motions from one frame, the ``target`` by its row, to the places where the next may be.

    ``log_odds`` (C,): of each over the first, by the pixels of the two frames, or of all targets
    where these say less: a slide before may have put the others in the wrong place.
    """

    target: int
    estimates: tuple[PoseEstimate, ...]
    log_odds: Array


@dataclass(frozen=True)
class ChosenMotions:
    """Motions to the best pose, and to the next if that is about as good; with probabilities.

    ``rivals``: those from the newest target, that to the best pose first; None where it has none.
    """

    estimates: Motions = field(default_factory=dict)
    alternatives: Motions = field(default_factory=dict)
    rivals: Rivals | None = None

    @property
    def probability(self) -> float:
        """That the motions to the best pose are the camera's; 1 where there are none."""
        return min((e.probability for e in self.estimates.values()), default=1.0)

    def from_row(self, row: int) -> list[PoseEstimate]:
        """Those from one frame: to the best pose, to the next, and to its rivals."""
        found = [motions[row] for motions in (self.estimates, self.alternatives) if row in motions]
        rivals = self.rivals.estimates if self.rivals and self.rivals.target == row else ()
        return [*found, *rivals]

    def exchanged(self) -> "ChosenMotions":
        """The next pose for the best, as probable as that was, where more than pixels says so."""
        p, q = self.probability, ChosenMotions(self.alternatives).probability
        return ChosenMotions(_as_likely(self.alternatives, p), _as_likely(self.estimates, q))


def _as_likely(motions: Motions, probability: float) -> Motions:
    return {row: replace(e, probability=probability) for row, e in motions.items()}


@dataclass(frozen=True)
class _Pose:
    """Where the frame may be in the track, and the motions that lead there."""

    T_track_current: Array
    motions: Motions = field(default_factory=dict)


def evenly_likely(T_track_current: Array) -> Array:
    """The prior (C,) of poses where nothing is known of the motion."""
    return np.zeros(len(T_track_current))


class PoseChoice:
    """The poses that are suggested of a frame, held against the targets, of which one at least."""

    def __init__(
        self,
        targets: Sequence[Target],
        current: ReducedFrame,
        config: RegistrationConfig,
        log_prior: LogPrior = evenly_likely,
    ) -> None:
        self._targets, self._current, self._config = targets, current, config
        self._log_prior = log_prior
        self._poses: list[_Pose] = []
        self._probabilities = self._refuting = np.zeros(0)
        self._log_odds = np.zeros((0, 0))  # of each pose over each, by the newest target and all

    @property
    def poses(self) -> list[Array]:
        """Those suggested so far, each ``T_track_current``."""
        return [pose.T_track_current for pose in self._poses]

    @property
    def best(self) -> Array | None:
        """The most probable pose as last judged; None before that."""
        return self.poses[int(self._probabilities.argmax())] if len(self._probabilities) else None

    def suggest(self, poses: Sequence[Array]) -> None:
        """Add poses without motions, each ``T_track_current``."""
        for pose in poses:
            self._known(pose)

    def add(self, target: Target, estimates: Sequence[PoseEstimate]) -> None:
        """Add the poses that motions from a target lead to; of two to one pose the better.

        One that features bear out and one by pixels alone, which was there before, become one.
        """
        row = target.row
        for estimate in estimates:
            pose = self._known(target.pose(estimate.T_a_b))
            known = pose.motions.get(row)
            if known is not None and estimate.agreeing and not known.agreeing:
                pose.motions[row] = estimate.fused(known)
            elif known is None or known.agreeing < estimate.agreeing:
                pose.motions[row] = estimate

    def missing(self, target: Target) -> list[Array]:
        """The poses that no motion from a target leads to."""
        return [p.T_track_current for p in self._poses if target.row not in p.motions]

    def leads_to(self, T_track_current: Array) -> bool:
        """Whether any motion leads to a pose."""
        return any(
            p.motions and self._are_one(p.T_track_current, T_track_current) for p in self._poses
        )

    def drop(self, T_track_current: Array) -> None:
        """Take a pose back, unless a motion leads there."""
        self._poses = [
            p for p in self._poses if p.motions or p.T_track_current is not T_track_current
        ]
        self._probabilities = np.zeros(0)

    def judge(self) -> None:
        """Weigh the poses by the pixels of all targets, where there are others than before.

        Where these leave it open, as among people who walk along, the prior counts.
        """
        if len(self._probabilities) == len(self._poses):
            return
        evidence = [self._judged(target) for target in self._targets]
        log_prior = self._log_prior(np.stack(self.poses))
        of_all = reduce(add, evidence)
        self._log_odds = np.minimum(evidence[0].log_odds, of_all.log_odds)
        self._probabilities, self._refuting = of_all.posterior(log_prior), of_all.refuting

    def _judged(self, target: Target) -> PixelEvidence:
        """What a target's pixels say of the poses."""
        motions = [target.motion(T) for T in self.poses]
        images = target.frame.image, self._current
        return judge(*images, motions, self._config, follow=True)

    @property
    def is_refuted(self) -> bool:
        """Whether much of what the images show refutes the best pose."""
        return bool(self._refuting[self._probabilities.argmax()] >= MUCH)

    @property
    def is_sure(self) -> bool:
        """Whether one pose is the best by far."""
        return bool(self._probabilities.max() >= CLEAR)

    @property
    def is_clear(self) -> bool:
        """Whether one pose is the best by far, and all targets that move anywhere move there."""
        best = int(self._probabilities.argmax())
        rows = {row for pose in self._poses for row in pose.motions}
        return self.is_sure and rows == set(self._poses[best].motions)

    def result(self) -> ChosenMotions:
        """The motions to the best pose that any lead to, and to the next of them."""
        order = np.argsort(-self._probabilities, kind="stable")
        best, *others = [k for k in order.tolist() if self._poses[k].motions] or [None]
        if best is None:
            return ChosenMotions()
        alike = self._like(best)
        estimates, rivals = self._weighed(best, alike), self._rivals(best)
        others = [k for k in others if k not in alike]
        if not others or self._probabilities[others[0]] < MIN_ALTERNATIVE:
            return ChosenMotions(estimates, rivals=rivals)
        other = self._weighed(others[0], others[:1])
        alternatives = {row: e for row, e in other.items() if row in estimates}
        return ChosenMotions(estimates, alternatives, rivals)

    def _rivals(self, best: int) -> Rivals | None:
        """Motions from the newest target to the best pose, and to those not far less likely."""
        row, log_odds = self._targets[0].row, self._log_odds[:, best]
        if row not in self._poses[best].motions:
            return None
        others = [k for k, p in enumerate(self._poses) if k != best and row in p.motions]
        numbers = [best, *(k for k in others if log_odds[k] > -MAX_LOG_ODDS)]
        estimates = tuple(self._poses[k].motions[row] for k in numbers)
        return Rivals(row, estimates, log_odds[numbers])

    def _like(self, number: int) -> list[int]:
        """The numbers of poses that may be this one, for all that delays are unknown."""
        T = self.poses[number]
        others = enumerate(self.poses)
        return [k for k, U in others if k == number or self._are_one(T, U, DELAY_S)]

    def _are_one(self, T: Array, U: Array, delay_s: float = 0.0) -> bool:
        """Whether pixels cannot tell two poses apart, by the first target's view."""
        first = self._targets[0]
        return are_same(first.frame.image, first.motion(T), first.motion(U), self._config, delay_s)

    def _weighed(self, number: int, alike: Sequence[int]) -> Motions:
        """The motions to a pose, that of the newest target first; the probability of all alike."""
        p = min(1.0, float(self._probabilities[list(alike)].sum()))  # a sum is rounded
        return _as_likely(dict(sorted(self._poses[number].motions.items(), reverse=True)), p)

    def _known(self, T_track_current: Array) -> _Pose:
        """The pose that stands for this one, which may be new; beyond the limit it is nowhere."""
        for pose in self._poses:
            if self._are_one(pose.T_track_current, T_track_current):
                return pose
        pose = _Pose(T_track_current)
        if len(self._poses) < MAX_POSES:
            self._poses.append(pose)
        return pose

"""The search for a frame's pose: several hypotheses, one judge."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from vnav.config import Config
from vnav.core.arrays import Array
from vnav.core.frame import PoseEstimate, Rejected
from vnav.core.mapping import FrameFeatures
from vnav.features.matching import DescriptorMatcher
from vnav.registration.followed_points import FollowedRegistration
from vnav.registration.points3d import PointRegistration
from vnav.tracking.pose_choice import (
    ChosenMotions,
    LogPrior,
    PoseChoice,
    Target,
    TrackedFrame,
    evenly_likely,
)


class PoseSearch:
    """Registers a frame against earlier ones of one track, so that all motions agree."""

    def __init__(self, config: Config) -> None:
        self._config, self._seed = config.registration, config.seed
        self._matcher = DescriptorMatcher(config.registration)

    def search(
        self,
        targets: Sequence[Target],
        current: TrackedFrame,
        expected: Sequence[Array],
        log_prior: LogPrior = evenly_likely,
    ) -> ChosenMotions:
        """Motions from the targets to the pose of a frame that is judged best; none without any.

        Poses that matches agree on, from one target after the other, are held against those that
        are ``expected`` without matches, ``T_track_current``, the most likely first. Unless one is
        clearly the best, more are sought: near all so far, and among twins. ``log_prior``: what is
        known of the pose beforehand.
        """
        choice = PoseChoice(targets, current.image, self._config, log_prior)
        for target in targets:
            choice.add(target, self._registered(target, current, choice.best, expected))
            if choice.poses:
                choice.suggest(expected)
                choice.judge()
        if choice.poses and not choice.is_clear:
            for target in targets:
                self._seek(choice, target, current)
            choice.judge()
        return choice.result()

    def near(
        self, targets: Sequence[Target], current: TrackedFrame, choice: ChosenMotions
    ) -> ChosenMotions:
        """A choice by other features of the frame, with the motions that its own tell near it.

        Some of the targets are those of the choice. None where too few features agree.
        """
        poses = [t.pose(choice.estimates[t.row]) for t in targets if t.row in choice.estimates]
        found = {}
        for target in targets if poses else []:
            a, b, pair = self._pair(target, current)
            near = pair.register_near(a, b, target.motion(poses[0]))
            if isinstance(near, PoseEstimate):
                found[target.row] = replace(near, probability=choice.probability)
        others = {row: e for row, e in choice.alternatives.items() if row in found}
        return ChosenMotions(found, others)

    def _registered(
        self,
        target: Target,
        current: TrackedFrame,
        best: Array | None,
        expected: Sequence[Array],
    ) -> list[PoseEstimate]:
        """The motion from a target to the best pose so far, else all that matches agree on."""
        a, b, pair = self._pair(target, current)
        predicted = target.motion(best if best is not None else expected[0]) if expected else None
        if best is not None:
            near = pair.register_near(a, b, target.motion(best))
            if isinstance(near, PoseEstimate):
                return [near]
        found = pair.hypotheses(a, b, self._rng(target, current), predicted)
        return [] if isinstance(found, Rejected) else found

    def _seek(self, choice: PoseChoice, target: Target, current: TrackedFrame) -> None:
        """Suggest more poses: by matches of a target near those so far, and by those among twins.

        An expected pose near which matches agree on others has those in its stead.
        """
        a, b, pair = self._pair(target, current)
        predicted, rng = target.motion(choice.poses[0]), self._rng(target, current)
        for pose in choice.missing(target):
            near = pair.hypotheses_near(a, b, target.motion(pose))
            if near:
                choice.add(target, near)
                choice.drop(pose)
        choice.add(target, pair.among_twins(a, b, rng, predicted))

    def _pair(
        self, target: Target, current: TrackedFrame
    ) -> tuple[FrameFeatures, FrameFeatures, PointRegistration]:
        """Features of the target and of the frame that compare, and what registers them."""
        images, camera = (target.frame.image, current.image), current.camera
        a, followed = target.frame.features_for(current), current.followed
        of_pair = camera, camera, self._config, self._matcher, images
        if followed is not None and followed.source is a:
            return a, current.features, FollowedRegistration(*of_pair, followed.rows)
        return a, current.features, PointRegistration(*of_pair)

    def _rng(self, target: Target, current: TrackedFrame) -> np.random.Generator:
        return np.random.default_rng([self._seed, target.row, current.features.row])

"""The search for a frame's pose: several hypotheses, one judge."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from vnav.config import Config
from vnav.core import se3
from vnav.core.arrays import Array
from vnav.core.frame import PoseEstimate, Rejected
from vnav.core.mapping import FrameFeatures
from vnav.core.reduced_frame import ReducedFrame
from vnav.features.matching import DescriptorMatcher
from vnav.registration.dense import align_near, fitted_near
from vnav.registration.followed_points import FollowedRegistration
from vnav.registration.judge import refuted
from vnav.registration.points3d import PointRegistration
from vnav.tracking.pose_choice import (
    ChosenMotions,
    LogPrior,
    PoseChoice,
    Target,
    TrackedFrame,
    evenly_likely,
)

PARTS = 3  # of an image that are asked, each for what it has against the pose by the one before


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
        clearly the best, more are sought: near all so far, and among twins; then where all pixels
        fit best. Where much refutes even the best, that is asked for another. ``log_prior``: what
        is known of the pose beforehand.
        """
        choice = PoseChoice(targets, current.image, self._config, log_prior)
        for target in targets:
            choice.add(target, self._registered(target, current, choice.best, expected))
            if choice.poses:
                choice.suggest(expected)
                choice.judge()
        if choice.poses:
            self._seek_others(choice, targets, current, expected)
        return choice.result()

    def near(
        self, targets: Sequence[Target], current: TrackedFrame, choice: ChosenMotions
    ) -> ChosenMotions:
        """A choice by other features of the frame, with the motions that its own tell near it.

        Some of the targets are those of the choice. None where too few features agree.
        """
        poses = [
            t.pose(choice.estimates[t.row].T_a_b) for t in targets if t.row in choice.estimates
        ]
        found = {}
        for target in targets if poses else []:
            a, b, pair = self._pair(target, current)
            near = pair.register_near(a, b, target.motion(poses[0]))
            if isinstance(near, PoseEstimate):
                found[target.row] = replace(near, probability=choice.probability)
        others = {row: e for row, e in choice.alternatives.items() if row in found}
        return ChosenMotions(found, others)

    def by_pixels(
        self,
        targets: Sequence[Target],
        current: TrackedFrame,
        choice: ChosenMotions,
        expected: Sequence[Array],
        log_prior: LogPrior = evenly_likely,
    ) -> ChosenMotions:
        """The choice again, after motions by all pixels were held against those of features.

        They are sought from the first target, near the chosen pose and near those expected. Where
        both lead to one pose, they tell the motion together. Rivals of the choice stay rivals.
        """
        first, poses = targets[0], PoseChoice(targets, current.image, self._config, log_prior)
        known = [(t, found) for t in targets for found in choice.from_row(t.row)]
        poses.suggest([target.pose(estimate.T_a_b) for target, estimate in known])
        poses.suggest(expected)
        for pose in poses.poses:
            poses.add(first, self._aligned(first, current, pose))
        for target, estimate in known:
            poses.add(target, [estimate])
        poses.judge()
        return poses.result()

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

    def _seek_others(
        self,
        choice: PoseChoice,
        targets: Sequence[Target],
        current: TrackedFrame,
        expected: Sequence[Array],
    ) -> None:
        """Suggest more poses, in one way after the other, where those so far leave it open."""
        if not choice.is_clear:
            for target in targets:
                self._seek(choice, target, current)
            choice.judge()
        if expected and not (choice.is_sure or current.is_followed):
            self._seek_by_pixels(choice, targets[0], current, expected[0])
            choice.judge()
        if choice.is_refuted:
            for target in targets:
                self._seek_refuting(choice, target, current)

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

    def _seek_by_pixels(
        self, choice: PoseChoice, target: Target, current: TrackedFrame, expected: Array
    ) -> None:
        """Suggest the pose by matches near where all pixels fit best, from the expected one.

        Where no motion leads there: what repeats may have matches in other places alone, and where
        a pan ends, the expected pose is too far off for matches near it.
        """
        a, b, pair = self._pair(target, current)
        images = target.frame.image, current.image
        fitted = fitted_near(*images, self._config, target.motion(expected))
        if not choice.leads_to(target.pose(fitted)):
            choice.add(target, pair.hypotheses_near(a, b, fitted))

    def _aligned(self, target: Target, current: TrackedFrame, pose: Array) -> list[PoseEstimate]:
        """The motion near a pose by all pixels, which no feature bears out; none if few agree."""
        images = target.frame.image, current.image
        found = align_near(*images, self._config, target.motion(pose))
        if isinstance(found, Rejected):
            return []
        return [PoseEstimate(found.T_a_b, found.information, np.zeros((0, 2), np.int32), 0)]

    def _seek_refuting(self, choice: PoseChoice, target: Target, current: TrackedFrame) -> None:
        """Suggest the pose by the part of the images that refutes the best, and so on with that."""
        a, b, pair = self._pair(target, current)
        for _ in range(PARTS):
            best = choice.best
            assert best is not None
            T_a_b = self._by_refuting(target.frame.image, current.image, target.motion(best))
            choice.suggest([target.pose(T_a_b)])
            choice.add(target, pair.hypotheses_near(a, b, T_a_b))
            choice.judge()
            if choice.best is best or not choice.is_refuted:
                return

    def _by_refuting(self, a: ReducedFrame, b: ReducedFrame, T_a_b: Array) -> Array:
        """The motion that fits the part of an image best that refutes one."""
        T_b_a, config = se3.inverse(T_a_b), self._config
        of_a, of_b = refuted(b, a, T_b_a, config), refuted(a, b, T_a_b, config)
        if of_b.mean() > of_a.mean():
            return fitted_near(a, b.without(~of_b), config, T_a_b)
        return np.asarray(se3.inverse(fitted_near(b, a.without(~of_a), config, T_b_a)))

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

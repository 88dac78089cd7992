"""Two frames registered by their matched features: claim 3, S3 to S5."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from math import ceil
from typing import Protocol, cast

import numpy as np
from numpy.typing import NDArray

from vnav.config import RegistrationConfig
from vnav.core import se3
from vnav.core.arrays import Array
from vnav.core.camera import Intrinsics
from vnav.core.frame import Features, PoseEstimate, Rejected
from vnav.core.mapping import FrameFeatures
from vnav.registration.correspondences import Correspondences, ImagesInBlocks
from vnav.registration.estimators import estimator
from vnav.registration.far_features import RADIUS_PX, count_without_depth, points
from vnav.registration.finer_motions import finer_motions

TWINS_SOUGHT = 64  # of the matches that agree, evenly spread over them
FITTING_SIGMAS = 6.0  # that a match may be off a pose that is predicted, and not measured
MOTIONS = 3  # of a set of matches: the camera's, and those of what repeats or moves
FINELY_ASKED = 100  # matches that are asked whether they show two motions


class Matcher(Protocol):
    """Finds which features of two frames are the same: rows (M, 2) of a's and b's."""

    def match(self, a: Features, b: Features) -> NDArray[np.int32]:
        """Matches over the whole image."""

    def match_guided(
        self, a: Features, b: Features, predicted_px: Array, radius_px: float
    ) -> NDArray[np.int32]:
        """Matches close to where a's features are predicted in b, NaN for those with no place."""

    def without_ratio(self) -> "Matcher":
        """The same, but the nearest is a match however near the second nearest is."""


@dataclass(frozen=True)
class PointRegistration:
    """Registers frame b, taken by ``camera_b``, against frame a, taken by ``camera_a``.

    ``config`` says how far pixels and depths are trusted, and names the estimator of the motion.
    ``images``: of a and of b, for those that ask for them.
    """

    camera_a: Intrinsics
    camera_b: Intrinsics
    config: RegistrationConfig
    matcher: Matcher
    images: ImagesInBlocks | None = None

    def register(
        self,
        a: FrameFeatures,
        b: FrameFeatures,
        rng: np.random.Generator,
        predicted: Array | None = None,
    ) -> PoseEstimate | Rejected:
        """How camera b stands to camera a, or why that cannot be told.

        The one of its `hypotheses` with the most inliers, where one is sought in each way.
        """
        found = self.hypotheses(a, b, rng, predicted, 1)
        if isinstance(found, Rejected):
            return found
        return max(found, key=lambda estimate: estimate.agreeing)

    def hypotheses(
        self,
        a: FrameFeatures,
        b: FrameFeatures,
        rng: np.random.Generator,
        predicted: Array | None = None,
        count: int = MOTIONS,
    ) -> list[PoseEstimate] | Rejected:
        """The motions ``T_a_b`` that many matches agree on, at most ``count`` of each way to match.

        Matches, RANSAC on three matched 3D points each, then robust non-linear refinement of
        reprojection and inverse depth with the sensor's noise. Where a motion is ``predicted``, the
        strongest features are first matched near the places that it gives. Unless nearly all of
        those agree, and are alike nowhere else, features are also matched over the whole image:
        near wrong places, wrong matches can agree, by chance or as things repeat. With each motion
        found, features are matched once more, close to where it puts them. Where several are asked
        for, the motions come in addition that one of these mixes.
        """
        guided = self._guided(a, b, rng, predicted, count)
        if not isinstance(guided, Rejected) and self._is_sure(guided[0], a, b):
            found = guided[:1]
        else:
            unguided = self._unguided(a, b, rng, count)
            found = [e for way in (guided, unguided) if not isinstance(way, Rejected) for e in way]
            if not found:
                return cast(Rejected, unguided)
        again = [self._matched_again(estimate, a, b) for estimate in found]
        return self._with_parts(again, a, b, rng) if count > 1 else again

    def among_twins(
        self, a: FrameFeatures, b: FrameFeatures, rng: np.random.Generator, predicted: Array
    ) -> list[PoseEstimate]:
        """The motions near a prediction that matches agree on, the ratio test left out.

        Among things that look the same the nearest descriptor is that of any of them, so that each
        of several motions has its share of the matches.
        """
        matcher = self.matcher.without_ratio()
        pair = replace(self, matcher=matcher)
        matches = pair.match_guided(a, b, predicted, self.config.search_radius_px)
        found = self._motions(a, b, matches, rng, MOTIONS)
        return [] if isinstance(found, Rejected) else found

    def register_near(
        self, a: FrameFeatures, b: FrameFeatures, T_a_b: Array, at_least: int = 0
    ) -> PoseEstimate | Rejected:
        """The motion from matches close to where a first one puts them, if there are so many."""
        matches = self.match_guided(a, b, T_a_b, self.config.refine_radius_px)
        return self._refined(T_a_b, a, b, matches, at_least)

    def hypotheses_near(
        self, a: FrameFeatures, b: FrameFeatures, T_a_b: Array
    ) -> list[PoseEstimate]:
        """The motions from matches close to where a first one puts them: by all, by those it fits.

        Somebody who walks ahead of the camera is close to where its motion puts him, but in depth
        not there. All matches together may settle on his motion.
        """
        matches = self.match_guided(a, b, T_a_b, self.config.refine_radius_px)
        fitting = self._correspondences(a, b, matches).squared(T_a_b) < FITTING_SIGMAS**2
        found = [self._refined(T_a_b, a, b, rows) for rows in (matches, matches[fitting])]
        return [estimate for estimate in found if isinstance(estimate, PoseEstimate)]

    def match_guided(
        self,
        a: FrameFeatures,
        b: FrameFeatures,
        T_a_b: Array,
        radius_px: float,
        strongest: int | None = None,
    ) -> NDArray[np.int32]:
        """Rows (M, 2) of a's and b's features that match close to where a motion puts one's point.

        Points of a are sought in b; where ``one_sided_depth``, those of b that are left are sought
        in a, among the features that have no depth. Where few have any, so are those without it.
        Only the ``strongest`` are sought, or all.
        """
        found = self._match_guided(a, b, T_a_b, radius_px, strongest)
        if not count_without_depth(a, b):
            return found
        in_b = self._projected_far(a, T_a_b, strongest)
        far = self.matcher.match_guided(a.features, b.features, in_b, max(radius_px, RADIUS_PX))
        taken = np.isin(far[:, 0], found[:, 0]) | np.isin(far[:, 1], found[:, 1])
        return np.concatenate([found, far[~(taken | b.has_depth[far[:, 1]])]])

    def _match_guided(
        self,
        a: FrameFeatures,
        b: FrameFeatures,
        T_a_b: Array,
        radius_px: float,
        strongest: int | None,
    ) -> NDArray[np.int32]:
        """Those that have depth in a or, where ``one_sided_depth``, in b."""
        in_b = _projected(a, T_a_b, self.camera_b, strongest)
        found = self.matcher.match_guided(a.features, b.features, in_b, radius_px)
        if not self.config.one_sided_depth:
            return found
        in_a = _projected(b, se3.inverse(T_a_b), self.camera_a, strongest)
        back = self.matcher.match_guided(b.features, a.features, in_a, radius_px)[:, ::-1]
        only_b = ~a.has_depth[back[:, 0]] & ~np.isin(back[:, 1], found[:, 1])
        return np.concatenate([found, back[only_b]])

    def _projected_far(self, a: FrameFeatures, T_a_b: Array, strongest: int | None) -> Array:
        """Where b sees a's strongest features without depth: pixels (N, 2), NaN for all others."""
        predicted_px = np.full((len(a.features), 2), np.nan)
        rows = np.flatnonzero(~a.has_depth)[:strongest]
        points_b = se3.transform(se3.inverse(T_a_b), points(a, rows, self.camera_a))
        predicted_px[rows] = self.camera_b.project(points_b)
        return predicted_px

    def _refined(
        self,
        T_a_b: Array,
        a: FrameFeatures,
        b: FrameFeatures,
        matches: NDArray[np.int32],
        at_least: int = 0,
    ) -> PoseEstimate | Rejected:
        """The motion that matches agree on near a first one, if there are so many."""
        if len(matches) < max(at_least, self.config.min_inliers):
            return Rejected("too few matches", len(matches))
        return estimator(self.config).refine(T_a_b, self._correspondences(a, b, matches))

    def _is_sure(self, guided: PoseEstimate, a: FrameFeatures, b: FrameFeatures) -> bool:
        """Whether nearly all matches agree, and nearly all have no twin elsewhere in b's image."""
        enough = self.config.search_min_inlier_share
        inliers = np.concatenate([guided.inliers, guided.far])
        if guided.inlier_share < enough:
            return False
        asked = inliers[:: ceil(len(inliers) / TWINS_SOUGHT)]
        of_a = a.features[asked[:, 0].astype(np.intp)]
        rows, nearest = self.matcher.without_ratio().match(of_a, b.features).T
        px = b.features.keypoints_px
        off = np.linalg.norm(px[nearest] - px[asked[rows, 1]], axis=1)
        return bool((off < self.config.refine_radius_px).sum() >= enough * len(asked))

    def _guided(
        self,
        a: FrameFeatures,
        b: FrameFeatures,
        rng: np.random.Generator,
        predicted: Array | None,
        count: int,
    ) -> list[PoseEstimate] | Rejected:
        """By matches near the predicted places of the strongest features.

        Few with depth may agree on no motion where, with those without it, they bear out the
        predicted one.
        """
        if predicted is None:
            return Rejected("no prediction")
        radius_px, strongest = self.config.search_radius_px, self.config.search_features
        matches = self.match_guided(a, b, predicted, radius_px, strongest)
        found = self._motions(a, b, matches, rng, count)
        if isinstance(found, Rejected) and count_without_depth(a, b):
            near = self.register_near(a, b, predicted)
            return near if isinstance(near, Rejected) else [near]
        return found

    def _unguided(
        self, a: FrameFeatures, b: FrameFeatures, rng: np.random.Generator, count: int
    ) -> list[PoseEstimate] | Rejected:
        """By matches over the whole image."""
        matches = self.matcher.match(a.features, b.features)
        of_a, of_b = a.has_depth[matches[:, 0]], b.has_depth[matches[:, 1]]
        asked = of_a | of_b if self.config.one_sided_depth else of_a
        if count_without_depth(a, b):
            asked = asked | ~(of_a | of_b)
        return self._motions(a, b, matches[asked], rng, count)

    def _motions(
        self,
        a: FrameFeatures,
        b: FrameFeatures,
        matches: NDArray[np.int32],
        rng: np.random.Generator,
        count: int,
    ) -> list[PoseEstimate] | Rejected:
        """Sequential RANSAC: the motion that most matches agree with, and again of the rest."""
        found: list[PoseEstimate] = []
        of_matches = estimator(self.config)
        rejected = Rejected("too few matches", len(matches))
        while len(found) < count and len(matches) >= self.config.min_inliers:
            correspondences = self._correspondences(a, b, matches)
            estimate = of_matches.estimate(correspondences, rng)
            if isinstance(estimate, Rejected):
                rejected = estimate
                break
            found.append(estimate)
            taken = np.concatenate([estimate.inliers[:, 0], estimate.far[:, 0]])
            matches = matches[~np.isin(matches[:, 0], taken)]
        return found or rejected

    def _with_parts(
        self,
        found: Sequence[PoseEstimate],
        a: FrameFeatures,
        b: FrameFeatures,
        rng: np.random.Generator,
    ) -> list[PoseEstimate]:
        """Motions, each with those that it mixes, or the one in its place."""
        return [e for whole in found for e in self._parts(whole, a, b, rng)]

    def _parts(
        self, whole: PoseEstimate, a: FrameFeatures, b: FrameFeatures, rng: np.random.Generator
    ) -> list[PoseEstimate]:
        """A motion and the two that it mixes, or in its place that of most of its matches.

        What moves little from frame to frame agrees with what stands still, but for a few pixels.
        Of two each has the matches that it is nearer to.
        """
        every = max(1, ceil(len(whole.inliers) / FINELY_ASKED))  # of far features there is none
        of, asked = partial(self._correspondences, a, b), whole.inliers[::every]
        motions = finer_motions(of, asked, whole.T_a_b, rng)
        if not motions:
            return [whole]
        nearest = np.argmin([of(whole.inliers).squared(T) for T in motions], 0)
        refined = [
            self._refined(T, a, b, whole.inliers[nearest == k]) for k, T in enumerate(motions)
        ]
        parts = [estimate for estimate in refined if isinstance(estimate, PoseEstimate)]
        return parts if len(motions) == 1 and parts else [whole, *parts]

    def _matched_again(
        self, estimate: PoseEstimate, a: FrameFeatures, b: FrameFeatures
    ) -> PoseEstimate:
        """The estimate from all matches close to where the motion puts them, if those are more."""
        refined = self.register_near(a, b, estimate.T_a_b, estimate.agreeing + 1)
        return refined if isinstance(refined, PoseEstimate) else estimate

    def _correspondences(
        self, a: FrameFeatures, b: FrameFeatures, matches: NDArray[np.int32]
    ) -> Correspondences:
        cameras = self.camera_a, self.camera_b
        return Correspondences(a, b, matches, cameras, self.config, self.images)


def _projected(
    a: FrameFeatures, T_a_b: Array, camera_b: Intrinsics, strongest: int | None
) -> Array:
    """Where b sees the points of a's strongest features: pixels (N, 2), NaN for all others."""
    predicted_px = np.full((len(a.features), 2), np.nan)
    points_b = se3.transform(se3.inverse(T_a_b), a.points_camera[:strongest])
    predicted_px[:strongest] = camera_b.project(points_b)
    return predicted_px

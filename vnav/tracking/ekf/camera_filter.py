"""One image after another through the filter: [000 section 3], [001 section 4]."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from vnav.config import Config
from vnav.core.arrays import Array, Floats, Rows
from vnav.core.camera import Intrinsics
from vnav.core.frame import Rejected
from vnav.features.description import undescribed
from vnav.tracking.correlation import TEMPLATE_PX
from vnav.tracking.ekf.features import TrackedFeature, new_corners
from vnav.tracking.ekf.image_turn import turned
from vnav.tracking.ekf.measurement_model import Measurement, measure, pixels, points
from vnav.tracking.ekf.motion_model import predict
from vnav.tracking.ekf.new_features import with_features
from vnav.tracking.ekf.one_point_ransac import (
    high_innovation_inliers,
    low_innovation_inliers,
)
from vnav.tracking.ekf.state import CAMERA, FEATURE, FilterState, at_rest
from vnav.tracking.ekf.template_search import search
from vnav.tracking.ekf.templates import Template, cut
from vnav.tracking.ekf.update import innovation_covariances, updated
from vnav.tracking.trackers.klt import KltTracker

VELOCITY_SIGMA_M_S, SPIN_SIGMA_RAD_S = 1.0, 1.0  # of a camera that nothing is known of
UNKNOWN_FRAMES = 2  # at the beginning, whose motion no state predicts
FEW = 0.3  # share of the matches: where fewer agree, the motion was not predicted either
FEW_OF_FOLLOWED = 0.25  # share of the followed features whose templates are found
SHAKEN = 2.0  # times the deviation of a pixel, where a camera shakes: rows are seen one by one
WITHOUT_PREDICTION = 3  # matches that tell a motion
BORDER_PX = 6  # templates nearer to the image's edge are not whole
KNOWN = 0.2  # largest relative deviation of the inverse depth of a landmark


@dataclass(frozen=True)
class FilterImage:
    """What the filter takes of a frame: colour (H, W, 3), grey levels, also small, and depth."""

    color: NDArray[np.uint8]
    gray: NDArray[np.uint8]
    small: Floats
    depth_m: NDArray[np.float32]


@dataclass(frozen=True)
class Agreed:
    """Where features are found (N, 2), rows of those that agree on one motion, of how many.

    ``size``: matches that tell a motion; ``draws``: motions that were tried; ``by_template``: the
    features are where their templates are.
    """

    px: Array
    rows: Rows
    matches: int
    size: int
    draws: int
    sigma_px: float
    by_template: bool = True

    @property
    def support(self) -> int:
        """Matches that agree with the first of those that the motion is drawn from."""
        return len(self.rows) - self.size + 1


@dataclass(frozen=True)
class Followed:
    """How many features an image was to show and how many were found; numbers of those matched.

    ``low`` and ``high``: of low and of high innovation; ``draws``: motions that were tried.
    """

    predicted: int
    matches: int
    low: tuple[int, ...]
    high: tuple[int, ...]
    draws: int


class CameraFilter:
    """The state of a camera and its features, and how these looked first."""

    def __init__(
        self, first: FilterImage, camera: Intrinsics, config: Config, rng: np.random.Generator
    ) -> None:
        self._camera, self._config, self._ekf, self._rng = camera, config, config.tracking.ekf, rng
        self.state = at_rest(VELOCITY_SIGMA_M_S, SPIN_SIGMA_RAD_S)
        self.landmarks: list[Array] = []  # points (3,) in the world of features that have left
        self._features: list[TrackedFeature] = []
        self._is_lost = False
        self._frames = self._count = 0
        self._small = first.small
        self._add_features(first)
        self._follow_from(first)

    def track(self, image: FilterImage, step_s: float) -> Followed | Rejected:
        """Predict, match, update by low, then by high innovations, and renew the features.

        Where too few matches agree, the state is the predicted one.
        """
        self._predict(image, step_s)
        seen = self._in_view()
        agreed = self._agreed(image, seen)
        low = agreed.rows
        self._is_lost = agreed.support < self._ekf.min_inliers
        if self._is_lost:
            return Rejected("too few features found again", agreed.matches, len(low))
        self.state = updated(self.state, seen[low], agreed.px[low], agreed.sigma_px)
        rest = np.setdiff1d(np.arange(len(seen.features)), low)
        high = rest[self._rescue(image, seen.features[rest])]
        self._note(seen.features, np.append(low, high) if agreed.by_template else high)
        numbers = [self._features[k].number for k in seen.features]
        self._drop_features(seen.features)
        self._add_features(image)
        self._follow_from(image)
        matched = [tuple(numbers[k] for k in rows) for rows in (low, high)]
        return Followed(len(numbers), agreed.matches, matched[0], matched[1], agreed.draws)

    @property
    def can_follow(self) -> bool:
        """Whether there are features enough."""
        return len(self._features) >= self._ekf.min_inliers

    @property
    def numbers(self) -> frozenset[int]:
        """Of the features in the state."""
        return frozenset(feature.number for feature in self._features)

    def finish(self) -> Array:
        """All landmarks (N, 3) in the world, those of the last state too."""
        self._keep_landmarks(np.arange(len(self._features)))
        return np.array(self.landmarks).reshape(-1, 3)

    def _predict(self, image: FilterImage, step_s: float) -> None:
        """By the motion model, then by how the whole image turned."""
        ekf, state = self._ekf, self.state if self._is_lost else self.state.remembered()
        state = predict(state, step_s, ekf.sigma_m_s2, ekf.sigma_rad_s2)
        self.state = turned(state, self._small, image.small, step_s, self._camera)
        self._small = image.small
        self._frames += 1

    def _in_view(self) -> Measurement:
        """What is expected of the features that the image is to show."""
        px = pixels(self.state.x, np.arange(len(self._features)), self._camera)
        inside = (px >= BORDER_PX) & (px < np.array(self._camera.size) - BORDER_PX)
        return measure(self.state, np.flatnonzero(inside.all(1)), self._camera)

    def _search(self, image: FilterImage, state: FilterState, features: Rows) -> Array:
        """Pixels (N, 2) of features in the ellipses of their innovations, NaN where not found."""
        camera, y, T_world_camera = self._camera, state.features, state.T_world_camera
        views = [
            self._features[k].template.warped(T_world_camera, y[k, 5], camera) for k in features
        ]
        templates = np.array(views).reshape(-1, TEMPLATE_PX, TEMPLATE_PX)
        expected = measure(state, features, camera)
        S = innovation_covariances(state.P, expected, self._ekf.pixel_sigma_px)
        return np.asarray(search(image.gray, templates, expected.pixels, S))

    def _agreed(self, image: FilterImage, seen: Measurement) -> Agreed:
        """The matches that agree on one motion, which one match tells where it was predicted.

        Where it was not, the image before tells it: features are followed from there [001 section
        5], three tell a motion, and templates are sought near that. Where these are too blurred to
        be found, the followed features are taken as they are.
        """
        was_predicted = self._frames > UNKNOWN_FRAMES and not self._is_lost
        min_inliers = self._ekf.min_inliers
        found_px = self._search(image, self.state, seen.features)
        best = self._consensus(seen, found_px, 1 if was_predicted else WITHOUT_PREDICTION)
        if was_predicted and len(best.rows) >= FEW * best.matches:
            return best
        px = pixels(self.state.x, np.arange(len(self._features)), self._camera)
        klt = KltTracker(self._last_color, self._keypoints, self._config)
        followed_px = klt.find(image.color, px)[seen.features].astype(float)
        shaken_px = SHAKEN * self._ekf.pixel_sigma_px
        other = self._consensus(seen, followed_px, WITHOUT_PREDICTION, shaken_px)
        draws = best.draws + other.draws
        if other.support >= max(best.support, min_inliers):
            rows = other.rows
            near = updated(self.state, seen[rows], followed_px[rows], shaken_px)
            found_px = self._search(image, near, seen.features)
            again = self._consensus(seen, found_px, WITHOUT_PREDICTION)
            are_found = again.support >= max(FEW_OF_FOLLOWED * other.support, min_inliers)
            best = again if are_found else replace(other, by_template=False)
            draws += again.draws
        return replace(best, draws=draws)

    def _consensus(
        self, seen: Measurement, found_px: Array, size: int, sigma_px: float = 0.0
    ) -> Agreed:
        found = np.flatnonzero(np.isfinite(found_px[:, 0]))
        sigma_px, rng = sigma_px or self._ekf.pixel_sigma_px, self._rng
        low = low_innovation_inliers(
            self.state, seen[found], found_px[found], self._camera, sigma_px, rng, size
        )
        return Agreed(found_px, found[low.rows], len(found), size, low.draws, sigma_px)

    def _follow_from(self, image: FilterImage) -> None:
        """Be ready to follow the features from this image on."""
        px = pixels(self.state.x, np.arange(len(self._features)), self._camera)
        self._keypoints = undescribed(0, px, np.full((len(px), 3), np.nan)).features
        self._last_color = image.color

    def _rescue(self, image: FilterImage, features: Rows) -> Rows:
        """Rows of those of high innovation that the updated state explains; updated by these.

        They are sought again, in the ellipses that the first update has left.
        """
        sigma_px = self._ekf.pixel_sigma_px
        found_px = self._search(image, self.state, features)
        found = np.flatnonzero(np.isfinite(found_px[:, 0]))
        expected = measure(self.state, features[found], self._camera)
        rows = high_innovation_inliers(self.state, expected, found_px[found], sigma_px)
        high = found[rows]
        self.state = updated(self.state, expected[rows], found_px[high], sigma_px)
        return high

    def _note(self, features: Rows, matched: Rows) -> None:
        """Count predictions and matches by template: what is followed only drifts, and is to go."""
        for k in features:
            self._features[k].predicted += 1
        for k in features[matched]:
            self._features[k].matched += 1

    def _drop_features(self, in_view: Rows) -> None:
        """Those out of view, those rarely matched, and those beyond infinity."""
        poor = [feature.is_poor for feature in self._features]
        gone = np.array(poor, bool) | (self.state.features[:, 5] <= 0)
        gone[np.setdiff1d(np.arange(len(poor)), in_view)] = True
        self._keep_landmarks(np.flatnonzero(gone))
        kept = np.flatnonzero(~gone)
        self.state = self.state.keep(kept)
        self._features = [self._features[k] for k in kept]

    def _keep_landmarks(self, features: Rows) -> None:
        """The points of features whose distance is known, and that were matched often enough."""
        sigma = np.sqrt(np.diag(self.state.P)[CAMERA + FEATURE - 1 :: FEATURE])
        y = self.state.features
        known = [
            k for k in features if self._features[k].is_good and 0 < sigma[k] < KNOWN * y[k, 5]
        ]
        self.landmarks += list(points(y[known]))

    def _add_features(self, image: FilterImage) -> None:
        """Fill empty cells of the image, as far as the state may grow."""
        camera, count = self._camera, self._ekf.max_features - len(self._features)
        px = pixels(self.state.x, np.arange(len(self._features)), camera)
        seen_px = px[np.isfinite(px[:, 0])]
        new = new_corners(image.gray, image.depth_m, seen_px, count, camera, self._config)
        T_world_camera = self.state.T_world_camera
        self.state = with_features(
            self.state, new.px, new.inverse_depth, new.sigma, camera, self._ekf.pixel_sigma_px
        )
        for px, slopes in zip(new.px, new.slopes, strict=True):
            ray = np.linalg.norm(camera.unproject(px, 1.0))
            template = Template(cut(image.gray, px), px, float(ray), slopes, T_world_camera)
            self._features.append(TrackedFeature(self._count, template))
            self._count += 1

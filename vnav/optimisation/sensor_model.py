"""What cameras see of landmarks, and with what noise: residuals in standard deviations."""

import copy
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vnav.config import RegistrationConfig
from vnav.core import se3
from vnav.core.arrays import Array
from vnav.core.camera import Intrinsics
from vnav.core.robust import robust_sigma
from vnav.optimisation.linearisation import NEAREST_M, linearise

CAUCHY_SIGMAS = 2.0
UNSEEN = 1e6  # squared residual that a point behind its camera counts for
ENOUGH_SIGHTINGS = 3  # of a landmark: two leave little over to tell noise from
ENOUGH_RESIDUALS = 100  # of such landmarks; fewer tell no noise
LEAST_PIXEL_SIGMA, LEAST_DEPTH_SIGMA = 0.1, 1e-4  # a perfect capture would divide by zero


@dataclass(frozen=True)
class Observations:
    """M observations of landmarks by cameras.

    ``landmark``, ``camera`` (M,) rows; ``px`` (M, 2); ``inverse_depth`` (M,) 1/m, NaN where the
    camera had no depth there.
    """

    landmark: NDArray[np.int32]
    camera: NDArray[np.int32]
    px: Array
    inverse_depth: Array

    def __getitem__(self, selection: Any) -> "Observations":
        """The selected observations."""
        return Observations(*(column[selection] for column in vars(self).values()))

    def __len__(self) -> int:
        return len(self.landmark)

    def measured(self, px: Array, inverse_depth: Array) -> "Observations":
        """Of the same landmarks by the same cameras, otherwise measured."""
        return Observations(self.landmark, self.camera, px, inverse_depth)


@dataclass(frozen=True)
class Bundle:
    """Poses (K, 4, 4) and points (L, 3)."""

    T_world_camera: Array
    points_world: Array


class SensorModel:
    """The camera and its noise: residuals in standard deviations."""

    def __init__(self, intrinsics: Sequence[Intrinsics], config: RegistrationConfig) -> None:
        self.intrinsics = intrinsics  # one a camera row
        self.pixel_sigma = config.pixel_sigma_px
        self.depth_sigma = config.depth_sigma_per_m2
        self._fx_fy_cx_cy = np.stack([camera.pinhole for camera in intrinsics])
        self.focal_px = self._fx_fy_cx_cy[:, 0]

    def fitted(self, bundle: Bundle, seen: Observations) -> "SensorModel":
        """The same cameras with the noise of the residuals, at most that of the settings.

        From the median absolute residual of landmarks with `ENOUGH_SIGHTINGS` sightings or more,
        corrected for what their points take up. Too few of these: no change.
        """
        track_length = np.bincount(seen.landmark)[seen.landmark]
        long = track_length >= ENOUGH_SIGHTINGS
        if long.sum() < ENOUGH_RESIDUALS:
            return self
        p = self._in_camera(bundle, seen[long])
        left = np.sqrt(1 - (1 / track_length[long]).mean())
        off = self._reprojection(p, seen[long])
        d = 1 / p[:, 2] - seen.inverse_depth[long]
        pixel = max(float(robust_sigma(off)) / left, LEAST_PIXEL_SIGMA)
        depth = max(float(robust_sigma(d)) / left, LEAST_DEPTH_SIGMA)
        model = copy.copy(self)
        model.pixel_sigma = min(pixel, self.pixel_sigma)
        model.depth_sigma = min(depth, self.depth_sigma)
        return model

    def wider(self, times: float) -> "SensorModel":
        """The same cameras with so many times the noise."""
        model = copy.copy(self)
        model.pixel_sigma, model.depth_sigma = times * self.pixel_sigma, times * self.depth_sigma
        return model

    def squared_residuals(self, bundle: Bundle, seen: Observations) -> Array:
        """Squared residuals (M,) in standard deviations; infinite behind the camera."""
        p = self._in_camera(bundle, seen)
        front = p[:, 2] > NEAREST_M
        w = 1 / np.where(front, p[:, 2], 1.0)
        off = self._reprojection(p, seen)
        d = np.nan_to_num(w - seen.inverse_depth)
        squared = (off**2).sum(1) / self.pixel_sigma**2 + (d / self.depth_sigma) ** 2
        return np.where(front, squared, np.inf)

    def cost(self, bundle: Bundle, seen: Observations) -> float:
        """Half the sum of squared residuals under the kernel that `bundle.adjust` minimises."""
        width, squared = CAUCHY_SIGMAS**2, self.squared_residuals(bundle, seen)
        return float(width / 2 * np.log1p(np.minimum(squared, UNSEEN) / width).sum())

    def rms_px(self, bundle: Bundle, seen: Observations) -> float:
        """Root mean square reprojection error; NaN without observations."""
        if not len(seen):
            return float("nan")
        off = self._reprojection(self._in_camera(bundle, seen), seen)
        return float(np.sqrt((off**2).sum(1).mean()))

    def point_sigmas(self, bundle: Bundle, seen: Observations) -> Array:
        """Standard deviation (L,) of each point given the poses, root mean square over the axes.

        Infinite for a point that its observations do not fix.
        """
        _, _, J = self.linearised(bundle, seen)
        information = np.zeros((len(bundle.points_world), 3, 3))
        np.add.at(information, seen.landmark, np.swapaxes(J, 1, 2) @ J)
        fixed = np.linalg.eigvalsh(information)[:, 0] > 1.0  # a metre at the most
        safe = np.where(fixed[:, None, None], information, np.eye(3))
        variance = np.trace(np.linalg.inv(safe), axis1=1, axis2=2) / 3
        return np.asarray(np.where(fixed, np.sqrt(variance), np.inf))

    @property
    def sigmas(self) -> Array:
        """Noise (3,) of a pixel's x and y, and of inverse depth."""
        return np.array([self.pixel_sigma, self.pixel_sigma, self.depth_sigma])

    def linearised(self, bundle: Bundle, seen: Observations) -> tuple[Array, Array, Array]:
        """What is measured less what the bundle shows (M, 3), in standard deviations.

        And the derivatives of what it shows by the camera's tangent (M, 3, 6) and by the point
        (M, 3, 3). Without depth the third rows are 0.
        """
        measured = np.column_stack([seen.px, seen.inverse_depth])
        T, points = se3.inverse(bundle.T_world_camera), bundle.points_world
        rows = seen.camera, seen.landmark
        return linearise(T, points, *rows, measured, self._fx_fy_cx_cy, self.sigmas)

    def weighted(self, bundle: Bundle, seen: Observations) -> tuple[Array, Array, Array, Array]:
        """The same three, weighted by the kernel; and the square roots of the weights (M,)."""
        found = self.linearised(bundle, seen)
        root = np.sqrt(1 / (1 + (found[0] ** 2).sum(1) / CAUCHY_SIGMAS**2))
        for values in found:
            values *= root.reshape(-1, *(1,) * (values.ndim - 1))
        return (*found, root)

    def rays(self, seen: Observations) -> Array:
        """Where observations look (M, 3), in their cameras; z is 1."""
        k = self._fx_fy_cx_cy[seen.camera]
        return np.column_stack([(seen.px - k[:, 2:]) / k[:, :2], np.ones(len(seen))])

    def _in_camera(self, bundle: Bundle, seen: Observations) -> Array:
        """Points (M, 3) in their cameras."""
        T = se3.inverse(bundle.T_world_camera)[seen.camera]
        points = bundle.points_world[seen.landmark]
        return np.asarray((T[:, :3, :3] @ points[:, :, None])[..., 0] + T[:, :3, 3])

    def _reprojection(self, points_camera: Array, seen: Observations) -> Array:
        k = self._fx_fy_cx_cy[seen.camera]
        z = np.where(points_camera[:, 2] > NEAREST_M, points_camera[:, 2], 1.0)
        return np.asarray(k[:, :2] * points_camera[:, :2] / z[:, None] + k[:, 2:] - seen.px)

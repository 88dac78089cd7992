"""Where registration puts a camera whose sensor errs while it moves, and edges freed of that."""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from vnav.config import RegistrationConfig
from vnav.core import se3
from vnav.core.arrays import Array, Rows
from vnav.core.frame import Edge
from vnav.features.lifting import inverse_depth_planes
from vnav.optimisation.sensor_errors import MovingSensor, MovingView, SensorErrors
from vnav.optimisation.sensor_model import Bundle, Observations, SensorModel


def displacements(
    sensor: MovingSensor, errors: SensorErrors, twists: Array, keyframe_rows: Rows
) -> Array:
    """Tangents (N, 6) by which registration displaces frames that move by ``twists`` (N, 6).

    Points that are seen late lie elsewhere in the camera. A rigid motion fits part of that, and is
    taken for the camera's own. It is linear in the twist, and told by the features of the
    keyframe before, for other frames' are not kept.
    """
    by_twist = np.stack([_by_twist(view, errors, sensor.config) for view in sensor.views()])
    frames = np.arange(len(twists))
    before = np.searchsorted(keyframe_rows, frames, side="right") - 1
    return np.asarray((by_twist[before.clip(0)] @ twists[:, :, None])[..., 0])


def without_displacement(edges: Iterable[Edge], displacement: Array) -> list[Edge]:
    """The edges between cameras that are not displaced by tangents (N, 6)."""
    T = se3.exp(displacement)
    T_inverse = se3.inverse(T)
    return [replace(e, T_i_j=T[e.i] @ e.T_i_j @ T_inverse[e.j]) for e in edges]


def _by_twist(view: MovingView, errors: SensorErrors, config: RegistrationConfig) -> Array:
    """The tangent (6, 6) that each of the six unit twists displaces a camera by."""
    px = view.keyframe.features.keypoints_px.astype(float)
    planes = inverse_depth_planes(px, view.depth_m, config)
    known = np.isfinite(planes[:, 0])
    px, inverse, slopes = px[known], planes[known, 0], planes[known, 1:]
    delays = replace(errors, depth_offset=0.0).vector
    moving = [view.with_twist(twist) for twist in np.eye(6)]
    shifts = np.stack([m.by_error(px, inverse, slopes) @ delays for m in moving], 2)
    model, rows = SensorModel([view.intrinsics], config), np.arange(len(px), dtype=np.int32)
    bundle = Bundle(np.eye(4)[None], view.intrinsics.unproject(px, 1 / inverse))
    _, J, _ = model.linearised(bundle, Observations(rows, np.zeros_like(rows), px, inverse))
    across = (shifts / model.sigmas[:, None]).reshape(-1, 6)
    return np.asarray(np.linalg.lstsq(J.reshape(-1, 6), across, rcond=None)[0])

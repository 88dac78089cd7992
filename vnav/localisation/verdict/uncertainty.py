"""How far off an answer may be."""

import math
from dataclasses import dataclass

import numpy as np

from vnav.core.arrays import Array
from vnav.core.camera import CameraPrior
from vnav.core.map_index import MapIndex
from vnav.localisation.hypotheses.pose_refinement import refine_pose
from vnav.localisation.query import Query
from vnav.localisation.verification.verify import VerifiedPose


@dataclass(frozen=True)
class Sigmas:
    """Standard deviations of a pose and focal length.

    ``position_covariance`` (3, 3) in square metres, along the world's axes; ``rotation_rad`` (3,):
    about the camera's axes; ``focal``: relative, 0 where the focal length was given.
    """

    position_covariance: Array
    rotation_rad: Array
    focal: float

    @property
    def position_m(self) -> Array:
        """Along the world's axes (3,)."""
        return np.asarray(np.sqrt(np.diag(self.position_covariance)))

    def within(self, distance_m: float, angle_rad: float) -> float:
        """Probability that position and rotation are no farther off than that."""
        return _within(distance_m, self.position_m) * _within(angle_rad, self.rotation_rad)

    def __str__(self) -> str:
        off_m, off_deg = (
            np.linalg.norm(s) for s in (self.position_m, np.rad2deg(self.rotation_rad))
        )
        return f"give or take {100 * off_m:.1f} cm and {off_deg:.2f} deg"


def sigmas(pose: VerifiedPose, index: MapIndex) -> Sigmas:
    """From the information of the matches, and the map's own where it is known.

    The map's is the covariance of the keyframe that sees most of the matched landmarks: the photo
    is located against what that keyframe saw.
    """
    R = pose.view.T_world_camera[:3, :3]
    position = R @ pose.covariance[3:6, 3:6] @ R.T
    rotation = pose.covariance[:3, :3]
    _, keyframes = index.keyframes_of(pose.matches.landmark)
    keyframe = int(np.bincount(keyframes).argmax())
    of_map = index.keyframe_covariance[keyframe]
    if np.isfinite(of_map).all():
        R_world_keyframe = index.T_world_keyframe[keyframe, :3, :3]
        R_camera_keyframe = R.T @ R_world_keyframe
        position = position + R_world_keyframe @ of_map[3:, 3:] @ R_world_keyframe.T
        rotation = rotation + R_camera_keyframe @ of_map[:3, :3] @ R_camera_keyframe.T
    focal = pose.covariance[6, 6] if len(pose.covariance) > 6 else 0.0
    return Sigmas(position, np.sqrt(np.diag(rotation)), float(np.sqrt(focal)))


def focal_length_check(pose: VerifiedPose, query: Query) -> tuple[float, float]:
    """What the matches alone say of the focal length: factor of the one used, its log's sigma.

    Far from 1, the photo was taken by another camera than was assumed.
    """
    view = pose.view
    matched = query.correspondences(pose.matches, view)
    free = refine_pose(view, matched, CameraPrior(view.intrinsics, float("inf")))
    return free.view.intrinsics.fx / view.intrinsics.fx, float(np.sqrt(free.covariance[6, 6]))


def _within(radius: float, sigma: Array) -> float:
    """Probability that a normal vector of three is shorter, were it the same in all directions."""
    r = radius / max(float(np.sqrt((sigma**2).mean())), 1e-12)
    return math.erf(r / math.sqrt(2)) - math.sqrt(2 / math.pi) * r * math.exp(-r * r / 2)

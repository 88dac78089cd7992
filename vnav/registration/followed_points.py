"""A frame registered against the one whose points it was followed by: their matches are known."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from vnav.core import se3
from vnav.core.arrays import Array, Rows
from vnav.core.frame import PoseEstimate, Rejected
from vnav.core.mapping import FrameFeatures
from vnav.registration.points3d import MOTIONS, PointRegistration


@dataclass(frozen=True)
class FollowedRegistration(PointRegistration):
    """Registers frame b, whose features are rows of a's, in the order of ``rows`` (N,)."""

    rows: Rows = field(default_factory=lambda: np.zeros(0, np.intp))

    def hypotheses(
        self,
        a: FrameFeatures,
        b: FrameFeatures,
        rng: np.random.Generator,
        predicted: Array | None = None,
        count: int = MOTIONS,
    ) -> list[PoseEstimate] | Rejected:
        """The motions ``T_a_b`` that many points agree on, at most ``count``.

        A tracker finds each near its prediction, and only there: no other place is sought.
        """
        found = self._motions(a, b, self._known, rng, count)
        if isinstance(found, Rejected) or count == 1:
            return found
        return self._with_parts(found, a, b, rng)

    def among_twins(
        self, a: FrameFeatures, b: FrameFeatures, rng: np.random.Generator, predicted: Array
    ) -> list[PoseEstimate]:
        """None: a point that is followed has no twin."""
        return []

    def match_guided(
        self,
        a: FrameFeatures,
        b: FrameFeatures,
        T_a_b: Array,
        radius_px: float,
        strongest: int | None = None,
    ) -> NDArray[np.int32]:
        """Those of the matches (M, 2) that lie close to where a motion puts a's points."""
        points_b = se3.transform(se3.inverse(T_a_b), a.points_camera[self.rows])
        off = np.linalg.norm(self.camera_b.project(points_b) - b.features.keypoints_px, axis=1)
        return np.asarray(self._known[off <= radius_px])

    @property
    def _known(self) -> NDArray[np.int32]:
        return np.stack([self.rows, np.arange(len(self.rows))], 1).astype(np.int32)

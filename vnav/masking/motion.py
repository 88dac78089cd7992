"""What moves between views, by free space and by brightness: 003 S3, its mends included.

Free space decides: where one view sees a surface and others, of the seconds before and after, have
seen through that place, something came or left. Brightness decides where that has no depth.
"""

from collections.abc import Sequence

from vnav.config import Config
from vnav.core import se3
from vnav.core.arrays import Array
from vnav.core.reduced_frame import BLOCK_PX, ReducedFrame
from vnav.masking.background import Background
from vnav.masking.free_space import count_votes
from vnav.masking.regions import beside, grown, large, opened
from vnav.masking.view import Blocks, PosedView
from vnav.masking.warps import WARPS

ENOUGH = 1.0  # views that fit, or more that fit worse, see through what is not there


class MotionMask:
    """Masks what other views see through, and where there is no depth, what looks different."""

    def __init__(self, config: Config) -> None:
        self._config = config.masking
        self._sigma = config.registration.depth_sigma_per_m2
        self._warp = WARPS[self._config.warp]
        self._min_blocks = self._config.min_region_px / BLOCK_PX**2
        self.forget()

    def forget(self) -> None:
        """Begin anew, with a background that is not known anywhere."""
        self._last: PosedView | None = None
        self._background: Background | None = None
        self._expected: Background | None = None

    def look(self, frame: ReducedFrame, T_track_camera: Array) -> PosedView:
        """The frame, and where its brightness is not that of the background: 003 S34."""
        expected = self._seen_from(frame, T_track_camera)
        self._expected = expected
        return PosedView(frame, T_track_camera, expected.differs(frame.grey))

    def add(self, view: PosedView) -> None:
        """Take the view that was looked at last into the background: 003 S33."""
        if self._expected is not None:
            self._background = self._expected.updated(view.frame.grey)
        self._last = view

    def moving(self, view: PosedView, others: Sequence[PosedView]) -> Blocks:
        """Surfaces that others see through, and beside them changed brightness without depth."""
        if self._config.warp == "homography":
            return large(opened(view.changed), self._min_blocks)
        votes = count_votes(view, others, self._sigma, self._config.depth_margin_m)
        inverse_depth = view.frame.inverse_depth
        regions = large(opened(votes.free >= ENOUGH), self._min_blocks)
        if not regions.any():
            return regions
        regions = grown(regions, votes, view.frame)
        return regions | beside(regions, opened(view.changed & (inverse_depth == 0)))

    def _seen_from(self, frame: ReducedFrame, T_track_camera: Array) -> Background:
        """The background as it moves with the camera; an unknown one where nobody knows how."""
        if self._background is not None and self._last is not None:
            T_last_current = se3.inverse(self._last.T_track_camera) @ T_track_camera
            places = self._warp(self._last.frame, frame, T_last_current)
            if places is not None:
                return self._background.warped(places).adapted(frame.grey)
        return Background.unknown(frame.grey.shape)

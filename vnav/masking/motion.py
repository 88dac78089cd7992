"""What moves between views, by free space and by brightness: 003 S3, its mends included.

Free space decides: where one view sees a surface and others, of the seconds before and after, have
seen through that place, something came or left. Brightness decides where that has no depth. Who
stands still before or after is followed from frame to frame, by surfaces that stay in their place.
"""

from collections.abc import Sequence

import numpy as np

from vnav.config import Config
from vnav.core import se3
from vnav.core.arrays import Array, Floats
from vnav.core.reduced_frame import BLOCK_PX, ReducedFrame
from vnav.masking.attached import with_attached
from vnav.masking.background import Background
from vnav.masking.carrying import SurfaceCarrier
from vnav.masking.free_space import COARSE, Votes, count_votes
from vnav.masking.regions import (
    MAX_SAME,
    beside,
    bodies,
    completed,
    grown,
    joined,
    large,
    may_hold_bodies,
    opened,
)
from vnav.masking.view import MaskedView, PosedView, still
from vnav.masking.warps import WARPS

REMEMBERED_S = 3.0  # who has moved counts as moving for so long, and who will move


class MotionMask:
    """Masks what other views see through, and where there is no depth, what looks different."""

    def __init__(self, config: Config) -> None:
        self._config = config.masking
        self._sigma = config.registration.depth_sigma_per_m2
        self._warp = WARPS[self._config.warp]
        self._carrier = SurfaceCarrier(self._sigma, self._config.depth_margin_m)
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

    def moving(self, view: PosedView, others: Sequence[PosedView], carried: Floats) -> Floats:
        """Surfaces that others see through, and beside them changed brightness without depth."""
        if self._config.warp == "homography":
            return np.where(
                large(opened(view.changed), self._min_blocks), np.float32(0), still(view)
            )
        if np.isinf(carried).all():
            coarse = self._votes(view, others, COARSE)
            if not may_hold_bodies(coarse.seen_through):
                return carried
        votes = self._votes(view, others)
        regions = large(opened(votes.seen_through), self._min_blocks)
        moved_s = np.where(regions, np.float32(0), carried)
        if not bodies(np.isfinite(moved_s)).any():
            return still(view)
        moved_s = grown(moved_s, votes, view)
        changed = beside(np.isfinite(moved_s), opened(view.changed & (view.surfaces == 0)))
        return joined(moved_s, changed, view.surfaces)

    def carried(
        self, view: PosedView, beside: MaskedView, witnesses: Sequence[MaskedView]
    ) -> Floats:
        """Surfaces that move in the view beside, where they are still there; not for too long."""
        result = still(view)
        if self._config.warp == "homography" or np.isinf(beside.moved_s).all():
            return result
        moved_s = self._carrier.carried(view, beside)
        moved_s += np.float32(abs(view.frame.stamp_s - beside.view.frame.stamp_s))
        moves = moved_s <= REMEMBERED_S
        if not moves.any():
            return result
        asked = np.isin(view.surfaces, view.surfaces[moves])
        seen_still = self._carrier.seen_still(view, asked, witnesses)
        found = large(opened(moves & (seen_still <= 0)), self._min_blocks)
        return completed(np.where(found, moved_s, result), view, seen_still > MAX_SAME)

    def with_attached(self, masked: MaskedView, others: Sequence[PosedView]) -> Floats:
        """What moves, with surfaces that touch it and that no view sees stay when it has left."""
        if self._config.warp == "homography" or np.isinf(masked.moved_s).all():
            return masked.moved_s
        return with_attached(masked, others, self._sigma, self._config.depth_margin_m)

    def _votes(self, view: PosedView, others: Sequence[PosedView], step: int = 1) -> Votes:
        return count_votes(view, others, self._sigma, self._config.depth_margin_m, step)

    def _seen_from(self, frame: ReducedFrame, T_track_camera: Array) -> Background:
        """The background as it moves with the camera; an unknown one where nobody knows how."""
        if self._background is not None and self._last is not None:
            T_last_current = se3.inverse(self._last.T_track_camera) @ T_track_camera
            places = self._warp(self._last.frame, frame, T_last_current)
            if places is not None:
                return self._background.warped(places).adapted(frame.grey)
        return Background.unknown(frame.grey.shape)

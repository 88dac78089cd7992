"""What moves in the frames that are tracked: at once by those before, later by those after: S4.

003 S4: features in what moves are dropped. A person who stands still is seen to have moved only
when he is gone: a frame's mask is final when the time that the settings name has passed.
"""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from vnav.config import Config
from vnav.core.arrays import Array
from vnav.core.mapping import FrameFeatures
from vnav.core.reduced_frame import blocks_of
from vnav.masking import PosedView, mask
from vnav.masking.view import Blocks
from vnav.tracking.pose_choice import TrackedFrame

SPACING_S = 0.18  # at least, between the views that others are held against


@dataclass(frozen=True)
class SeenFrame:
    """A frame with all its features, and its mask (h, w), ``moving``; ``share`` of it moves.

    Where that is more than a mask may cover, there is no mask, and the share is NaN.
    """

    frame: TrackedFrame
    view: PosedView
    moving: Blocks
    share: float = 0.0
    is_keyframe: bool = False

    @property
    def row(self) -> int:
        """In the frame table."""
        return self.frame.features.row

    @cached_property
    def static(self) -> TrackedFrame:
        """The frame without the features and the depth of what moves; the same if nothing does."""
        if not self.moving.any():
            return self.frame
        row, features = self.row, self.frame.features.features
        kept = ~blocks_of(self.moving, features.keypoints_px, self.frame.camera.size)
        points = self.frame.features.points_camera[kept]
        image = self.frame.image
        image = replace(image, inverse_depth=np.where(self.moving, 0, image.inverse_depth))
        return TrackedFrame(FrameFeatures(row, features[kept], points), image, self.frame.camera)


@dataclass(frozen=True)
class FinalFrame:
    """A frame with its final mask, and whether that is the one that it was tracked with."""

    seen: SeenFrame
    is_changed: bool


class FrameMasks:
    """Masks frame after frame, and once more when the frames after are known."""

    def __init__(self, config: Config) -> None:
        self._config = config.masking
        self._mask = mask(config)
        self._views: list[PosedView] = []
        self._pending: deque[SeenFrame] = deque()
        self._final: list[FinalFrame] = []
        self._moved_s = -np.inf  # time of the newest frame in which something moves
        self._static: dict[int, FrameFeatures] = {}
        self._shares: dict[int, float] = {}
        self.moving: dict[int, Blocks] = {}  # of keyframes in which something moves, by row

    def look(self, frame: TrackedFrame, T_track_camera: Array) -> SeenFrame:
        """The next frame at its pose, as far as that is known, and what the frames before say."""
        view = self._mask.look(frame.image, T_track_camera)
        return self._masked(SeenFrame(frame, view, np.zeros(frame.image.grey.shape, bool)))

    def add(self, seen: SeenFrame, T_track_camera: Array, is_keyframe: bool) -> None:
        """Take the frame that was looked at last, at the pose that was found in the end."""
        view = replace(seen.view, T_track_camera=T_track_camera)
        seen = replace(seen, view=view, is_keyframe=is_keyframe)
        now_s, window_s = view.frame.stamp_s, self._config.window_s
        self._mask.add(view)
        self._note(seen)
        if not self._views or now_s - self._views[-1].frame.stamp_s >= SPACING_S:
            self._views.append(view)
        self._pending.append(seen)
        while now_s - self._pending[0].view.frame.stamp_s > window_s:
            self._finish(self._pending.popleft())
        self._views = [v for v in self._views if now_s - v.frame.stamp_s <= 2 * window_s]

    def restart(self) -> None:
        """Begin a new track, or end the last: the masks of all frames become final."""
        while self._pending:
            self._finish(self._pending.popleft())
        self._views = []
        self._mask.forget()

    def taken_final(self) -> list[FinalFrame]:
        """The frames whose masks have become final since this was asked last, in order."""
        final, self._final = self._final, []
        return final

    def static(self, keyframe: FrameFeatures) -> FrameFeatures:
        """A keyframe with the features that its final mask leaves."""
        return self._static.get(keyframe.row, keyframe)

    def shares(self, frames: int) -> NDArray[np.float32]:
        """Share (N,) of each of so many frames that moves, NaN where too much did for a mask."""
        return np.array([self._shares.get(row, 0.0) for row in range(frames)], np.float32)

    def _finish(self, seen: SeenFrame) -> None:
        """Decide a mask for good; not where nothing moves for as long as it can see."""
        final = seen
        if seen.is_keyframe or self._moved_s >= seen.view.frame.stamp_s - self._config.window_s:
            final = self._masked(seen)
            self._note(final)
        self._final.append(FinalFrame(final, not np.array_equal(final.moving, seen.moving)))
        if final.is_keyframe:
            self._static[final.row] = final.static.features
            if final.moving.any():
                self.moving[final.row] = final.moving

    def _note(self, seen: SeenFrame) -> None:
        self._shares[seen.row] = seen.share
        if seen.share != 0:
            self._moved_s = max(self._moved_s, seen.view.frame.stamp_s)

    def _masked(self, seen: SeenFrame) -> SeenFrame:
        """The frame with its mask by all views within the window, before it and after."""
        moving = self._mask.moving(seen.view, self._near(seen.view.frame.stamp_s))
        share = float(moving.mean())
        if share > self._config.max_share:
            return replace(seen, moving=np.zeros_like(moving), share=np.nan)
        return replace(seen, moving=moving, share=share)

    def _near(self, stamp_s: float) -> Sequence[PosedView]:
        window_s = self._config.window_s
        return [v for v in self._views if 0 < abs(v.frame.stamp_s - stamp_s) <= window_s]

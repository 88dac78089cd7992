"""What moves in the frames that are tracked: at once by those before, later by those after: S4.

003 S4: features in what moves are dropped. A person who stands still is seen to have moved only
when he is gone: where something moves, a frame's mask is final `REMEMBERED_S` after the views of
the time that the settings name are known.
"""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from vnav.config import Config
from vnav.core.arrays import Array, Floats
from vnav.core.mapping import FrameFeatures
from vnav.core.reduced_frame import blocks_of
from vnav.masking import PosedView, mask
from vnav.masking.history import ViewHistory
from vnav.masking.motion import REMEMBERED_S
from vnav.masking.regions import widened
from vnav.masking.view import Blocks, MaskedView, still
from vnav.tracking.pose_choice import TrackedFrame

BETWEEN_S = 1.0  # at least, from one time that masks are carried back to the next


@dataclass(frozen=True)
class SeenFrame:
    """A frame with all its features, and its mask; ``share`` of it moves.

    ``moved_s`` as in `MaskedView`. Where more moves than a mask may cover, there is no mask, and
    the share is NaN.
    """

    frame: TrackedFrame
    view: PosedView
    moved_s: Floats
    share: float = 0.0
    is_keyframe: bool = False

    @property
    def row(self) -> int:
        """In the frame table."""
        return self.frame.features.row

    @property
    def stamp_s(self) -> float:
        """When it was taken."""
        return self.view.stamp_s

    @property
    def masked(self) -> MaskedView:
        """What others are told of it."""
        return MaskedView(self.view, self.moved_s)

    @cached_property
    def moving(self) -> Blocks:
        """The mask (h, w)."""
        return np.isfinite(self.moved_s)

    @cached_property
    def static(self) -> TrackedFrame:
        """The frame without the depth of what moves, and features on or beside it."""
        if not self.moving.any():
            return self.frame
        frame = self.frame
        kept = self._is_static(frame.features)
        return replace(
            frame,
            features=frame.features[kept],
            image=frame.image.without(self.moving),
            followed=frame.followed and replace(frame.followed, rows=frame.followed.rows[kept]),
            coarse=frame.coarse and frame.coarse[self._is_static(frame.coarse)],
        )

    def _is_static(self, found: FrameFeatures) -> Blocks:
        """Which features (N,) are more than a block off what moves: its outline moves, too."""
        beside = widened(self.moving)
        return ~blocks_of(beside, found.features.keypoints_px, self.frame.camera.size)


@dataclass(frozen=True)
class FinalFrame:
    """A frame with its final mask, and whether that is the one that it was tracked with."""

    seen: SeenFrame
    is_changed: bool


class FrameMasks:
    """Masks frame after frame, and once more when the frames after are known.

    A mask is made at once by the views before, again when those after are known, and is final with
    what masks of later frames carry back to it.
    """

    def __init__(self, config: Config, is_first: bool = True) -> None:
        """If these are the first masks, keyframes are looked at again where nothing moved, too."""
        self._config, self._is_first = config.masking, is_first
        self._keeps_all = config.odometry.kept_frames == "all"
        self._mask = mask(config)
        self._views = ViewHistory()
        self._last: SeenFrame | None = None
        self._last_known: SeenFrame | None = None
        self._new: deque[SeenFrame] = deque()  # whose views after are not all known
        self._known: deque[tuple[SeenFrame, SeenFrame]] = deque()  # as tracked, and by all views
        self._final: list[FinalFrame] = []
        self._moved_s = -np.inf  # time of the newest frame in which something moves
        self._static: dict[int, FrameFeatures] = {}
        self._shares: dict[int, float] = {}
        self.moving: dict[
            int, Blocks
        ] = {}  # of frames that are kept, where something moves, by row

    def look(self, frame: TrackedFrame, T_track_camera: Array) -> SeenFrame:
        """The next frame at its pose, as far as that is known, and what the frames before say."""
        view = self._mask.look(frame.image, T_track_camera)
        return self._masked(SeenFrame(frame, view, still(view)), self._last)

    def add(self, seen: SeenFrame, T_track_camera: Array, is_keyframe: bool) -> None:
        """Take the frame that was looked at last, at the pose that was found in the end."""
        view = replace(seen.view, T_track_camera=T_track_camera)
        seen = replace(seen, view=view, is_keyframe=is_keyframe)
        self._mask.add(view)
        self._note(seen)
        self._views.add(seen.masked)
        self._new.append(seen)
        self._last = seen
        known_s = seen.stamp_s - self._config.window_s
        while self._new[0].stamp_s < known_s:
            self._look_again(self._new.popleft())
        self._finish(known_s)

    def restart(self) -> None:
        """Begin a new track, or end the last: the masks of all frames become final."""
        while self._new:
            self._look_again(self._new.popleft())
        self._finish(np.inf)
        self._views, self._last, self._last_known = ViewHistory(), None, None
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

    def _look_again(self, seen: SeenFrame) -> None:
        """Mask by the views after, too; not where nothing moves for as long as it can see."""
        known = seen
        is_asked = seen.is_keyframe and self._is_first
        if is_asked or self._moved_s >= seen.stamp_s - self._config.window_s:
            known = self._masked(seen, self._last_known)
            self._note(known)
            self._views.replace(known.masked)
        self._known.append((seen, known))
        self._last_known = known

    def _finish(self, known_s: float) -> None:
        """Decide masks that no later frame can change, by those of frames until a time."""
        while self._known and self._moved_s < self._known[0][1].stamp_s:
            self._decide(*self._known.popleft())
        final_s = known_s - REMEMBERED_S
        if self._known and self._known[0][1].stamp_s < final_s - BETWEEN_S:
            self._carry_back()
            while self._known and self._known[0][1].stamp_s < final_s:
                self._decide(*self._known.popleft())
        undecided = [*(known for _, known in self._known), *self._new]
        oldest_s = min((seen.stamp_s for seen in undecided), default=np.inf)
        self._views.forget(oldest_s - self._config.window_s)

    def _carry_back(self) -> None:
        """Let each frame know what moves in those after it, as far as it sees that there."""
        later: SeenFrame | None = None
        for k in reversed(range(len(self._known))):
            seen, known = self._known[k]
            if later is not None and later.moving.any():
                before, after = self._views_about(known.stamp_s)
                moved_s = self._mask.carried(known.view, later.masked, after)
                if (moved_s < known.moved_s).any():
                    others = [other.view for other in (*before, *after)]
                    known = self._with(known, np.minimum(known.moved_s, moved_s), others)
                    self._note(known)
            self._views.replace(known.masked)
            self._known[k] = seen, known
            later = known

    def _decide(self, seen: SeenFrame, final: SeenFrame) -> None:
        """Give a mask away for good."""
        self._final.append(FinalFrame(final, not np.array_equal(final.moving, seen.moving)))
        if final.is_keyframe:
            self._static[final.row] = final.static.features
        if final.moving.any() and (final.is_keyframe or self._keeps_all):
            self.moving[final.row] = final.moving

    def _note(self, seen: SeenFrame) -> None:
        self._shares[seen.row] = seen.share
        if seen.share != 0:
            self._moved_s = max(self._moved_s, seen.stamp_s)

    def _masked(self, seen: SeenFrame, before: SeenFrame | None) -> SeenFrame:
        """The frame with its mask by all views within the window, and by the frame ``before``."""
        view, (earlier, later) = seen.view, self._views_about(seen.stamp_s)
        carried = (
            still(view) if before is None else self._mask.carried(view, before.masked, earlier)
        )
        others = [other.view for other in (*earlier, *later)]
        return self._with(seen, self._mask.moving(view, others, carried), others)

    def _views_about(self, stamp_s: float) -> tuple[list[MaskedView], list[MaskedView]]:
        """The views before a time and after it, as far as the window reaches."""
        window_s = self._config.window_s
        earlier = self._views.between(stamp_s - window_s, stamp_s)
        return earlier, self._views.between(stamp_s, stamp_s + window_s)

    def _with(self, seen: SeenFrame, moved_s: Floats, others: Sequence[PosedView]) -> SeenFrame:
        """The frame with another mask and what is attached to that, if this is not too large."""
        moved_s = self._mask.with_attached(MaskedView(seen.view, moved_s), others)
        share = float(np.isfinite(moved_s).mean())
        if share > self._config.max_share:
            return replace(seen, moved_s=still(seen.view), share=np.nan)
        return replace(seen, moved_s=moved_s, share=share)

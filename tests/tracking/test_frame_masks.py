"""Masks of frames in the order of time: by which masks of other frames one is made."""

import weakref
from collections.abc import Sequence

import numpy as np
import pytest

from tests.masking.moving_box import STEP_S, all_masks, look_on, walk
from vnav.config import Config, load
from vnav.core.arrays import Floats
from vnav.core.camera import Intrinsics
from vnav.core.frame import Frame, no_depth
from vnav.features.description import undescribed
from vnav.masking.nothing import NoMask
from vnav.masking.view import MaskedView, PosedView, still
from vnav.registration.reduction import reduced
from vnav.tracking import frame_masks
from vnav.tracking.frame_masks import SeenFrame
from vnav.tracking.pose_choice import FollowedPoints, TrackedFrame

SECONDS = 3.0


class Hindsight(NoMask):
    """Sees half of a view move as soon as it has later ones; notes who bears out what is carried.

    ``witnesses``: for each view, by its time, those of one call after another.
    """

    witnesses: dict[float, list[list[MaskedView]]]

    def moving(self, view: PosedView, others: Sequence[PosedView], _carried: Floats) -> Floats:
        moved_s = still(view)
        if any(other.stamp_s > view.stamp_s for other in others):
            moved_s[:, : moved_s.shape[1] // 2] = 0
        return moved_s

    def carried(
        self, view: PosedView, _beside: MaskedView, witnesses: Sequence[MaskedView]
    ) -> Floats:
        self.witnesses.setdefault(view.stamp_s, []).append(list(witnesses))
        return still(view)


def test_a_second_look_believes_the_second_looks_before_it(monkeypatch: pytest.MonkeyPatch) -> None:
    witnesses: dict[float, list[list[MaskedView]]] = {}

    def hindsight(config: Config) -> Hindsight:
        mask = Hindsight(config)
        mask.witnesses = witnesses
        return mask

    monkeypatch.setattr(frame_masks, "mask", hindsight)
    all_masks(walk(SECONDS, None), load(settings=["masking.window_s=0.5"]))
    not_the_last = [calls for stamp_s, calls in witnesses.items() if stamp_s < SECONDS - 0.5]
    second_looks = [calls[1] for calls in not_the_last if calls[1:] and calls[1]]
    assert len(second_looks) > 10
    assert all(np.isfinite(w.moved_s).any() for views in second_looks for w in views)


def test_of_a_still_scene_no_view_is_held_that_no_mask_needs() -> None:
    config, still_scene = load(settings=["masking.window_s=0.5"]), walk(6.0, None)
    masks, frames, held = frame_masks.FrameMasks(config), len(still_scene.frames), []
    alive = weakref.WeakSet(still_scene.frames)
    for row in range(frames):
        look_on(masks, still_scene, row)
        masks.taken_final()
        still_scene.frames[row] = None
        held.append(len(alive) - (frames - row - 1))
    assert max(held) <= 2 * 0.5 / STEP_S  # those of the window before a view, and after it


def test_what_is_followed_stays_with_its_source_where_others_move_or_are_beside_what_does() -> None:
    blocks = np.zeros((120, 160), bool)
    blocks[:, :80] = True  # the left half moves
    px = np.array([[10, 10], [600, 10], [322, 300], [500, 400]], np.float32)  # the third beside it
    camera = Intrinsics(640, 480, 525.0, 525.0, 319.5, 239.5)
    image = reduced(Frame(0, 1, 0.1, np.zeros((480, 640, 3), np.uint8), no_depth(480, 640), camera))
    own, source = undescribed(1, px, np.ones((4, 3))), undescribed(0)
    followed = FollowedPoints(source, np.array([7, 8, 9, 10]))
    view = PosedView(image, np.eye(4), np.zeros_like(blocks))
    moved_s = np.where(blocks, np.float32(0), np.float32(np.inf))

    static = SeenFrame(TrackedFrame(own, image, camera, followed), view, moved_s).static

    assert static.features.features.keypoints_px.tolist() == px[[1, 3]].tolist()
    assert static.followed is not None
    assert static.followed.source is source
    assert static.followed.rows.tolist() == [8, 10]

"""What every mask must hold; a new one in MASKS is tested by being there."""

import numpy as np
import pytest

from tests.masking.moving_box import CAMERA, Walk, all_masks, walk
from vnav.config import SETTINGS, Config, load
from vnav.config.registries import MASKS, registered
from vnav.core.reduced_frame import ReducedFrame
from vnav.errors import ConfigError
from vnav.masking import mask
from vnav.masking.view import MaskedView, still

SECONDS = 6.0


@pytest.fixture(params=sorted(MASKS))
def config(request: pytest.FixtureRequest) -> Config:
    return load(settings=[f"masking.method={request.param}"])


@pytest.fixture(params=sorted(MASKS.keys() - {"none"}))
def watchful(request: pytest.FixtureRequest) -> Config:
    """A configuration of a mask that masks anything at all."""
    return load(settings=[f"masking.method={request.param}"])


@pytest.fixture(scope="module")
def crossing() -> Walk:
    return walk(SECONDS, lambda t_s: -0.9 + 0.35 * t_s)


def recalls(walked: Walk, config: Config, rows: range) -> list[float]:
    moving = all_masks(walked, config)[1].moving
    return [float(moving[k][walked.box[k]].mean()) if k in moving else 0.0 for k in rows]


def test_the_mask_that_the_configuration_names_is_made(config: Config) -> None:
    assert type(mask(config)) is registered(MASKS, config.masking.method)


def test_the_choice_of_the_setting_is_the_registry() -> None:
    with pytest.raises(ConfigError, match="masking.method"):
        load(settings=["masking.method=nonsense"])
    assert set(SETTINGS["masking.method"].allowed.values) == set(MASKS)


def test_a_mask_has_the_frames_shape_and_the_first_frame_has_none(
    config: Config, crossing: Walk
) -> None:
    looked, masks = all_masks(crossing, config)
    shape = CAMERA.height, CAMERA.width
    assert {seen.moving.shape for seen in looked} == {shape}
    assert not looked[0].moving.any()
    assert {blocks.shape for blocks in masks.moving.values()} <= {shape}


def test_the_same_frames_give_the_same_masks(config: Config, crossing: Walk) -> None:
    first, second = (all_masks(crossing, config)[1].moving for _ in range(2))
    assert first.keys() == second.keys()
    assert all(np.array_equal(first[row], second[row]) for row in first)


@pytest.mark.parametrize("box_m", [None, 0.2])
def test_where_nothing_moves_nothing_is_masked(config: Config, box_m: float | None) -> None:
    still = walk(SECONDS, None if box_m is None else lambda _: box_m)
    assert all_masks(still, config)[1].shares(len(still.frames)).max() < 0.01


def test_a_frame_whose_given_pose_is_wrong_masks_nothing(config: Config) -> None:
    """Poses from elsewhere may jump: this one is half a metre nearer to the wall than it was."""
    still = walk(SECONDS, lambda _: 0.2)
    still.poses[30][2, 3] += 0.5
    assert all_masks(still, config)[1].shares(len(still.frames)).max() < 0.01


def test_nothing_is_attached_where_nothing_moves(config: Config, crossing: Walk) -> None:
    any_mask = mask(config)
    first, *others = (any_mask.look(frame, np.eye(4)) for frame in crossing.frames[:5])
    assert np.isinf(any_mask.with_attached(MaskedView(first, still(first)), others)).all()


def test_a_jump_of_exposure_masks_nothing(config: Config) -> None:
    still = walk(SECONDS, lambda _: 0.2, gain=lambda k: 0.5 if k // 15 % 2 else 1.0)
    assert all_masks(still, config)[1].shares(len(still.frames)).max() < 0.01


def test_frames_without_depth_are_legal(config: Config, crossing: Walk) -> None:
    blind = [
        ReducedFrame(f.stamp_s, f.grey, np.zeros_like(f.inverse_depth), CAMERA)
        for f in crossing.frames
    ]
    looked, _ = all_masks(Walk(blind, crossing.poses, crossing.box), config)
    assert np.mean([seen.moving.mean() for seen in looked]) < 0.01


def test_what_moves_is_covered_and_little_else(watchful: Config, crossing: Walk) -> None:
    moving = all_masks(crossing, watchful)[1].moving
    rows = [k for k, box in enumerate(crossing.box) if box.sum() > 100]
    both = sum((moving[k] & crossing.box[k]).sum() for k in rows if k in moving)
    either = sum((moving[k] | crossing.box[k]).sum() if k in moving else 1e9 for k in rows)
    assert both / either > 0.8


def test_what_stands_for_two_seconds_is_covered_before_it_moves_on(watchful: Config) -> None:
    stopped = walk(SECONDS, lambda t_s: -0.4 + 0.6 * (min(t_s, 2.0) + max(t_s - 4.0, 0.0)))
    assert min(recalls(stopped, watchful, range(22, 38))) > 0.8


def test_nothing_is_known_of_before_when_a_mask_begins_anew(
    watchful: Config, crossing: Walk
) -> None:
    anew = mask(watchful)
    for frame, pose in zip(crossing.frames[:20], crossing.poses[:20], strict=True):
        anew.add(anew.look(frame, pose))
    anew.forget()
    assert not anew.look(crossing.frames[40], np.eye(4)).changed.any()

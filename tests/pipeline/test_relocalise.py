import numpy as np
import pytest

from vnav.core import se3
from vnav.pipeline.relocalise import CaptureRelocalisation, RelocalisedKeyframes


def seen(segment: list[int], off_m: list[float], turned_rad: float = 0.0) -> RelocalisedKeyframes:
    """Cameras a metre apart, on a line in their segment and, but for an error, in the world."""
    along = [[k, 0, 0] for k in range(len(segment))]
    T_segment_camera = se3.make(np.tile(np.eye(3), (len(segment), 1, 1)), np.array(along, float))
    T_world_segment = se3.exp([0.1, 0.2, 2.0, 5, -3, 1])
    T_world_camera = T_world_segment @ T_segment_camera
    T_world_camera[:, 2, 3] += off_m
    T_world_camera[:1] = T_world_camera[:1] @ se3.exp([0, 0, turned_rad, 0, 0, 0])
    return RelocalisedKeyframes(np.array(segment, np.int32), T_segment_camera, T_world_camera)


def agreeing(sightings: RelocalisedKeyframes) -> int:
    return CaptureRelocalisation(sightings, 9, None).agreeing


def test_keyframes_agree_where_the_world_has_them_as_their_segment_has() -> None:
    assert agreeing(seen([0, 0, 0, 0], [0, 0.1, -0.1, 6])) == 3


def test_keyframes_of_different_segments_say_nothing_of_each_other() -> None:
    assert agreeing(seen([0, 1, 2], [0, 0, 0])) == 1


def test_keyframes_apart_do_not_agree_nor_do_turned_ones() -> None:
    assert agreeing(seen([0, 0, 0], [0, 1, 2])) == 1
    assert agreeing(seen([0, 0], [0, 0], turned_rad=0.3)) == 1


def test_nothing_located_agrees_with_nothing() -> None:
    nothing = seen([0], [0]).agrees_with(
        RelocalisedKeyframes(np.zeros(0, np.int32), *np.zeros((2, 0, 4, 4)))
    )
    assert nothing.shape == (1, 0)
    assert agreeing(RelocalisedKeyframes(np.zeros(0, np.int32), *np.zeros((2, 0, 4, 4)))) == 0


@pytest.mark.parametrize("metres", [1.0, 100.0])
def test_neighbours_agree_however_far_they_are_from_where_their_segment_began(
    metres: float,
) -> None:
    # Turned by half a degree each its own way: 2 cm from one to the other, 0.9 m at 100 m.
    rng = np.random.default_rng(0)
    there = se3.make(np.eye(3), [metres, 0, 0])
    sightings = seen([0, 0, 0], [0, 0, 0])
    wrong = se3.exp(np.concatenate([0.009 * rng.choice([-1, 1], (3, 3)), np.zeros((3, 3))], 1))
    far = RelocalisedKeyframes(
        sightings.segment,
        there @ sightings.T_segment_camera,
        sightings.T_world_camera @ wrong,
    )
    assert agreeing(far) == 3

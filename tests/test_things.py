"""Rendered things that move as a whole."""

from dataclasses import replace

import numpy as np
import pytest

from vnav.core.arrays import Array
from vnav.synthetic import MINIATURE, SCENES, CaptureSpec
from vnav.synthetic.masks import moving_around
from vnav.synthetic.people import Peopled
from vnav.synthetic.rendered_capture import camera_poses, with_walkers
from vnav.synthetic.things import THINGS, thing_before

PLACE = np.array([1.0, 2.0, 0.3, 2.5])  # x, y, yaw, and the floor of an upper storey
RATE_HZ = 30.0
TIMES_S = np.arange(0, 10, 1 / RATE_HZ)
FASTEST_M_S = 2.0
STAYS = replace(MINIATURE, frames=len(TIMES_S), rate_hz=RATE_HZ, motion="halfsphere")


def corners(name: str) -> Array:
    """All corners of its faces (T, S, 3) at `TIMES_S`."""
    thing = thing_before(name, PLACE, 0)
    return np.array([thing.at(t).corner for t in TIMES_S])


def peopled(spec: CaptureSpec) -> Peopled:
    place = with_walkers(SCENES[spec.scene](spec.seed), spec)
    assert place is not None
    return place


def shares(name: str) -> Array:
    """Of the pixels that show the thing, every third of a second."""
    spec = replace(STAYS, thing=name, camera=MINIATURE.camera.scaled(80, 60))
    place = peopled(spec)
    poses = camera_poses(place, spec)
    shown = [
        place.at(t).render_walkers(spec.camera, T) for t, T in zip(TIMES_S, poses, strict=True)
    ]
    return np.mean(np.array(shown[::10]) > 0, axis=(1, 2))


@pytest.mark.parametrize("name", THINGS)
def test_a_thing_moves_without_jumps_above_the_floor(name: str) -> None:
    there = corners(name)[: round(7.9 * RATE_HZ)]  # the box starts anew after 8 s, out of sight
    steps_m = np.linalg.norm(np.diff(there, axis=0), axis=2)
    assert 0.01 < steps_m.max() < FASTEST_M_S / RATE_HZ
    assert there[..., 2].min() >= PLACE[3] - 1e-9


@pytest.mark.parametrize("name", THINGS)
def test_a_thing_keeps_its_shape(name: str) -> None:
    apart = corners(name) - corners(name)[:, :1]
    assert np.allclose(np.linalg.norm(apart, axis=2), np.linalg.norm(apart[0], axis=1))


def test_a_panel_slides_over_a_third_of_the_view_all_the_time() -> None:
    covered = shares("panel")
    assert covered.min() > 0.15
    assert 0.25 < covered.mean() < 0.4


def test_a_box_fills_the_view_and_leaves_it() -> None:
    covered = shares("box")
    assert covered.max() > 0.8
    assert covered.min() == 0


def test_a_crate_that_was_set_down_stands_still() -> None:
    crate = thing_before("crate", PLACE, 0)
    assert [crate.moves_at(t) for t in (3.0, 4.5, 5.29, 5.31, 9.0)] == [True] * 3 + [False] * 2


def test_things_move_beside_people() -> None:
    spec = replace(STAYS, thing="panel", walkers=2, walker_share=0.2)
    place = peopled(spec)
    assert len(place.walkers) == 3
    assert moving_around(place.walkers, TIMES_S)[0][-1] == 3
    assert len(place.textures.start) == len(place.at(0.0).rectangles.corner)

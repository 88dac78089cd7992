"""Closures that bend steps of odometry, on a walk in a circle whose truth is known.

Some steps are held loosely by their own noise, 5 cm and 50 mrad, as motions by pixels are. What
looks alike lies 1.5 m beside the frames that follow them, and pixels tell the two motions apart.
"""

import dataclasses
from collections.abc import Sequence

import numpy as np
import pytest

from tests.optimisation.walks import EVERY, FixedLook, walked
from vnav.config import OptimiseConfig
from vnav.core import se3
from vnav.core.frame import Edge
from vnav.core.mapping import Odometry
from vnav.optimisation.bent_steps import bending
from vnav.optimisation.robust_graph import robust_pose_graph
from vnav.synthetic.circle import LAP, edge, walk

T = walk(2 * LAP)
LOOSE = range(20, 32)  # frames, of three steps from keyframe to keyframe
BESIDE = se3.make(np.eye(3), [0, 1.5, 0.2])
LOOSELY = np.diag([1 / 0.05**2] * 6)
CLEARLY, HARDLY = 20.0, 0.0  # log-odds against none


class SteppingLook(FixedLook):
    """A second look that bears out steps as they truly are, and others by so much."""

    def __init__(self, other: float) -> None:
        super().__init__(None)
        self._other = other

    def log_odds(self, i: int, j: int, motions: Sequence[np.ndarray]) -> np.ndarray:
        true = se3.inverse(T[i]) @ T[j]
        off_m = [np.linalg.norm((se3.inverse(true) @ motion)[:3, 3]) for motion in motions]
        told = np.array([CLEARLY if off < 0.1 else self._other for off in off_m] + [0.0])
        return told[:, None] - told

    def is_borne_out(self, *_: object, **__: object) -> bool:
        return True


def loosely_held() -> Odometry:
    """The walk, with one edge to each loose frame."""
    edges = [
        dataclasses.replace(e, information=LOOSELY) if e.j in LOOSE else e
        for e in walked(T).edges
        if e.j not in LOOSE or e.i == e.j - 1
    ]
    return dataclasses.replace(walked(T), edges=tuple(edges))


def beside(count: int) -> list[Edge]:
    """Closures from the first keyframes to those after the loose steps, that are beside."""
    moved, rng = T.copy(), np.random.default_rng(5)
    moved[LOOSE.stop :] = BESIDE @ T[LOOSE.stop :]
    return [edge(moved, EVERY * k, LOOSE.stop + EVERY * k, rng) for k in range(count)]


def right(count: int) -> list[Edge]:
    """Closures across the loose steps that are right."""
    rng = np.random.default_rng(6)
    return [edge(T, EVERY * k, LOOSE.stop + EVERY * k, rng) for k in range(count)]


def off_m(poses: np.ndarray) -> float:
    """Of the worst frame."""
    off = se3.inverse(se3.inverse(T[0]) @ T) @ se3.inverse(poses[0]) @ poses
    return float(np.linalg.norm(off[:, :3, 3], axis=1).max())


def test_closures_that_bend_what_pixels_bear_out_are_not_kept() -> None:
    found = beside(4)
    bent = robust_pose_graph(loosely_held(), found, OptimiseConfig(), None)
    assert bent.graph.kept.all()
    assert off_m(bent.graph.T_world_camera) > 1.0
    look: object = SteppingLook(HARDLY)
    robust = robust_pose_graph(loosely_held(), found, OptimiseConfig(), look)  # type: ignore[arg-type]
    assert not robust.graph.kept.any()
    assert off_m(robust.graph.T_world_camera) < 0.3  # 12 steps of 5 cm leave 0.17 m open


@pytest.mark.parametrize(("other", "bends"), [(HARDLY, True), (CLEARLY, False)])
def test_a_step_is_bent_where_pixels_bear_out_odometry_alone(other: float, bends: bool) -> None:
    found, odometry = beside(4), loosely_held()
    poses = robust_pose_graph(odometry, found, OptimiseConfig(), None).graph.T_world_camera
    look: object = SteppingLook(other)
    kept = np.ones(len(found), bool)
    assert bending(odometry, poses, found, kept, look).all() == bends  # type: ignore[arg-type]


def test_closures_that_agree_with_odometry_bend_nothing_nor_do_those_that_are_not_kept() -> None:
    found, odometry = [*beside(3), *right(2)], loosely_held()
    poses = robust_pose_graph(odometry, beside(3), OptimiseConfig(), None).graph.T_world_camera
    look: object = SteppingLook(HARDLY)
    kept = np.array([True, True, False, True, True])
    bent = bending(odometry, poses, found, kept, look)  # type: ignore[arg-type]
    assert bent.tolist() == [True, True, False, False, False]


def test_without_closures_nothing_is_bent() -> None:
    look: object = SteppingLook(HARDLY)
    assert not len(bending(walked(T), T, [], np.zeros(0, bool), look))  # type: ignore[arg-type]

"""Surfaces of the tiny capture, whose walk ends where it began; its odometry is right to mm."""

import dataclasses
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from vnav.config import Config
from vnav.core import se3
from vnav.core.arrays import Array
from vnav.core.camera import Intrinsics
from vnav.core.camera_motion import velocities
from vnav.core.frame import Edge, Frame
from vnav.core.graph import chain
from vnav.core.mapping import Odometry
from vnav.io.formats.trajectories import read_tum
from vnav.io.store.artifacts import load_keyframe, load_odometry
from vnav.io.store.map_folder import MapFolder
from vnav.optimisation.revisits import Revisits
from vnav.optimisation.second_look import SecondLook
from vnav.optimisation.solution import solve

CONFIG = Config()
DRIFT_RAD = 0.02  # over the walk, about the first camera's y: 4 cm at 2 m, 5 sigma of depth
NO_MATCHES = np.zeros((0, 4), np.int32)
DELAY_S, FASTER = 0.1, 2.0  # 10 frames a second: their velocities are known

Looking = Callable[[Odometry], SecondLook]


@pytest.fixture(scope="module")
def looking(folder: MapFolder, camera: Intrinsics) -> Looking:
    views = partial(load_keyframe, folder, frames=load_odometry(folder).frames)
    return lambda odometry: SecondLook(odometry, [camera], views, CONFIG)


@pytest.fixture(scope="module")
def true(tiny_capture: Path) -> Array:
    """The poses (N, 4, 4) of the walk."""
    return read_tum(tiny_capture / "groundtruth.txt").T_world_camera


@pytest.fixture(scope="module")
def bent(odometry: Odometry) -> Odometry:
    """The same walk by edges that each turn a little too far."""
    frames = len(odometry.frames)

    def turned(e: Edge) -> Edge:
        too_far = se3.exp([0.0, DRIFT_RAD * (e.j - e.i) / frames, 0.0, 0.0, 0.0, 0.0])
        return dataclasses.replace(e, T_i_j=e.T_i_j @ too_far)

    edges = tuple(map(turned, odometry.edges))
    poses, segment = chain(frames, edges, odometry.keyframe_rows.tolist())
    return dataclasses.replace(odometry, edges=edges, T_segment_camera=poses, segment=segment)


def turned_rad(revisits: Revisits, poses: Array, right: Array) -> float:
    """How far the keyframes of revisits are turned against each other, on average."""
    i, j = np.transpose(revisits.pairs)
    off = se3.inverse(se3.inverse(right[i]) @ right[j]) @ se3.inverse(poses[i]) @ poses[j]
    return float(np.linalg.norm(se3.log_so3(off[:, :3, :3]), axis=1).mean())


def off_m(pairs: Sequence[tuple[int, int]], T_i_j: Array, poses: Array) -> Array:
    """How far motions (P, 4, 4) are off those between poses."""
    i, j = np.transpose(pairs)
    return np.linalg.norm((se3.inverse(T_i_j) @ se3.inverse(poses[i]) @ poses[j])[:, :3, 3], axis=1)


def at_once(odometry: Odometry) -> np.ndarray:
    """Delays (N,) of depth that is measured with colour."""
    return np.zeros(len(odometry.frames))


def test_surfaces_bear_out_a_walk_that_is_right(odometry: Odometry, looking: Looking) -> None:
    revisits = looking(odometry).revisits(odometry.T_segment_camera, at_once(odometry))
    assert len(revisits.pairs) >= 5
    assert not revisits.contradict


def with_somebody(frame: Frame) -> Frame:
    """Somebody near covers a quarter of the view."""
    color, depth_m = frame.color.copy(), frame.depth_m.copy()
    height, width = depth_m.shape
    body = slice(height // 8, None), slice(3 * width // 5, 9 * width // 10)
    depth_m[body] = 0.6
    color[body] = np.random.default_rng(frame.index).integers(0, 255, color[body].shape)
    return dataclasses.replace(frame, color=color, depth_m=depth_m)


@pytest.fixture
def looking_past(odometry: Odometry, folder: MapFolder, camera: Intrinsics) -> Looking:
    """At keyframes of which the last shows somebody who stands there."""
    last = odometry.keyframe_rows[-1]

    def views(row: int) -> Frame:
        frame = load_keyframe(folder, row, odometry.frames)
        return with_somebody(frame) if row == last else frame

    return lambda odometry: SecondLook(odometry, [camera], views, CONFIG)


@pytest.mark.parametrize("turned", [False, True])
def test_somebody_who_stands_where_a_walk_ends_does_not_hide_whether_it_is_right(
    odometry: Odometry, bent: Odometry, true: Array, looking_past: Looking, turned: bool
) -> None:
    poses = bent.T_segment_camera if turned else true
    assert looking_past(odometry).revisits(poses, at_once(odometry)).contradict == turned


def test_surfaces_contradict_a_walk_that_has_turned_too_far(
    bent: Odometry, looking: Looking
) -> None:
    assert looking(bent).revisits(bent.T_segment_camera, at_once(bent)).contradict


def test_edges_by_surfaces_are_nearer_to_the_truth_than_the_walk(
    odometry: Odometry, bent: Odometry, looking: Looking
) -> None:
    look, right = looking(bent), odometry.T_segment_camera
    revisits = look.revisits(bent.T_segment_camera, at_once(bent))

    edges = look.surface_edges(revisits, set())

    assert {(e.i, e.j) for e in edges} <= set(revisits.pairs)
    assert len(edges) >= 5
    for e in edges:
        off = se3.deviation(se3.inverse(se3.inverse(right[e.i]) @ right[e.j]) @ e.T_i_j)
        assert off @ e.information @ off < 6  # that of its own six degrees of freedom
        assert np.linalg.norm(off[:3]) < 0.75 * DRIFT_RAD * (e.j - e.i) / len(right)


def test_keyframes_that_are_joined_already_get_no_second_edge(
    bent: Odometry, looking: Looking
) -> None:
    look = looking(bent)
    revisits = look.revisits(bent.T_segment_camera, at_once(bent))
    first, *others = look.surface_edges(revisits, set())

    found = look.surface_edges(revisits, {(first.i, first.j)})

    assert [(e.i, e.j) for e in found] == [(e.i, e.j) for e in others]


def test_surfaces_take_back_what_a_walk_without_loops_has_turned(
    odometry: Odometry, bent: Odometry, looking: Looking, camera: Intrinsics
) -> None:
    look, right = looking(bent), odometry.T_segment_camera
    revisits = look.revisits(bent.T_segment_camera, at_once(bent))

    without = solve(bent, [], NO_MATCHES, [camera], CONFIG)
    by_surfaces = solve(bent, [], NO_MATCHES, [camera], CONFIG, look=look)

    assert not without.surfaces
    assert len(by_surfaces.surfaces) >= 5
    before, after = (turned_rad(revisits, s.poses, right) for s in (without, by_surfaces))
    assert after < 0.75 * before  # so few and so coarse pixels tell it to 0.01 rad


def test_a_walk_that_is_right_is_adjusted_once(
    odometry: Odometry, looking: Looking, camera: Intrinsics
) -> None:
    walks = (
        solve(odometry, [], NO_MATCHES, [camera], CONFIG, look=look)
        for look in (None, looking(odometry))
    )
    without, with_look = (walk.poses for walk in walks)
    assert np.array_equal(without, with_look)


def test_surfaces_are_held_against_each_other_where_depth_was_measured(
    odometry: Odometry, looking: Looking
) -> None:
    """Poses of the moments before depth, which is said to be late by so much."""
    frames = odometry.frames
    fast = dataclasses.replace(frames, stamp_s=frames.stamp_s / FASTER)
    walk, right = dataclasses.replace(odometry, frames=fast), odometry.T_segment_camera
    early = right @ se3.exp(-velocities(right, fast) * DELAY_S)
    look = looking(walk)

    now = at_once(walk)
    told, untold = look.revisits(early, now + DELAY_S), look.revisits(early, now)

    by_delay, without = (off_m(told.pairs, r.T_i_j, right).max() for r in (told, untold))
    assert by_delay < 0.5 * without  # a velocity changes in a tenth of a second, too
    edges = look.surface_edges(told, set())
    pairs, by_surface = [(e.i, e.j) for e in edges], np.stack([e.T_i_j for e in edges])
    assert off_m(pairs, by_surface, early).mean() < 0.5 * off_m(pairs, by_surface, right).mean()

"""A room whose chair moves, whose box goes and whose door opens, at true poses."""

import dataclasses

import numpy as np
import pytest

from vnav.config import Config
from vnav.core.frame import Frame
from vnav.synthetic import MINIATURE, SCENES, Box, Scene, Sensor
from vnav.synthetic.rendered_capture import camera_poses
from vnav.synthetic.sensor import measured_depth
from vnav.volumes.departed import DepthHistory, seen_depth
from vnav.volumes.fusion import FusedVolumes, PosedFrame, fuse

CONFIG = Config()
CELL_M = CONFIG.fuse.octree_m
SPEC = dataclasses.replace(MINIATURE, frames=24)
GREY = np.full((240, 320, 3), 128, np.uint8)


def views(name: str) -> list[PosedFrame]:
    """Keyframes of a walk through a scene, without its colours."""
    scene, camera, rng = SCENES[name](0), SPEC.camera, np.random.default_rng(0)
    return [
        PosedFrame(Frame(0, k, k, GREY, depth_m, camera), T)
        for k, T in enumerate(camera_poses(scene, SPEC))
        for depth_m in [measured_depth(scene.render_depth(camera, T), camera, Sensor(), rng)]
    ]


def history(frames: list[PosedFrame]) -> DepthHistory:
    seen = [
        seen_depth(view.frame.depth_m, view.frame.intrinsics, view.T_world_camera)
        for view in frames
    ]
    sigma_per_m2, needed = CONFIG.registration.depth_sigma_per_m2, CONFIG.fuse.departed_after
    return DepthHistory(seen, sigma_per_m2, CELL_M, needed)


@pytest.fixture(scope="module")
def before() -> list[PosedFrame]:
    return views("room_before")


@pytest.fixture(scope="module")
def both(before: list[PosedFrame]) -> list[PosedFrame]:
    return before + views("room_after")


@pytest.fixture(scope="module")
def fused_before(before: list[PosedFrame]) -> FusedVolumes:
    return fuse(before.__getitem__, history(before), CONFIG.fuse)


@pytest.fixture(scope="module")
def fused_both(both: list[PosedFrame]) -> FusedVolumes:
    return fuse(both.__getitem__, history(both), CONFIG.fuse)


def boxes(scene: Scene) -> set[Box]:
    return {box for piece in scene.pieces for box in piece}


def near(points: np.ndarray, things: set[Box], within_m: float) -> np.ndarray:
    """Which points (N, 3) are so near to a box."""
    found = np.zeros(len(points), bool)
    for box in things:
        own = np.abs((points - box.centre) @ box.R_world_box) - np.array(box.size) / 2
        found |= np.linalg.norm(np.maximum(own, 0), axis=1) <= within_m
    return found


def of_what_left(points: np.ndarray) -> int:
    """How many points are on what left, and not beside what stands there now."""
    now = boxes(SCENES["room_after"](0))
    left = boxes(SCENES["room_before"](0)) - now
    return int((near(points, left, CELL_M) & ~near(points, now, 2 * CELL_M)).sum())


def of_what_came(points: np.ndarray) -> int:
    now = boxes(SCENES["room_after"](0))
    return int(near(points, now - boxes(SCENES["room_before"](0)), CELL_M).sum())


def occupied(fused: FusedVolumes) -> np.ndarray:
    leaves = fused.octree.most_likely.leaves()
    return leaves.centres_world[leaves.occupied]


def test_what_left_is_gone_from_octree_cloud_and_mesh(
    fused_before: FusedVolumes, fused_both: FusedVolumes
) -> None:
    for places in (
        occupied,
        lambda fused: fused.cloud.points_world,
        lambda fused: fused.mesh.vertices_world,
    ):
        was, now = of_what_left(places(fused_before)), of_what_left(places(fused_both))
        assert was > 400
        assert now < 0.1 * was  # a place in ten is seen through by fewer than three keyframes


def test_what_came_is_there(fused_before: FusedVolumes, fused_both: FusedVolumes) -> None:
    was, now = of_what_came(occupied(fused_before)), of_what_came(occupied(fused_both))
    assert now > was + 400


def test_what_is_left_out_is_told_and_lies_on_what_left(
    fused_before: FusedVolumes, fused_both: FusedVolumes
) -> None:
    departed = fused_both.departed_world
    left = boxes(SCENES["room_before"](0)) - boxes(SCENES["room_after"](0))
    assert len(departed) > 400
    assert near(departed, left, CELL_M).mean() > 0.95
    assert len(fused_before.departed_world) < 0.001 * len(occupied(fused_before))

"""A camera that moves along a wall, and a box before it that may move: frames in blocks."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from vnav.config import Config
from vnav.core.camera import Intrinsics
from vnav.core.frame import Features
from vnav.core.mapping import FrameFeatures
from vnav.core.reduced_frame import ReducedFrame
from vnav.features.sift import SPACE
from vnav.tracking.frame_masks import FrameMasks, SeenFrame
from vnav.tracking.pose_choice import TrackedFrame

CAMERA = Intrinsics(80, 60, 65.0, 65.0, 39.5, 29.5)
WALL_M, BOX_M, HALF_BOX_M = 3.0, 2.0, (0.25, 0.4)
STEP_S, CAMERA_STEP_M = 0.1, 0.01
NO_FEATURES = Features(np.zeros((0, 2)), SPACE.none(), *np.zeros((3, 0)), SPACE)
Place = Callable[[float], float]  # of the box, in metres to the right, by time


@dataclass(frozen=True)
class Walk:
    """Frames, their poses (4, 4), and where each shows the box (h, w)."""

    frames: list[ReducedFrame]
    poses: list[np.ndarray]
    box: list[np.ndarray]


def walk(seconds: float, place: Place | None, gain: Callable[[int], float] = lambda k: 1.0) -> Walk:
    """A walk past the wall; ``place`` of the box, None without it. Depth has a sensor's noise."""
    frames, poses, boxes = [], [], []
    for k in range(round(seconds / STEP_S)):
        pose = np.eye(4)
        pose[0, 3] = CAMERA_STEP_M * k
        grey, depth_m, box = _seen(pose[0, 3], None if place is None else place(STEP_S * k))
        noise = 0.0014 * np.random.default_rng(k).standard_normal(depth_m.shape)
        edge = _beside_the_other(box)
        inverse_depth = np.where(edge, 0, 1 / depth_m + noise)
        grey = np.clip(gain(k) * grey, 0, 255)
        frames.append(ReducedFrame(STEP_S * k, grey, inverse_depth, CAMERA))
        poses.append(pose)
        boxes.append(box)
    return Walk(frames, poses, boxes)


def _seen(camera_m: float, box_m: float | None) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rows, columns = np.indices((CAMERA.height, CAMERA.width))
    rays = CAMERA.unproject(np.stack([columns, rows], -1), np.ones(rows.shape))
    x, y = WALL_M * rays[..., 0] + camera_m, WALL_M * rays[..., 1]
    grey = 120 + 50 * np.sin(5 * x) * np.cos(4 * y)
    depth_m, box = np.full(rows.shape, WALL_M), np.zeros(rows.shape, bool)
    if box_m is not None:
        x, y = BOX_M * rays[..., 0] + camera_m - box_m, BOX_M * rays[..., 1]
        box = (np.abs(x) < HALF_BOX_M[0]) & (np.abs(y) < HALF_BOX_M[1])
        grey = np.where(box, 60 + 30 * np.sin(20 * x), grey)
        depth_m = np.where(box, BOX_M, depth_m)
    return grey, depth_m, box


def _beside_the_other(box: np.ndarray) -> np.ndarray:
    """Blocks of the box with the wall beside them: the edge, where a sensor has no depth."""
    around = np.pad(box, 1)
    neighbours = [around[1:-1, 2:], around[1:-1, :-2], around[2:, 1:-1], around[:-2, 1:-1]]
    return box & ~np.logical_and.reduce(neighbours)


def all_masks(seen: Walk, config: Config) -> tuple[list[SeenFrame], FrameMasks]:
    """Every frame as it is looked at, and the masks that all have in the end."""
    masks = FrameMasks(config)
    looked = [look_on(masks, seen, row) for row in range(len(seen.frames))]
    masks.restart()
    return looked, masks


def look_on(masks: FrameMasks, seen: Walk, row: int) -> SeenFrame:
    """The next frame as it is looked at."""
    camera = CAMERA.scaled(4 * CAMERA.width, 4 * CAMERA.height)
    nothing = FrameFeatures(row, NO_FEATURES, np.zeros((0, 3)))
    frame = TrackedFrame(nothing, seen.frames[row], camera)
    looked = masks.look(frame, seen.poses[row])
    masks.add(looked, seen.poses[row], is_keyframe=True)
    return looked

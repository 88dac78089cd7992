"""The world frame: z up, floor at z = 0, x along the walls."""

import dataclasses

import numpy as np

from vnav.core import se3
from vnav.core.arrays import Array
from vnav.core.mapping import Odometry, OptimisedMap, World
from vnav.optimisation.floor import AUTO, SIDES, find_floor, up_in_camera
from vnav.optimisation.sensor_errors import depth_delays
from vnav.optimisation.solution import Solution
from vnav.optimisation.surface import Surface

CLEARLY = 0.5  # length of up in images, on average, that has a side
UPRIGHT = 0.2  # cosine between up and the normal of a wall, at most
LINE_M, BIN_M = 0.02, 0.005  # standard deviation of a wall about its line; edge of a bin
SPREAD = np.exp(-((np.arange(-12, 13) * BIN_M / LINE_M) ** 2) / 2)
TURNS_DEG = ((4.0, 0.2), (0.3, 0.02))  # that are tried: as far, in such steps; coarse, fine


def place_in_world(
    solution: Solution,
    odometry: Odometry,
    surface: Surface,
    rng: np.random.Generator,
    up_in_images: str = AUTO,
) -> OptimisedMap:
    """The solution in the world frame, by the ``surface`` that its keyframes saw.

    Given poses keep their own world, an extended map the one it had; ``up_in_images`` as of
    `find_floor`.
    """
    T_any_camera = solution.adjusted.T_world_camera
    T_any_camera = T_any_camera[np.isfinite(T_any_camera[:, 0, 0])]
    T_floor_any, found = find_world(surface, T_any_camera, rng, up_in_images)
    T_world_any, world = T_floor_any, found
    if odometry.given:
        T_world_any = np.eye(4)
        world = existing_world(found, T_floor_any, T_any_camera[0], "given")
    elif odometry.T_world_before is not None:
        T_world_any = align_to_previous(odometry.T_world_before, solution.poses)
        T_floor_world = T_floor_any @ se3.inverse(T_world_any)
        world = existing_world(found, T_floor_world, T_world_any @ T_any_camera[0], "kept")
    landmarks = solution.adjusted.landmarks
    points = se3.transform(T_world_any, landmarks.points_world).astype(np.float32)
    side = side_up(T_world_any @ T_any_camera)
    return OptimisedMap(
        T_world_any @ solution.poses,
        solution.adjusted.covariance,
        dataclasses.replace(landmarks, points_world=points),
        dataclasses.replace(world, up_in_images=side),
        depth_delays(solution.adjusted.sensor.errors, odometry.frames),
    )


def find_world(
    surface: Surface, T_any_camera: Array, rng: np.random.Generator, up_in_images: str = AUTO
) -> tuple[Array, World]:
    """``T_world_any``, the transformation to the world, and how it was found.

    The floor is the plane that much surface lies on, hardly any under, and whose normal points the
    same way, upwards, in all images. Where no floor is seen, up is the normal of the horizontal
    structure or else the cameras' mean up, and z = 0 at the lowest points.
    """
    floor = find_floor(surface, T_any_camera, rng, up_in_images)
    if floor is None:
        mean = T_any_camera[:, :3, :3].mean(0) @ up_in_camera(T_any_camera, up_in_images)
        up, source = _horizontal_structure(surface, mean / max(float(np.linalg.norm(mean)), 1e-9))
        height = float(np.percentile(surface.points @ up, 0.5)) if len(surface.points) else 0.0
        return _upright_frame(up, height, surface, T_any_camera), World(source, 0, None)
    T_world_any = _upright_frame(floor.up, floor.height, surface, T_any_camera)
    off = surface.points[floor.members] @ floor.up - floor.height
    rms, less_stands = float(np.sqrt((off**2).mean())), floor.less_stands
    return T_world_any, World("floor", len(off), rms, floor_less_stands=less_stands)


def existing_world(found: World, T_floor_world: Array, T_world_camera: Array, source: str) -> World:
    """A world that is given, or kept, and where the floor that was found lies in it.

    ``T_floor_world``: as `find_world` gives it; ``T_world_camera``: a camera above the floor.
    """
    if found.source != "floor":
        return World(source, 0, None)
    up = T_floor_world[2, :3]
    camera = T_world_camera[:3, 3]
    foot = camera - (camera @ up + T_floor_world[2, 3]) * up
    tilt_deg = float(np.rad2deg(np.arccos(np.clip(up[2], -1, 1))))
    return World(source, found.floor_points, found.floor_rms_m, float(foot[2]), tilt_deg)


def side_up(T_world_camera: Array) -> str:
    """The side of the images that is up, by all cameras; the top where none clearly is."""
    z_in_camera = T_world_camera[:, 2, :3].mean(0)
    clearly = {side: z for side in SIDES if (z := float(z_in_camera @ SIDES[side])) > CLEARLY}
    return "top" if "top" in clearly or not clearly else max(clearly, key=clearly.__getitem__)


def align_to_previous(T_world_before: Array, T_any_camera: Array) -> Array:
    """``T_world_any`` that moves cameras least from where they were in a world (N, 4, 4).

    By least squares over each camera's centre and the points 1 m along its axes, so that cameras on
    one spot or line fix it, too. Rows that are NaN in either count for nothing.
    """
    both = np.isfinite(T_world_before[:, 0, 0]) & np.isfinite(T_any_camera[:, 0, 0])
    axes = np.vstack([np.zeros(3), np.eye(3)])
    before, now = (se3.transform(T[both], axes) for T in (T_world_before, T_any_camera))
    return se3.align(before.reshape(-1, 3), now.reshape(-1, 3))


def _horizontal_structure(surface: Surface, mean: Array) -> tuple[Array, str]:
    """Up from horizontal surfaces about the cameras' ``mean`` up, or that mean itself.

    A ceiling, and what else is seen from below, faces down.
    """
    up = mean
    for angle_deg in (30.0, 15.0, 10.0):
        along = surface.normals @ up
        level = np.abs(along) > np.cos(np.deg2rad(angle_deg))
        if level.sum() < max(50, 0.03 * len(along)):
            return mean, "cameras"
        up = np.median(surface.normals[level] * np.sign(along[level, None]), axis=0)
        up = up / np.linalg.norm(up)
    return up, "structure"


def _upright_frame(up: Array, height: float, surface: Surface, T_any_camera: Array) -> Array:
    """``T_world_any``: z along up, origin under the first camera, x along a wall.

    Of the four directions along the walls, the one nearest to where the first camera looks.
    """
    forward = T_any_camera[0, :3, 2]
    if abs(forward @ up) > 0.99:
        forward = T_any_camera[0, :3, 1]
    x = forward - (forward @ up) * up
    x /= np.linalg.norm(x)
    y = np.cross(up, x)
    wall = np.abs(surface.normals @ up) < UPRIGHT
    across = np.stack([x, y], 1)
    turn = _walls_turn(surface.points[wall] @ across, surface.normals[wall] @ across)
    x = np.cos(turn) * x + np.sin(turn) * y
    R = np.stack([x, np.cross(up, x), up])
    origin = T_any_camera[0, :3, 3]
    foot = origin - (origin @ up - height) * up
    return se3.make(R, -R @ foot)


def _walls_turn(points: Array, normals: Array) -> float:
    """Angle from the first axis to the walls, in radians, of their points and normals (N, 2).

    It is where points lie on the fewest lines along either axis, near to the mean of the normals,
    which furniture and the noise of depth turn by half a degree. 0 of nothing.
    """
    phase = np.exp(4j * np.arctan2(normals[:, 1], normals[:, 0])).sum()
    if abs(phase) == 0:
        return 0.0
    best = float(np.angle(phase)) / 4
    for reach, step in np.deg2rad(TURNS_DEG):
        turns = best + np.arange(-reach, reach + step / 2, step)
        best = max(turns.tolist(), key=lambda turn: _sharpness(points, turn))
    return best


def _sharpness(points: Array, turn: float) -> float:
    """How densely points (N, 2) lie on lines along two axes that are turned by so much."""
    x = np.array([np.cos(turn), np.sin(turn)])
    offsets = (points @ x, points @ (-x[1], x[0]))
    bins = [((offset - offset.min()) / BIN_M).astype(np.intp) for offset in offsets]
    return float(sum((np.convolve(np.bincount(b), SPREAD) ** 2).sum() for b in bins))

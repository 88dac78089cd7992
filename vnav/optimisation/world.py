"""The world frame: z up, floor at z = 0, x along the walls."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vnav.core import se3
from vnav.core.arrays import Array
from vnav.core.camera import Intrinsics
from vnav.core.mapping import World
from vnav.volumes.cloud import first_in_voxel

COLUMNS = 80  # of sampled pixels in an image; normals reach from one to the next
VOXEL_M = 0.05  # of the surface, so that support is area and not time spent looking
BAND_M = 0.04  # half the thickness of what counts as one plane
BELOW_M = 0.15  # what lies deeper than this lies under the plane
MAX_BELOW = 0.02  # share of the surface that may lie under a floor: reflections, noise
MIN_SUPPORT = 0.02  # share of the surface that must lie on it
HEIGHTS_M = (0.15, 3.0)  # of the cameras above a floor
STEADY = 0.7  # length of the mean of a floor's normals in all cameras; a wall's turns about
UPRIGHT = 0.25  # of it across the optical axis: the cameras do not look straight down
HYPOTHESES = 500
COS_SAME = float(np.cos(np.deg2rad(15)))


@dataclass(frozen=True)
class Surface:
    """Points (N, 3) with unit normals (N, 3) towards the camera that saw them, in any frame."""

    points: Array
    normals: Array


def find_world(
    surface: Surface, T_any_camera: Array, rng: np.random.Generator
) -> tuple[Array, World]:
    """``T_world_any``, the transformation to the world, and how it was found.

    The floor is the plane that much surface lies on, hardly any under, and whose normal points the
    same way, upwards, in all images. Where no floor is seen, up is the normal of the horizontal
    structure or else the cameras' mean up, and z = 0 at the lowest points.
    """
    floor = _floor(surface, T_any_camera, rng)
    if floor is None:
        up, source = _structure(surface, T_any_camera)
        height = float(np.percentile(surface.points @ up, 0.5)) if len(surface.points) else 0.0
        return _upright(up, height, surface, T_any_camera), World(source, 0, None)
    up, height, members = floor
    rms = float(np.sqrt(((surface.points[members] @ up - height) ** 2).mean()))
    return _upright(up, height, surface, T_any_camera), World("floor", int(members.sum()), rms)


def in_given(
    found: World, T_floor_given: Array, T_given_camera: Array, source: str = "given"
) -> World:
    """A world that is given, or kept, and where the floor that was found lies in it.

    ``T_floor_given``: as `find_world` gives it; ``T_given_camera``: a camera above the floor.
    """
    if found.source != "floor":
        return World(source, 0, None)
    up = T_floor_given[2, :3]
    camera = T_given_camera[:3, 3]
    foot = camera - (camera @ up + T_floor_given[2, 3]) * up
    tilt_deg = float(np.rad2deg(np.arccos(np.clip(up[2], -1, 1))))
    return World(source, found.floor_points, found.floor_rms_m, float(foot[2]), tilt_deg)


def kept_world(T_world_before: Array, T_any_camera: Array) -> Array:
    """``T_world_any`` that moves cameras least from where they were in a world (N, 4, 4).

    By least squares over each camera's centre and the points 1 m along its axes, so that cameras on
    one spot or line fix it, too. Rows that are NaN in either count for nothing.
    """
    both = np.isfinite(T_world_before[:, 0, 0]) & np.isfinite(T_any_camera[:, 0, 0])
    marks = np.vstack([np.zeros(3), np.eye(3)])
    before, now = (se3.transform(T[both], marks) for T in (T_world_before, T_any_camera))
    return se3.align(before.reshape(-1, 3), now.reshape(-1, 3))


def seen_surface(
    depths: Iterable[NDArray[np.float32]],
    cameras: Sequence[Intrinsics],
    T_any_camera: Array,
    max_depth_m: float,
) -> Surface:
    """The surface in several depth images, one point a voxel; empty where nothing is seen."""
    parts = [
        _in_view(depth, camera, T, max_depth_m)
        for depth, camera, T in zip(depths, cameras, T_any_camera, strict=True)
    ]
    both = np.concatenate([np.zeros((0, 6)), *parts])
    first = first_in_voxel(both[:, :3], VOXEL_M)
    return Surface(both[first, :3], both[first, 3:])


def _in_view(
    depth_m: NDArray[np.float32], camera: Intrinsics, T_any_camera: Array, max_depth_m: float
) -> Array:
    """Points and normals (N, 6) of one depth image, where it is smooth."""
    step = max(1, camera.width // COLUMNS)
    z = depth_m[::step, ::step].astype(float)
    v, u = np.mgrid[: z.shape[0], : z.shape[1]] * float(step)
    points = camera.unproject(np.stack([u, v], -1), z)
    right, down = points[1:-1, 2:] - points[1:-1, :-2], points[2:, 1:-1] - points[:-2, 1:-1]
    middle = points[1:-1, 1:-1]
    normals = np.cross(down, right)  # towards the camera
    length = np.linalg.norm(normals, axis=-1)
    around = np.stack([z[1:-1, 2:], z[1:-1, :-2], z[2:, 1:-1], z[:-2, 1:-1], z[1:-1, 1:-1]])
    smooth = (around.min(0) > 0) & (around.max(0) < 1.25 * around.min(0))
    good = smooth & (length > 1e-9) & (around[-1] <= max_depth_m)
    return np.concatenate(
        [
            se3.transform(T_any_camera, middle[good]),
            normals[good] / length[good][:, None] @ T_any_camera[:3, :3].T,
        ],
        1,
    )


def _floor(
    surface: Surface, T_any_camera: Array, rng: np.random.Generator
) -> tuple[Array, float, NDArray[np.bool_]] | None:
    """Up, height along it, and which points lie on the floor; None where none is convincing."""
    if not len(surface.points):
        return None
    best, best_score = None, 0.0
    for k in rng.integers(0, len(surface.points), HYPOTHESES):
        score = _floor_score(surface, surface.normals[k], surface.points[k], T_any_camera)
        if score > best_score:
            best, best_score = int(k), score
    if best is None:
        return None
    up, height = surface.normals[best], float(surface.points[best] @ surface.normals[best])
    for _ in range(5):
        members = _members(surface, up, height)
        centre = surface.points[members].mean(0)
        up = np.linalg.svd(surface.points[members] - centre, full_matrices=False)[2][2]
        up = up if up @ surface.normals[best] > 0 else -up
        height = float(centre @ up)
    return up, height, _members(surface, up, height)


def _members(surface: Surface, up: Array, height: float) -> NDArray[np.bool_]:
    near = np.abs(surface.points @ up - height) < BAND_M
    return np.asarray(near & (surface.normals @ up > COS_SAME))


def _floor_score(surface: Surface, up: Array, point: Array, T_any_camera: Array) -> float:
    """How much a plane is like a floor: its area, weighted by how steadily it lies below; else 0.

    Seen from a camera that turns about, the normals of walls turn and that of the floor stays:
    the mean of ``up`` in camera coordinates is long. It shows upwards in the image, or sideways
    in that of a rolled camera, rather than along the optical axis.
    """
    height = float(point @ up)
    above = T_any_camera[:, :3, 3] @ up - height
    offset = surface.points @ up - height
    if not HEIGHTS_M[0] < np.median(above) < HEIGHTS_M[1] or above.min() < 0:
        return 0.0
    support = float(_members(surface, up, height).mean())
    if support < MIN_SUPPORT or (offset < -BELOW_M).mean() > MAX_BELOW:
        return 0.0
    in_camera = (np.swapaxes(T_any_camera[:, :3, :3], 1, 2) @ up).mean(0)
    steady = float(np.hypot(in_camera[0], in_camera[1]))
    if np.linalg.norm(in_camera) < STEADY or steady < UPRIGHT:
        return 0.0
    upwards = (1 - in_camera[1] / steady) / 2
    return float(support * steady**4 * upwards)


def _structure(surface: Surface, T_any_camera: Array) -> tuple[Array, str]:
    """Up from horizontal surfaces about the cameras' mean up, or that mean itself."""
    mean = -T_any_camera[:, :3, 1].mean(0)
    up = mean / max(float(np.linalg.norm(mean)), 1e-9)
    for angle_deg in (30.0, 15.0, 10.0):
        alike = surface.normals @ up > np.cos(np.deg2rad(angle_deg))
        if alike.sum() < max(50, 0.03 * len(surface.normals)):
            return mean / max(float(np.linalg.norm(mean)), 1e-9), "cameras"
        up = np.median(surface.normals[alike], axis=0)
        up = up / np.linalg.norm(up)
    return up, "structure"


def _upright(up: Array, height: float, surface: Surface, T_any_camera: Array) -> Array:
    """``T_world_any``: z along up, origin under the first camera, x along a wall.

    Of the four directions along the walls, the one nearest to where the first camera looks.
    """
    forward = T_any_camera[0, :3, 2]
    if abs(forward @ up) > 0.99:
        forward = T_any_camera[0, :3, 1]
    x = forward - (forward @ up) * up
    x /= np.linalg.norm(x)
    y = np.cross(up, x)
    wall = np.abs(surface.normals @ up) < 0.2
    phase = np.exp(4j * np.arctan2(surface.normals[wall] @ y, surface.normals[wall] @ x)).sum()
    turn = np.angle(phase) / 4 if abs(phase) > 0 else 0.0
    x = np.cos(turn) * x + np.sin(turn) * y
    R = np.stack([x, np.cross(up, x), up])
    origin = T_any_camera[0, :3, 3]
    foot = origin - (origin @ up - height) * up
    return se3.make(R, -R @ foot)

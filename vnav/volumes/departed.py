"""Which places have departed: later depth sees through them, clearly and from several keyframes.

Source: 003 S6 (motion detection at map level), whose rule is lost. Here what is seen last is
believed: a place has departed where keyframes see through it after the last that saw it. All around
it must be seen through, too, or a pose that is off by a little would take the edges of what stays.
Beside what departed by that rule a narrower look is enough: hysteresis, as in Canny 1986.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vnav.compiled import compiled
from vnav.core import se3
from vnav.core.arrays import Array
from vnav.core.camera import Intrinsics
from vnav.core.reduced_frame import pixels_of_blocks, reduced_camera

COLUMNS = 160  # of blocks in an image; a place is held against blocks of pixels
NARROW = 1  # blocks around a place that must lie beyond it, where it is beside what surely departed
BESIDE = 2.0  # so near is beside, in slacks
FILLED = 0.5  # share of pixels or blocks that must have depth
SIGMAS = 3.0  # of noise that a measurement must lie beyond a place
Blocks = NDArray[np.float32]


@dataclass(frozen=True)
class SeenDepth:
    """What a keyframe measured in each block of pixels.

    ``least``, ``most`` (h, w) float32 in metres, 0 for blocks most of which have no depth;
    ``camera``: fx, fy, cx, cy in blocks.
    """

    least: Blocks
    most: Blocks
    camera: tuple[float, float, float, float]
    T_camera_world: Array


def seen_depth(
    depth_m: NDArray[np.float32], intrinsics: Intrinsics, T_world_camera: Array
) -> SeenDepth:
    """A depth image (H, W) in metres, 0 where it has none, in blocks."""
    edge = max(1, intrinsics.width // COLUMNS)
    pixels, camera = pixels_of_blocks(depth_m, edge), reduced_camera(intrinsics, edge)
    filled = (pixels > 0).mean(0) >= FILLED
    least = np.where(filled, np.where(pixels > 0, pixels, np.float32(np.inf)).min(0), np.float32(0))
    most = np.where(filled, pixels.max(0), np.float32(0))
    focal_and_centre = camera.fx, camera.fy, camera.cx, camera.cy
    return SeenDepth(least, most, focal_and_centre, se3.inverse(T_world_camera))


class DepthHistory:
    """The depth of keyframes in order of time, which tells what has departed since it was seen.

    Parameters
    ----------
    seen
        What each keyframe measured.
    sigma_per_m2
        Axial noise of depth: its standard deviation is this times depth squared.
    slack_m
        What a place may be off beside that, along rays and across.
    needed
        So many keyframes must see through a place; 0: nothing departs.
    """

    def __init__(
        self, seen: Iterable[SeenDepth], sigma_per_m2: float, slack_m: float, needed: int
    ) -> None:
        self._seen = list(seen)
        self._sigma_per_m2, self._slack_m, self._needed = sigma_per_m2, slack_m, needed
        self._forward = np.array([s.T_camera_world[2] for s in self._seen]).reshape(-1, 4)
        self._farthest_m = np.array([s.most.max(initial=0) for s in self._seen], float)

    def __len__(self) -> int:
        return len(self._seen)

    def departed_since(
        self, keyframe: int, points_world: Array, depth_m: NDArray[np.floating]
    ) -> NDArray[np.bool_]:
        """Which points (N, 3) have departed that a keyframe measured at a depth (N,) in metres."""
        sigma_m = self._sigma_per_m2 * depth_m.astype(float) ** 2
        return self.departed(points_world, sigma_m, np.full(len(points_world), keyframe))

    def departed(
        self, points_world: ArrayLike, sigma_m: ArrayLike, last_seen: NDArray[np.intp]
    ) -> NDArray[np.bool_]:
        """Which places (N,) have departed since they were seen; N = 0 is legal.

        ``points_world`` (N, 3); ``sigma_m`` (N,): the standard deviation of where they are;
        ``last_seen`` (N,): by which keyframe.
        """
        points, sigmas = np.ascontiguousarray(points_world, float), np.asarray(sigma_m, float)
        through, left = np.zeros((2, len(points)), np.int32), np.arange(len(points))
        places = points, sigmas, last_seen
        noise = self._sigma_per_m2, self._slack_m
        for k in self._views_of(points, sigmas, last_seen) if self._needed else ():
            seen = self._seen[k]
            view = seen.least, seen.most, seen.camera, seen.T_camera_world
            left = left[: _look_back(through, left, places, k, view, noise, self._needed)]
            if not len(left):
                break
        surely, narrowly = (through >= self._needed) & (self._needed > 0)
        beside = _beside(points, surely, BESIDE * self._slack_m)
        return np.asarray(surely | narrowly & beside)

    def _views_of(
        self, points: Array, sigmas: Array, last_seen: NDArray[np.intp]
    ) -> NDArray[np.intp]:
        """Keyframes after the first that saw any of the places (N,), and near these, backward."""
        if not len(points):
            return np.zeros(0, np.intp)
        centre = (points.min(0) + points.max(0)) / 2
        radius_m = np.linalg.norm(points - centre, axis=1).max()
        middle_m = self._forward[:, :3] @ centre + self._forward[:, 3]
        nearest_m = np.maximum(middle_m - radius_m, 0)
        off_m = SIGMAS * np.hypot(self._sigma_per_m2 * nearest_m**2, sigmas.max()) + self._slack_m
        near = (middle_m + radius_m > 0) & (nearest_m - off_m <= self._farthest_m)
        near[: last_seen.min() + 1] = False
        return np.flatnonzero(near)[::-1]


def _beside(points: Array, chosen: NDArray[np.bool_], within_m: float) -> NDArray[np.bool_]:
    """Which points (N, 3) have a chosen one within a distance."""
    if not chosen.any():
        return chosen
    from scipy.spatial import cKDTree

    away_m, _ = cKDTree(points[chosen]).query(points, distance_upper_bound=within_m)
    return np.asarray(np.isfinite(away_m))


@compiled
def _look_back(
    through: NDArray[np.int32],
    left: NDArray[np.intp],
    places: tuple[Array, Array, NDArray[np.intp]],
    keyframe: int,
    view: tuple[Blocks, Blocks, tuple[float, float, float, float], Array],
    noise: tuple[float, float],
    needed: int,
) -> int:
    """Count the keyframes (2, N) that see through since a place was seen: all around it, and it.

    Keyframes come in backward. ``left``: places that those after do not decide; what is left now is
    moved to its front, and its number given.
    """
    points, sigmas, last_seen = places
    least, most, (fx, fy, cx, cy), T = view
    sigma_per_m2, slack_m = noise
    height, width = least.shape
    count = 0
    for n in left:
        if last_seen[n] >= keyframe:
            continue
        left[count] = n
        count += 1
        X, Y, Z = points[n]
        z = T[2, 0] * X + T[2, 1] * Y + T[2, 2] * Z + T[2, 3]
        if z <= slack_m:
            continue
        x = T[0, 0] * X + T[0, 1] * Y + T[0, 2] * Z + T[0, 3]
        y = T[1, 0] * X + T[1, 1] * Y + T[1, 2] * Z + T[1, 3]
        u, v = int(np.rint(fx * x / z + cx)), int(np.rint(fy * y / z + cy))
        if u < 0 or v < 0 or u >= width or v >= height or least[v, u] == 0:
            continue
        off_m = slack_m + SIGMAS * np.hypot(sigma_per_m2 * z * z, sigmas[n])
        decided = False
        if least[v, u] > z + off_m:
            reach = int(np.ceil(slack_m * fx / z))
            through[0, n] += _all_beyond(least, u, v, reach, z + off_m)
            through[1, n] += _all_beyond(least, u, v, NARROW, z + off_m)
            decided = through[0, n] >= needed
        else:
            decided = most[v, u] >= z - off_m
        count -= decided
    return count


@compiled
def _all_beyond(least: Blocks, u: int, v: int, reach: int, depth_m: float) -> bool:
    """Whether most blocks within reach were measured, and all of those lie beyond a depth."""
    height, width = least.shape
    measured = 0
    for y in range(max(v - reach, 0), min(v + reach + 1, height)):
        for x in range(max(u - reach, 0), min(u + reach + 1, width)):
            if 0 < least[y, x] <= depth_m:
                return False
            measured += least[y, x] > 0
    return bool(measured >= FILLED * (2 * reach + 1) ** 2)

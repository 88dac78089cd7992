"""Views of textured rectangles that face the camera: exact truth for tests of registration."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from vnav.core.camera import Intrinsics
from vnav.core.frame import Frame

CAMERA = Intrinsics(320, 240, 262.5, 262.5, 159.5, 119.5)
GREY_SIGMA, DEPTH_SIGMA_PER_M2 = 2.0, 0.0014
Texture = Callable[[np.ndarray, np.ndarray], np.ndarray]


@dataclass(frozen=True)
class Plane:
    """A rectangle at a depth, from ``low`` to ``high`` in x and y, all in metres."""

    z: float
    texture: Texture
    low: tuple[float, float] = (-50.0, -50.0)
    high: tuple[float, float] = (50.0, 50.0)

    def moved(self, x: float, y: float = 0.0) -> "Plane":
        """The same thing in another place; its texture goes with it."""
        return Plane(
            self.z,
            lambda u, v: self.texture(u - x, v - y),
            (self.low[0] + x, self.low[1] + y),
            (self.high[0] + x, self.high[1] + y),
        )


def view(
    planes: Sequence[Plane], x: float | np.ndarray, y: float = 0.0, *, seed: int, index: int = 0
) -> Frame:
    """What a camera at x, y sees of them, with the noise of a Kinect; x may be one a row (H, 1)."""
    rng = np.random.default_rng(seed)
    v, u = np.mgrid[: CAMERA.height, : CAMERA.width].astype(float)
    grey, depth = np.zeros(u.shape), np.full(u.shape, np.inf)
    for plane in planes:
        px = (u - CAMERA.cx) / CAMERA.fx * plane.z + x
        py = (v - CAMERA.cy) / CAMERA.fy * plane.z + y
        inside = (px > plane.low[0]) & (px < plane.high[0])
        inside &= (py > plane.low[1]) & (py < plane.high[1]) & (plane.z < depth)
        grey = np.where(inside, plane.texture(px, py), grey)
        depth = np.where(inside, plane.z, depth)
    grey += GREY_SIGMA * rng.standard_normal(u.shape)
    inverse = 1 / depth + DEPTH_SIGMA_PER_M2 * rng.standard_normal(u.shape)
    color = np.repeat(np.clip(grey, 0, 255).astype(np.uint8)[..., None], 3, 2)
    return Frame(0, index, index / 10.0, color, (1 / inverse).astype(np.float32), CAMERA)


def speckle(seed: int, contrast: float = 40.0, grain_m: float = 0.04) -> Texture:
    """Grey values without any order, the same over and over after 20 m."""
    rng = np.random.default_rng(seed)
    cells = 500
    image = cv2.GaussianBlur(rng.standard_normal((cells, cells)), (0, 0), 1.0)
    image = np.clip(128 + contrast * image / image.std(), 0, 255).astype(np.float32)
    image = np.pad(image, (0, 1), mode="wrap")

    def look(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        px, py = (np.mod(k / grain_m, cells).astype(np.float32) for k in (x, y))
        return np.asarray(cv2.remap(image, px, py, cv2.INTER_LINEAR), float)

    return look


def periodic(look: Texture, period_m: float) -> Texture:
    """The same strip again and again along x."""
    return lambda x, y: look(np.mod(x, period_m), y)


def plain(grey: float) -> Texture:
    return lambda x, _: np.full(x.shape, grey)

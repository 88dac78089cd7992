"""Casting one ray per pixel against textured rectangles.

A rectangle ``corner + a U + b V`` with a, b in [0, 1] meets the ray of pixel (x, y) where
``(a, b, 1) / z = H (x, y, 1)``: one 3x3 matrix H a rectangle, linear in the pixel. So a hit needs
no division, and 1 / z, the third row, decides which rectangle is nearest.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from vnav.compiled import compiled
from vnav.core import se3
from vnav.core.camera import Intrinsics

NEAR_M = 0.01
SUPERSAMPLING = 2  # colour rays a pixel, along each axis
MAX_ANISOTROPY = 4.0  # textures seen at a slant are blurred no more than this along the short side


@dataclass(frozen=True)
class Rectangles:
    """S one-sided rectangles in the world, seen from the side where U points right and V down.

    ``corner``, ``u_edge``, ``v_edge`` (S, 3) in metres.
    """

    corner: NDArray[np.float64]
    u_edge: NDArray[np.float64]
    v_edge: NDArray[np.float64]

    @classmethod
    def joined(cls, parts: Sequence["Rectangles"]) -> "Rectangles":
        """Those of all parts, one after the other."""
        return cls(
            np.concatenate([part.corner for part in parts]),
            np.concatenate([part.u_edge for part in parts]),
            np.concatenate([part.v_edge for part in parts]),
        )

    def moved(self, T: NDArray[np.float64]) -> "Rectangles":
        """The same, in the frame of reference that ``T`` (4, 4) leads to."""
        R = T[:3, :3]
        return Rectangles(se3.transform(T, self.corner), self.u_edge @ R.T, self.v_edge @ R.T)


@dataclass(frozen=True)
class Textures:
    """A mip-map pyramid for each of S rectangles in one flat array.

    ``texels`` (T, 3) uint8 RGB; ``start``, ``width``, ``height`` (S, L) int64: where level l of a
    pyramid begins and its size; levels beyond the smallest repeat it.
    """

    texels: NDArray[np.uint8]
    start: NDArray[np.int64]
    width: NDArray[np.int64]
    height: NDArray[np.int64]

    def followed_by(self, other: "Textures") -> "Textures":
        """The textures of these rectangles and of others after them."""
        return Textures(
            np.concatenate([self.texels, other.texels]),
            np.concatenate([self.start, other.start + len(self.texels)]),
            np.concatenate([self.width, other.width]),
            np.concatenate([self.height, other.height]),
        )


def pyramids(images: list[NDArray[np.uint8]], levels: int = 8) -> Textures:
    """Mip-maps of S images (H, W, 3), each level the area average of the one before."""
    parts, start, width, height, total = [], [], [], [], 0
    for image in images:
        for level in range(levels):
            if level > 0 and min(image.shape[:2]) > 1:
                half = (image.shape[1] + 1) // 2, (image.shape[0] + 1) // 2
                image = cv2.resize(image, half, interpolation=cv2.INTER_AREA)
            parts.append(image.reshape(-1, 3))
            start.append(total)
            width.append(image.shape[1])
            height.append(image.shape[0])
            total += len(parts[-1])
    sizes = (np.array(v, np.int64).reshape(-1, levels) for v in (start, width, height))
    return Textures(np.concatenate(parts), *sizes)


def depth_of(
    rectangles: Rectangles, intrinsics: Intrinsics, T_world_camera: NDArray[np.float64]
) -> NDArray[np.float32]:
    """Exact z in metres (height, width) at the pixel centres; 0 where a ray meets nothing."""
    _, inverse_depth, _ = _cast(rectangles, intrinsics, T_world_camera)
    return np.where(inverse_depth > 0, 1 / np.maximum(inverse_depth, 1e-9), 0).astype(np.float32)


def nearest_of(
    rectangles: Rectangles, intrinsics: Intrinsics, T_world_camera: NDArray[np.float64]
) -> NDArray[np.int32]:
    """Which rectangle each pixel's centre sees (height, width); -1 where a ray meets nothing."""
    return _cast(rectangles, intrinsics, T_world_camera)[0]


def color_of(
    rectangles: Rectangles,
    textures: Textures,
    intrinsics: Intrinsics,
    T_world_camera: NDArray[np.float64],
) -> NDArray[np.uint8]:
    """The RGB image (height, width, 3); black where a ray meets nothing."""
    fine = intrinsics.scaled(SUPERSAMPLING * intrinsics.width, SUPERSAMPLING * intrinsics.height)
    nearest, _, H = _cast(rectangles, fine, T_world_camera)
    color = _shade(nearest, H, textures.texels, textures.start, textures.width, textures.height)
    return np.asarray(cv2.resize(color, intrinsics.size, interpolation=cv2.INTER_AREA), np.uint8)


def _cast(
    rectangles: Rectangles, intrinsics: Intrinsics, T_world_camera: NDArray[np.float64]
) -> tuple[NDArray[np.int32], NDArray[np.float64], NDArray[np.float64]]:
    """Nearest rectangle (-1: none) and 1 / z of every pixel, and H (S, 3, 3)."""
    T_camera_world = se3.inverse(T_world_camera)
    R = T_camera_world[:3, :3]
    corner = se3.transform(T_camera_world, rectangles.corner)
    M = np.stack([rectangles.u_edge @ R.T, rectangles.v_edge @ R.T, corner], -1)
    faces_camera = np.linalg.det(M) > 1e-9
    H = np.zeros_like(M)
    H[faces_camera] = np.linalg.inv(M[faces_camera]) @ np.linalg.inv(intrinsics.K)
    boxes = np.where(faces_camera[:, None], _bounding_boxes(M, intrinsics), 0)
    return (*_nearest(H, boxes, intrinsics.height, intrinsics.width), H)


def _bounding_boxes(M: NDArray[np.float64], intrinsics: Intrinsics) -> NDArray[np.int64]:
    """Pixels x0, y0, x1, y1 (S, 4), ends exclusive, that may see what lies before NEAR_M."""
    a, b = np.array([0, 1, 1, 0.0]), np.array([0, 0, 1, 1.0])
    corners = np.einsum("sij,kj->ski", M, np.stack([a, b, np.ones(4)], -1))
    following = np.roll(corners, -1, 1)
    z0, z1 = corners[..., 2:] - NEAR_M, following[..., 2:] - NEAR_M
    crosses = (z0 > 0) != (z1 > 0)
    share = np.where(crosses, z0, 0) / np.where(crosses, z0 - z1, 1)
    points = np.concatenate([corners, corners + share * (following - corners)], 1)
    visible = np.concatenate([z0 > 0, crosses], 1)
    points[..., 2] = np.maximum(points[..., 2], NEAR_M)
    px = intrinsics.project(points)
    low = np.floor(np.where(visible, px, np.inf).min(1))
    high = np.ceil(np.where(visible, px, -np.inf).max(1)) + 1
    box = np.concatenate([low, high], 1)
    return np.asarray(np.clip(box, 0, 2 * intrinsics.size), np.int64)


@compiled
def _nearest(
    H: NDArray[np.float64], boxes: NDArray[np.int64], height: int, width: int
) -> tuple[NDArray[np.int32], NDArray[np.float64]]:
    nearest = np.full((height, width), -1, np.int32)
    inverse_depth = np.zeros((height, width))
    for k in range(len(H)):
        h = H[k]
        x0, y0, x1, y1 = boxes[k]
        for y in range(y0, y1):
            a0 = h[0, 1] * y + h[0, 2]
            b0 = h[1, 1] * y + h[1, 2]
            w0 = h[2, 1] * y + h[2, 2]
            for x in range(x0, x1):
                w = h[2, 0] * x + w0
                if w > inverse_depth[y, x]:
                    a = h[0, 0] * x + a0
                    b = h[1, 0] * x + b0
                    if a >= 0 and b >= 0 and a <= w and b <= w:
                        inverse_depth[y, x] = w
                        nearest[y, x] = k
    return nearest, inverse_depth


@compiled
def _shade(
    nearest: NDArray[np.int32],
    H: NDArray[np.float64],
    texels: NDArray[np.uint8],
    start: NDArray[np.int64],
    width: NDArray[np.int64],
    height: NDArray[np.int64],
) -> NDArray[np.uint8]:
    """Trilinear mip-mapping; the level from the pixel's footprint on the rectangle."""
    color = np.zeros((*nearest.shape, 3), np.uint8)
    for y in range(nearest.shape[0]):
        for x in range(nearest.shape[1]):
            k = nearest[y, x]
            if k < 0:
                continue
            z = 1 / (H[k, 2, 0] * x + H[k, 2, 1] * y + H[k, 2, 2])
            a = (H[k, 0, 0] * x + H[k, 0, 1] * y + H[k, 0, 2]) * z
            b = (H[k, 1, 0] * x + H[k, 1, 1] * y + H[k, 1, 2]) * z
            u, v = width[k, 0] * z, height[k, 0] * z
            ax, bx = (H[k, 0, 0] - a * H[k, 2, 0]) * u, (H[k, 1, 0] - b * H[k, 2, 0]) * v
            ay, by = (H[k, 0, 1] - a * H[k, 2, 1]) * u, (H[k, 1, 1] - b * H[k, 2, 1]) * v
            along_x, along_y = ax * ax + bx * bx, ay * ay + by * by
            longest = max(along_x, along_y) / MAX_ANISOTROPY**2
            footprint = max(np.sqrt(along_x * along_y), longest, 1.0)  # squared
            level = min(np.log2(footprint) / 2, width.shape[1] - 1.001)
            fine = int(level)
            share = level - fine
            red, green, blue = _sample(
                texels, start[k, fine], width[k, fine], height[k, fine], a, b
            )
            if share > 0:
                fine += 1
                r, g, b_ = _sample(texels, start[k, fine], width[k, fine], height[k, fine], a, b)
                red += share * (r - red)
                green += share * (g - green)
                blue += share * (b_ - blue)
            color[y, x, 0] = int(red + 0.5)
            color[y, x, 1] = int(green + 0.5)
            color[y, x, 2] = int(blue + 0.5)
    return color


@compiled
def _sample(
    texels: NDArray[np.uint8], start: int, width: int, height: int, a: float, b: float
) -> tuple[float, float, float]:
    """Bilinear interpolation of one level at (a, b) in [0, 1]."""
    u = min(max(a * width - 0.5, 0.0), width - 1.0)
    v = min(max(b * height - 0.5, 0.0), height - 1.0)
    left, top = int(u), int(v)
    right, bottom = min(left + 1, width - 1), min(top + 1, height - 1)
    du, dv = u - left, v - top
    p, q = start + top * width + left, start + top * width + right
    r, s = start + bottom * width + left, start + bottom * width + right
    wp, wq, wr, ws = (1 - du) * (1 - dv), du * (1 - dv), (1 - du) * dv, du * dv
    return (
        wp * texels[p, 0] + wq * texels[q, 0] + wr * texels[r, 0] + ws * texels[s, 0],
        wp * texels[p, 1] + wq * texels[q, 1] + wr * texels[r, 1] + ws * texels[s, 1],
        wp * texels[p, 2] + wq * texels[q, 2] + wr * texels[r, 2] + ws * texels[s, 2],
    )

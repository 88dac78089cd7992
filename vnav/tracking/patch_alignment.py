"""Patches of one image found in another to a fraction of a pixel: 003 cl.4 S251, S252.

A patch is warped to how the other camera sees it, then moved until its brightness agrees, up to an
offset. Inverse compositional: gradients and normal matrix are those of the warped patch, once.
"""

import numpy as np

from vnav.compiled import compiled
from vnav.core.arrays import Array
from vnav.core.camera import Intrinsics

PATCH_PX = 8  # the source has 4: 16 residuals for 3 unknowns
ITERATIONS = 10
CONVERGED_PX = 0.03
MAX_SHIFT_PX = 6.0  # from where the patch was predicted; Gauss-Newton does not reach farther
MIN_CORRELATION = 0.8  # of the patch and of what it was found to be
GREY_NOISE = 3.0  # of a pixel
MAX_SIGMA_PX = 0.25  # that this noise leaves in the direction of least gradient


def affine_warp(T_b_a: Array, px_a: Array, surface_a: Array, camera: Intrinsics) -> Array:
    """How pixels (N, 2) around each pixel of a move in b: derivatives (N, 2, 2).

    ``surface_a`` (N, 3): inverse depth in 1/m and its slopes along u and v, a plane's. S251.
    """
    R, t = T_b_a[:3, :3], T_b_a[:3, 3]
    focal, centre = np.array([camera.fx, camera.fy]), np.array([camera.cx, camera.cy])
    rays = np.concatenate([(px_a - centre) / focal, np.ones((len(px_a), 1))], 1)
    p = rays @ R.T + surface_a[:, :1] * t  # the point, times its inverse depth in a
    dp = R[:, :2] / focal + surface_a[:, None, 1:] * t[:, None]  # (N, 3, 2)
    along = dp[:, :2] - p[:, :2, None] / p[:, 2:, None] * dp[:, 2:]
    return np.asarray(focal[:, None] * along / p[:, 2:, None])


@compiled
def align_patches(
    image_a: Array, image_b: Array, px_a: Array, px_b: Array, warp: Array, gain: float
) -> Array:
    """Where b shows the patches around pixels (N, 2) of a, near ``px_b``; NaN where it does not.

    ``warp`` (N, 2, 2): as `affine_warp` gives it; ``gain``: how much brighter b is.
    """
    found = np.full((len(px_a), 2), np.nan)
    wide = np.empty((PATCH_PX + 2, PATCH_PX + 2))
    J = np.empty((PATCH_PX * PATCH_PX, 3))
    patch = np.empty(PATCH_PX * PATCH_PX)
    for n in range(len(px_a)):
        if not sample(wide, image_a, px_a[n], np.linalg.inv(warp[n])):
            continue
        wide *= gain
        _differentiate(patch, J, wide)
        H = J.T @ J
        if not _is_corner(H):
            continue
        found[n] = _moved(patch, J, H, image_b, px_b[n])
    return found


@compiled
def _moved(patch: Array, J: Array, H: Array, image: Array, start: Array) -> Array:
    """Gauss-Newton over shift and offset of brightness: S252, eq 8 and 9."""
    nowhere, identity = np.full(2, np.nan), np.eye(2)
    seen = np.empty((PATCH_PX, PATCH_PX))
    px, offset = start.copy(), 0.0
    for _ in range(ITERATIONS):
        if not sample(seen, image, px, identity):
            return nowhere
        e = patch + offset - seen.reshape(-1)
        step = -np.linalg.solve(H, J.T @ e)
        px, offset = px - step[:2], offset + step[2]
        if np.abs(px - start).max() > MAX_SHIFT_PX:
            return nowhere
        if np.abs(step[:2]).max() < CONVERGED_PX:
            return px if _correlation(patch, seen.reshape(-1)) > MIN_CORRELATION else nowhere
    return nowhere


@compiled
def sample(window: Array, image: Array, px: Array, A: Array) -> bool:
    """Fill a square window with the image around a pixel, its offsets moved by A; if all is in."""
    size = len(window)
    height, width = image.shape
    for i in range(size):
        for j in range(size):
            dx, dy = j - (size - 1) / 2, i - (size - 1) / 2
            u = px[0] + A[0, 0] * dx + A[0, 1] * dy
            v = px[1] + A[1, 0] * dx + A[1, 1] * dy
            if not (0 <= u < width - 1 and 0 <= v < height - 1):
                return False
            x, y = int(u), int(v)
            a, b = u - x, v - y
            above = (1 - a) * image[y, x] + a * image[y, x + 1]
            below = (1 - a) * image[y + 1, x] + a * image[y + 1, x + 1]
            window[i, j] = (1 - b) * above + b * below
    return True


@compiled
def _differentiate(patch: Array, J: Array, wide: Array) -> None:
    """The inner part of a window, and its derivatives by shift and by offset of brightness."""
    for i in range(PATCH_PX):
        for j in range(PATCH_PX):
            k = i * PATCH_PX + j
            patch[k] = wide[i + 1, j + 1]
            J[k, 0] = (wide[i + 1, j + 2] - wide[i + 1, j]) / 2
            J[k, 1] = (wide[i + 2, j + 1] - wide[i, j + 1]) / 2
            J[k, 2] = 1.0


@compiled
def _is_corner(H: Array) -> bool:
    """Whether the gradients tell every direction of the shift (Shi, Tomasi 1994)."""
    half_trace, half_difference = (H[0, 0] + H[1, 1]) / 2, (H[0, 0] - H[1, 1]) / 2
    least = half_trace - np.sqrt(half_difference**2 + H[0, 1] ** 2)
    return bool(least * MAX_SIGMA_PX**2 > GREY_NOISE**2)


@compiled
def _correlation(a: Array, b: Array) -> float:
    """Normalised cross-correlation: blind to gain and offset."""
    a, b = a - a.mean(), b - b.mean()
    return float((a * b).sum() / np.sqrt((a * a).sum() * (b * b).sum() + 1e-9))

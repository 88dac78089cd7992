"""The compiled loops of depth registration; imported only where depth is not registered."""

import numpy as np
from numpy.typing import NDArray

from vnav.compiled import compiled

Image = NDArray[np.float32]
Corner = tuple[float, float, float]  # column, row, inverse depth

# Neighbours belong to one surface where their depths differ by less than a slanted surface explains
# (80 degrees: 1 % of the depth at 585 px) plus what the noise of a structured-light sensor does,
# which grows with depth squared (6 mm at 1 m: two disparity steps). In inverse depth:
# slant * i + NOISE.
LEAST_SLANT, SLANT_PX, _NOISE_PER_M = 0.01, 5.85, 0.006
_ON_EDGE = 1e-4  # share of a triangle: a pixel centre on a common edge belongs to both


@compiled
def place(depth_m: Image, rays: Image, offset: Image, uvi: Image, inverse_depth: Image) -> None:
    """Put every depth pixel where it lies in the colour image.

    ``rays`` (h, w, 3): K_color @ R_color_depth @ inverse(K_depth) @ pixel; ``offset`` (3,): K_color
    @ t_color_depth. Fills ``uvi`` (h, w, 3) with column, row and inverse depth there, inverse
    depth 0 where there is none, and enters the nearest pixel of ``inverse_depth`` (H, W), negated.
    """
    height, width = inverse_depth.shape
    for r in range(depth_m.shape[0]):
        for c in range(depth_m.shape[1]):
            d = depth_m[r, c]
            z = rays[r, c, 2] * d + offset[2]
            if d <= 0 or z <= 0:
                uvi[r, c, 2] = 0
                continue
            i = 1 / z
            u = (rays[r, c, 0] * d + offset[0]) * i
            v = (rays[r, c, 1] * d + offset[1]) * i
            uvi[r, c, 0], uvi[r, c, 1], uvi[r, c, 2] = u, v, i
            if -0.5 <= u < width - 0.5 and -0.5 <= v < height - 0.5:
                x, y = int(u + 0.5), int(v + 0.5)
                inverse_depth[y, x] = min(inverse_depth[y, x], -i)


@compiled
def draw(uvi: Image, inverse_depth: Image, slant: float) -> None:
    """Draw the surface between neighbouring depth pixels, the nearest where several overlap.

    ``slant``: by which share of their depth neighbours on one surface may differ.

    Two triangles for each square of four pixels, their inverse depth interpolated linearly, which
    is exact on planes. A surface replaces the lone points that `place` entered.
    """
    for r in range(uvi.shape[0] - 1):
        for c in range(uvi.shape[1] - 1):
            a, b = _corner(uvi, r, c), _corner(uvi, r, c + 1)
            d, e = _corner(uvi, r + 1, c), _corner(uvi, r + 1, c + 1)
            upper = _joined(a[2], b[2], d[2], slant)
            lower = _joined(e[2], d[2], b[2], slant)
            if upper or lower:
                _draw_square(a if upper else b, b, d, e if lower else d, inverse_depth)


@compiled
def _corner(uvi: Image, r: int, c: int) -> Corner:
    return uvi[r, c, 0], uvi[r, c, 1], uvi[r, c, 2]


@compiled
def _joined(i: float, j: float, k: float, slant: float) -> bool:
    low, high = min(i, min(j, k)), max(i, max(j, k))
    return low > 0 and high - low < slant * high + _NOISE_PER_M


@compiled
def _draw_square(a: Corner, b: Corner, d: Corner, e: Corner, inverse_depth: Image) -> None:
    height, width = inverse_depth.shape
    left = max(0, int(np.ceil(min(min(a[0], b[0]), min(d[0], e[0])))))
    right = min(width - 1, int(np.floor(max(max(a[0], b[0]), max(d[0], e[0])))))
    top = max(0, int(np.ceil(min(min(a[1], b[1]), min(d[1], e[1])))))
    bottom = min(height - 1, int(np.floor(max(max(a[1], b[1]), max(d[1], e[1])))))
    for y in range(top, bottom + 1):
        for x in range(left, right + 1):
            i = max(_at(a, b, d, x, y), _at(e, d, b, x, y))
            if i > inverse_depth[y, x]:
                inverse_depth[y, x] = i


@compiled
def _at(p: Corner, q: Corner, s: Corner, x: int, y: int) -> float:
    """Inverse depth of a triangle at a pixel; 0 outside, seen from behind or without area."""
    qu, qv, su, sv = q[0] - p[0], q[1] - p[1], s[0] - p[0], s[1] - p[1]
    area = qu * sv - su * qv
    along_q = (x - p[0]) * sv - su * (y - p[1])
    along_s = qu * (y - p[1]) - (x - p[0]) * qv
    slack = _ON_EDGE * area
    if area <= 0 or min(along_q, along_s) < -slack or along_q + along_s > area + slack:
        return 0.0
    return p[2] + (along_q * (q[2] - p[2]) + along_s * (s[2] - p[2])) / area

"""Procedural textures: every surface of a scene gets its own, with detail at many scales.

A material is a function ``(shape, texel_m, colors, rng) -> image`` of float32 RGB in [0, 1], row 0
at the top; shape is (rows, columns). ``colors`` draws the tones, alike on all faces of one piece of
furniture, ``rng`` the pattern, which is nowhere the same.
"""

from collections.abc import Callable

import cv2
import numpy as np
from numpy.typing import NDArray

Image = NDArray[np.float32]
Shape = tuple[int, int]
Rng = np.random.Generator
Material = Callable[[Shape, float, Rng, Rng], Image]


def texture(
    material: Material, size_m: tuple[float, float], texel_m: float, colors: Rng, rng: Rng
) -> NDArray[np.uint8]:
    """An RGB image for a surface of width and height ``size_m``."""
    shape = max(2, round(size_m[1] / texel_m)), max(2, round(size_m[0] / texel_m))
    image = material(shape, texel_m, colors, rng)
    return np.asarray(np.clip(255 * image + 0.5, 0, 255), np.uint8)


def noise(shape: Shape, cell: float | tuple[float, float], rng: Rng) -> Image:
    """Smooth noise, about normal, with blobs of ``cell`` texels or (rows, columns) of texels."""
    cells = (cell, cell) if isinstance(cell, int | float) else cell
    coarse = [max(2, round(n / max(c, 1)) + 2) for n, c in zip(shape, cells, strict=True)]
    grid = rng.standard_normal(coarse, np.float32)
    return np.asarray(cv2.resize(grid, shape[::-1], interpolation=cv2.INTER_CUBIC), np.float32)


def fractal(shape: Shape, coarsest: float, finest: float, rng: Rng) -> Image:
    """Noise of equal strength in every octave of blob sizes, scaled to unit variance."""
    octaves = max(1, int(np.log2(max(coarsest / finest, 1))) + 1)
    total = sum(noise(shape, coarsest / 2**k, rng) for k in range(octaves))
    return np.asarray(total / np.sqrt(octaves), np.float32)


def _tone(colors: Rng, low: float, high: float, saturation: float) -> Image:
    """A random colour (3,)."""
    return np.asarray(colors.uniform(low, high) + saturation * colors.uniform(-1, 1, 3), np.float32)


def _mix(a: Image, b: Image, share: Image) -> Image:
    return np.asarray(a + (b - a) * share[..., None], np.float32)


def _shaded(color: Image, shade: Image) -> Image:
    return np.asarray(color * shade[..., None], np.float32)


def _step(values: Image, threshold: float, softness: float = 0.12) -> Image:
    return np.asarray(np.clip((values - threshold) / softness + 0.5, 0, 1), np.float32)


def _bare(shape: Shape, texel_m: float, colors: Rng, rng: Rng) -> Image:
    """One tone and nothing on it, such as painted steel."""
    return np.broadcast_to(_tone(colors, 0.45, 0.8, 0.05), (*shape, 3))


def _plaster(shape: Shape, texel_m: float, colors: Rng, rng: Rng) -> Image:
    shade = 1 + 0.035 * fractal(shape, 0.5 / texel_m, 0.012 / texel_m, rng)
    stains = _step(noise(shape, 0.06 / texel_m, rng), 1.6)
    return _shaded(_tone(colors, 0.72, 0.8, 0.04), shade - 0.10 * stains)


def _wallpaper(shape: Shape, texel_m: float, colors: Rng, rng: Rng) -> Image:
    """Leaves of three sizes."""
    ground = _tone(colors, 0.68, 0.78, 0.07)
    image = np.broadcast_to(ground, (*shape, 3))
    for size_m in (0.30, 0.12, 0.05):
        leaves = _step(noise(shape, size_m / texel_m, rng), 0.55)
        shade = 1 + colors.choice([-1, 1]) * colors.uniform(0.08, 0.15)
        image = _mix(image, ground * shade + _tone(colors, 0, 0, 0.03), leaves)
    return _shaded(image, 1 + 0.02 * fractal(shape, 0.1 / texel_m, 0.01 / texel_m, rng))


def _wood(shape: Shape, texel_m: float, colors: Rng, rng: Rng) -> Image:
    tone = colors.uniform(0.45, 0.95) * np.array([0.86, 0.66, 0.45], np.float32)
    if shape[0] > shape[1]:
        return _shaded(tone, _grain(shape[::-1], texel_m, rng).T)
    return _shaded(tone, _grain(shape, texel_m, rng))


def _grain(shape: Shape, texel_m: float, rng: Rng) -> Image:
    """Shades of wood, its grain along the rows, with knots."""
    fine = noise(shape, (0.008 / texel_m, 0.25 / texel_m), rng)
    broad = noise(shape, (0.03 / texel_m, 0.5 / texel_m), rng)
    knots = _step(noise(shape, (0.03 / texel_m, 0.05 / texel_m), rng), 1.9, 0.5)
    return np.asarray(1 + 0.06 * fine + 0.06 * broad - 0.3 * knots, np.float32)


def _planks(shape: Shape, texel_m: float, colors: Rng, rng: Rng) -> Image:
    shade = _grain(shape, texel_m, rng)
    width, gap = round(0.14 / texel_m), max(1, round(0.004 / texel_m))
    for top in range(0, shape[0], width):
        left = 0
        while left < shape[1]:
            length = int(rng.uniform(0.5, 1.5) / texel_m)
            plank = shade[top : top + width, left : left + length]
            plank *= rng.uniform(0.78, 1.15)
            plank[:gap] *= 0.55
            plank[:, :gap] *= 0.55
            left += length
    return _shaded(colors.uniform(0.6, 0.8) * np.array([1, 0.78, 0.56], np.float32), shade)


def _tiles(shape: Shape, texel_m: float, colors: Rng, rng: Rng) -> Image:
    veins = np.exp(-6 * np.abs(fractal(shape, 0.4 / texel_m, 0.02 / texel_m, rng)))
    shade = 1 - 0.25 * veins + 0.04 * fractal(shape, 0.1 / texel_m, 0.01 / texel_m, rng)
    edge, gap = round(0.3 / texel_m), max(1, round(0.006 / texel_m))
    for top in range(0, shape[0], edge):
        for left in range(0, shape[1], edge):
            tile = shade[top : top + edge, left : left + edge]
            tile *= rng.uniform(0.8, 1.1)
            tile[:gap] = tile[:, :gap] = 0.5
    return _shaded(_tone(colors, 0.68, 0.78, 0.05), shade)


def _fabric(shape: Shape, texel_m: float, colors: Rng, rng: Rng) -> Image:
    ground = _tone(colors, 0.3, 0.6, 0.15)
    pattern = _step(fractal(shape, 0.16 / texel_m, 0.04 / texel_m, rng), 0.5)
    image = _mix(ground, ground * colors.uniform(1.2, 1.5), pattern)
    return _shaded(image, 1 + 0.06 * fractal(shape, 0.05 / texel_m, 0.006 / texel_m, rng))


def _linen(shape: Shape, texel_m: float, colors: Rng, rng: Rng) -> Image:
    folds = 1 + 0.06 * fractal(shape, 0.2 / texel_m, 0.01 / texel_m, rng)
    dots = _step(noise(shape, 0.03 / texel_m, rng), 1.3)
    return _shaded(_mix(_tone(colors, 0.75, 0.85, 0.05), _tone(colors, 0.4, 0.6, 0.2), dots), folds)


def _painting(shape: Shape, texel_m: float, colors: Rng, rng: Rng) -> Image:
    """Overlapping polygons of many sizes on two colours that run into each other, framed."""
    sides = _tone(colors, 0.2, 0.8, 0.3), _tone(colors, 0.2, 0.8, 0.3)
    image = np.ascontiguousarray(_mix(*sides, _step(noise(shape, shape[0] / 2, rng), 0, 2)))
    for size in np.geomspace(0.5, 0.03, 60):
        angles = np.sort(rng.uniform(0, 2 * np.pi, 5))
        radius = size * min(shape) * rng.uniform(0.3, 1, (5, 1))
        centre = rng.uniform(0, 1, 2) * shape[::-1]
        corners = centre + radius * np.stack([np.cos(angles), np.sin(angles)], 1)
        color = _tone(colors, 0.1, 0.9, 0.25).tolist()
        cv2.fillPoly(image, [np.rint(corners * 16).astype(np.int32)], color, cv2.LINE_AA, 4)
    _frame(image, round(0.025 / texel_m), _tone(colors, 0.1, 0.4, 0.05))
    return _shaded(image, 1 + 0.03 * fractal(shape, 0.05 / texel_m, 0.008 / texel_m, rng))


def _carton(shape: Shape, texel_m: float, colors: Rng, rng: Rng) -> Image:
    """The front of a box of goods: a picture, a broad name above it, small print below."""
    image = np.full((*shape, 3), _tone(colors, 0.4, 0.8, 0.25), np.float32)
    top, bottom = int(0.1 * shape[0]), int(0.75 * shape[0])
    left, right = int(0.1 * shape[1]), int(0.9 * shape[1])
    for size in np.geomspace(0.5, 0.08, 25):
        centre = rng.uniform((left, top), (right, bottom))
        axes = size * min(shape) / 2 * rng.uniform(0.4, 1, 2)
        color = _tone(colors, 0.1, 0.9, 0.25).tolist()
        box = (centre.tolist(), axes.tolist(), float(rng.uniform(0, 360)))
        cv2.ellipse(image, box, color, -1, cv2.LINE_AA)
    ink = _tone(colors, 0.05, 0.25, 0.05)
    for row in range(bottom, int(0.95 * shape[0]), max(2, round(0.008 / texel_m))):
        printed = rng.random(right - left) < 0.6
        image[row, left:right][printed] = ink
    return image


def _window(shape: Shape, texel_m: float, colors: Rng, rng: Rng) -> Image:
    """Sky above trees, behind a frame with a bar."""
    clouds = _step(noise(shape, shape[0] / 3, rng), 0.5, 2)
    sky = _mix(np.array([0.62, 0.76, 0.92], np.float32), np.ones(3, np.float32), clouds)
    height = np.linspace(1, 0, shape[0], dtype=np.float32)[:, None]
    trees = _step(noise(shape, 0.15 / texel_m, rng) * 0.2 - height + 0.55, 0, 0.05)
    leaf = colors.uniform(0.35, 0.6) * np.array([0.75, 1, 0.5], np.float32)
    shade = 1 + 0.3 * fractal(shape, 0.1 / texel_m, 0.015 / texel_m, rng)
    image = _mix(sky, _shaded(leaf, shade), trees)
    bar, middle = max(2, round(0.04 / texel_m)), shape[1] // 2
    _frame(image, bar, np.full(3, 0.88, np.float32))
    image[:, middle - bar // 2 : middle + bar // 2] = 0.88
    return image


def _frame(image: Image, rim: int, color: Image) -> None:
    for part in (image[:rim], image[-rim:], image[:, :rim], image[:, -rim:]):
        part[:] = color


def _books(shape: Shape, texel_m: float, colors: Rng, rng: Rng) -> Image:
    """One row of books with labels on their spines."""
    image = np.full((*shape, 3), 0.12, np.float32)
    left = 0
    while left < shape[1]:
        width = max(2, int(rng.uniform(0.015, 0.06) / texel_m))
        spine = image[int(shape[0] * rng.uniform(0.05, 0.35)) :, left : left + width]
        spine[:] = _tone(rng, 0.25, 0.75, 0.2)
        top, bottom = (rng.uniform([0.1, 0.35], [0.3, 0.6]) * len(spine)).astype(int)
        rim = max(1, width // 5)
        spine[top:bottom, rim:-rim] = _tone(rng, 0.2, 0.9, 0.2)
        spine[:, :1] *= 0.5
        left += width
    return _shaded(image, 1 + 0.05 * fractal(shape, 0.1 / texel_m, 0.01 / texel_m, rng))


def _drawers(shape: Shape, texel_m: float, colors: Rng, rng: Rng) -> Image:
    """A wooden front of doors or drawers, each with a gap around it and a handle."""
    image = _wood(shape, texel_m, colors, rng)
    handle = _tone(colors, 0.1, 0.4, 0.03)
    columns = max(1, round(shape[1] * texel_m / 0.5))
    rows = max(1, round(shape[0] * texel_m / rng.uniform(0.3, 0.7)))
    gap = max(1, round(0.006 / texel_m))
    for across in np.array_split(image, rows):
        for front in np.array_split(across, columns, 1):
            front *= rng.uniform(0.85, 1.1)
            front[:gap] = front[:, :gap] = 0.1
            top, left = (rng.uniform([0.15, 0.3], [0.3, 0.45]) * front.shape[:2]).astype(int)
            front[top : top + 2 * gap, left:-left] = handle
    return image


MATERIALS: dict[str, Material] = {
    "bare": _bare,
    "plaster": _plaster,
    "wallpaper": _wallpaper,
    "wood": _wood,
    "planks": _planks,
    "tiles": _tiles,
    "fabric": _fabric,
    "linen": _linen,
    "painting": _painting,
    "carton": _carton,
    "window": _window,
    "books": _books,
    "drawers": _drawers,
}

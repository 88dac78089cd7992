"""Procedural textures: every surface of a scene gets its own, with detail at many scales.

A material is a function ``(shape, texel_m, rng) -> image`` of float32 RGB in [0, 1], row 0 at the
top; shape is (rows, columns).
"""

from collections.abc import Callable

import cv2
import numpy as np
from numpy.typing import NDArray

Image = NDArray[np.float32]
Shape = tuple[int, int]
Material = Callable[[Shape, float, np.random.Generator], Image]


def texture(
    material: str, size_m: tuple[float, float], texel_m: float, rng: np.random.Generator
) -> NDArray[np.uint8]:
    """An RGB image for a surface of width and height ``size_m``; KeyError for no such material."""
    shape = max(2, round(size_m[1] / texel_m)), max(2, round(size_m[0] / texel_m))
    image = MATERIALS[material](shape, texel_m, rng)
    return np.asarray(np.clip(255 * image + 0.5, 0, 255), np.uint8)


def noise(shape: Shape, cell: float | tuple[float, float], rng: np.random.Generator) -> Image:
    """Smooth noise, about normal, with blobs of ``cell`` texels or (rows, columns) of texels."""
    cells = (cell, cell) if isinstance(cell, int | float) else cell
    coarse = [max(2, round(n / max(c, 1)) + 2) for n, c in zip(shape, cells, strict=True)]
    grid = rng.standard_normal(coarse, np.float32)
    return np.asarray(cv2.resize(grid, shape[::-1], interpolation=cv2.INTER_CUBIC), np.float32)


def fractal(shape: Shape, coarsest: float, finest: float, rng: np.random.Generator) -> Image:
    """Noise of equal strength in every octave of blob sizes, scaled to unit variance."""
    octaves = max(1, int(np.log2(max(coarsest / finest, 1))) + 1)
    total = sum(noise(shape, coarsest / 2**k, rng) for k in range(octaves))
    return np.asarray(total / np.sqrt(octaves), np.float32)


def _tone(rng: np.random.Generator, low: float, high: float, saturation: float = 0.15) -> Image:
    """A random colour (3,)."""
    color = rng.uniform(low, high) + saturation * rng.uniform(-1, 1, 3)
    return np.asarray(color, np.float32)


def _mix(a: Image, b: Image, share: Image) -> Image:
    return np.asarray(a + (b - a) * share[..., None], np.float32)


def _step(values: Image, threshold: float, softness: float = 0.12) -> Image:
    return np.asarray(np.clip((values - threshold) / softness + 0.5, 0, 1), np.float32)


def _plaster(shape: Shape, texel_m: float, rng: np.random.Generator) -> Image:
    shade = 1 + 0.035 * fractal(shape, 0.5 / texel_m, 0.012 / texel_m, rng)
    stains = _step(noise(shape, 0.06 / texel_m, rng), 1.6)
    return np.asarray(_tone(rng, 0.7, 0.8, 0.06) * (shade - 0.10 * stains)[..., None], np.float32)


def _wallpaper(shape: Shape, texel_m: float, rng: np.random.Generator) -> Image:
    ground = _tone(rng, 0.6, 0.8)
    image = np.broadcast_to(ground, (*shape, 3))
    for size_m in (0.30, 0.12, 0.05):
        leaves = _step(noise(shape, size_m / texel_m, rng), 0.55)
        image = _mix(image, ground * rng.uniform(0.75, 1.12) + _tone(rng, 0, 0, 0.06), leaves)
    return np.asarray(
        image * (1 + 0.02 * fractal(shape, 0.1 / texel_m, 0.01 / texel_m, rng))[..., None]
    )


def _grain(shape: Shape, texel_m: float, rng: np.random.Generator) -> Image:
    """Wood grain along the rows, with knots."""
    fine = noise(shape, (0.008 / texel_m, 0.25 / texel_m), rng)
    broad = noise(shape, (0.03 / texel_m, 0.5 / texel_m), rng)
    knots = _step(noise(shape, (0.03 / texel_m, 0.05 / texel_m), rng), 1.9, 0.5)
    return np.asarray(1 + 0.06 * fine + 0.06 * broad - 0.3 * knots, np.float32)


def _wood(shape: Shape, texel_m: float, rng: np.random.Generator) -> Image:
    tone = rng.uniform(0.45, 0.95) * np.array([0.86, 0.66, 0.45])
    along = _grain(shape, texel_m, rng) if shape[1] >= shape[0] else None
    grain = _grain(shape[::-1], texel_m, rng).T if along is None else along
    return np.asarray(grain[..., None] * tone, np.float32)


def _planks(shape: Shape, texel_m: float, rng: np.random.Generator) -> Image:
    grain = _grain(shape, texel_m, rng)
    width, gap = round(0.14 / texel_m), max(1, round(0.004 / texel_m))
    for top in range(0, shape[0], width):
        left = 0
        while left < shape[1]:
            length = int(rng.uniform(0.5, 1.5) / texel_m)
            board = grain[top : top + width, left : left + length]
            board *= rng.uniform(0.78, 1.15)
            board[:gap] *= 0.55
            board[:, :gap] *= 0.55
            left += length
    return np.asarray(
        grain[..., None] * (rng.uniform(0.6, 0.8) * np.array([1, 0.78, 0.56])), np.float32
    )


def _tiles(shape: Shape, texel_m: float, rng: np.random.Generator) -> Image:
    veins = np.exp(-6 * np.abs(fractal(shape, 0.4 / texel_m, 0.02 / texel_m, rng)))
    shade = 1 - 0.25 * veins + 0.04 * fractal(shape, 0.1 / texel_m, 0.01 / texel_m, rng)
    edge, gap = round(0.3 / texel_m), max(1, round(0.006 / texel_m))
    for top in range(0, shape[0], edge):
        for left in range(0, shape[1], edge):
            tile = shade[top : top + edge, left : left + edge]
            tile *= rng.uniform(0.8, 1.1)
            tile[:gap] = tile[:, :gap] = 0.5
    return np.asarray(shade[..., None] * _tone(rng, 0.65, 0.8, 0.08), np.float32)


def _fabric(shape: Shape, texel_m: float, rng: np.random.Generator) -> Image:
    ground = _tone(rng, 0.3, 0.6, 0.25)
    pattern = _step(fractal(shape, 0.16 / texel_m, 0.04 / texel_m, rng), 0.5)
    weave = 1 + 0.06 * fractal(shape, 0.05 / texel_m, 0.006 / texel_m, rng)
    return np.asarray(_mix(ground, _tone(rng, 0.4, 0.8, 0.2), pattern) * weave[..., None])


def _painting(shape: Shape, texel_m: float, rng: np.random.Generator) -> Image:
    image = np.ascontiguousarray(
        _mix(_tone(rng, 0.2, 0.8, 0.3), _tone(rng, 0.2, 0.8, 0.3), noise(shape, shape[0] / 2, rng))
    )
    extent = np.array(shape[::-1])
    for size in np.geomspace(0.5, 0.03, 60):
        centre = rng.uniform(0, 1, 2) * extent
        color = [float(c) for c in _tone(rng, 0.1, 0.9, 0.3)]
        angles = np.sort(rng.uniform(0, 2 * np.pi, 5))
        radius = size * min(shape) * rng.uniform(0.3, 1, (5, 1))
        corners = centre + radius * np.stack([np.cos(angles), np.sin(angles)], 1)
        cv2.fillPoly(image, [np.rint(corners * 16).astype(np.int32)], color, cv2.LINE_AA, 4)
    rim = max(2, round(0.025 / texel_m))
    frame = _tone(rng, 0.1, 0.4, 0.05)
    image[:rim], image[-rim:], image[:, :rim], image[:, -rim:] = frame, frame, frame, frame
    image *= 1 + 0.03 * fractal(shape, 0.05 / texel_m, 0.008 / texel_m, rng)[..., None]
    return image


def _books(shape: Shape, texel_m: float, rng: np.random.Generator) -> Image:
    """One row of books."""
    image = np.full((*shape, 3), 0.12, np.float32)
    left = 0
    while left < shape[1]:
        width = max(2, int(rng.uniform(0.015, 0.06) / texel_m))
        top = int(shape[0] * rng.uniform(0.05, 0.35))
        spine = image[top:, left : left + width]
        spine[:] = _tone(rng, 0.25, 0.75, 0.3)
        label = slice(
            int(len(spine) * rng.uniform(0.1, 0.3)), int(len(spine) * rng.uniform(0.35, 0.6))
        )
        spine[label, width // 5 : -max(1, width // 5)] = _tone(rng, 0.2, 0.9, 0.3)
        spine[:, :1] *= 0.5
        left += width
    return np.asarray(
        image * (1 + 0.05 * fractal(shape, 0.1 / texel_m, 0.01 / texel_m, rng))[..., None]
    )


def _drawers(shape: Shape, texel_m: float, rng: np.random.Generator) -> Image:
    """A front of doors or drawers with a gap around each, and a handle."""
    image = _wood(shape, texel_m, rng)
    columns = max(1, round(shape[1] * texel_m / 0.5))
    rows = max(1, round(shape[0] * texel_m / rng.uniform(0.3, 0.7)))
    gap = max(1, round(0.006 / texel_m))
    for row in range(rows):
        for column in range(columns):
            y = slice(row * shape[0] // rows, (row + 1) * shape[0] // rows)
            x = slice(column * shape[1] // columns, (column + 1) * shape[1] // columns)
            front = image[y, x]
            front *= rng.uniform(0.85, 1.1)
            front[:gap] = front[:, :gap] = 0.1
            h, w = front.shape[:2]
            at = int(h * rng.uniform(0.15, 0.3)), int(w * rng.uniform(0.3, 0.45))
            front[at[0] : at[0] + 2 * gap, at[1] : w - at[1]] = _tone(rng, 0.1, 0.4)
    return image


def _window(shape: Shape, texel_m: float, rng: np.random.Generator) -> Image:
    """Sky, trees and houses behind a frame."""
    sky = _mix(
        _tone(rng, 0.8, 0.9, 0.05), _tone(rng, 0.9, 1.0, 0.02), noise(shape, shape[0] / 3, rng)
    )
    height = np.linspace(1, 0, shape[0], dtype=np.float32)[:, None]
    trees = _step(noise(shape, 0.15 / texel_m, rng) * 0.2 - height + 0.55, 0, 0.05)
    leaf = (
        _tone(rng, 0.35, 0.5)
        * (1 + 0.3 * fractal(shape, 0.1 / texel_m, 0.015 / texel_m, rng))[..., None]
    )
    image = _mix(sky, leaf.astype(np.float32), trees)
    bar = max(2, round(0.04 / texel_m))
    middle = shape[1] // 2
    for part in (image[:bar], image[-bar:], image[:, :bar], image[:, -bar:]):
        part[:] = 0.85
    image[:, middle - bar // 2 : middle + bar // 2] = 0.85
    return image


MATERIALS: dict[str, Material] = {
    "plaster": _plaster,
    "wallpaper": _wallpaper,
    "wood": _wood,
    "planks": _planks,
    "tiles": _tiles,
    "fabric": _fabric,
    "painting": _painting,
    "books": _books,
    "drawers": _drawers,
    "window": _window,
}

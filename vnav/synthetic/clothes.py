"""Textures of what people wear and are: clothes, skin, hair, shoes and a face."""

import cv2
import numpy as np

from vnav.synthetic.textures import Image, Material, Rng, Shape, fractal, noise

SKIN = np.array([[0.92, 0.72, 0.60], [0.80, 0.58, 0.44], [0.52, 0.35, 0.26]], np.float32)
HAIR = np.array([[0.16, 0.12, 0.10], [0.42, 0.28, 0.16], [0.72, 0.58, 0.36]], np.float32)


def _color(colors: Rng, low: float, high: float) -> Image:
    """A random colour (3,), often a strong one."""
    return np.asarray(colors.uniform(low, high, 3), np.float32)


def _folds(shape: Shape, texel_m: float, rng: Rng) -> Image:
    """Shades (rows, columns, 1) of creased cloth, with its weave."""
    creases = fractal(shape, 0.15 / texel_m, 0.02 / texel_m, rng)
    weave = noise(shape, 0.006 / texel_m, rng)
    return np.asarray(1 + 0.08 * creases + 0.04 * weave, np.float32)[..., None]


def _striped(shape: Shape, texel_m: float, colors: Rng, rng: Rng) -> Image:
    """Stripes of three colours around the body, none as wide as its neighbour."""
    tones = np.array(
        [_color(colors, 0.1, 0.5), _color(colors, 0.5, 0.95), _color(colors, 0.1, 0.9)]
    )
    widths = rng.uniform(0.012, 0.06, 200) / texel_m
    kind = np.searchsorted(np.cumsum(widths), np.arange(shape[0])) % 3
    return np.asarray(tones[kind][:, None] * _folds(shape, texel_m, rng), np.float32)


def _checked(shape: Shape, texel_m: float, colors: Rng, rng: Rng) -> Image:
    """Bands both ways, darker where they cross."""
    ground, band = _color(colors, 0.5, 0.9), _color(colors, 0.2, 0.8)
    period = colors.uniform(0.05, 0.09) / texel_m
    down, along = (((np.arange(n) + rng.uniform(0, period)) % period < 0.4 * period) for n in shape)
    crossed = (down[:, None].astype(np.float32) + along)[..., None] / 2
    print_ = (fractal(shape, 0.10 / texel_m, 0.03 / texel_m, rng) > 0.9)[..., None]
    cloth = ground + (band - ground) * crossed
    return np.asarray(cloth * (1 - 0.35 * print_) * _folds(shape, texel_m, rng), np.float32)


def _printed(shape: Shape, texel_m: float, colors: Rng, rng: Rng) -> Image:
    """Blots of two colours on a third."""
    image = np.broadcast_to(_color(colors, 0.1, 0.9), (*shape, 3))
    for size_m in (0.09, 0.035):
        blots = (fractal(shape, size_m / texel_m, size_m / texel_m / 3, rng) > 0.5)[..., None]
        image = np.where(blots, _color(colors, 0.1, 0.95), image)
    return np.asarray(image * _folds(shape, texel_m, rng), np.float32)


def _denim(shape: Shape, texel_m: float, colors: Rng, rng: Rng) -> Image:
    """Blue or grey cloth, worn pale in places, with seams along its sides."""
    ground = colors.uniform(0.25, 0.6) * np.array([0.7, 0.85, colors.uniform(0.9, 1.3)])
    worn = np.clip(fractal(shape, 0.12 / texel_m, 0.015 / texel_m, rng), -1, 2)[..., None]
    image = ground * (1 + 0.22 * worn) * _folds(shape, texel_m, rng)
    seam = max(1, round(0.008 / texel_m))
    image[:, :seam] *= 0.6
    image[:seam] *= 0.6
    return np.asarray(image, np.float32)


def _skin(shape: Shape, texel_m: float, colors: Rng, rng: Rng) -> Image:
    tone = SKIN[colors.integers(len(SKIN))]
    spots = (noise(shape, 0.012 / texel_m, rng) > 1.7)[..., None]
    shade = 1 + 0.06 * fractal(shape, 0.08 / texel_m, 0.01 / texel_m, rng)[..., None]
    return np.asarray(tone * shade * (1 - 0.15 * spots), np.float32)


def _face(shape: Shape, texel_m: float, colors: Rng, rng: Rng) -> Image:
    """Skin with brows, eyes, a nose and a mouth."""
    image = np.ascontiguousarray(_skin(shape, texel_m, colors, rng))
    scale = np.array(shape[::-1])

    def blot(x: float, y: float, size: tuple[float, float], color: Image | float) -> None:
        middle, axes = np.rint((x, y) * scale), np.maximum(np.rint(size * scale), 1)
        tone = np.broadcast_to(color, 3).tolist()
        cv2.ellipse(
            image, middle.astype(int).tolist(), axes.astype(int).tolist(), 0, 0, 360, tone, -1
        )

    for x in (0.3, 0.7):
        blot(x, 0.42, (0.13, 0.025), 0.15)
        blot(x, 0.50, (0.11, 0.04), 0.95)
        blot(x, 0.50, (0.045, 0.04), 0.1)
    blot(0.5, 0.63, (0.05, 0.09), 0.8 * image[0, 0])
    blot(0.5, 0.82, (0.18, 0.03), np.array([0.6, 0.25, 0.25], np.float32))
    return image


def _hair(shape: Shape, texel_m: float, colors: Rng, rng: Rng) -> Image:
    tone = HAIR[colors.integers(len(HAIR))]
    strands = noise(shape, (0.08 / texel_m, 0.006 / texel_m), rng)
    locks = noise(shape, (0.10 / texel_m, 0.025 / texel_m), rng)
    return np.asarray(tone * (1 + 0.25 * strands + 0.25 * locks)[..., None], np.float32)


def _shoe(shape: Shape, texel_m: float, colors: Rng, rng: Rng) -> Image:
    image = _color(colors, 0.15, 0.6) * _folds(shape, texel_m, rng)
    sole = max(1, shape[0] // 4)
    image[-sole:] = 0.85
    return np.asarray(image, np.float32)


CLOTHES: dict[str, Material] = {
    "striped": _striped,
    "checked": _checked,
    "printed": _printed,
    "denim": _denim,
    "skin": _skin,
    "face": _face,
    "hair": _hair,
    "shoe": _shoe,
}

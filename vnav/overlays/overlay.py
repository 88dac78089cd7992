"""What every image of a moving camera shows at one place: burnt-in text, a logo, a robot's bumper.

Edges of the scene move over the image, and their mean is blurred away. Those of an overlay stay.
What agrees on standing still would hold the camera for standing still.
"""

import dataclasses
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache
from itertools import combinations

import cv2
import numpy as np
from numpy.typing import NDArray

from vnav.core.arrays import Floats
from vnav.core.frame import Frame
from vnav.errors import CaptureError
from vnav.io.sources.capture import Capture
from vnav.io.sources.derived import DerivedCapture

FRAMES, LEAST_VIEWS = 24, 10  # of the capture, evenly, and those of them that differ
WIDTH_PX = 640  # of the images that are compared, at most
COARSE_WIDTH_PX, CELLS = 80, (20, 15)  # where frames are compared: a hand that trembles is nothing
SAME = 0.7  # correlation of the gradients of a cell that shows the same
STANDS = 0.1  # share of pairs of views in which half of the cells show the same: the camera stands
EDGE = 4.0  # grey levels a pixel, of the mean of all views
STEADY = 1.4  # times what it differs by between them
OF_SCENE = 1 / 80  # of the width: so near to an edge, features see it
FILLED = 1 / 16  # of the width: letters and what lies between them are one overlay
MOST = 0.5  # share of the image; where more stands still, the camera does

Pixels = NDArray[np.bool_]


class WithoutOverlay(DerivedCapture):
    """The frames of a capture, which an overlay hides a part of: without depth, and said so.

    So nothing there has a place in the scene, nor a feature. Its fingerprint is that of the
    capture: what the overlay is follows from the frames.
    """

    def __init__(self, capture: Capture, overlay: Pixels) -> None:
        super().__init__(capture)
        self._overlay = lru_cache(4)(lambda shape: _resized(overlay, shape))

    def read(self, index: int) -> Frame:
        """A frame of the capture."""
        frame = super().read(index)
        overlay = self._overlay(frame.depth_m.shape)
        depth_m = np.where(overlay, 0, frame.depth_m)
        return dataclasses.replace(frame, depth_m=depth_m, hidden=overlay)


def without_overlay(capture: Capture) -> tuple[Capture, float]:
    """The capture without its overlay, and the share of the image that this covers.

    The capture itself, and 0, where there is none, or no depth.
    """
    overlay = overlay_of(capture) if capture.has_depth else None
    if overlay is None:
        return capture, 0.0
    return WithoutOverlay(capture, overlay), float(overlay.mean())


def overlay_of(capture: Capture) -> Pixels | None:
    """Where (h, w) a capture shows the same in all views; None where it does not.

    And where the views are too few to tell. Large images are made small. Frames that cannot be
    read, or are of another size than the first, are left out.
    """
    rows = np.unique(np.linspace(0, len(capture) - 1, min(FRAMES, len(capture))).astype(int))
    with ThreadPoolExecutor() as pool:
        found = list(pool.map(lambda row: _grey(capture, row), rows.tolist()))
    known = [each for each in found if each is not None]
    greys = [each for each in known if each.shape == known[0].shape]
    coarse = [_gradient(_narrowed(grey, COARSE_WIDTH_PX)) for grey in greys]
    pairs = {(i, j): _same(coarse[i], coarse[j]) for i, j in combinations(range(len(greys)), 2)}
    views = _different(len(greys), pairs)
    if len(views) < LEAST_VIEWS or _is_resting([pairs[pair] for pair in combinations(views, 2)]):
        return None
    overlay = _grown(_standing([_gradient(greys[k]) for k in views]))
    return overlay if 0 < overlay.mean() <= MOST else None


def _grey(capture: Capture, row: int) -> NDArray[np.uint8] | None:
    """A frame's brightness (h, w)."""
    try:
        color = np.asarray(capture.read(row).color)
    except CaptureError:
        return None
    grey = cv2.cvtColor(color, cv2.COLOR_RGB2GRAY)
    return _narrowed(grey, WIDTH_PX) if grey.shape[1] > WIDTH_PX else grey


def _narrowed(grey: NDArray[np.uint8], width: int) -> NDArray[np.uint8]:
    """An image of that width."""
    size = width, max(1, round(len(grey) * width / grey.shape[1]))
    return np.asarray(cv2.resize(grey, size, interpolation=cv2.INTER_AREA), np.uint8)


def _gradient(grey: NDArray[np.uint8]) -> Floats:
    """How brightness changes (h, w, 2), a pixel to the right and below."""
    along = [cv2.Sobel(grey, cv2.CV_32F, *axis, scale=1 / 8) for axis in ((1, 0), (0, 1))]
    return np.stack(along, -1)


def _same(a: Floats, b: Floats) -> tuple[Pixels, Pixels]:
    """Cells that show the same edges in two images' gradients (h, w, 2), and those with edges."""
    both, of_a, of_b = (_in_cells((x * y).sum(-1)) for x, y in ((a, b), (a, a), (b, b)))
    strong = np.sqrt(of_a * of_b)
    edges = strong > EDGE
    return edges & (both > SAME * strong), edges


def _different(count: int, pairs: Mapping[tuple[int, int], tuple[Pixels, Pixels]]) -> list[int]:
    """Images that show other edges than each before them, in most cells with edges.

    ``pairs``: what `_same` says of any two. A camera that rests shows one view.
    """
    chosen: list[int] = []
    for k in range(count):
        compared = [pairs[before, k] for before in chosen]
        if not any(same.sum() > MOST * max(edges.sum(), 1) for same, edges in compared):
            chosen.append(k)
    return chosen


def _is_resting(pairs: Sequence[tuple[Pixels, Pixels]]) -> bool:
    """Whether views differ by who walks through them alone: most of what they show comes back.

    ``pairs``: what `_same` says of any two.
    """
    same, edges = (np.sum(of_pairs, 0) for of_pairs in zip(*pairs, strict=True))
    seen = edges > 0
    return not seen.any() or bool(np.median(same[seen] / edges[seen]) > STANDS)


def _in_cells(image: Floats) -> Floats:
    """Means of `CELLS` of an image (h, w)."""
    return np.asarray(cv2.resize(image, CELLS, interpolation=cv2.INTER_AREA))


def _standing(gradients: Sequence[Floats]) -> Pixels:
    """Where all gradients (h, w, 2) are nearly the same edge."""
    mean, squared = np.zeros_like(gradients[0]), np.zeros(gradients[0].shape[:2], np.float32)
    for each in gradients:
        mean += each / len(gradients)
        squared += np.einsum("hwc,hwc->hw", each, each) / len(gradients)
    strength = np.einsum("hwc,hwc->hw", mean, mean)
    spread = squared - strength
    return np.asarray((strength > EDGE**2) & (strength > STEADY**2 * spread))


def _grown(edges: Pixels) -> Pixels:
    """What lies between edges (h, w), and so near to them that features see them."""
    around, between = (
        cv2.getStructuringElement(cv2.MORPH_ELLIPSE, [2 * round(share * edges.shape[1]) + 1] * 2)
        for share in (OF_SCENE, FILLED)
    )
    filled = cv2.morphologyEx(edges.astype(np.uint8), cv2.MORPH_CLOSE, between)
    return np.asarray(cv2.dilate(filled, around) > 0)


def _resized(overlay: Pixels, shape: tuple[int, ...]) -> Pixels:
    """The overlay of an image of that height and width."""
    size = shape[1], shape[0]
    image = cv2.resize(overlay.astype(np.uint8), size, interpolation=cv2.INTER_NEAREST)
    return np.asarray(image > 0)

"""A legend below a picture of pixels: what its colours and marks mean."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

Image = NDArray[np.uint8]
Color = tuple[int, int, int]  # BGR

ROW_PX, MARK_PX, SPACE_PX, SCALE = 22, 22, 14, 0.45
FONT, WHITE = cv2.FONT_HERSHEY_SIMPLEX, (255, 255, 255)
DOT, RING, LINE, ARROW = "dot", "ring", "line", "arrow"


@dataclass(frozen=True)
class LegendEntry:
    """A mark, one of DOT, RING, LINE and ARROW, and what it stands for."""

    mark: str
    color: Color
    text: str


def with_legend(picture: Image, entries: Sequence[LegendEntry]) -> Image:
    """The picture (H, W, 3), BGR, with a black strip below it that has as many rows as it takes."""
    width = picture.shape[1]
    places, x, row = list[tuple[int, int]](), SPACE_PX // 2, 0
    for entry in entries:
        wide = MARK_PX + cv2.getTextSize(entry.text, FONT, SCALE, 1)[0][0]
        if places and x + wide > width:
            x, row = SPACE_PX // 2, row + 1
        places.append((x, row))
        x += wide + SPACE_PX
    strip = np.zeros((ROW_PX * (row + 1), width, 3), np.uint8)
    for entry, (x, row) in zip(entries, places, strict=True):
        _draw_entry(strip, entry, x, ROW_PX * row + ROW_PX // 2)
    return np.concatenate([picture, strip])


def _draw_entry(strip: Image, entry: LegendEntry, x: int, y: int) -> None:
    """The mark with its left end at a point, and the text after it."""
    left, right, middle = (x, y), (x + MARK_PX - 8, y), (x + (MARK_PX - 8) // 2, y)
    if entry.mark == ARROW:
        cv2.arrowedLine(strip, left, right, entry.color, 2, cv2.LINE_AA, tipLength=0.4)
    elif entry.mark == LINE:
        cv2.line(strip, left, right, entry.color, 2, cv2.LINE_AA)
    else:
        cv2.circle(strip, middle, 3, entry.color, 1 if entry.mark == RING else -1, cv2.LINE_AA)
    cv2.putText(strip, entry.text, (x + MARK_PX, y + 5), FONT, SCALE, WHITE, 1, cv2.LINE_AA)

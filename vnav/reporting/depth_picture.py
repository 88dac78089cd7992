"""A picture of some frames of a capture: colour, and over it where depth has edges."""

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from vnav.checking.depth_edges import depth_edges
from vnav.core.frame import Frame
from vnav.errors import CaptureError
from vnav.io.sources.capture import Capture
from vnav.reporting.picture_file import write_picture

SHOWN, ACROSS = 6, 2  # frames, and how many side by side
EDGE, WHITE = (0, 230, 255), (255, 255, 255)  # BGR
DIMMED = 0.75  # colour, so that edges stand out
LEAST_WIDTH, TITLE_PX = 480, 28
LEGEND = "yellow: rim of what is near, by depth. It should lie on the rim that colour shows."


def draw(capture: Capture, path: Path) -> None:
    """Write a picture of frames spread over the capture; VnavError where that cannot be.

    Frames that cannot be read are left out; CaptureError where none can.
    """
    rows = np.linspace(0, len(capture) - 1, min(SHOWN, len(capture)) + 2).round().astype(int)
    panels = []
    for row in dict.fromkeys(rows[1:-1].tolist()):
        try:
            panels.append(_panel(capture.read(row)))
        except CaptureError as error:
            failed = error
    if not panels:
        raise failed
    panels += [np.zeros_like(panels[0])] * (-len(panels) % ACROSS)
    lines = [np.hstack(panels[k : k + ACROSS]) for k in range(0, len(panels), ACROSS)]
    picture = np.vstack([_titled(lines[0].shape[1], LEGEND), *lines])
    write_picture(path, np.asarray(picture, np.uint8), "--png")


def _panel(frame: Frame) -> NDArray[np.uint8]:
    """A frame (H, W, 3), BGR, under its number; small ones enlarged."""
    canvas = (DIMMED * frame.color[..., ::-1]).astype(np.uint8)
    canvas[depth_edges(frame.depth_m).any(0)] = EDGE
    times = -(-LEAST_WIDTH // canvas.shape[1])
    large = np.repeat(np.repeat(canvas, times, 0), times, 1)
    title = _titled(large.shape[1], f"frame {frame.index}, {frame.stamp_s:.3f} s")
    return np.vstack([title, large])


def _titled(width: int, text: str) -> NDArray[np.uint8]:
    bar = np.zeros((TITLE_PX, width, 3), np.uint8)
    cv2.putText(bar, text, (8, 20), cv2.FONT_HERSHEY_SIMPLEX, 0.55, WHITE, 1, cv2.LINE_AA)
    return bar

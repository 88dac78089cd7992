"""Where an image shows the corners of a board, to a fraction of a pixel, and how sharp they are."""

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from vnav.calibration.board import Board
from vnav.core.arrays import Array
from vnav.core.frame import Rejected

FEWEST_CORNERS = 6
BLURRED = 0.008  # of the image's width: an edge as wide is blurred, 5 px at 640
ENOUGH_PX = 1280  # of the image's longer side, to find a chessboard
WINDOW = 0.25  # of a square, to either side of a corner, where it is refined
PAD_PX = 50  # white around a board that is drawn
REACH = 0.1  # of a square: as far to either side of its edge there is nothing else
SAMPLES = 33  # of the grey levels across an edge

STEPS = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 50, 1e-4)
Edges = tuple[Array, Array]  # their ends, pixels (N, 2) each
# Without EXHAUSTIVE, boards with markers are taken for chessboards.
_CHESSBOARD = cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_EXHAUSTIVE


@dataclass(frozen=True)
class BoardView:
    """What the image of a file, of ``size`` (width, height), shows of a board.

    Corners by their row in `Board.points` (N,) and their pixels (N, 2); ``edge_px``: how wide the
    way from black to white is, across the worse of both directions.
    """

    path: Path
    size: tuple[int, int]
    corner: NDArray[np.intp]
    px: Array
    edge_px: float


def find_board(gray: NDArray[np.uint8], board: Board, path: Path) -> BoardView | Rejected:
    """The board in the image (H, W) of a file; of a chessboard all, of ChArUco a part."""
    corner, px = _charuco(gray, board) if board.kind == "charuco" else _chessboard(gray, board)
    columns = np.unique(corner % (board.columns - 1))
    rows = np.unique(corner // (board.columns - 1))
    if not len(corner):
        return Rejected("no board found")
    if len(corner) < FEWEST_CORNERS or min(len(columns), len(rows)) < 2:
        return Rejected(f"only {len(corner)} corners of the board found")
    edge_px = max(_width_px(gray, a, b) for a, b in _edges(board, corner, px))
    width, height = gray.shape[1], gray.shape[0]
    if edge_px > BLURRED * max(width, height):
        return Rejected(f"blurred: edges are {edge_px:.1f} px wide")
    return BoardView(path, (width, height), corner, px, edge_px)


def _chessboard(gray: NDArray[np.uint8], board: Board) -> tuple[NDArray[np.intp], Array]:
    """Corners refined where edges meet: as detected they make focal lengths 0.3 % too long."""
    shape = board.columns - 1, board.rows - 1
    scale = min(1.0, ENOUGH_PX / max(gray.shape))
    small = cv2.resize(gray, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    found, px = cv2.findChessboardCornersSB(small, shape, flags=_CHESSBOARD)
    if not found:
        return np.zeros(0, np.intp), np.zeros((0, 2))
    corner = np.arange(shape[0] * shape[1])
    px = (np.asarray(px, float).reshape(-1, 2) + 0.5) / scale - 0.5
    shortest = min(np.linalg.norm(b - a, axis=1).min() for a, b in _edges(board, corner, px))
    half = max(2, int(WINDOW * shortest))
    px = cv2.cornerSubPix(gray, px.astype(np.float32), (half, half), (-1, -1), STEPS)
    return corner, np.asarray(px, float)


def _charuco(gray: NDArray[np.uint8], board: Board) -> tuple[NDArray[np.intp], Array]:
    """By both ways of placing markers, where there are two."""
    ways = (False, True)[: 2 - board.rows % 2]
    found = [board.corners_by_markers(gray, legacy=legacy) for legacy in ways]
    corner, px = max(found, key=lambda way: len(way[0]))
    return corner, px - _centre_of_a_pixel()


@lru_cache
def _centre_of_a_pixel() -> float:
    """Coordinate of the first pixel's centre where OpenCV finds markers: 0, and 0.5 in 4.11."""
    board = Board(columns=4, rows=4)
    image = np.pad(board.image(), PAD_PX, constant_values=255)
    corner, px = board.corners_by_markers(image)
    square_px = (len(image) - 2 * PAD_PX) / board.rows
    drawn = PAD_PX - 0.5 + board.points[corner, :2] / board.square_m * square_px
    return round(2 * float((px - drawn).mean())) / 2


def _edges(board: Board, corner: NDArray[np.intp], px: Array) -> list[Edges]:
    """Neighbouring corners (N, 2) and (N, 2), along rows and along columns."""
    grid = np.full((board.rows - 1, board.columns - 1, 2), np.nan)
    grid.reshape(-1, 2)[corner] = px
    ways = (grid[:, :-1], grid[:, 1:]), (grid[:-1], grid[1:])
    return [(a[known], b[known]) for a, b in ways for known in [np.isfinite(a + b).all(-1)]]


def _width_px(gray: NDArray[np.uint8], a: Array, b: Array) -> float:
    """Width of the edges from a to b (N, 2), of their mean profile: contrast by steepest slope.

    Source: edge rise distance, as ISO 12233 and cv2.estimateChessboardSharpness have it, which
    knows whole chessboards only.
    """
    if not len(a):
        return 0.0
    across = REACH * (b - a)[:, ::-1] * (-1, 1)
    steps = np.linspace(-1, 1, SAMPLES)[:, None]
    at = (((a + b) / 2)[:, None] + steps * across[:, None]).astype(np.float32)
    levels = cv2.remap(gray, at, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    profiles = np.asarray(levels, float)
    rising = np.sign(profiles[:, -1] - profiles[:, 0])[:, None]
    mean = (rising * profiles).mean(0)
    slope = np.diff(mean).max() * (SAMPLES - 1) / 2
    width = (mean[-1] - mean[0]) / max(slope, 1e-6)
    return float(width * np.linalg.norm(across, axis=1).mean())

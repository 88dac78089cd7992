"""The boards that a camera is calibrated by: a chessboard, or one with markers in it (ChArUco)."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from vnav.core.arrays import Array
from vnav.errors import CameraError

KINDS = ("charuco", "chessboard")
FEWEST_SQUARES, MOST_SQUARES = 4, 100  # along a side
LEAST_M, MOST_M = 1e-3, 1.0  # of a square
MOST_OF_SQUARE = 0.95  # a marker needs a white margin
BIT_PX = 12  # of a marker's bit, where a picture of the board is drawn


@dataclass(frozen=True)
class Board:
    """A board: squares are counted, corners are one fewer each way.

    Marker and dictionary (of OpenCV's, without DICT_) are those of "charuco" alone.
    CameraError where there is no such board.
    """

    kind: str = "charuco"
    columns: int = 7
    rows: int = 10
    square_m: float = 0.025
    marker_m: float = 0.018
    dictionary: str = "4X4_50"

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise CameraError(f"expected a board of {' or '.join(KINDS)}, found '{self.kind}'")
        if not FEWEST_SQUARES <= min(self.size) <= max(self.size) <= MOST_SQUARES:
            raise CameraError(
                f"expected a board of {FEWEST_SQUARES} to {MOST_SQUARES} squares along each side,"
                f" found {self.columns} x {self.rows}"
            )
        if not LEAST_M <= self.square_m <= MOST_M:
            raise CameraError(
                f"expected squares of {LEAST_M * 1e3:g} to {MOST_M * 1e3:g} mm, found"
                f" {self.square_m * 1e3:g}"
            )
        if self.kind == "charuco":
            self._check_markers()

    def _check_markers(self) -> None:
        if not 0 < self.marker_m <= MOST_OF_SQUARE * self.square_m:
            raise CameraError(
                f"expected markers smaller than squares of {self.square_m * 1e3:g} mm, with a white"
                f" margin around, found {self.marker_m * 1e3:g} mm"
            )
        known, needed = len(self._markers().bytesList), self.columns * self.rows // 2
        if needed > known:
            raise CameraError(
                f"expected a dictionary of {needed} markers for {self.columns} x {self.rows}"
                f" squares, found {known} in {self.dictionary}"
            )

    @property
    def size(self) -> tuple[int, int]:
        """Squares in a row, and in a column."""
        return self.columns, self.rows

    @property
    def points(self) -> Array:
        """The corners (N, 3) between squares in metres, row by row, in a plane z = 0."""
        rows, columns = np.indices((self.rows - 1, self.columns - 1)).reshape(2, -1)
        return self.square_m * np.stack([columns + 1.0, rows + 1.0, 0.0 * rows], -1)

    def _markers(self) -> "cv2.aruco.Dictionary":
        """OpenCV's dictionary; CameraError names all where there is none of that name."""
        names = sorted(name[5:] for name in dir(cv2.aruco) if name.startswith("DICT_"))
        if self.dictionary not in names:
            raise CameraError(
                f"expected a dictionary of markers ({', '.join(names)}), found '{self.dictionary}'"
            )
        kind: int = getattr(cv2.aruco, f"DICT_{self.dictionary}")
        return cv2.aruco.getPredefinedDictionary(kind)

    def _charuco(self) -> "cv2.aruco.CharucoBoard":
        return cv2.aruco.CharucoBoard(self.size, self.square_m, self.marker_m, self._markers())

    def corners_by_markers(
        self, gray: NDArray[np.uint8], *, legacy: bool = False
    ) -> tuple[NDArray[np.intp], Array]:
        """Rows of `points` (N,) and pixels (N, 2) that an image (H, W) shows, as OpenCV has them.

        ``legacy``: the other way to place markers on a board of even rows, of OpenCV before 4.6.
        """
        known = self._charuco()
        known.setLegacyPattern(legacy)
        px, corner, _, _ = cv2.aruco.CharucoDetector(known).detectBoard(gray)
        if corner is None:
            return np.zeros(0, np.intp), np.zeros((0, 2))
        return np.asarray(corner, np.intp).ravel(), np.asarray(px, float).reshape(-1, 2)

    def image(self) -> NDArray[np.uint8]:
        """The board (H, W) in grey levels, squares as many pixels wide as high, no margin."""
        if self.kind == "chessboard":
            return _checkered(self.columns, self.rows)
        bits = self._markers().markerSize + 2  # with its border
        square_px = round(BIT_PX * bits * self.square_m / self.marker_m)
        size_px = self.columns * square_px, self.rows * square_px
        return np.asarray(self._charuco().generateImage(size_px), np.uint8)


def _checkered(columns: int, rows: int) -> NDArray[np.uint8]:
    """Black first, as OpenCV's boards with markers."""
    white = np.indices((rows, columns)).sum(0) % 2
    return np.kron(white, np.full((BIT_PX, BIT_PX), 255)).astype(np.uint8)

from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.calibration.board_photos import CAMERA, photo, pose, project
from vnav.calibration.board import Board
from vnav.calibration.detection import BoardView, find_board
from vnav.core.frame import Rejected

FILE = Path("image.png")
BOARDS = [Board(), Board("chessboard", 10, 7)]
TILTED = (25.0, -20.0), (0.02, 0.01, 0.45)


@pytest.mark.parametrize("board", BOARDS, ids=lambda board: board.kind)
def test_corners_are_found_where_the_camera_sees_them(board: Board) -> None:
    T = pose(board, *TILTED)
    view = find_board(photo(board, CAMERA, T, np.random.default_rng(0)), board, FILE)
    assert isinstance(view, BoardView)
    off_px = view.px - project(board, CAMERA, T)[view.corner]
    if view.corner[0] != 0 or np.abs(off_px).max() > 5:  # a chessboard may be read from its end
        off_px = view.px - project(board, CAMERA, T)[::-1][view.corner]
    assert len(view.corner) == len(board.points)
    # Noise of 2 grey levels on edges of about 200 moves a corner by some hundredths of a pixel;
    # beside markers OpenCV leaves a tenth or two.
    assert np.sqrt((off_px**2).sum(1).mean()) < (0.25 if board.kind == "charuco" else 0.1)
    assert np.abs(off_px.mean(0)).max() < 0.05
    assert 1 < view.edge_px < 2


def test_a_part_of_a_board_with_markers_is_enough() -> None:
    board = Board()
    T = pose(board, (0, 0), (0.09, 0, 0.25))
    view = find_board(photo(board, CAMERA, T, np.random.default_rng(0)), board, FILE)
    assert isinstance(view, BoardView)
    assert 6 <= len(view.corner) < len(board.points)
    off_px = view.px - project(board, CAMERA, T)[view.corner]
    assert np.abs(off_px).max() < 1


def test_boards_that_older_opencv_printed_are_found() -> None:
    board = Board()
    known = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    printed = cv2.aruco.CharucoBoard(board.size, board.square_m, board.marker_m, known)
    printed.setLegacyPattern(True)
    image = np.pad(printed.generateImage((350, 500)), 40, constant_values=255)
    view = find_board(image, board, FILE)
    assert isinstance(view, BoardView)
    assert len(view.corner) == len(board.points)
    # Squares are 50 px; a pixel's centre, not its corner, has integer coordinates.
    expected = 40 - 0.5 + board.points[view.corner, :2] / board.square_m * 50
    assert np.abs(view.px - expected).max() < 0.2


@pytest.mark.parametrize("board", BOARDS, ids=lambda board: board.kind)
def test_no_board_is_no_view(board: Board) -> None:
    noise = np.random.default_rng(0).integers(0, 255, (240, 320)).astype(np.uint8)
    assert find_board(noise, board, FILE) == Rejected("no board found")


@pytest.mark.parametrize("kind", ["charuco", "chessboard"])
@pytest.mark.parametrize("shape", [(1, 1), (3, 4000), (20, 20)])
def test_images_of_any_size_are_looked_at(kind: str, shape: tuple[int, int]) -> None:
    found = find_board(np.full(shape, 99, np.uint8), Board(kind, 4, 4), FILE)
    assert found == Rejected("no board found")


def test_too_few_corners_are_no_view() -> None:
    board = Board()
    image = np.pad(board.image(), 50, constant_values=255)
    cut = image[: 50 + 310, : 50 + 310]  # squares are 100 px: four corners and their markers
    found = find_board(cut, board, FILE)
    assert isinstance(found, Rejected)
    assert found.reason == "only 4 corners of the board found"


def test_a_board_that_is_smeared_in_one_direction_is_blurred() -> None:
    board = Board("chessboard", 5, 4)
    seen = photo(board, CAMERA, pose(board, (0, 0), (0, 0, 0.18)), np.random.default_rng(0))
    assert isinstance(find_board(seen, board, FILE), BoardView)
    # A box of 9 px makes edges 9 px wide; a pixel, and corners that are off, change that a little.
    found = find_board(np.asarray(cv2.blur(seen, (9, 1)), np.uint8), board, FILE)
    assert isinstance(found, Rejected)
    assert found.reason.startswith("blurred: edges are ")
    assert float(found.reason.split()[3]) == pytest.approx(9, abs=1.5)

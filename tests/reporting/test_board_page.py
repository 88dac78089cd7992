from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from vnav.calibration.board import Board
from vnav.calibration.detection import BoardView, find_board
from vnav.errors import VnavError
from vnav.io.formats.images import read_gray
from vnav.reporting.board_page import page, write_board

PX_PER_MM = 300 / 25.4


@pytest.mark.parametrize("board", [Board(), Board("chessboard", 10, 7)], ids=lambda b: b.kind)
def test_squares_of_a_page_have_the_size_that_is_asked_for(board: Board, tmp_path: Path) -> None:
    write_board(board, tmp_path / "board.png")
    page_px = read_gray(tmp_path / "board.png")
    expected = (3508, 2480) if board.rows > board.columns else (2480, 3508)  # A4
    assert page_px.shape == pytest.approx(expected, abs=1)
    view = find_board(page_px, board, tmp_path / "board.png")
    assert isinstance(view, BoardView)
    assert len(view.corner) == len(board.points)
    # The first and the last corner; edges are drawn at the nearest pixel, a twelfth of a mm.
    across_mm = 1e3 * np.linalg.norm(board.points[-1] - board.points[0])
    assert np.linalg.norm(view.px[-1] - view.px[0]) / PX_PER_MM == pytest.approx(across_mm, abs=0.1)


def test_a_large_board_gets_a_page_of_its_own() -> None:
    width, height = page(Board(square_m=0.1, marker_m=0.07)).get_size_inches()
    assert (width * 25.4, height * 25.4) == pytest.approx((720, 1020))


def test_the_command_writes_a_page_to_print(
    vnav: Callable[..., tuple[int, str, str]], tmp_path: Path
) -> None:
    assert vnav("calibrate", "--print", tmp_path / "board.pdf")[0] == 0
    assert (tmp_path / "board.pdf").read_bytes().startswith(b"%PDF")
    assert vnav("calibrate", "--print", tmp_path / "board.svg", "--kind", "chessboard")[0] == 0
    assert b"<svg" in (tmp_path / "board.svg").read_bytes()


def test_a_page_of_another_format_is_refused(tmp_path: Path) -> None:
    with pytest.raises(VnavError, match="a name that ends in .pdf, .svg, .png, found .*board.jpg"):
        write_board(Board(), tmp_path / "board.jpg")

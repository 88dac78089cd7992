import pytest

from vnav.calibration.board import Board
from vnav.errors import CameraError


def test_corners_are_one_fewer_than_squares_each_way() -> None:
    points = Board(columns=5, rows=4, square_m=0.5, marker_m=0.3).points
    assert points.tolist() == [[x, y, 0] for y in (0.5, 1, 1.5) for x in (0.5, 1, 1.5, 2)]


@pytest.mark.parametrize("kind", ["charuco", "chessboard"])
def test_the_image_has_the_boards_squares_black_first(kind: str) -> None:
    image = Board(kind, 5, 4).image()
    side = image.shape[0] // 4
    assert image.shape == (4 * side, 5 * side)
    corners = image[1::side, 1::side] > 0  # a marker leaves the square's corner white
    assert (corners == [[(r + c) % 2 for c in range(5)] for r in range(4)]).all()


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"kind": "circles"}, "charuco or chessboard"),
        ({"columns": 3}, "4 to 100 squares along each side, found 3 x 10"),
        ({"square_m": 25.0}, "squares of 1 to 1000 mm, found 25000"),
        ({"marker_m": 0.025}, "markers smaller than squares of 25 mm"),
        ({"dictionary": "4X4"}, "4X4_50, .*found '4X4'"),
        ({"columns": 11}, "a dictionary of 55 markers for 11 x 10 squares, found 50 in 4X4_50"),
    ],
)
def test_a_board_that_cannot_be_is_refused(wrong: dict[str, object], said: str) -> None:
    with pytest.raises(CameraError, match=said):
        Board(**wrong)  # type: ignore[arg-type]


def test_a_chessboard_asks_for_no_markers() -> None:
    assert Board("chessboard", 20, 20, marker_m=1.0, dictionary="none").size == (20, 20)

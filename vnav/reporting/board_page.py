"""A page with a calibration board, to be printed at its size."""

from pathlib import Path

from matplotlib.figure import Figure

from vnav.calibration.board import Board
from vnav.errors import VnavError
from vnav.reporting.figures import save

FORMATS = (".pdf", ".svg", ".png")
A4_MM, MARGIN_MM, INCH_MM = (210.0, 297.0), 10.0, 25.4
DPI = 300
TEXT_MM = 2.0  # below the board


def write_board(board: Board, path: Path) -> None:
    """Write a page with the board, A4 where it fits; VnavError where that cannot be."""
    if path.suffix.lower() not in FORMATS:
        raise VnavError(f"expected a name that ends in {', '.join(FORMATS)}, found {path}")
    save(page(board), path, "--print", format=path.suffix[1:].lower(), dpi=DPI)


def page(board: Board) -> Figure:
    """The board in the middle of its page, at its size, and below it how it is to be named."""
    width, height = (1e3 * board.square_m * count for count in board.size)
    page_mm = _page_mm(width, height)
    figure = Figure((page_mm[0] / INCH_MM, page_mm[1] / INCH_MM))
    left, bottom = (page_mm[0] - width) / 2, (page_mm[1] - height) / 2
    place = left / page_mm[0], bottom / page_mm[1], width / page_mm[0], height / page_mm[1]
    axes = figure.add_axes(place)
    axes.axis("off")
    axes.imshow(board.image(), cmap="gray", aspect="auto", interpolation="none")
    figure.text(
        0.5, (bottom - TEXT_MM) / page_mm[1], _caption(board), ha="center", va="top", size=8
    )
    return figure


def _page_mm(width: float, height: float) -> tuple[float, float]:
    """A4 upright or across, else what the board and its margin take."""
    wanted = width + 2 * MARGIN_MM, height + 2 * MARGIN_MM
    for page_mm in (A4_MM, A4_MM[::-1]):
        if wanted[0] <= page_mm[0] and wanted[1] <= page_mm[1]:
            return page_mm
    return wanted


def _caption(board: Board) -> str:
    named = f"--kind {board.kind} --squares {board.columns}x{board.rows}"
    named += f" --square-mm {1e3 * board.square_m:g}"
    if board.kind == "charuco":
        named += f" --marker-mm {1e3 * board.marker_m:g} --dictionary {board.dictionary}"
    return f"{named}\nPrint at 100 %, glue to a flat plate, measure a square."

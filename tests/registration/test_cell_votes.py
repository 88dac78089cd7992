"""What cells say of two motions that see little of the same, as votes by hand."""

import numpy as np
import pytest

from vnav.core.arrays import Array
from vnav.registration.cell_votes import poll
from vnav.registration.judge import CELLS, WRONG

FITS, MISFITS, SILENT = 3.0, -3.0, np.nan  # log-likelihoods of a pixel, over chance
PIXELS = 3.0  # that each in `CELL` counts for
CELL = np.arange(CELLS[0] * CELLS[1])  # a pixel each
THING, ROOM = len(CELL) // 8 > CELL, len(CELL) // 4 <= CELL


def votes(
    right: Array, wrong: Array, alone: bool = True, are_afar: bool = False
) -> tuple[float, float]:
    """For one of two motions over the other, and the standard deviation."""
    told = np.stack([right, wrong, np.zeros(len(CELL))])
    afar = np.full((3, 3), are_afar)
    favour, variance = poll(told, CELL, np.full(CELLS, 0.5), PIXELS, WRONG, alone, afar)
    return float(favour[0, 1]), float(np.sqrt(variance[0, 1]))


def test_a_room_that_one_of_two_motions_meets_outweighs_a_thing_that_both_see() -> None:
    favour, sigma = votes(
        np.select([THING, ROOM], [MISFITS, FITS], SILENT), np.where(THING, FITS, SILENT)
    )
    assert favour > 3 * sigma


def test_a_room_that_looks_otherwise_counts_against_the_motion_that_alone_meets_it() -> None:
    favour, sigma = votes(
        np.where(THING, MISFITS, SILENT), np.select([THING, ROOM], [FITS, MISFITS], SILENT)
    )
    assert favour > 3 * sigma


def test_what_looks_alike_under_both_motions_tells_nothing_where_one_alone_meets_it() -> None:
    both = np.where(THING, FITS, SILENT)
    assert votes(np.where(ROOM, FITS, both), both) == (0, 0)


@pytest.mark.parametrize("told", [FITS, MISFITS])
def test_cells_that_one_motion_meets_alone_count_only_where_they_are_the_more(told: float) -> None:
    right, wrong = np.where(ROOM, FITS, SILENT), np.where(ROOM, MISFITS, SILENT)
    assert votes(np.where(THING, told, right), wrong) == votes(right, wrong)


def test_frames_that_need_not_see_the_same_are_compared_by_what_both_motions_meet() -> None:
    right = np.select([THING, ROOM], [MISFITS, FITS], SILENT)
    favour, sigma = votes(right, np.where(THING, FITS, SILENT), alone=False)
    assert favour < -3 * sigma


def test_a_part_that_refutes_a_motion_outweighs_a_rest_that_fits_a_little_better_under_it() -> None:
    right = np.full(len(CELL), 0.8 * FITS)
    wrong = np.where(THING, MISFITS, FITS)
    favour, sigma = votes(right, wrong, are_afar=True)
    assert favour > 3 * sigma
    assert votes(right, wrong)[0] < 0


def test_small_differences_tell_two_motions_apart_that_are_nearly_one() -> None:
    better, worse = np.full(len(CELL), FITS), np.full(len(CELL), 0.8 * FITS)
    favour, sigma = votes(better, worse)
    assert favour > 3 * sigma

"""The strip below a picture that says what its colours mean."""

import numpy as np
import pytest

from vnav.reporting.picture_legend import DOT, LINE, ROW_PX, LegendEntry, with_legend

RED, BLUE = (0, 0, 255), (255, 0, 0)
ENTRIES = (LegendEntry(DOT, RED, "a feature"), LegendEntry(LINE, BLUE, "how far it is off"))


def test_the_picture_stays_whole_above_its_legend() -> None:
    picture = np.random.default_rng(0).integers(0, 256, (40, 600, 3)).astype(np.uint8)
    drawn = with_legend(picture, ENTRIES)
    np.testing.assert_array_equal(drawn[:40], picture)
    assert drawn.shape == (40 + ROW_PX, 600, 3)
    for color in (RED, BLUE):
        assert (drawn[40:] == color).all(2).any()


@pytest.mark.parametrize(("width", "rows"), [(170, 2), (320, 1)])
def test_what_is_too_long_for_a_row_goes_to_the_next_and_is_not_cut(width: int, rows: int) -> None:
    strip = with_legend(np.zeros((1, width, 3), np.uint8), ENTRIES)[1:]
    assert len(strip) == rows * ROW_PX
    assert not strip[:, -2:].any()  # nothing runs out at the right

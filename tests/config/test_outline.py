"""Which polygons may be a robot's footprint."""

import pytest

from vnav.config.outline import Outline, corners_of

SQUARE = "1,1 -1,1 -1,-1 1,-1"
U_SHAPE = "2,1 -1,1 -1,-1 2,-1 2,-0.5 0.5,-0.5 0.5,0.5 2,0.5"  # its two ends lie on one line


@pytest.mark.parametrize(
    "text", [SQUARE, "1,-1 -1,-1 -1,1 1,1", "3,0 -1,1 -1,-1", U_SHAPE, "", "  1,1   -2,0 1,-1 "]
)
def test_a_polygon_round_the_origin_is_taken_as_it_is(text: str) -> None:
    assert Outline().taken(text) == " ".join(text.split())


@pytest.mark.parametrize(
    ("text", "flaw"),
    [
        ("1,1 2,1 2,2", "the origin lies outside"),
        ("0,0 1,0 0,1", "the origin is a corner"),
        ("1,-1 1,1 0,1 0,-1", "the origin lies on an edge"),
        ("1,1 -1,-1 -1,1 1,-1", "edges cross"),
        ("2,1 -2,1 -2,-1 2,-1 2,-0.2 -2,-0.2 -2,0.2 2,0.2", "edges lie on each other"),
        ("1,1 -1,-1", "two corners"),
        ("1,1 1,1 -1,1 -1,-1 1,-1", "one corner twice"),
        ("10.1,1 -1,1 -1,-1", "too far away"),
        ("inf,1 -1,1 -1,-1", "no end"),
        ("1,1,1 -1,1 -1,-1", "three numbers"),
        ("a,b c,d e,f", "no numbers"),
    ],
)
def test_what_is_no_such_polygon_is_refused(text: str, flaw: str) -> None:
    assert Outline().taken(text) is None, flaw


def test_corners_are_read_in_order() -> None:
    assert corners_of("1,2 -3,4.5") == ((1.0, 2.0), (-3.0, 4.5))

from dataclasses import replace

import numpy as np
import pytest

from vnav.core.mapping import MOST_SPANS, FrameTable, Span, in_short


def table(*counts: int) -> FrameTable:
    """Frames of captures of so many frames each."""
    captures = np.repeat(np.arange(len(counts)), counts)
    index = np.concatenate([np.arange(n) for n in counts])
    return FrameTable(captures, index, index / 10)


def test_a_span_ends_where_the_reason_or_the_capture_changes() -> None:
    reasons = ["", "dark", "dark", "blurred", "dark", "dark", ""]
    found = table(5, 2).lost_spans(reasons)
    assert found == [
        Span(0, 1, 2, "dark"),
        Span(0, 3, 3, "blurred"),
        Span(0, 4, 4, "dark"),
        Span(1, 0, 0, "dark"),
    ]


def test_depth_is_uneven_by_what_its_stamps_are_off_their_captures_median() -> None:
    after_s = np.array([0.01, 0.03, 0.02, np.nan, 0.5, 0.5, 0.5004, np.nan])
    frames = replace(table(4, 3, 1), depth_after_s=after_s)
    # The second capture's stay within a millisecond; of the third, and one frame, none is known.
    np.testing.assert_allclose(frames.uneven_s, [-0.01, 0.01, 0, 0, 0, 0, 0, 0], atol=1e-12)
    assert not table(3, 3).uneven_s.any()


@pytest.mark.parametrize(
    ("gap_s", "expected"),
    [
        ([0.1, 0.1, 0.5, 0.1], [2]),  # more than 0.4 s
        ([0.1, 0.1, 0.39, 0.1], []),
        ([0.5, 0.5, 1.4, 0.5], []),  # less than three times what is usual
        ([0.5, 0.5, 1.6, 0.5], [2]),
    ],
)
def test_a_capture_is_interrupted_where_a_hand_may_have_gone_anywhere(
    gap_s: list[float], expected: list[int]
) -> None:
    stamps_s = np.cumsum([0.0, *gap_s])
    frames = FrameTable(np.zeros(5), np.arange(5), stamps_s)
    assert np.flatnonzero(frames.interrupted(np.arange(5))).tolist() == expected


@pytest.mark.parametrize("count", [0, 1])
def test_so_few_frames_have_no_interruption(count: int) -> None:
    assert not len(table(9).interrupted(np.arange(count)))


def test_the_rows_of_each_capture_are_told() -> None:
    assert [rows.tolist() for rows in table(3, 2).of_captures()] == [[0, 1, 2], [3, 4]]
    assert table(0).of_captures() == []


def test_where_nothing_is_to_be_said_there_is_no_span() -> None:
    assert table(3).lost_spans(["", "", ""]) == []
    assert table(0).lost_spans([]) == []


def test_the_only_capture_needs_no_name() -> None:
    assert table(9).span_text(0, 3, 3) == "frame 3"
    assert table(9).rows_text(np.array([2, 3, 7])) == "frames 2 to 7"


def test_of_several_captures_each_is_named() -> None:
    told = table(5, 4).rows_text(np.array([3, 4, 5, 7]))
    assert told == "frames 3 to 4 of capture 0 and frames 0 to 2 of capture 1"


def test_spans_of_one_reason_are_told_one_by_one_or_in_one() -> None:
    dark = [Span(0, k, k + 1, "dark") for k in range(0, 4 * MOST_SPANS, 4)]
    blurred = Span(0, 2, 2, "blurred")
    elsewhere = Span(1, 0, 0, "dark")
    assert in_short([*dark, blurred, elsewhere]) == sorted(
        [*dark, blurred, elsewhere], key=lambda span: (span.capture, span.first)
    )
    one_more = Span(0, 98, 99, "dark")
    assert in_short([*dark, blurred, one_more, elsewhere]) == [
        Span(0, 0, 99, f"{2 * MOST_SPANS + 2} of them, dark"),
        blurred,
        elsewhere,
    ]

"""Trackers side by side on one pair of a rendered capture, whose depth and poses are exact."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from vnav.api.judging import compare_trackers
from vnav.config import Config
from vnav.config.registries import TRACKERS
from vnav.errors import CaptureError
from vnav.evaluation.tracker_matches import TrackerPair, match_by_all, table
from vnav.reporting.picture_legend import ROW_PX
from vnav.reporting.tracks_picture import TITLE_PX, draw

A, B = 3, 4
PRECISE = Config().registration.search_min_inlier_share  # with fewer right, tracking is unsure


@pytest.fixture(scope="module")
def pair(tiny_capture: Path) -> TrackerPair:
    return compare_trackers(tiny_capture, A, B)


def test_every_tracker_is_there_and_has_the_same_points(pair: TrackerPair) -> None:
    assert [m.name for m in pair.matches] == sorted(TRACKERS)
    for matches in pair.matches:
        np.testing.assert_array_equal(matches.px, pair.matches[0].px)
        np.testing.assert_array_equal(matches.true_px, pair.matches[0].true_px)


def test_matches_of_neighbours_are_precise_and_show_what_both_frames_see(
    pair: TrackerPair,
) -> None:
    for matches in pair.matches:
        assert matches.precision is not None
        assert matches.recall is not None
        assert matches.precision >= PRECISE
        assert matches.recall >= 0.5  # most of what both see
        assert matches.ms > 0


def test_points_that_are_hidden_or_beyond_the_image_are_not_asked_for(pair: TrackerPair) -> None:
    true_px = pair.matches[0].true_px
    assert true_px is not None
    seen = np.isfinite(true_px[:, 0])
    assert 0.5 * len(seen) < seen.sum() < len(seen)
    height, width = pair.b.depth_m.shape
    assert (true_px[seen] >= 0).all()
    assert (true_px[seen] <= [width - 1, height - 1]).all()


def test_wrong_matches_count_against_precision_and_recall(pair: TrackerPair) -> None:
    klt = next(m for m in pair.matches if m.name == "klt")
    off = dataclasses.replace(klt, found_px=klt.found_px + np.float32(3.1))
    assert off.precision is not None
    assert off.precision < 0.1
    none = dataclasses.replace(klt, found_px=np.full_like(klt.found_px, np.nan))
    assert (none.precision, none.recall) == (None, 0.0)


def test_without_truth_there_is_neither_precision_nor_recall(pair: TrackerPair) -> None:
    alone = match_by_all(pair.a, pair.b, (), None, Config())
    assert {(m.precision, m.recall) for m in alone.matches} == {(None, None)}
    assert all(" - " in line for line in table(alone.matches)[1:])


def test_a_frame_that_is_not_there_is_told(tiny_capture: Path) -> None:
    with pytest.raises(CaptureError, match="expected frames 0 to 59 of .*, found 60"):
        compare_trackers(tiny_capture, 0, 60)


def test_the_picture_shows_both_frames_once_for_each_tracker(
    pair: TrackerPair, tmp_path: Path
) -> None:
    import cv2

    draw(pair, tmp_path / "tracks.png")
    height, width = pair.a.depth_m.shape
    shape = cv2.imread(str(tmp_path / "tracks.png")).shape
    assert shape == (len(TRACKERS) * (height + TITLE_PX) + ROW_PX, 2 * width, 3)  # the legend

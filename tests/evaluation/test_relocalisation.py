from pathlib import Path

import numpy as np
import pytest

from vnav.config import CaptureConfig
from vnav.core import se3
from vnav.errors import PhotoError
from vnav.evaluation.relocalisation import held_out_queries, photo_queries, without_held_out
from vnav.io.formats.trajectories import read_tum
from vnav.io.sources.open_capture import open_capture


def test_held_out_frames_are_those_that_the_map_does_not_get(tiny_capture: Path) -> None:
    capture = open_capture(tiny_capture, CaptureConfig())
    truth = read_tum(tiny_capture / "groundtruth.txt")
    mapped = without_held_out(capture, 7)
    queries = held_out_queries(capture, 7, truth, 0.02)
    left_out = [k for k in range(60) if capture.stamps_s[k] not in mapped.stamps_s]
    assert [query.path for query in queries] == [
        capture.files.pairs[k].color.path for k in left_out
    ]
    assert len(queries) == 60 // 7
    np.testing.assert_array_equal(queries[0].T_truth_camera, truth.T_world_camera[6])


def test_nothing_is_held_out_unless_asked_for(tiny_capture: Path) -> None:
    capture = open_capture(tiny_capture, CaptureConfig())
    assert without_held_out(capture, 0) is capture


def test_a_held_out_frame_without_a_true_pose_is_no_query(tiny_capture: Path) -> None:
    capture = open_capture(tiny_capture, CaptureConfig())
    truth = read_tum(tiny_capture / "groundtruth.txt")
    late = type(truth)(truth.stamps_s[10:], truth.T_world_camera[10:])
    assert len(held_out_queries(capture, 7, late, 0.02)) == 60 // 7 - 1


def test_photos_are_those_that_the_truth_names(tmp_path: Path) -> None:
    for name in ("a.jpg", "other.jpg"):
        (tmp_path / name).touch()
    (tmp_path / "groundtruth.txt").write_text("# name pose\na.jpg 1 2 3 0 0 0 1\n")
    (query,) = photo_queries(tmp_path)
    assert query.path == tmp_path / "a.jpg"
    np.testing.assert_array_equal(query.T_truth_camera, se3.make(np.eye(3), [1, 2, 3]))


def test_a_photo_that_is_named_and_missing_is_an_error(tmp_path: Path) -> None:
    (tmp_path / "groundtruth.txt").write_text("a.jpg 1 2 3 0 0 0 1\n")
    with pytest.raises(PhotoError, match=r"a\.jpg, which groundtruth\.txt names"):
        photo_queries(tmp_path)

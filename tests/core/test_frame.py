import dataclasses

import numpy as np
import pytest

from vnav.core import se3
from vnav.core.camera import Intrinsics
from vnav.core.frame import Edge, Features, Frame, PoseEstimate, no_depth
from vnav.features.sift import SPACE

CAMERA = Intrinsics(6, 4, 5.0, 5.0, 2.5, 1.5)


def features(count: int) -> Features:
    rng = np.random.default_rng(0)
    return Features(
        rng.uniform(0, 99, (count, 2)),
        rng.integers(0, 256, (count, 128)).astype(np.uint8),
        np.arange(count)[::-1],
        np.ones(count),
        np.zeros(count),
        SPACE,
    )


def test_a_frame_cannot_be_written_into() -> None:
    frame = Frame(0, 0, 0.0, np.zeros((4, 6, 3), np.uint8), np.zeros((4, 6), np.float32), CAMERA)
    for array in (frame.color, frame.depth_m):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1


def test_depth_of_another_size_than_colour_is_refused() -> None:
    with pytest.raises(ValueError, match=r"shape \(4, 6\), found \(3, 6\)"):
        Frame(0, 0, 0.0, np.zeros((4, 6, 3), np.uint8), np.zeros((3, 6), np.float32), CAMERA)


def test_a_camera_of_another_size_or_with_distortion_is_refused() -> None:
    images = np.zeros((4, 6, 3), np.uint8), no_depth(4, 6)
    for wrong in (CAMERA.scaled(8, 4), dataclasses.replace(CAMERA, distortion=(0.1, 0.0))):
        with pytest.raises(ValueError, match=r"expected a pinhole camera of \(6, 4\) pixels"):
            Frame(0, 0, 0.0, *images, wrong)


def test_a_frame_without_depth_has_zeros_of_its_size() -> None:
    frame = Frame(0, 0, 0.0, np.zeros((4, 6, 3), np.uint8), no_depth(4, 6), CAMERA)
    assert frame.depth_m.shape == (4, 6)
    assert not frame.depth_m.any()


def test_no_features_are_legal() -> None:
    assert len(features(0)) == 0
    assert len(features(0)[np.zeros(0, np.intp)]) == 0


def test_selected_features_keep_all_their_columns_in_step() -> None:
    every, rows = features(9), np.array([5, 2])
    chosen = every[rows]
    assert len(chosen) == 2
    for name in ("keypoints_px", "descriptors", "scores", "scales_px", "angles_rad"):
        np.testing.assert_array_equal(getattr(chosen, name), getattr(every, name)[rows])


def test_columns_of_different_length_are_refused() -> None:
    with pytest.raises(ValueError, match="expected an array of shape"):
        Features(np.zeros((2, 2)), np.zeros((3, 128), np.uint8), *np.zeros((3, 2)), SPACE)


def test_an_edge_needs_a_transform_and_an_information_matrix() -> None:
    with pytest.raises(ValueError, match=r"shape \(6, 6\), found \(3, 3\)"):
        Edge(0, 1, np.eye(4), np.eye(3))


def test_an_edge_with_added_noise_has_both_noises() -> None:
    variances = np.arange(1, 7) * 1e-5
    edge = Edge(0, 1, np.eye(4), np.diag(1 / variances))
    noisier = edge.with_added_noise(0.01, 0.02)
    added = np.repeat([0.01**2, 0.02**2], 3)
    np.testing.assert_allclose(np.diag(np.linalg.inv(noisier.information)), variances + added)


def test_two_motions_fused_are_nearer_to_the_one_that_knows_more_in_each_direction() -> None:
    none = np.zeros((0, 2), np.int32)
    at_rest = PoseEstimate(np.eye(4), np.diag([1, 1, 1, 3e4, 1e4, 1e4]), none, 7)
    ahead = PoseEstimate(se3.exp([0, 0, 0, 0.04, 0.04, 0]), 1e4 * np.eye(6), none, 0)
    fused = at_rest.fused(ahead)
    np.testing.assert_allclose(fused.T_a_b[:3, 3], [0.01, 0.02, 0], atol=1e-12)
    np.testing.assert_allclose(fused.information, at_rest.information + ahead.information)
    assert fused.matches == 7

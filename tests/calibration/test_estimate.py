import dataclasses
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from tests.calibration.board_photos import CAMERA, pose, poses, project
from vnav.calibration.board import Board
from vnav.calibration.detection import BoardView
from vnav.calibration.doubts import covered_share, doubts
from vnav.calibration.estimate import FittedCamera, fit, fit_without_outliers
from vnav.core.arrays import Array
from vnav.core.camera import Intrinsics

BOARD = Board("chessboard", 10, 7)
SIGMA_PX = 0.1
TRUE = np.array([CAMERA.fx, CAMERA.fy, CAMERA.cx, CAMERA.cy, *CAMERA.distortion])


def seen(
    T_camera_board: Sequence[Array], seed: int = 0, camera: Intrinsics = CAMERA
) -> list[BoardView]:
    """The corners as the camera sees them, with noise."""
    rng, corner = np.random.default_rng(seed), np.arange(len(BOARD.points))
    return [
        BoardView(
            Path(f"{k}.png"),
            CAMERA.size,
            corner,
            project(BOARD, camera, T) + SIGMA_PX * rng.standard_normal((len(corner), 2)),
            1.5,
        )
        for k, T in enumerate(T_camera_board)
    ]


def off(camera: FittedCamera) -> Array:
    """Errors (9,) of a camera."""
    i = camera.intrinsics
    return np.array([i.fx, i.fy, i.cx, i.cy, *i.distortion]) - TRUE


def test_standard_deviations_are_what_the_errors_are() -> None:
    runs = [fit(seen(poses(BOARD, 12, seed), seed), BOARD) for seed in range(20)]
    ratios = np.array([(off(run) / np.where(run.sigmas, run.sigmas, 1))[:8] for run in runs])
    # Mean squares of 20 standard normal numbers: 1 with a standard deviation of 0.32.
    assert np.abs((ratios**2).mean(0) - 1).max() < 3 * 0.32
    # Of all 160, though they hang together in pairs: 1 with one of about 0.16.
    assert (ratios**2).mean() == pytest.approx(1, abs=3 * 0.16)


def test_residuals_are_the_noise() -> None:
    camera = fit(seen(poses(BOARD, 12)), BOARD)
    # Two numbers a corner; 80 parameters take up few of 1296 residuals.
    assert camera.rms_px == pytest.approx(SIGMA_PX * np.sqrt(2), rel=0.07)


def test_k3_is_left_out_where_it_is_nothing() -> None:
    camera = fit(seen(poses(BOARD, 12)), BOARD)
    assert (camera.intrinsics.distortion[-1], camera.sigmas[-1]) == (0, 0)


def test_k3_is_found_where_it_is_something() -> None:
    camera = dataclasses.replace(CAMERA, distortion=(0.12, -0.25, 0.002, -0.001, 0.5))
    found = fit(seen(poses(BOARD, 25), camera=camera), BOARD)
    assert 0 < found.sigmas[-1] < 0.1
    assert abs(found.intrinsics.distortion[-1] - 0.5) < 4 * found.sigmas[-1]


def test_an_image_that_does_not_agree_is_left_out() -> None:
    views = seen(poses(BOARD, 12))
    bent = views[4].px + 2 * np.sin(views[4].px / 40)
    views[4] = BoardView(views[4].path, CAMERA.size, views[4].corner, bent, 1.5)
    camera, outliers = fit_without_outliers(views, BOARD)
    assert [each.view.path.name for each in outliers] == ["4.png"]
    assert (np.abs(off(camera))[:4] < 4 * camera.sigmas[:4]).all()


def test_good_images_leave_no_doubts() -> None:
    camera = fit(seen(poses(BOARD, 25)), BOARD)
    assert covered_share(camera) > 0.8
    assert doubts(camera) == ()


def test_boards_that_are_never_tilted_leave_the_focal_length_in_doubt() -> None:
    places = [(x, y, z) for z in (0.4, 0.5) for x in (-0.1, 0.1) for y in (-0.06, 0, 0.06)]
    found = doubts(fit(seen([pose(BOARD, (0, 0), place) for place in places]), BOARD))
    assert "the board is tilted by 15 degrees or more in 0 images" in found[0]
    assert "the images do not determine fx (" in found[-1]


def test_few_images_in_the_middle_are_doubted() -> None:
    tilts = [(30, 0), (-30, 0), (0, 30), (0, -30)]
    found = doubts(fit(seen([pose(BOARD, tilt, (0, 0, 0.6)) for tilt in tilts]), BOARD))
    assert found[0].startswith("only 4 images are used")
    assert any("of the image only, and beyond them distortion is a guess" in one for one in found)


def test_a_lens_that_the_model_does_not_fit_is_doubted() -> None:
    views = seen(poses(BOARD, 25))
    wavy = [
        BoardView(view.path, view.size, view.corner, view.px + 2 * np.sin(view.px / 20), 1.5)
        for view in views
    ]
    assert "is the board flat" in doubts(fit(wavy, BOARD))[0]

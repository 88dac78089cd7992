"""The camera that explains the corners of a board in several images, and how well it is known."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from vnav.calibration.board import Board
from vnav.calibration.detection import BoardView
from vnav.core.arrays import Array
from vnav.core.camera import Intrinsics
from vnav.errors import CameraError

PARAMETERS = ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3")
FEWEST_IMAGES = 3  # Zhang 2000: fewer leave the camera open
OUTLIER = 3.0  # times the median residual of the images, and no less than
LEAST_OUTLIER = 1 / 1280  # of the image's width
SIGNIFICANT = 3.0  # standard deviations: k3 nearer to 0 is left out
LEAST_KNOWN = 1e-15  # of what is known best: less is nothing but rounding
PIXEL_DIGITS, DISTORTION_DIGITS = 4, 8


@dataclass(frozen=True)
class FittedView:
    """An image's corners beside where the camera sees them; tilt of the board and its distance.

    ``residuals_px`` (N, 2): found minus projected.
    """

    view: BoardView
    residuals_px: Array
    tilt_deg: float
    distance_m: float

    @property
    def rms_px(self) -> float:
        """Root mean square of how far corners are off."""
        return rms(self.residuals_px)


@dataclass(frozen=True)
class FittedCamera:
    """A camera, the standard deviations of `PARAMETERS` (9,), and the images that it is made of.

    The deviation of a parameter that was not estimated is 0.
    """

    intrinsics: Intrinsics
    sigmas: Array
    fitted: tuple[FittedView, ...]

    @property
    def rms_px(self) -> float:
        """Root mean square of how far all corners are off."""
        return rms(np.concatenate([each.residuals_px for each in self.fitted]))


def rms(residuals_px: Array) -> float:
    """Root mean square of distances (N, 2)."""
    return float(np.sqrt((residuals_px**2).sum(1).mean()))


def fit_without_outliers(
    views: Sequence[BoardView], board: Board
) -> tuple[FittedCamera, list[FittedView]]:
    """The camera of those images that agree, and the others, which are far from it.

    One image is left out at a time, the worst: it bends the camera that judges the others.
    """
    kept, outliers = list(views), list[FittedView]()
    while True:
        camera = fit(kept, board)
        worst = max(camera.fitted, key=lambda each: each.rms_px)
        usual = float(np.median([each.rms_px for each in camera.fitted]))
        least = LEAST_OUTLIER * max(camera.intrinsics.size)
        if len(kept) == FEWEST_IMAGES or worst.rms_px <= max(OUTLIER * usual, least):
            return camera, outliers
        kept = [view for view in kept if view is not worst.view]
        outliers.append(worst)


def fit(views: Sequence[BoardView], board: Board) -> FittedCamera:
    """The pinhole camera with k1, k2, p1, p2, and k3 where it clearly is not 0.

    CameraError where the images do not determine one. Source: Zhang 2000, by
    cv2.calibrateCameraExtended.
    """
    camera = _fit(views, board, 0)
    if abs(camera.intrinsics.distortion[-1]) < SIGNIFICANT * camera.sigmas[-1]:
        return _fit(views, board, cv2.CALIB_FIX_K3)
    return camera


def _fit(views: Sequence[BoardView], board: Board, flags: int) -> FittedCamera:
    points = [board.points[view.corner].astype(np.float32) for view in views]
    found = [view.px.astype(np.float32) for view in views]
    try:
        _, K, distortion, rotations, translations, *_ = cv2.calibrateCameraExtended(
            points, found, views[0].size, None, None, flags=flags
        )
    except cv2.error as error:
        raise _undetermined(len(views)) from error
    fx, fy, cx, cy = (round(float(K[at]), PIXEL_DIGITS) for at in ((0, 0), (1, 1), (0, 2), (1, 2)))
    coefficients = tuple(round(float(k), DISTORTION_DIGITS) for k in distortion.ravel()[:5])
    intrinsics = Intrinsics(*views[0].size, fx, fy, cx, cy, coefficients)
    if not np.isfinite([fx, fy, cx, cy, *coefficients]).all() or not intrinsics.is_possible:
        raise _undetermined(len(views))
    poses = list(zip(rotations, translations, strict=True))
    fitted = tuple(
        _fitted(view, board, intrinsics, *pose) for view, pose in zip(views, poses, strict=True)
    )
    free = np.array([True] * 8 + [not flags & cv2.CALIB_FIX_K3])
    return FittedCamera(intrinsics, _sigmas(fitted, board, intrinsics, poses, free), fitted)


def _undetermined(images: int) -> CameraError:
    return CameraError(
        f"expected images that determine a camera, found {images} that do not; take more, with the"
        " board tilted to all sides"
    )


def _fitted(
    view: BoardView, board: Board, intrinsics: Intrinsics, rotation: Array, translation: Array
) -> FittedView:
    projected, _ = _project(view, board, intrinsics, rotation, translation)
    R, _ = cv2.Rodrigues(rotation)
    middle = board.points[view.corner].mean(0)
    distance_m = float((R @ middle + translation.ravel())[2])
    tilt_deg = float(np.rad2deg(np.arccos(min(1.0, abs(R[2, 2])))))
    return FittedView(view, view.px - projected, tilt_deg, distance_m)


def _project(
    view: BoardView, board: Board, intrinsics: Intrinsics, rotation: Array, translation: Array
) -> tuple[Array, Array]:
    """Pixels (N, 2), and their derivatives (2 N, 15) by rotation, translation, `PARAMETERS`."""
    points, distortion = board.points[view.corner], np.array(intrinsics.distortion)
    px, by = cv2.projectPoints(points, rotation, translation, intrinsics.K, distortion)
    return px.reshape(-1, 2), np.asarray(by)


def _sigmas(
    fitted: Sequence[FittedView],
    board: Board,
    intrinsics: Intrinsics,
    poses: Sequence[tuple[Array, Array]],
    free: Array,
) -> Array:
    """Standard deviations (9,) of least squares, the noise as large as the residuals tell.

    OpenCV's own differ from version to version, and count corners where there are two residuals
    each. Enormous where the images leave a parameter open.
    """
    normal, residuals = np.zeros((free.sum(), free.sum())), 0
    for each, pose in zip(fitted, poses, strict=True):
        _, by = _project(each.view, board, intrinsics, *pose)
        q, _ = np.linalg.qr(by[:, :6])  # what the board's own pose takes up tells nothing
        shared = by[:, 6:][:, free]
        shared = shared - q @ (q.T @ shared)
        normal += shared.T @ shared
        residuals += each.residuals_px.size
    squares = sum(float((each.residuals_px**2).sum()) for each in fitted)
    variance = squares / max(residuals - 6 * len(fitted) - int(free.sum()), 1)
    scale = np.sqrt(np.diag(normal))
    sigmas = np.zeros(len(PARAMETERS))
    values, ways = np.linalg.eigh(normal / np.outer(scale, scale))
    inverse = (ways**2 / np.maximum(values, LEAST_KNOWN)).sum(1)  # its diagonal
    sigmas[free] = np.sqrt(variance * inverse) / scale
    return sigmas

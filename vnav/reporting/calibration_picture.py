"""A picture of a calibration: corners with their residuals, and an image without distortion."""

from pathlib import Path
from typing import Any

import cv2
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from vnav.calibration.estimate import FittedView
from vnav.calibration.images import Calibration
from vnav.core.arrays import Array
from vnav.core.camera import Intrinsics
from vnav.io.photos.photo_files import read_photo
from vnav.reporting.figures import legend, save

CORNER, RESIDUAL, STRAIGHT = "#64b5f6", "#c62828", "#ffd600"
LONGEST = 0.05  # of the image's width: a residual three times the usual
NICE = (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000)


def draw(calibration: Calibration, path: Path) -> None:
    """Write a PNG: residuals, an image as it is, and undistorted; VnavError if that cannot be."""
    intrinsics = calibration.camera.intrinsics
    width, height = intrinsics.size
    figure = Figure((16, 16 / 3 * height / width + 1.2), dpi=100, layout="constrained")
    panels = figure.subplots(1, 3)
    lines = _draw_residuals(panels[0], calibration)
    shown = max(calibration.camera.fitted, key=_spread)
    image = read_photo(shown.view.path)
    K, distortion = intrinsics.K, np.array(intrinsics.distortion)
    without = cv2.undistort(image, K, distortion)
    straight = cv2.undistortPoints(shown.view.px[:, None], K, distortion, P=K)[:, 0]
    _draw_rows(panels[1], calibration, shown, shown.view.px)
    _draw_rows(panels[2], calibration, shown, np.asarray(straight))
    for axes, content in zip(panels[1:], (image, without), strict=True):
        axes.imshow(content)
    panels[0].set_title(f"Corners of {len(calibration.camera.fitted)} images")
    panels[1].set_title(f"{shown.view.path.name}, as taken")
    panels[2].set_title("Undistorted: rows of corners are straight")
    for axes in panels:
        axes.set(xlim=(-0.5, width - 0.5), ylim=(height - 0.5, -0.5), aspect="equal")
    legend(figure, lines)
    save(figure, path, "--png", format="png")


def _spread(fitted: FittedView) -> float:
    """How much of the image the board takes: there distortion is seen best."""
    return float(np.prod(np.ptp(fitted.view.px, axis=0)))


def _draw_residuals(axes: Axes, calibration: Calibration) -> list[Line2D]:
    """All corners, and how far they are off, enlarged; their entries of the legend."""
    camera = calibration.camera
    px = np.concatenate([each.view.px for each in camera.fitted])
    off = np.concatenate([each.residuals_px for each in camera.fitted])
    times = _enlargement(camera.intrinsics, camera.rms_px)
    axes.plot(*px.T, ".", color=CORNER, ms=2.5)
    longer: dict[str, Any] = {"angles": "xy", "scale_units": "xy", "scale": 1 / times}
    axes.quiver(*px.T, *off.T, color=RESIDUAL, width=0.003, zorder=3, **longer)
    covered = f"corners, on {calibration.covered_share:.0%} of the image"
    told = f"residuals {times} times as long, RMS {camera.rms_px:.2f} px"
    return [
        Line2D([], [], color=CORNER, marker=".", ls="", label=covered),
        Line2D([], [], color=RESIDUAL, label=told),
        Line2D([], [], color=STRAIGHT, lw=2, label="from a row's first corner to its last"),
    ]


def _enlargement(intrinsics: Intrinsics, rms_px: float) -> int:
    wanted = LONGEST * max(intrinsics.size) / max(3 * rms_px, 1e-6)
    return max((times for times in NICE if times <= wanted), default=1)


def _draw_rows(axes: Axes, calibration: Calibration, shown: FittedView, px: Array) -> None:
    """A straight line between the ends of each row of corners."""
    row = shown.view.corner // (calibration.board.columns - 1)
    for number in np.unique(row):
        ends = px[row == number][[0, -1]]
        axes.plot(*ends.T, color=STRAIGHT, lw=1)
    axes.plot(*px.T, ".", color=CORNER, ms=3)

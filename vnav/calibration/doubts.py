"""What the images of a board leave open about a camera, and what to do about it."""

import numpy as np

from vnav.calibration.estimate import PARAMETERS, FittedCamera
from vnav.core.arrays import Array
from vnav.core.camera import Intrinsics

ENOUGH_IMAGES = 10
TILTED_DEG, ENOUGH_TILTED = 15.0, 3
CELLS = (8, 6)  # of the image, along its longer side and its shorter
COVERED = 0.7  # share of the cells
VAGUE = 0.005  # standard deviation: of a focal length, of the image's width for a principal point
POOR_FIT = 1 / 640  # of the image's width: a pixel at 640


def covered_share(camera: FittedCamera) -> float:
    """Share of the image's cells that have a corner."""
    width, height = camera.intrinsics.size
    cells = np.array(CELLS if width >= height else CELLS[::-1])
    px = np.concatenate([each.view.px for each in camera.fitted])
    found = np.unique(((px + 0.5) / (width, height) * cells).astype(int), axis=0)
    return float(len(found) / cells.prod())


def doubts(camera: FittedCamera) -> tuple[str, ...]:
    """Warnings for people, in order of what to do first."""
    return (*_of_images(camera), *_of_the_fit(camera))


def _of_images(camera: FittedCamera) -> list[str]:
    fitted, found = camera.fitted, []
    if len(fitted) < ENOUGH_IMAGES:
        found.append(f"only {len(fitted)} images are used; take 20, of all parts of the image")
    tilted = sum(each.tilt_deg >= TILTED_DEG for each in fitted)
    if tilted < ENOUGH_TILTED:
        found.append(
            f"the board is tilted by {TILTED_DEG:g} degrees or more in {tilted} images, which does"
            " not tell focal length from distance; tilt it by 30 to 45 degrees to all sides"
        )
    covered = covered_share(camera)
    if covered < COVERED:
        found.append(
            f"corners lie on {covered:.0%} of the image only, and beyond them distortion is a"
            " guess; hold the board at all edges of the image, too"
        )
    return found


def _of_the_fit(camera: FittedCamera) -> list[str]:
    found = []
    width = max(camera.intrinsics.size)
    if camera.rms_px > POOR_FIT * width:
        found.append(
            f"corners are {camera.rms_px:.2f} px off; is the board flat, is the focus locked, is"
            " the lens no fisheye?"
        )
    vague = _vague(camera.intrinsics, camera.sigmas, width)
    if vague:
        found.append(
            f"the images do not determine {', '.join(vague)}; take more, closer and tilted"
        )
    return found


def _vague(intrinsics: Intrinsics, sigmas: Array, width: int) -> list[str]:
    """Lengths that are known too badly, with their standard deviations."""
    wholes = intrinsics.fx, intrinsics.fy, width, width
    return [
        f"{name} ({getattr(intrinsics, name):.1f} +- {sigma:.1f} px)"
        for name, sigma, whole in zip(PARAMETERS, sigmas, wholes, strict=False)
        if sigma > VAGUE * whole
    ]

"""A camera is calibrated by images of a board."""

from pathlib import Path

from vnav.api.arguments import AnyPath
from vnav.calibration.board import Board
from vnav.calibration.estimate import PARAMETERS
from vnav.calibration.images import Calibration, calibrate_images
from vnav.core.camera import Camera
from vnav.core.progress import Progress, silent
from vnav.errors import CameraError
from vnav.io.files import write_text
from vnav.io.formats.camera_file import camera_text

CHARUCO = Board()


def calibrate(
    folder: AnyPath,
    board: Board = CHARUCO,
    *,
    out: AnyPath | None = None,
    force: bool = False,
    units_per_metre: float | None = None,
    picture: AnyPath | None = None,
    progress: Progress = silent,
) -> Calibration:
    """The colour camera that took the images of a board in a folder, or in a capture.

    ``out``: a camera.toml to write; CameraError where there is one and not ``force``.
    ``units_per_metre``: of depth on the pixels of colour, for the file's [depth].
    ``picture``: a PNG to draw corners, residuals and an undistorted image into. VnavError where
    there are no images, or no camera comes of them.
    """
    path = None if out is None else Path(out)
    if path is not None and path.exists() and not force:
        raise CameraError(
            f"expected no camera at {path} yet, found one, and left it as it is; name another file"
            " with --out, or replace it with --force"
        )
    found = calibrate_images(Path(folder), board, progress)
    if path is not None:
        write_text(path, _file_text(found, units_per_metre))
    if picture is not None:
        from vnav.reporting.calibration_picture import draw

        draw(found, Path(picture))
    return found


def _file_text(found: Calibration, units_per_metre: float | None) -> str:
    """The camera.toml, with what is known of its quality as comments."""
    fitted = found.camera
    camera = fitted.intrinsics
    images = len(fitted.fitted)
    head = [
        f"By vnav calibrate, from {images} of {images + len(found.left_out)} images; corners are"
        f" {fitted.rms_px:.2f} px off.",
        *(f"Warning: {warning}." for warning in found.warnings),
    ]
    if units_per_metre is None:
        head.append("A capture needs [depth] with units_per_metre, too; photos do not.")
    of_lens = ", ".join(f"{sigma:.1g}" for sigma in fitted.sigmas[4:])
    remarks = {
        name: f"+- {sigma:.2g}" for name, sigma in zip(PARAMETERS[:4], fitted.sigmas, strict=False)
    } | {"distortion": f"+- {of_lens}"}
    known = camera if units_per_metre is None else Camera(camera, units_per_metre)
    return "".join(f"# {line}\n" for line in head) + camera_text(known, remarks) + "\n"

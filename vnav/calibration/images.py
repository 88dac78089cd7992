"""A camera from a folder of images of a board: read, sought, thinned out, fitted."""

from collections import Counter
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from vnav.calibration.board import Board
from vnav.calibration.detection import BoardView, find_board
from vnav.calibration.doubts import covered_share, doubts
from vnav.calibration.estimate import (
    FEWEST_IMAGES,
    PARAMETERS,
    FittedCamera,
    fit_without_outliers,
)
from vnav.config import CaptureConfig
from vnav.core.frame import Rejected
from vnav.core.progress import Progress, silent
from vnav.errors import CameraError, CaptureError, PhotoError
from vnav.io.photos.photo_files import photos_in, read_photo
from vnav.io.sources.open_capture import recognised

MOST_IMAGES = 60  # that a camera is fitted to: more take long and tell little more
HOPELESS = 0.1  # standard deviation of a focal length: that is no camera
MOST_TOLD = 3  # reasons, where no camera comes of it


@dataclass(frozen=True)
class Calibration:
    """A camera, the images it was made of, those left out and why, and what is in doubt."""

    folder: Path
    board: Board
    camera: FittedCamera
    left_out: dict[str, str]
    warnings: tuple[str, ...]

    @property
    def covered_share(self) -> float:
        """Share of the image's cells with corners."""
        return covered_share(self.camera)

    def as_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        camera = self.camera
        return {
            "folder": str(self.folder),
            "board": asdict(self.board),
            "intrinsics": asdict(camera.intrinsics),
            "sigmas": dict(zip(PARAMETERS, camera.sigmas.tolist(), strict=True)),
            "rms_px": camera.rms_px,
            "covered_share": self.covered_share,
            "images": {
                each.view.path.name: {
                    "corners": len(each.view.px),
                    "rms_px": each.rms_px,
                    "tilt_deg": each.tilt_deg,
                    "distance_m": each.distance_m,
                }
                for each in camera.fitted
            },
            "left_out": self.left_out,
            "warnings": list(self.warnings),
        }


def calibrate_images(folder: Path, board: Board, progress: Progress = silent) -> Calibration:
    """The colour camera that took the images of a board in a folder, or in a capture.

    CaptureError or PhotoError where there are no images, CameraError where no camera comes of them.
    """
    files = board_images(folder)
    found: list[BoardView] = []
    left_out: dict[str, str] = {}
    with ThreadPoolExecutor() as pool:
        looks = pool.map(lambda path: _look(path, board), files)
        for done, (path, look) in enumerate(zip(files, looks, strict=True), 1):
            if isinstance(look, Rejected):
                left_out[path.name] = look.reason
            else:
                found.append(look)
            progress("seek the board", done, len(files))
    found = _of_one_size(found, left_out)
    _require_enough(folder, len(found), len(files), left_out)
    camera, outliers = fit_without_outliers(_thinned(found, left_out), board)
    _require_determined(camera)
    for each in outliers:
        left_out[each.view.path.name] = f"outlier: its corners are {each.rms_px:.2f} px off"
    return Calibration(folder, board, camera, left_out, doubts(camera))


def board_images(folder: Path) -> list[Path]:
    """Images of a folder in order of name, or the colour images of a capture."""
    reader = recognised(folder)
    if reader is None:
        files = photos_in(folder)
    else:
        frames = reader.list_frames(folder, CaptureConfig())
        images = [*(pair.color for pair in frames.pairs), *frames.dropped_color]
        files = sorted({image.path for image in images if image.video_frame is None})
    if not files:
        raise CaptureError(f"expected images of a board in {folder}, found none; name their folder")
    return files


def _look(path: Path, board: Board) -> BoardView | Rejected:
    try:
        image = read_photo(path)
    except PhotoError as error:
        return Rejected(str(error))
    gray = np.asarray(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), np.uint8)
    return find_board(gray, board, path)


def _of_one_size(views: Sequence[BoardView], left_out: dict[str, str]) -> list[BoardView]:
    """The views of the commonest size; a camera has one."""
    sizes = Counter(view.size for view in views).most_common(1)
    for view in views:
        if view.size != sizes[0][0]:
            (width, height), (w, h) = sizes[0][0], view.size
            left_out[view.path.name] = f"{w} x {h} pixels, where most have {width} x {height}"
    return [view for view in views if view.path.name not in left_out]


def _thinned(views: Sequence[BoardView], left_out: dict[str, str]) -> list[BoardView]:
    """At most `MOST_IMAGES`: of neighbours the one whose edges are sharpest."""
    if len(views) <= MOST_IMAGES:
        return list(views)
    groups = np.array_split(np.arange(len(views)), MOST_IMAGES)
    kept = [min((views[k] for k in group), key=lambda view: view.edge_px) for group in groups]
    used = {view.path for view in kept}
    for view in views:
        if view.path not in used:
            left_out[view.path.name] = f"not needed: {MOST_IMAGES} images are enough"
    return kept


def _require_determined(camera: FittedCamera) -> None:
    known = camera.intrinsics
    if max(camera.sigmas[0] / known.fx, camera.sigmas[1] / known.fy) > HOPELESS:
        raise CameraError(
            f"expected images that determine a focal length, found {known.fx:.0f} +-"
            f" {camera.sigmas[0]:.0f} px; {'; '.join(doubts(camera))}"
        )


def _require_enough(folder: Path, found: int, images: int, left_out: dict[str, str]) -> None:
    if found >= FEWEST_IMAGES:
        return
    reasons = Counter(left_out.values()).most_common(MOST_TOLD)
    told = "; ".join(f"{count} times {reason}" for reason, count in reasons)
    raise CameraError(
        f"expected the board in at least {FEWEST_IMAGES} images of {folder}, better 20, found it in"
        f" {found} of {images} ({told}); is the board as --kind, --squares and --dictionary say?"
        " Squares are counted, not corners"
    )

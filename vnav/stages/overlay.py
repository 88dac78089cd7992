"""A photo with what was recognised in it."""

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from vnav.errors import PhotoError
from vnav.localisation.localise import Located
from vnav.stages.locate import PhotoReport

SEEN, PREDICTED, TEXT = (60, 200, 60), (220, 60, 200), (255, 255, 255)  # RGB


def write_overlay(report: PhotoReport, path: Path) -> None:
    """Write the picture; PhotoError where it cannot be written."""
    bgr = cv2.cvtColor(overlay(report), cv2.COLOR_RGB2BGR)
    try:
        written = cv2.imwrite(str(path), bgr)
    except cv2.error:
        written = False
    if not written:
        raise PhotoError(f"expected to write a picture at {path}, could not; name a .png or .jpg")


def overlay(report: PhotoReport) -> NDArray[np.uint8]:
    """The photo (H, W, 3) RGB, its inliers joined to where the map puts them, and a caption."""
    assert report.photo is not None
    image = np.array(report.photo.color)
    if isinstance(report.answer, Located):
        for seen, predicted in zip(report.seen_px, report.predicted_px, strict=True):
            a, b = (tuple(int(v) for v in np.rint(px)) for px in (seen, predicted))
            cv2.line(image, a, b, PREDICTED, 1, cv2.LINE_AA)
            cv2.circle(image, a, 4, SEEN, 1, cv2.LINE_AA)
        x, y, z = report.answer.best.view.centre_world
        caption = f"x {x:.2f} y {y:.2f} z {z:.2f} m, {report.answer.best.inliers} inliers"
    else:
        caption = f"not located: {report.reason}"
    cv2.rectangle(image, (0, 0), (image.shape[1], 28), (0, 0, 0), -1)
    cv2.putText(image, caption, (8, 20), cv2.FONT_HERSHEY_SIMPLEX, 0.6, TEXT, 1, cv2.LINE_AA)
    return image

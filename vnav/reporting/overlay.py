"""A photo with what was found in it drawn over it, and the map from above beside it."""

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from vnav.core.voxels import Voxels
from vnav.errors import VnavError
from vnav.io.photos.photo_files import read_photo
from vnav.localisation.database import LandmarkDatabase
from vnav.localisation.verdict.answer import PhotoAnswer, summary
from vnav.localisation.verification.prediction import predict
from vnav.localisation.verification.verify import VerifiedPose
from vnav.reporting.inset import GREEN, RED, Inset
from vnav.reporting.picture_file import write_picture
from vnav.reporting.picture_legend import ARROW, DOT, LINE, RING, LegendEntry, with_legend

YELLOW, BLUE = (0, 220, 255), (255, 150, 60)  # BGR
MOST_PLACES = 8  # drawn of a photo that was not located


def draw(answer: PhotoAnswer, database: LandmarkDatabase, path: Path) -> None:
    """Write a picture: blue what the map predicts, green the inliers, yellow how far they are off.

    Beside it the map from above: the camera in green, with its uncertainty. A photo that was not
    located shows its features, and the places it may have been taken at, in red. A legend stands
    below. VnavError where the picture cannot be written.
    """
    canvas = _beside(over_photo(answer, database), answer, database.index.voxels)
    _draw_title(canvas, summary(answer).removeprefix(f"{answer.path}: "))
    canvas = with_legend(canvas, _entries(answer, database.index.voxels))
    if path.resolve() == answer.path.resolve():
        raise VnavError(
            f"expected another file for the picture than its photo {path}, and wrote nothing; name"
            " another with --overlay"
        )
    write_picture(path, canvas, "--overlay")


def over_photo(answer: PhotoAnswer, database: LandmarkDatabase) -> NDArray[np.uint8]:
    """The photo (H, W, 3), BGR, with what was found in it; PhotoError where it is not there."""
    canvas = _seen(answer)
    if answer.best is not None:
        _draw_pose(canvas, answer, answer.best, database)
    else:
        for x, y in answer.photo.features.keypoints_px:
            cv2.circle(canvas, (round(x), round(y)), 2, RED, -1, cv2.LINE_AA)
    return canvas


def _seen(answer: PhotoAnswer) -> NDArray[np.uint8]:
    """The photo (H, W, 3), BGR, as its features were searched: scaled and undistorted."""
    image = cv2.cvtColor(read_photo(answer.path), cv2.COLOR_RGB2BGR)
    size, k = answer.photo.intrinsics.size, answer.camera.intrinsics
    if image.shape[1::-1] != size:
        image = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
    if k.distortion:
        image = cv2.undistort(image, k.scaled(*size).K, np.array(k.distortion))
    return np.asarray(image, np.uint8)


def _draw_pose(
    canvas: NDArray[np.uint8], answer: PhotoAnswer, best: VerifiedPose, database: LandmarkDatabase
) -> None:
    for x, y in predict(best.view, database).px:
        cv2.circle(canvas, (round(x), round(y)), 1, BLUE, -1, cv2.LINE_AA)
    features = answer.photo.features.keypoints_px[best.matches.feature]
    landmarks, _ = best.view.project(database.index.points_world[best.matches.landmark])
    for feature, landmark in zip(features, landmarks, strict=True):
        place = round(feature[0]), round(feature[1])
        cv2.line(canvas, place, (round(landmark[0]), round(landmark[1])), YELLOW, 1, cv2.LINE_AA)
        cv2.circle(canvas, place, 3, GREEN, 1, cv2.LINE_AA)


def _beside(canvas: NDArray[np.uint8], answer: PhotoAnswer, voxels: Voxels) -> NDArray[np.uint8]:
    """The photo and, where the map knows of anything that stands, the map (H, W + map, 3)."""
    if not voxels.solid.any():
        return canvas
    inset = Inset(voxels, len(canvas))
    if answer.best is not None and answer.sigmas is not None:
        inset.draw_uncertainty(answer.best, answer.sigmas)
        inset.draw(answer.best, GREEN)
    else:
        for hypothesis in answer.result.hypotheses[:MOST_PLACES]:
            inset.draw(hypothesis, RED)
    return np.concatenate([canvas, inset.image], 1)


def _entries(answer: PhotoAnswer, voxels: Voxels) -> list[LegendEntry]:
    """What is drawn, on the photo and, where it is there, on the map beside it."""
    has_map = bool(voxels.solid.any())
    if answer.best is None:
        maybe = [LegendEntry(ARROW, RED, "where it may have been taken")]
        is_somewhere = has_map and bool(answer.result.hypotheses)
        return [LegendEntry(DOT, RED, "feature"), *(maybe if is_somewhere else [])]
    seen = [
        LegendEntry(DOT, BLUE, "what the map predicts"),
        LegendEntry(RING, GREEN, "feature that agrees"),
        LegendEntry(LINE, YELLOW, "how far it is off"),
    ]
    camera = LegendEntry(ARROW, GREEN, "camera, and the ellipse that holds it with 99 %")
    return [*seen, camera] if has_map and answer.sigmas is not None else seen


def _draw_title(canvas: NDArray[np.uint8], text: str) -> None:
    """White on black at the top, as wide as the picture allows."""
    width = canvas.shape[1]
    (wanted, _), _ = cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, 1.0, 1)
    scale = min(0.6, (width - 16) / max(wanted, 1))
    cv2.rectangle(canvas, (0, 0), (width, 24), (0, 0, 0), -1)
    place = (8, 17)
    cv2.putText(
        canvas, text, place, cv2.FONT_HERSHEY_SIMPLEX, scale, (255, 255, 255), 1, cv2.LINE_AA
    )

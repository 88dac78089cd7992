"""Where photos were taken: claim 4."""

import os
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from vnav.config import Config, FeaturesConfig
from vnav.core import se3
from vnav.core.frame import Rejected
from vnav.core.progress import Progress, silent
from vnav.errors import PhotoError
from vnav.features import front_end
from vnav.io.artifacts import map_camera
from vnav.io.index_file import load_index
from vnav.io.map_folder import MapFolder
from vnav.io.photos import PhotoFile, read_photo
from vnav.io.tree_file import load_tree
from vnav.localisation.atlas import Atlas
from vnav.localisation.localise import Hypothesis, Located, localise
from vnav.localisation.photo import Photo, prepare

Array = NDArray[np.float64]
DARK = 25.0  # mean brightness of 255 below which a photo without features is called dark


@dataclass(frozen=True)
class PhotoReport:
    """What is said of one photo; ``answer`` is `PhotoError` where it could not be read.

    ``features`` found; ``seconds`` by step; ``seen_px`` and ``predicted_px`` (M, 2): where the
    inliers were seen, and where the map puts them, in an image without distortion.
    """

    path: Path
    photo: PhotoFile | None
    answer: Located | Rejected | PhotoError
    features: int = 0
    seconds: dict[str, float] = field(default_factory=dict)
    seen_px: Array = field(default_factory=lambda: np.zeros((0, 2)))
    predicted_px: Array = field(default_factory=lambda: np.zeros((0, 2)))

    @property
    def T_world_camera(self) -> Array | None:
        """The pose (4, 4), None where the photo was not located."""
        return self.answer.best.view.T_world_camera if isinstance(self.answer, Located) else None

    @property
    def reason(self) -> str:
        """Why there is no pose; empty where there is one."""
        if isinstance(self.answer, Located):
            return ""
        return self.answer.reason if isinstance(self.answer, Rejected) else str(self.answer)

    def as_dict(self) -> dict[str, Any]:
        """Plain values for JSON, as docs/locating.md lists them."""
        values = {
            "photo": str(self.path),
            "located": False,
            "reason": self.reason,
            "T_world_camera": None,
            "position_m": None,
            "quaternion_xyzw": None,
            "intrinsics": None,
            "intrinsics_source": self.photo.source if self.photo else None,
            "features": self.features,
            "matches": 0,
            "inliers": 0,
            "sigma_position_m": None,
            "sigma_rotation_deg": None,
            "confidence": None,
            "hypotheses": [],
            "seconds": self.seconds,
        }
        if isinstance(self.answer, Rejected):
            values |= {"matches": self.answer.matches, "inliers": self.answer.inliers}
        if isinstance(self.answer, Located):
            values |= _pose(self.answer)
        return values


class Locator:
    """A map, loaded once, that finds photos."""

    def __init__(self, folder: MapFolder, config: Config) -> None:
        self._config = config
        self._camera = map_camera(folder)
        self._atlas = Atlas(load_index(folder), load_tree(folder))
        features = FeaturesConfig(**folder.settings("odometry")["features"])
        self._extract = front_end(
            replace(features, max_features=config.locate.max_features)
        ).extract

    def __call__(self, path: Path, camera: str | None = None) -> PhotoReport:
        """Where a photo was taken; its camera as `read_photo` finds it."""
        started = time.perf_counter()
        try:
            photo = read_photo(path, camera, self._camera)
        except PhotoError as error:
            return PhotoReport(path, None, error)
        read = time.perf_counter()
        features = self._extract(photo.color)
        extracted = time.perf_counter()
        asked = prepare(features, photo.intrinsics, photo.is_known, self._atlas.tree)
        rng = np.random.default_rng([self._config.seed, 4])
        answer = localise(asked, self._atlas, self._config.locate, rng)
        if isinstance(answer, Rejected):
            answer = _explained(answer, photo, len(features))
        ended = time.perf_counter()
        seconds = {
            "read": read - started,
            "features": extracted - read,
            "locate": ended - extracted,
        }
        report = PhotoReport(path, photo, answer, len(features), seconds)
        return self._with_pixels(report, answer, asked) if isinstance(answer, Located) else report

    def _with_pixels(self, report: PhotoReport, located: Located, asked: Photo) -> PhotoReport:
        matches, view = located.best.matches, located.best.view
        predicted, _ = view.project(self._atlas.index.points_world[matches.landmark])
        seen = asked.features.keypoints_px[matches.feature].astype(float)
        return replace(report, seen_px=seen, predicted_px=predicted)


def locate(
    folder: MapFolder,
    photos: Sequence[Path],
    config: Config,
    *,
    camera: str | None = None,
    progress: Progress = silent,
) -> list[PhotoReport]:
    """Where each photo was taken, in the order asked; several are worked on at once."""
    locator = Locator(folder, config)
    if len(photos) == 1:
        return [locator(photos[0], camera)]
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        with ThreadPoolExecutor(os.cpu_count()) as pool:
            reports = []
            for report in pool.map(lambda path: locator(path, camera), photos):
                reports.append(report)
                progress("locate", len(reports), len(photos))
            return reports
    finally:
        cv2.setNumThreads(threads)


def _explained(answer: Rejected, photo: PhotoFile, features: int) -> Rejected:
    """The refusal with what the photo itself shows of its cause."""
    if answer.reason != "too few features":
        return answer
    brightness = float(photo.color.mean())
    dark = f"too dark: mean brightness {brightness:.0f} of 255, "
    return Rejected(
        f"{dark if brightness < DARK else ''}too few features: {features}",
        answer.matches,
        answer.inliers,
    )


def _pose(located: Located) -> dict[str, Any]:
    best = located.best
    T = best.view.T_world_camera
    # The tangent is the camera's; positions are told along the world's axes.
    in_world = T[:3, :3] @ best.covariance[3:6, 3:6] @ T[:3, :3].T
    rotation = best.covariance[:3, :3]
    return {
        "located": True,
        "T_world_camera": T.tolist(),
        "position_m": T[:3, 3].tolist(),
        "quaternion_xyzw": se3.quat_xyzw(T).tolist(),
        "intrinsics": asdict(best.view.intrinsics),
        "matches": located.matches,
        "inliers": best.inliers,
        "sigma_position_m": np.sqrt(np.diag(in_world)).tolist(),
        "sigma_rotation_deg": np.rad2deg(np.sqrt(np.diag(rotation))).tolist(),
        "hypotheses": [_hypothesis(h) for h in (best, *located.rivals)],
    }


def _hypothesis(h: Hypothesis) -> dict[str, Any]:
    return {
        "position_m": h.view.centre_world.tolist(),
        "inliers": h.inliers,
        "predicted": h.predicted,
        "evidence": h.evidence,
    }

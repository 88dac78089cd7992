"""How far off a map's answers are, for photos whose true poses are known."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from vnav.core.arrays import Array
from vnav.core.association import associate
from vnav.core.progress import Progress, silent
from vnav.core.trajectory import Trajectory
from vnav.errors import CaptureError, PhotoError
from vnav.evaluation import metrics
from vnav.io.formats.trajectories import read_photo_poses
from vnav.io.sources.capture import Capture, FileBacked
from vnav.io.sources.subset import Subset
from vnav.localisation.verdict.answer import PhotoAnswer, UnreadablePhoto
from vnav.stages.locate import Locator, locate


@dataclass(frozen=True)
class PosedPhoto:
    """A photo and where it was truly taken (4, 4), in the truth's world."""

    path: Path
    T_truth_camera: Array


def photo_queries(folder: Path) -> list[PosedPhoto]:
    """The photos that a folder's groundtruth.txt names; PhotoError where one is missing."""
    queries = [
        PosedPhoto(folder / n, T) for n, T in read_photo_poses(folder / "groundtruth.txt").items()
    ]
    for query in queries:
        if not query.path.is_file():
            raise PhotoError(f"expected the photo {query.path}, which groundtruth.txt names")
    return queries


def without_held_out(capture: Capture, every: int) -> Capture:
    """The capture without its ``every``-th frames; whole where that is 0."""
    if not every:
        return capture
    return Subset(capture, [row for row in range(len(capture)) if (row + 1) % every])


def held_out_queries(
    capture: FileBacked, every: int, truth: Trajectory, max_difference_s: float
) -> list[PosedPhoto]:
    """The frames that `without_held_out` leaves out and that have a true pose."""
    colors = [pair.color for pair in capture.files.pairs][every - 1 :: every]
    if any(color.video_frame is not None for color in colors):
        raise CaptureError(
            f"expected frames that are image files to be held out, found those of {colors[0].path};"
            " leave out hold_out_every"
        )
    stamps_s = np.array([color.stamp_s for color in colors])
    matches = associate(stamps_s, truth.stamps_s, max_difference_s)
    return [PosedPhoto(colors[i].path, truth.T_world_camera[j]) for i, j in matches]


def relocalise(
    locator: Locator,
    queries: Sequence[PosedPhoto],
    T_truth_world: Array,
    progress: Progress = silent,
) -> dict[str, Any]:
    """Errors of a map's answers, moved into the truth's world: in all, and ``answers`` one by one.

    What is in all is `metrics.Relocalisation`; a photo that cannot be read is not located.
    """
    found = list(locate(locator, [query.path for query in queries], progress=progress))
    answers = [
        _answer(answer, query, T_truth_world) for answer, query in zip(found, queries, strict=True)
    ]
    located = [answer for answer in answers if answer["located"]]
    summary = metrics.Relocalisation.of(
        [answer["off_m"] for answer in located],
        [answer["off_deg"] for answer in located],
        len(queries),
    )
    medians = {} if located else {"median_m": None, "median_deg": None}
    return asdict(summary) | medians | {"answers": answers}


def _answer(
    answer: PhotoAnswer | UnreadablePhoto, query: PosedPhoto, T_truth_world: Array
) -> dict[str, Any]:
    best = answer.best if isinstance(answer, PhotoAnswer) else None
    values: dict[str, Any] = {"photo": query.path.name, "located": best is not None}
    if best is None:
        return values | {"reason": answer.reason}
    T_truth_camera = T_truth_world @ best.view.T_world_camera
    off_m, off_deg = metrics.relocalisation_error(T_truth_camera, query.T_truth_camera)
    return values | {"off_m": float(off_m), "off_deg": float(off_deg)}

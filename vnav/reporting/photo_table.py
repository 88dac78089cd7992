"""Where photos were taken, as a table for other programs."""

import csv
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np

from vnav.core import se3
from vnav.errors import VnavError
from vnav.localisation.verdict.answer import HELD, PhotoAnswer, UnreadablePhoto

CSV_HEADER = (
    *("photo", "located", "reason", "tx", "ty", "tz", "qx", "qy", "qz", "qw"),
    *("sigma_x_m", "sigma_y_m", "sigma_z_m", "sigma_rotation_deg", "matches", "inliers"),
    "confidence",
)


@contextmanager
def photo_table(path: Path | None) -> Iterator[Callable[[PhotoAnswer | UnreadablePhoto], None]]:
    """Writes a line for each photo below a header, at once: what is interrupted has its lines.

    Fields of what is not known are empty. Without a path, nothing is written. VnavError where the
    file cannot be.
    """
    if path is None:
        yield lambda answer: None
        return
    with _told(path):
        file = path.open("w", encoding="utf-8", newline="")
    writer = csv.writer(file, lineterminator="\n")

    def write(row: Iterable[Any]) -> None:
        with _told(path):
            writer.writerow(row)
            file.flush()

    try:
        write(CSV_HEADER)
        yield lambda answer: write(_row(answer))
    finally:
        with suppress(OSError):  # what could not be written is told
            file.close()


@contextmanager
def _told(path: Path) -> Iterator[None]:
    """VnavError for what the system has against writing."""
    try:
        yield
    except OSError as error:
        raise VnavError(
            f"expected to write {path}, found: {error.strerror}; name another file with --csv"
        ) from error


def _row(answer: PhotoAnswer | UnreadablePhoto) -> list[Any]:
    if isinstance(answer, UnreadablePhoto):
        return [answer.path, False, answer.reason, *[""] * (len(CSV_HEADER) - 3)]
    result, sigmas = answer.result, answer.sigmas
    pose: list[Any] = [""] * 11
    confidence = "" if answer.confidence is None else f"{answer.confidence:.4f}"
    if answer.best is not None and sigmas is not None:
        T = answer.best.view.T_world_camera
        numbers = [*T[:3, 3], *se3.quat_xyzw(T), *sigmas.position_m]
        numbers.append(np.rad2deg(np.linalg.norm(sigmas.rotation_rad)))
        pose = [f"{number:.6f}" for number in numbers]
    located, reason = answer.best is not None, HELD if answer.held_by_prior else answer.reason
    return [answer.path, located, reason, *pose, result.matches, result.inliers, confidence]

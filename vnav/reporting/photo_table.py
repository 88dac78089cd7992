"""Where photos were taken, as a table for other programs."""

import csv
import io
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from vnav.core import se3
from vnav.errors import VnavError
from vnav.io.files import write_text
from vnav.localisation.verdict.answer import PhotoAnswer, UnreadablePhoto

CSV_HEADER = (
    *("photo", "located", "reason", "tx", "ty", "tz", "qx", "qy", "qz", "qw"),
    *("sigma_x_m", "sigma_y_m", "sigma_z_m", "sigma_rotation_deg", "matches", "inliers"),
)


def write_csv(path: Path, answers: Iterable[PhotoAnswer | UnreadablePhoto]) -> None:
    """A header and a line for each photo; empty fields for what is not known."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(CSV_HEADER)
    writer.writerows(_row(answer) for answer in answers)
    try:
        write_text(path, text.getvalue())
    except OSError as error:
        raise VnavError(
            f"expected to write {path}, found: {error.strerror}; name another file with --csv"
        ) from error


def _row(answer: PhotoAnswer | UnreadablePhoto) -> list[Any]:
    if isinstance(answer, UnreadablePhoto):
        return [answer.path, False, answer.reason, *[""] * (len(CSV_HEADER) - 3)]
    result, sigmas = answer.result, answer.sigmas
    pose: list[Any] = [""] * 11
    if answer.best is not None and sigmas is not None:
        T = answer.best.view.T_world_camera
        numbers = [*T[:3, 3], *se3.quat_xyzw(T), *sigmas.position_m]
        numbers.append(np.rad2deg(np.linalg.norm(sigmas.rotation_rad)))
        pose = [f"{number:.6f}" for number in numbers]
    located = answer.best is not None
    return [answer.path, located, answer.reason, *pose, result.matches, result.inliers]

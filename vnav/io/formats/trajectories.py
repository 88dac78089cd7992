"""Trajectory files: TUM (read, written) and KITTI (written)."""

import hashlib
import itertools
import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vnav.core import se3
from vnav.core.trajectory import Trajectory
from vnav.errors import TrajectoryError
from vnav.io.files import read_text, write_text

FARTHEST_M = 1e6  # from the origin; no map is as large
_UNIT = 0.01  # how far a quaternion's length may lie from 1: three printed digits


def read_tum(path: Path) -> Trajectory:
    """A trajectory from lines ``stamp tx ty tz qx qy qz qw``, metres, camera to world.

    Spaces, tabs or commas separate; lines that start with # are comments. Quaternions are
    normalised, lines sorted by time. A file without poses gives an empty trajectory.
    TrajectoryError names the line that has no eight finite numbers or no unit quaternion, and a
    time that occurs twice.
    """
    rows = sorted(
        _values(path, number, line, line.replace(",", " ").split(), "stamp")
        for number, line in _lines(path)
    )
    for before, row in itertools.pairwise(rows):
        if row[0] == before[0]:
            raise TrajectoryError(f"expected one pose a time in {path}, found two at {row[0]!r}")
    values = np.array(rows).reshape(-1, 8)
    R_world_camera = se3.rotation_from_quat(values[:, 4:])
    return Trajectory(values[:, 0], se3.make(R_world_camera, values[:, 1:4]))


def read_photo_poses(path: Path) -> dict[str, NDArray[np.float64]]:
    """Pose (4, 4), camera to world, of each photo from lines ``filename tx ty tz qx qy qz qw``.

    Otherwise as `read_tum`.
    """
    poses = {}
    for number, line in _lines(path):
        name, *words = line.replace(",", " ").split()
        values = _values(path, number, line, ["0", *words], "filename")
        poses[name] = se3.make(se3.rotation_from_quat(values[4:]), values[1:4])
    return poses


def fingerprint(trajectory: Trajectory) -> str:
    """A hash of all times and poses."""
    content = trajectory.stamps_s.tobytes() + trajectory.T_world_camera.tobytes()
    return hashlib.sha256(content).hexdigest()


def write_tum(path: Path, trajectory: Trajectory) -> None:
    """Write lines ``stamp tx ty tz qx qy qz qw``; what is read again is the same within 1e-9."""
    quats_xyzw = se3.quat_xyzw(trajectory.T_world_camera)
    rows = zip(trajectory.stamps_s, trajectory.positions, quats_xyzw, strict=True)
    lines = [f"{t:.9f} " + " ".join(f"{x:.12f}" for x in (*p, *q)) for t, p, q in rows]
    write_text(path, "\n".join(["# stamp tx ty tz qx qy qz qw (camera to world)", *lines, ""]))


def write_kitti(path: Path, trajectory: Trajectory) -> None:
    """Write one line a pose: the upper three rows of T_world_camera, row by row; no times."""
    rows = trajectory.T_world_camera[:, :3].reshape(-1, 12)
    write_text(path, "".join(" ".join(f"{x:.12f}" for x in row) + "\n" for row in rows))


def _lines(path: Path) -> list[tuple[int, str]]:
    try:
        text = read_text(path)
    except OSError as error:
        raise TrajectoryError(
            f"expected a trajectory at {path}, found: {error.strerror}"
        ) from error
    except UnicodeDecodeError as error:
        raise TrajectoryError(f"expected a trajectory in {path}, found no text: {error}") from error
    numbered = ((number, line.strip()) for number, line in enumerate(text.splitlines(), 1))
    return [(number, line) for number, line in numbered if line and not line.startswith("#")]


def _values(path: Path, number: int, line: str, words: Sequence[str], first: str) -> list[float]:
    try:
        values = [float(word) for word in words]
    except ValueError:
        values = []
    if len(values) != 8 or not np.isfinite(values).all():
        raise TrajectoryError(
            f"expected '{first} tx ty tz qx qy qz qw' in {path}, line {number}, found '{line}'"
        )
    if np.abs(values[1:4]).max() > FARTHEST_M:
        raise TrajectoryError(
            f"expected positions in metres in {path}, line {number}, found '{line}'"
        )
    length = math.hypot(*values[4:])
    if abs(length - 1) > _UNIT:
        raise TrajectoryError(
            f"expected a unit quaternion in {path}, line {number}, found length {length:.4g}"
        )
    return values

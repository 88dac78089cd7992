"""Pose graphs as g2o text, which g2o, gtsam and others read."""

from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from vnav.core import se3
from vnav.core.arrays import Array
from vnav.core.frame import Edge
from vnav.io.files import write_text

TRANSLATION_FIRST = np.ix_([3, 4, 5, 0, 1, 2], [3, 4, 5, 0, 1, 2])  # g2o's order of a tangent


def write_g2o(path: Path, T_world_camera: Array, edges: Sequence[Edge]) -> None:
    """Write a VERTEX_SE3:QUAT for each pose (N, 4, 4) that is no NaN, and the edges between them.

    Edges are EDGE_SE3:QUAT with the upper triangle of the information, six digits a number.
    """
    posed = np.isfinite(T_world_camera[:, 0, 0])
    lines = [f"VERTEX_SE3:QUAT {n} {_pose(T_world_camera[n])}" for n in np.flatnonzero(posed)]
    for e in edges:
        if posed[e.i] and posed[e.j]:
            information = e.information[TRANSLATION_FIRST][np.triu_indices(6)]
            lines.append(f"EDGE_SE3:QUAT {e.i} {e.j} {_pose(e.T_i_j)} {_numbers(information)}")
    write_text(path, "".join(f"{line}\n" for line in lines))


def _pose(T: Array) -> str:
    """``x y z qx qy qz qw``; w is positive where it exceeds one half, as gtsam writes it."""
    q = se3.quat_xyzw(T)
    return f"{_numbers(T[:3, 3])} {_numbers(-q if q[3] < -0.5 else q)}"


def _numbers(values: Iterable[float]) -> str:
    return " ".join(f"{value:g}" for value in values)

"""The connected parts of a map, and its frames that are no keyframes: poses follow by edges."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from vnav.core import se3
from vnav.core.arrays import Array
from vnav.core.frame import Edge
from vnav.core.graph import propagate_poses
from vnav.core.mapping import LOST, Odometry
from vnav.optimisation.pose_graph import optimise_others

Parts = dict[str, NDArray[np.intp]]  # rows of frames, by name


def split_parts(
    part: NDArray[np.int32], T_world_before: Array | None = None
) -> tuple[NDArray[np.bool_], Parts]:
    """Which frames (N,) are in the main part, and the other parts; a frame alone is none.

    The main part is the largest; of an extended map, the one with most of what was mapped before.
    """
    numbers, sizes = np.unique(part[part != LOST], return_counts=True)
    if T_world_before is not None:
        mapped = part[np.isfinite(T_world_before[:, 0, 0])]
        sizes = sizes + len(part) * (mapped[:, None] == numbers).sum(0)
    main, *others = numbers[np.argsort(-sizes, kind="stable")]
    rows = [np.flatnonzero(part == number) for number in others]
    named = enumerate((r for r in rows if len(r) > 1), 2)
    return part == main, {f"part_{number}": r for number, r in named}


def follow_keyframes(
    poses: Array, T_keyframes: Array, odometry: Odometry, edges: Sequence[Edge]
) -> Array:
    """Poses (N, 4, 4) of all frames by their edges, where keyframes (K, 4, 4) were adjusted.

    NaN for those that were not.
    """
    rows = odometry.keyframe_rows
    poses = _moved_with_keyframes(poses, T_keyframes, rows)
    return optimise_others(poses, edges, rows[np.isfinite(T_keyframes[:, 0, 0])])


def attach_degenerate_frames(
    poses: Array, odometry: Odometry, parts: Parts, most_frames: int
) -> tuple[Array, Parts]:
    """Poses (N, 4, 4) with those that degenerate edges connect to them, and the parts that remain.

    Parts of more than ``most_frames`` remain: nothing is built on degenerate edges.
    """
    large = [rows for rows in parts.values() if len(rows) > most_frames]
    edges = _outside(np.concatenate([[-1], *large]), odometry)
    poses = joined_by(edges, poses)
    posed = np.isfinite(poses[:, 0, 0])
    return poses, {name: rows for name, rows in parts.items() if not posed[rows].any()}


def joined_by(edges: Sequence[Edge], poses: Array) -> Array:
    """Poses (N, 4, 4) with those of frames that edges connect to them; the ones before stay."""
    fixed = np.isfinite(poses[:, 0, 0])
    poses = propagate_poses(poses, edges)
    posed = np.isfinite(poses[:, 0, 0])
    if not (posed & ~fixed).any():
        return poses
    inside = [e for e in edges if posed[e.i] and posed[e.j]]
    return optimise_others(poses, inside, np.flatnonzero(fixed))


def _outside(rows: NDArray[np.intp], odometry: Odometry) -> list[Edge]:
    """All edges of odometry, degenerate ones too, that touch none of the rows."""
    inside = np.isin(np.arange(len(odometry.frames)), rows)
    return [e for e in odometry.motions if not (inside[e.i] or inside[e.j])]


def _moved_with_keyframes(poses: Array, T_keyframes: Array, rows: NDArray[np.intp]) -> Array:
    """All poses, each moved as the keyframe before it was moved by the adjustment."""
    good = np.isfinite(T_keyframes[:, 0, 0])
    rows, correction = rows[good], (T_keyframes @ se3.inverse(poses[rows]))[good]
    before = np.searchsorted(rows, np.arange(len(poses)), side="right") - 1
    return np.asarray(correction[before.clip(0)] @ poses)

"""Final poses of all frames from their edges and landmarks: claim 3, S7."""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import compress, pairwise

import numpy as np
from numpy.typing import NDArray

from vnav.config import Config
from vnav.core import se3
from vnav.core.arrays import Array
from vnav.core.camera import Intrinsics
from vnav.core.frame import Edge
from vnav.core.graph import reached
from vnav.core.mapping import LOST, Odometry
from vnav.core.progress import Progress, silent
from vnav.optimisation import pose_graph
from vnav.optimisation.bundle import Prior, SensorModel
from vnav.optimisation.given_noise import noise
from vnav.optimisation.landmarks import Adjusted, Tracks, adjust_landmarks
from vnav.optimisation.pose_graph import softened

JOINED_SIGMAS = np.repeat([0.01, 0.03], 3)  # rad, m: between keyframes that loops close
ALONG_FACTOR = 2.0  # noise of a way of edges over its sum: edges that share a frame err alike


@dataclass(frozen=True)
class Solved:
    """Poses (N, 4, 4) of the main part, its adjusted keyframes and landmarks, closures kept.

    ``others``: rows of the parts that no closure joins to it, by name, the largest first;
    ``prior``: of keyframes whose poses were given.
    """

    poses: Array
    adjusted: Adjusted
    graph: pose_graph.PoseGraph
    closures: tuple[Edge, ...]
    others: dict[str, NDArray[np.intp]]
    prior: Prior | None = None


def solve(
    odometry: Odometry,
    closures: Sequence[Edge],
    matches: NDArray[np.int32],
    cameras: Sequence[Intrinsics],
    config: Config,
    progress: Progress = silent,
) -> Solved:
    """Robust pose graph, bundle adjustment of the keyframes, then the frames between them.

    There is no pose graph where poses are given: `config.OptimiseConfig.given_poses` says whether
    they stay as they are or are a prior.
    """
    if odometry.given:
        return _on_given(odometry, closures, matches, cameras, config)
    segments = odometry.T_segment_camera, odometry.segment, odometry.frames.capture
    initial, _ = pose_graph.join(*segments, closures)
    graph = pose_graph.optimise(
        initial, odometry.edges, closures, config.optimise.max_closure_sigmas
    )
    _, part = pose_graph.join(*segments, list(compress(closures, graph.kept)))
    inside = np.array([part[e.i] == part[e.j] for e in closures], bool)
    graph = dataclasses.replace(graph, kept=graph.kept & inside)
    kept = tuple(compress(closures, graph.kept))
    main, others = _parts(part, odometry.T_world_before)
    poses = np.where(main[:, None, None], graph.T_world_camera, np.nan)
    edges = [e for e in (*odometry.edges, *kept) if main[e.i] and main[e.j]]
    progress("optimise", 1, 3)
    adjusted = _adjust(poses, odometry, kept, matches, cameras, config)
    progress("optimise", 2, 3)
    poses = _carried(poses, adjusted, odometry, edges)
    poses, others = _hung(poses, odometry, others, config.odometry.max_degenerate_frames)
    progress("optimise", 3, 3)
    return Solved(poses, adjusted, graph, kept, others)


def _on_given(
    odometry: Odometry,
    closures: Sequence[Edge],
    matches: NDArray[np.int32],
    cameras: Sequence[Intrinsics],
    config: Config,
) -> Solved:
    """Which closures agree with the given poses, and the landmarks that their matches make."""
    poses = odometry.T_segment_camera
    sigmas, fixed = noise(poses, closures), config.optimise.given_poses == "fixed"
    rad, m = np.sqrt(2) * sigmas[[0, 3]]  # of two poses
    graph = pose_graph.held(
        poses, [softened(e, rad, m) for e in closures], config.optimise.max_closure_sigmas
    )
    kept = tuple(compress(closures, graph.kept))
    rows = np.array([k.row for k in odometry.keyframes])
    prior = Prior(poses[rows], sigmas, fixed)
    adjusted = _adjust(poses, odometry, kept, matches, cameras, config, prior)
    if not fixed:
        poses = _carried(poses, adjusted, odometry, odometry.edges)
    return Solved(poses, adjusted, graph, kept, {}, prior)


def _parts(
    part: NDArray[np.int32], T_world_before: Array | None = None
) -> tuple[NDArray[np.bool_], dict[str, NDArray[np.intp]]]:
    """Which frames are in the main part, and the rows of the others; a frame alone is none.

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


def _adjust(
    poses: Array,
    odometry: Odometry,
    closures: Sequence[Edge],
    matches: NDArray[np.int32],
    cameras: Sequence[Intrinsics],
    config: Config,
    prior: Prior | None = None,
) -> Adjusted:
    rows = [k.row for k in odometry.keyframes]
    number = {row: k for k, row in enumerate(rows)}
    kept = {(number[e.i], number[e.j]) for e in closures}
    of_kept = [(int(i), int(j)) in kept for i, j in matches[:, [0, 2]]]
    tracks = Tracks(odometry.keyframes, matches[np.array(of_kept, bool)])
    model = SensorModel([cameras[odometry.frames.capture[r]] for r in rows], config.registration)
    joined = _joined(poses, odometry, kept)
    return adjust_landmarks(poses[rows], tracks, joined, model, config.optimise, prior)


def _joined(poses: Array, odometry: Odometry, closed: set[tuple[int, int]]) -> list[Edge]:
    """Edges between keyframes, by number: of odometry to the next, and of the pairs loops close.

    Odometry's have its own motion and noise, for it saw the frames between, some of them loosely;
    the others, and those of given poses, have the motion of ``poses``.
    """
    rows = [k.row for k in odometry.keyframes]
    number = {row: k for k, row in enumerate(rows)}
    T, segment = poses[rows], odometry.segment[rows]
    posed = np.isfinite(T[:, 0, 0])
    of_segment = [np.flatnonzero(segment == s).tolist() for s in np.unique(segment)]
    neighbours = {pair for keyframes in of_segment for pair in pairwise(keyframes)}
    information = np.diag(JOINED_SIGMAS**-2.0)
    joined = {
        (i, j): Edge(i, j, se3.inverse(T[i]) @ T[j], information)
        for i, j in neighbours | closed
        if posed[i] and posed[j]
    }
    if not odometry.given:
        followed = neighbours | set(pairwise(range(len(rows))))
        between = [(rows[i], rows[j]) for i, j in followed if posed[i] and posed[j]]
        for e in pose_graph.along((*odometry.edges, *odometry.degenerate_edges), between):
            i, j = number[e.i], number[e.j]
            joined[i, j] = Edge(i, j, e.T_i_j, e.information / ALONG_FACTOR**2)
    return [joined[pair] for pair in sorted(joined)]


def _carried(poses: Array, adjusted: Adjusted, odometry: Odometry, edges: Sequence[Edge]) -> Array:
    """All poses, where the keyframes' are those of the adjustment."""
    rows = np.array([k.row for k in odometry.keyframes])
    poses = _moved_along(poses, adjusted.T_world_camera, rows)
    return pose_graph.carry(poses, edges, rows[np.isfinite(poses[rows, 0, 0])])


def _hung(
    poses: Array, odometry: Odometry, others: dict[str, NDArray[np.intp]], most: int
) -> tuple[Array, dict[str, NDArray[np.intp]]]:
    """All poses, with those of frames that loose edges join to the rest; and the parts left.

    Parts of more frames than ``most`` stay parts: nothing is built on loose edges.
    """
    large = [rows for rows in others.values() if len(rows) > most]
    apart = np.isin(np.arange(len(poses)), np.concatenate([[-1], *large]))
    edges = [
        e for e in (*odometry.edges, *odometry.degenerate_edges) if not (apart[e.i] or apart[e.j])
    ]
    held = np.flatnonzero(np.isfinite(poses[:, 0, 0]))
    poses = reached(poses, edges)
    known = np.isfinite(poses[:, 0, 0])
    if known.sum() > len(held):
        poses = pose_graph.carry(poses, [e for e in edges if known[e.i] and known[e.j]], held)
    return poses, {name: rows for name, rows in others.items() if not known[rows].any()}


def _moved_along(poses: Array, adjusted: Array, rows: NDArray[np.intp]) -> Array:
    """All poses, each moved as the keyframe before it was moved by the adjustment."""
    good = np.isfinite(adjusted[:, 0, 0])
    rows, correction = rows[good], (adjusted @ se3.inverse(poses[rows]))[good]
    before = np.searchsorted(rows, np.arange(len(poses)), side="right") - 1
    return np.asarray(correction[before.clip(0)] @ poses)

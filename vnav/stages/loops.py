"""Which keyframes see the same place again: claim 3, S6 and the edges of S7."""

import dataclasses
import os
from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from vnav.config import Config, LoopsConfig
from vnav.core import se3
from vnav.core.arrays import Array
from vnav.core.camera import Intrinsics
from vnav.core.frame import Edge, PoseEstimate, Rejected
from vnav.core.mapping import LoopVerdict, Odometry
from vnav.core.progress import Progress, silent
from vnav.core.report import Report
from vnav.core.tree import VocabularyTree
from vnav.features.appearance import tfidf_similarity
from vnav.features.matching import DescriptorMatcher
from vnav.io.store.artifacts import load_odometry, map_camera, save_loops
from vnav.io.store.map_folder import MapFolder
from vnav.io.store.stage_reports import clock, finished, reused, settings_of
from vnav.io.store.tree_file import load_tree
from vnav.optimisation import pose_graph
from vnav.optimisation.pose_graph import softened
from vnav.registration.points3d import PointRegistration
from vnav.threads import one_blas_thread

NEIGHBOURS = 3  # keyframes apart: what odometry demands of a match will do, for it joined them

Candidate = tuple[int, int, str, float]


@one_blas_thread
def run(folder: MapFolder, config: Config, *, progress: Progress = silent) -> Report:
    """Find, verify and record loops between keyframes."""
    started = clock()
    settings = settings_of(config, "registration", "loops", "optimise")
    inputs = folder.inputs_of("odometry", "vocabulary")
    if folder.is_current("loops", settings, inputs):
        return reused(folder, "loops")
    odometry, tree = load_odometry(folder), load_tree(folder)
    cameras = [map_camera(folder, k) for k in range(len(folder.captures))]
    found = close(odometry, tree, cameras, config, progress)
    with folder.writing("loops", settings, inputs) as draft:
        save_loops(draft, found.verdicts, found.edges, found.matches)
    return finished(folder, _report(found.verdicts), started)


@dataclass
class Closures:
    """Verdicts on all candidates so far, and the edges and matches (M, 4) of the accepted."""

    verdicts: list[LoopVerdict] = field(default_factory=list)
    edges: list[Edge] = field(default_factory=list)
    parts: list[NDArray[np.int32]] = field(default_factory=list)

    @property
    def matches(self) -> NDArray[np.int32]:
        """FrameFeatures, feature, keyframe, feature of every match of an accepted pair."""
        return np.concatenate([np.zeros((0, 4), np.int32), *self.parts])

    @property
    def tried(self) -> set[tuple[int, int]]:
        """Pairs that have a verdict."""
        return {(v.i, v.j) for v in self.verdicts}


def close(
    odometry: Odometry,
    tree: VocabularyTree,
    cameras: Sequence[Intrinsics],
    config: Config,
    progress: Progress = silent,
) -> Closures:
    """Loops by appearance, then by nearness of the poses that those give, until nothing is new."""
    verify = Verifier(odometry, cameras, config, progress)
    found = Closures()
    verify(by_appearance(odometry, tree, config.loops), found)
    for _ in range(config.loops.proximity_rounds):
        T_world_camera, part = _posed(odometry, found.edges, config)
        overlap = view_overlap(odometry, T_world_camera, part, cameras)
        pairs = by_proximity(overlap, config.loops, found.tried)
        if not pairs:
            break
        verify(pairs, found, T_world_camera)
    return found


def _posed(
    odometry: Odometry, closures: Sequence[Edge], config: Config
) -> tuple[Array, NDArray[np.int32]]:
    """Poses (N, 4, 4) and parts (N,) as the closures so far give them, or as they were given."""
    if odometry.given:
        return odometry.T_segment_camera, odometry.segment
    initial, part = pose_graph.join(
        odometry.T_segment_camera, odometry.segment, odometry.frames.capture, closures
    )
    graph = pose_graph.optimise(
        initial, odometry.edges, closures, config.optimise.max_closure_sigmas
    )
    return graph.T_world_camera, part


def by_appearance(odometry: Odometry, tree: VocabularyTree, config: LoopsConfig) -> list[Candidate]:
    """For each keyframe the most similar earlier ones by TF-IDF, and the two ends of the capture.

    A candidate needs a share of the similarity that neighbouring keyframes have (Galvez-Lopez,
    Tardos 2012), and must be farther away in time than ``exclude_s`` or in another segment.
    """
    keyframes = odometry.keyframes
    similarity = tfidf_similarity(keyframes, tree)
    frames, rows = odometry.frames, np.array([k.row for k in keyframes])
    gap = np.abs(frames.stamp_s[rows][:, None] - frames.stamp_s[rows])
    segment = odometry.segment[rows]
    apart = (gap > config.exclude_s) | (segment[:, None] != segment)
    apart |= frames.capture[rows][:, None] != frames.capture[rows]
    pairs: dict[tuple[int, int], Candidate] = {}
    for j in range(1, len(keyframes)):
        scores = np.where(apart[j, :j], similarity[j, :j], 0.0)
        least = config.min_relative_score * similarity[j, j - 1]
        for i in np.argsort(-scores, kind="stable")[: config.candidates]:
            if scores[i] > max(least, 0.0):
                pairs[int(i), j] = (int(i), j, "appearance", float(scores[i]))
    last = len(keyframes) - 1
    if last > 0 and apart[0, last]:
        pairs.setdefault((0, last), (0, last, "ends", float(similarity[0, last])))
    return list(pairs.values())


def by_proximity(
    overlap: Array, config: LoopsConfig, tried: set[tuple[int, int]]
) -> list[Candidate]:
    """Pairs of keyframes that should see the same by their poses and were not tried yet."""
    pairs: dict[tuple[int, int], Candidate] = {}
    for j in range(len(overlap)):
        for i in np.argsort(-overlap[j], kind="stable")[: config.proximity_candidates]:
            pair = min(int(i), j), max(int(i), j)
            if overlap[j, i] >= config.proximity_overlap and pair not in tried:
                pairs[pair] = (*pair, "proximity", float(overlap[j, i]))
    return [pairs[pair] for pair in sorted(pairs)]


def view_overlap(
    odometry: Odometry,
    T_world_camera: Array,
    part: NDArray[np.int32],
    cameras: Sequence[Intrinsics],
    sample: int = 64,
) -> Array:
    """Share (K, K) of two keyframes' points that lie in each other's image, the lesser of both.

    Zero on the diagonal and between frames of different parts (N,) of the pose graph.
    """
    keyframes = odometry.keyframes
    rows = np.array([k.row for k in keyframes])
    T_camera_world = se3.inverse(T_world_camera[rows])
    share = np.zeros((len(keyframes), len(keyframes)))
    for i, keyframe in enumerate(keyframes):
        points = keyframe.points_camera[keyframe.has_depth]
        points = points[:: max(1, len(points) // sample)]
        seen = se3.transform(T_camera_world @ T_world_camera[rows[i]], points)
        for c, camera in enumerate(cameras):
            of_camera = odometry.frames.capture[rows] == c
            px = camera.project(seen[of_camera])
            inside = ((px >= 0) & (px < camera.size)).all(-1)
            share[i, of_camera] = inside.mean(1) if len(points) else 0.0
    joined = part[rows][:, None] == part[rows]
    overlap = np.where(joined, np.minimum(share, share.T), 0.0)
    np.fill_diagonal(overlap, 0.0)
    return overlap


class Verifier:
    """Geometric verification of candidates on all cores."""

    def __init__(
        self,
        odometry: Odometry,
        cameras: Sequence[Intrinsics],
        config: Config,
        progress: Progress = silent,
    ) -> None:
        self._keyframes = odometry.keyframes
        self._captures = odometry.frames.capture
        self._cameras = cameras
        self._seed = config.seed
        self._loops = config.loops
        self._segment = odometry.segment
        # Features without depth mostly lie on edges, which look otherwise from afar.
        self._settings = dataclasses.replace(config.registration, one_sided_depth=False)
        self._settings_of_loops = dataclasses.replace(
            self._settings,
            min_inliers=config.loops.min_inliers,
            min_inlier_share=config.loops.min_inlier_share,
        )
        self._matcher = DescriptorMatcher(self._settings)
        self._progress = progress

    def __call__(
        self, candidates: Sequence[Candidate], found: Closures, T_world_camera: Array | None = None
    ) -> None:
        """Add every candidate's verdict, and the edge and matches of the accepted.

        Poses of all frames (N, 4, 4), where they are known, tell where matches are to be expected.
        """

        def estimate_of(candidate: Candidate) -> PoseEstimate | Rejected:
            return self._register(candidate, T_world_camera)

        with ThreadPoolExecutor(os.cpu_count()) as pool:
            estimates = pool.map(estimate_of, candidates)
            for n, ((i, j, source, score), estimate) in enumerate(
                zip(candidates, estimates, strict=True), 1
            ):
                self._progress("loops", n, len(candidates))
                inliers = estimate.inliers
                accepted = isinstance(estimate, PoseEstimate)
                count = inliers if isinstance(inliers, int) else len(inliers)
                reason = "" if isinstance(estimate, PoseEstimate) else estimate.reason
                found.verdicts.append(
                    LoopVerdict(i, j, source, score, accepted, reason, estimate.matches, count)
                )
                if isinstance(estimate, PoseEstimate):
                    found.edges.append(self._edge(i, j, estimate))
                    found.parts.append(_keyed(i, j, estimate.inliers))

    def _register(
        self, candidate: Candidate, T_world_camera: Array | None
    ) -> PoseEstimate | Rejected:
        a, b = self._keyframes[candidate[0]], self._keyframes[candidate[1]]
        rng = np.random.default_rng([self._seed, a.row, b.row])
        of_a, of_b = (self._cameras[self._captures[k.row]] for k in (a, b))
        near = candidate[1] - candidate[0] <= NEIGHBOURS
        followed = near and self._segment[a.row] == self._segment[b.row]
        settings = self._settings if followed else self._settings_of_loops
        registration = PointRegistration(of_a, of_b, settings, self._matcher)
        predicted = None
        if T_world_camera is not None:
            predicted = se3.inverse(T_world_camera[a.row]) @ T_world_camera[b.row]
        return registration.register(a, b, rng, predicted)

    def _edge(self, i: int, j: int, estimate: PoseEstimate) -> Edge:
        rows = self._keyframes[i].row, self._keyframes[j].row
        edge = Edge(*rows, estimate.T_a_b, estimate.information)
        return softened(edge, np.deg2rad(self._loops.sigma_deg), self._loops.sigma_m)


def _keyed(i: int, j: int, inliers: NDArray[np.int32]) -> NDArray[np.int32]:
    """Inliers (M, 2) with their keyframes: (M, 4)."""
    columns = np.full(len(inliers), i), inliers[:, 0], np.full(len(inliers), j), inliers[:, 1]
    return np.stack(columns, 1).astype(np.int32)


def _report(verdicts: Iterable[LoopVerdict]) -> Report:
    verdicts = list(verdicts)
    loops = [v for v in verdicts if v.source != "proximity"]
    accepted = sum(v.accepted for v in loops)
    near = sum(v.accepted for v in verdicts) - accepted
    reasons: dict[str, int] = {}
    for v in verdicts:
        if not v.accepted:
            reasons[v.reason] = reasons.get(v.reason, 0) + 1
    values = {
        "tried": len(loops),
        "accepted": accepted,
        "rejected": len(loops) - accepted,
        "proximity_tried": len(verdicts) - len(loops),
        "proximity_accepted": near,
        "reasons": reasons,
    }
    line = (
        f"{len(loops)} loop candidates tried, {accepted} accepted;"
        f" {near} more pairs of {len(verdicts) - len(loops)} near each other"
    )
    return Report("loops", values, (line,))

"""Geometric verification of loop candidates: registration of the two keyframes; claim 3, S6."""

import dataclasses
import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from vnav.config import Config
from vnav.core import se3
from vnav.core.arrays import Array
from vnav.core.camera import Intrinsics
from vnav.core.frame import Edge, PoseEstimate, Rejected
from vnav.core.mapping import FrameFeatures, LoopVerdict, Odometry
from vnav.core.progress import Progress, silent
from vnav.core.view_overlap import are_apart
from vnav.features.matching import DescriptorMatcher
from vnav.loop_closing.loop_candidates import LoopCandidate
from vnav.registration.judge import CLEAR
from vnav.registration.points3d import PointRegistration

NEIGHBOURS = 3  # keyframes apart: what odometry demands of a match will do, for it joined them
AMBIGUOUS = "two motions fit alike"
LogOdds = Callable[[int, int, Sequence[Array]], Array]  # rows i and j, motions: (C + 1, C + 1)


@dataclass
class Closures:
    """Verdicts on all candidates so far, and the edges and matches of the accepted."""

    verdicts: list[LoopVerdict] = field(default_factory=list)
    edges: list[Edge] = field(default_factory=list)
    matches_of_edges: list[NDArray[np.int32]] = field(default_factory=list)

    @property
    def matches(self) -> NDArray[np.int32]:
        """Keyframe, feature, keyframe, feature (M, 4) of every match of an accepted pair."""
        return np.concatenate([np.zeros((0, 4), np.int32), *self.matches_of_edges])

    @property
    def tried(self) -> set[tuple[int, int]]:
        """Pairs that have a verdict."""
        return {(v.i, v.j) for v in self.verdicts}

    def reject(self, candidate: LoopCandidate, why: Rejected, is_loop: bool) -> None:
        """Add the verdict on a candidate."""
        c, found = candidate, (why.reason, why.matches, why.inliers)
        self.verdicts.append(LoopVerdict(c.i, c.j, c.source, c.score, False, *found, is_loop))

    def accept(
        self, candidate: LoopCandidate, edge: Edge, estimate: PoseEstimate, is_loop: bool
    ) -> None:
        """Add the verdict on a candidate, its edge and its inliers."""
        c, inliers = candidate, np.concatenate([estimate.inliers, estimate.far])
        found = "", estimate.matches, len(inliers)
        self.verdicts.append(LoopVerdict(c.i, c.j, c.source, c.score, True, *found, is_loop))
        self.edges.append(edge)
        columns = (
            np.full(len(inliers), c.i),
            inliers[:, 0],
            np.full(len(inliers), c.j),
            inliers[:, 1],
        )
        self.matches_of_edges.append(np.stack(columns, 1).astype(np.int32))


class LoopVerifier:
    """Geometric verification of candidates on all cores."""

    def __init__(
        self,
        odometry: Odometry,
        cameras: Sequence[Intrinsics],
        config: Config,
        progress: Progress = silent,
        log_odds: LogOdds | None = None,
    ) -> None:
        """``cameras``: one a capture; ``log_odds``: of motions between keyframes, by their pixels.

        Without these the motion that most matches agree on is taken.
        """
        self._log_odds = log_odds
        self._odometry, self._cameras, self._seed = odometry, cameras, config.seed
        self._apart = are_apart(odometry, config.loops.exclude_s)
        self._added_noise = np.deg2rad(config.loops.sigma_deg), config.loops.sigma_m
        # Features without depth mostly lie on edges, which look otherwise from afar.
        self._of_neighbours = dataclasses.replace(config.registration, one_sided_depth=False)
        self._of_loops = dataclasses.replace(
            self._of_neighbours,
            min_inliers=config.loops.min_inliers,
            min_inlier_share=config.loops.min_inlier_share,
        )
        self._matcher = DescriptorMatcher(self._of_neighbours)
        self._progress = progress

    def verify(
        self,
        candidates: Sequence[LoopCandidate],
        found: Closures,
        T_world_camera: Array | None = None,
    ) -> None:
        """Add every candidate's verdict to those found, and the edge and matches of the accepted.

        Poses of all frames (N, 4, 4), where they are known, tell where matches are to be expected.
        """
        with ThreadPoolExecutor(os.cpu_count()) as pool:
            estimates = pool.map(lambda c: self._register(c, T_world_camera), candidates)
            for n, (candidate, estimate) in enumerate(zip(candidates, estimates, strict=True), 1):
                self._progress("loops", n, len(candidates))
                is_loop = bool(self._apart[candidate.i, candidate.j])
                if isinstance(estimate, Rejected):
                    found.reject(candidate, estimate, is_loop)
                else:
                    found.accept(candidate, self._edge(candidate, estimate), estimate, is_loop)

    def _register(
        self, candidate: LoopCandidate, T_world_camera: Array | None
    ) -> PoseEstimate | Rejected:
        a, b = (self._odometry.keyframes[k] for k in (candidate.i, candidate.j))
        rng = np.random.default_rng([self._seed, a.row, b.row])
        of_a, of_b = (self._cameras[self._odometry.frames.capture[k.row]] for k in (a, b))
        settings = self._of_neighbours if self._are_neighbours(candidate) else self._of_loops
        registration = PointRegistration(of_a, of_b, settings, self._matcher)
        if T_world_camera is None:
            return registration.register(a, b, rng)
        predicted = se3.inverse(T_world_camera[a.row]) @ T_world_camera[b.row]
        found = registration.register(a, b, rng, predicted)
        near = registration.register_near(a, b, predicted)
        if isinstance(found, Rejected) or isinstance(near, Rejected):
            return found
        if _apart_px(a, of_b, found, near) < settings.refine_radius_px:
            return found
        return self._preferred(found, near, a.row, b.row)

    def _preferred(
        self, found: PoseEstimate, near: PoseEstimate, i: int, j: int
    ) -> PoseEstimate | Rejected:
        """Of two motions from row i to j the one that pixels clearly prefer, else none.

        Among things that look the same, matches agree on wrong motions, too.
        """
        if self._log_odds is None:
            return found
        in_favour = float(self._log_odds(i, j, [found.T_a_b, near.T_a_b])[0, 1])
        if abs(in_favour) < CLEAR:
            return Rejected(AMBIGUOUS, found.matches, found.agreeing)
        return found if in_favour > 0 else near

    def _are_neighbours(self, candidate: LoopCandidate) -> bool:
        """Whether odometry joined the two, with few keyframes between."""
        i, j = candidate.i, candidate.j
        segment = self._odometry.segment[self._odometry.keyframe_rows[[i, j]]]
        return bool(j - i <= NEIGHBOURS and segment[0] == segment[1])

    def _edge(self, candidate: LoopCandidate, estimate: PoseEstimate) -> Edge:
        i, j = (self._odometry.keyframes[k].row for k in (candidate.i, candidate.j))
        edge = Edge(i, j, estimate.T_a_b, estimate.information)
        return edge.with_added_noise(*self._added_noise)


def _apart_px(a: FrameFeatures, of_b: Intrinsics, found: PoseEstimate, near: PoseEstimate) -> float:
    """How far two motions put a point of a from each other in b's image; the median."""
    points = a.points_camera[found.inliers[:, 0]]
    places = (of_b.project(se3.transform(se3.inverse(e.T_a_b), points)) for e in (found, near))
    return float(np.median(np.linalg.norm(np.subtract(*places), axis=1)))

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
from vnav.core.graph import log_odds_of, shortest_paths, weakest
from vnav.core.mapping import LoopVerdict, Odometry
from vnav.core.progress import Progress, silent
from vnav.core.view_overlap import are_apart
from vnav.features.matching import DescriptorMatcher
from vnav.loop_closing.loop_candidates import LoopCandidate
from vnav.registration.judge import CLEAR
from vnav.registration.points3d import PointRegistration

NEIGHBOURS = 3  # keyframes apart: what odometry demands of a match will do, for it joined them
AMBIGUOUS = "two motions fit alike"
TIMES_LOOSER = 5.0  # than odometry, in sigmas: a loop tells nothing, though odometry claim too much
LOOSE = "odometry tells the motion far better"
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
        estimates: list[PoseEstimate | Rejected] = []
        with ThreadPoolExecutor(os.cpu_count()) as pool:
            for estimate in pool.map(lambda c: self._register(c, T_world_camera), candidates):
                estimates.append(estimate)
                self._progress("loops", len(estimates), len(candidates))
        estimates = self._without_loose(candidates, estimates)
        for candidate, estimate in zip(candidates, estimates, strict=True):
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
        points = a.points_camera[found.inliers[:, 0]].astype(float)
        if _apart_px(points, of_b, found.T_a_b, near.T_a_b) < settings.refine_radius_px:
            return found
        T_a_b = self._by_odometry(a.row, b.row)
        led_there = _apart_px(points, of_b, T_a_b, near.T_a_b) < settings.refine_radius_px
        before = self._log_odds_before(candidate) if led_there else 0.0
        return self._preferred(found, near, before, a.row, b.row)

    def _without_loose(
        self, candidates: Sequence[LoopCandidate], estimates: Sequence[PoseEstimate | Rejected]
    ) -> list[PoseEstimate | Rejected]:
        """The estimates, without loops that tell far less than odometry from one to the other."""
        most = {
            self._rows(c): float(np.trace(np.linalg.inv(e.information))) / TIMES_LOOSER**2
            for c, e in zip(candidates, estimates, strict=True)
            if isinstance(e, PoseEstimate) and self._apart[c.i, c.j]
        }
        paths = shortest_paths(self._odometry.motions, list(most), list(most.values()))
        loose = {(path.i, path.j) for path in paths}
        return [
            Rejected(LOOSE, e.matches, e.agreeing)
            if isinstance(e, PoseEstimate) and self._rows(c) in loose
            else e
            for c, e in zip(candidates, estimates, strict=True)
        ]

    def _preferred(
        self, found: PoseEstimate, near: PoseEstimate, before: float, i: int, j: int
    ) -> PoseEstimate | Rejected:
        """Of two motions from row i to j the one that pixels clearly prefer, else none.

        Among things that look the same, matches agree on wrong motions, too. ``before``: log-odds
        of the near one, which only decide where pixels do not.
        """
        if self._log_odds is None:
            return found
        in_favour = float(self._log_odds(i, j, [found.T_a_b, near.T_a_b])[0, 1])
        if in_favour > CLEAR:
            return found
        if in_favour - before < -CLEAR:
            return near
        return Rejected(AMBIGUOUS, found.matches, found.agreeing)

    def _log_odds_before(self, candidate: LoopCandidate) -> float:
        """Of odometry's motion between neighbours, by the least probable of the edges on the way.

        What more keyframes are between has drifted, or odometry did not join it: 0. So it is where
        poses were given, for nothing was tracked.
        """
        if self._odometry.given or not self._are_neighbours(candidate):
            return 0.0
        return log_odds_of(weakest(self._odometry.edges, *self._rows(candidate))[1])

    def _by_odometry(self, i: int, j: int) -> Array:
        """The motion from row i to j as odometry has it, within a segment."""
        T = self._odometry.T_segment_camera
        return np.asarray(se3.inverse(T[i]) @ T[j])

    def _are_neighbours(self, candidate: LoopCandidate) -> bool:
        """Whether odometry joined the two, with few keyframes between."""
        i, j = candidate.i, candidate.j
        segment = self._odometry.segment[list(self._rows(candidate))]
        return bool(j - i <= NEIGHBOURS and segment[0] == segment[1])

    def _edge(self, candidate: LoopCandidate, estimate: PoseEstimate) -> Edge:
        edge = Edge(*self._rows(candidate), estimate.T_a_b, estimate.information)
        return edge.with_added_noise(*self._added_noise)

    def _rows(self, candidate: LoopCandidate) -> tuple[int, int]:
        """Of the frames that its keyframes are."""
        keyframes = self._odometry.keyframes
        return keyframes[candidate.i].row, keyframes[candidate.j].row


def _apart_px(points: Array, of_b: Intrinsics, T_a_b: Array, other: Array) -> float:
    """How far two motions put a point (N, 3) of a from each other in b's image; the median."""
    places = (of_b.project(se3.transform(se3.inverse(T), points)) for T in (T_a_b, other))
    return float(np.median(np.linalg.norm(np.subtract(*places), axis=1)))

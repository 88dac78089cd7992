"""Final poses of all frames from their edges and landmarks: claim 3, S7."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import compress

import numpy as np
from numpy.typing import NDArray

from vnav.config import Config
from vnav.core.arrays import Array
from vnav.core.camera import Intrinsics
from vnav.core.frame import Edge
from vnav.core.graph import ends_of
from vnav.core.mapping import Odometry
from vnav.core.progress import Progress, silent
from vnav.optimisation import pose_graph
from vnav.optimisation.bundle_problem import PosePrior
from vnav.optimisation.culling import needed_keyframes
from vnav.optimisation.displacement import without_displacement
from vnav.optimisation.feature_tracks import FeatureTracks, merged
from vnav.optimisation.keyframe_edges import by_number, keyframe_edges
from vnav.optimisation.landmarks import AdjustedBundle, adjust_landmarks
from vnav.optimisation.mending import with_edges
from vnav.optimisation.parts import (
    Parts,
    attach_degenerate_frames,
    follow_keyframes,
    split_parts,
)
from vnav.optimisation.pose_noise import pose_noise
from vnav.optimisation.robust_graph import RobustGraph, robust_pose_graph
from vnav.optimisation.second_look import SecondLook
from vnav.optimisation.sensor_errors import DepthOf, MovingSensor
from vnav.optimisation.sensor_model import SensorModel

MANY_DISPLACED = 0.1  # closures turned down for it, as a share of those kept


@dataclass(frozen=True)
class Solution:
    """Poses (N, 4, 4) of the main part, its adjusted keyframes and landmarks, closures kept.

    ``robust``: what odometry and closures gave before keyframes were adjusted; ``other_parts``:
    rows of the parts that no closure joins to it, by name, the largest first; ``prior``: of
    keyframes whose poses were given; ``surfaces``: edges by surfaces that contradicted the poses
    without them.
    """

    poses: Array
    adjusted: AdjustedBundle
    robust: RobustGraph
    closures: tuple[Edge, ...]
    other_parts: dict[str, NDArray[np.intp]]
    prior: PosePrior | None = None
    surfaces: tuple[Edge, ...] = ()


def solve(
    odometry: Odometry,
    closures: Sequence[Edge],
    matches: NDArray[np.int32],
    cameras: Sequence[Intrinsics],
    config: Config,
    progress: Progress = silent,
    depth_of: DepthOf | None = None,
    look: SecondLook | None = None,
) -> Solution:
    """Robust pose graph, bundle adjustment of the keyframes, then the frames between them.

    Once more without what the sensor's delays displace, where many closures were turned down for
    it; and with surfaces that were seen from two sides, where these contradict the result.
    ``matches`` (M, 4): keyframe, feature, keyframe, feature; ``cameras``: one a capture. There is
    no pose graph where poses are given: `config.OptimiseConfig.given_poses` says whether they stay
    as they are or are a prior. ``depth_of``: a keyframe's depth image by its row; without these
    nothing is said of delays. ``look``: a second one at stretches that closures contradict.
    """
    if odometry.given:
        adjustment = _Adjustment(odometry, matches, cameras, config, depth_of)
        return _solve_given(odometry, closures, adjustment)
    measured = _Adjustment(odometry, matches, cameras, config, depth_of)
    found = measured.joined(closures, look)
    progress("optimise", 1, 3)
    still = measured.undisplaced(found, closures)
    if still is not None:
        found = still[0].joined(still[1], look)
    progress("optimise", 2, 3)
    adjusted, poses, kept = found.adjusted, found.poses, found.closures
    surfaces = [] if look is None else _contradicting_surfaces(poses, adjusted, kept, look)
    if surfaces:
        most_sigmas = config.optimise.max_closure_sigmas
        graph = pose_graph.optimise(poses, found.edges, surfaces, most_sigmas)
        surfaces = list(compress(surfaces, graph.kept))
        adjusted, poses, _ = found.adjustment.of_frames(graph.T_world_camera, kept, surfaces)
    odometry, most_frames = found.robust.odometry, config.odometry.max_degenerate_frames
    poses, others = attach_degenerate_frames(poses, odometry, found.other_parts, most_frames)
    progress("optimise", 3, 3)
    return Solution(poses, adjusted, found.robust, kept, others, surfaces=tuple(surfaces))


def _contradicting_surfaces(
    poses: Array, adjusted: AdjustedBundle, closures: Sequence[Edge], look: SecondLook
) -> list[Edge]:
    """Edges by the surfaces of keyframes that no closure joins; none where these bear poses out."""
    revisits = look.revisits(poses, adjusted.sensor.errors.depth_delay_s)
    if not revisits.contradict:
        return []
    return look.surface_edges(revisits, {(e.i, e.j) for e in closures})


def _solve_given(
    odometry: Odometry, closures: Sequence[Edge], adjustment: "_Adjustment"
) -> Solution:
    """Which closures agree with the given poses, and the landmarks that their matches make."""
    poses, config = odometry.T_segment_camera, adjustment.config
    sigmas, fixed = pose_noise(poses, closures), config.optimise.given_poses == "fixed"
    of_two_rad, of_two_m = np.sqrt(2) * sigmas[[0, 3]]
    noisy = [e.with_added_noise(of_two_rad, of_two_m) for e in closures]
    graph = pose_graph.check_closures(poses, noisy, config.optimise.max_closure_sigmas)
    kept = tuple(compress(closures, graph.kept))
    prior = PosePrior(poses[odometry.keyframe_rows], sigmas, fixed)
    adjusted = adjustment.of_keyframes(poses, kept, prior)
    if not fixed:
        poses = follow_keyframes(poses, adjusted.T_world_camera, odometry, odometry.edges)
    robust = RobustGraph(odometry, (), graph, odometry.segment)
    return Solution(poses, adjusted, robust, kept, {}, prior)


@dataclass(frozen=True)
class _Joined:
    """One pose graph of odometry and closures, its keyframes adjusted, and what follows them.

    ``adjustment``: of odometry as the graph left it; ``edges``: those that frames follow.
    """

    adjustment: "_Adjustment"
    robust: RobustGraph
    closures: tuple[Edge, ...]
    adjusted: AdjustedBundle
    poses: Array
    edges: list[Edge]
    other_parts: Parts


@dataclass(frozen=True)
class _Adjustment:
    """Bundle adjustment of the keyframes, and what it says of edges; fields as of `solve`.

    ``is_still``: odometry is as a sensor without delays would have measured it.
    """

    odometry: Odometry
    matches: NDArray[np.int32]
    cameras: Sequence[Intrinsics]
    config: Config
    depth_of: DepthOf | None
    is_still: bool = False

    def joined(self, closures: Sequence[Edge], look: SecondLook | None) -> _Joined:
        """The main part of odometry and closures, and the names of the others."""
        robust = robust_pose_graph(self.odometry, closures, self.config.optimise, look)
        mended = replace(self, odometry=robust.odometry)
        in_main, other_parts = split_parts(robust.part, self.odometry.T_world_before)
        poses = np.where(in_main[:, None, None], robust.graph.T_world_camera, np.nan)
        kept = tuple(compress(closures, robust.graph.kept))
        return _Joined(mended, robust, kept, *mended.of_frames(poses, kept), other_parts)

    def undisplaced(
        self, found: _Joined, closures: Sequence[Edge]
    ) -> tuple["_Adjustment", list[Edge]] | None:
        """Odometry and closures as a sensor without the delays found would have measured them.

        None unless many of the closures were turned down that agree with the poses then.
        """
        free = partial(self._still, found.poses, found.adjusted)
        posed = np.isfinite(found.poses[ends_of(closures), 0, 0]).all(1)
        turned_down = free(list(compress(closures, posed & ~found.robust.graph.kept)))
        most_sigmas = self.config.optimise.max_closure_sigmas
        agree = pose_graph.check_closures(found.poses, turned_down, most_sigmas).kept
        if agree.sum() <= MANY_DISPLACED * len(found.closures):
            return None
        odometry = with_edges(self.odometry, free(self.odometry.edges))
        return replace(self, odometry=odometry, is_still=True), free(closures)

    def of_frames(
        self, poses: Array, closures: Sequence[Edge], surfaces: Sequence[Edge] = ()
    ) -> tuple[AdjustedBundle, Array, list[Edge]]:
        """The keyframes as `of_keyframes`, poses (N, 4, 4) that follow them by edges, and these.

        Edges of odometry and closures, as a sensor without delays would have measured them.
        """
        adjusted = self.of_keyframes(poses, closures, surfaces=surfaces)
        T_keyframes, posed = adjusted.T_world_camera, np.isfinite(poses[:, 0, 0])
        edges = [e for e in (*self.odometry.edges, *closures) if posed[e.i] and posed[e.j]]
        poses = follow_keyframes(poses, T_keyframes, self.odometry, edges)
        still = self._still(poses, adjusted, edges)
        if still:
            poses = follow_keyframes(poses, T_keyframes, self.odometry, still)
        return adjusted, poses, still or edges

    def of_keyframes(
        self,
        poses: Array,
        closures: Sequence[Edge],
        prior: PosePrior | None = None,
        surfaces: Sequence[Edge] = (),
    ) -> AdjustedBundle:
        """By the matches of closures that were kept, from poses (N, 4, 4) of all frames.

        ``surfaces``: further edges between keyframes. Of very many keyframes, those that it can do
        without are left out.
        """
        number = {row: k for k, row in enumerate(self.odometry.keyframe_rows.tolist())}
        keyframes, most = self.odometry.keyframes, self.config.optimise.max_keyframes
        closed = np.zeros((len(keyframes), len(keyframes)), bool)
        for e in closures:
            closed[number[e.i], number[e.j]] = True
        matches = self.matches[closed[self.matches[:, 0], self.matches[:, 2]]]
        tracks = merged(keyframes, matches)
        needed = needed_keyframes(tracks, most)
        among = self._among(needed, matches)
        among_tracks = [tracks[k] for k in needed]
        adjusted = among._adjusted(poses, among_tracks, prior and prior.among(needed), surfaces)
        return adjusted.of_all(needed, len(keyframes))

    def _among(self, needed: NDArray[np.intp], matches: NDArray[np.int32]) -> "_Adjustment":
        """With some keyframes only, and the matches between these."""
        keyframes = tuple(self.odometry.keyframes[k] for k in needed)
        between = matches[np.isin(matches[:, [0, 2]], needed).all(1)]
        between[:, [0, 2]] = np.searchsorted(needed, between[:, [0, 2]])
        return replace(self, odometry=replace(self.odometry, keyframes=keyframes), matches=between)

    def _adjusted(
        self,
        poses: Array,
        of_keyframes: Sequence[NDArray[np.int32]],
        prior: PosePrior | None,
        surfaces: Sequence[Edge],
    ) -> AdjustedBundle:
        """All keyframes, by the tracks of their features, and surfaces between them."""
        rows = self.odometry.keyframe_rows
        tracks = FeatureTracks(self.odometry.keyframes, of_keyframes, self._sensor(poses))
        model = SensorModel(self._intrinsics, self.config.registration)
        closed = set(map(tuple, np.unique(self.matches[:, [0, 2]], axis=0).tolist()))
        edges = keyframe_edges(poses, self.odometry, closed) + by_number(surfaces, rows)
        return adjust_landmarks(poses[rows], tracks, edges, model, self.config.optimise, prior)

    def _still(self, poses: Array, adjusted: AdjustedBundle, edges: Sequence[Edge]) -> list[Edge]:
        """The edges without what delays displace; none where nothing does."""
        sensor, errors = self._sensor(poses), adjusted.sensor.errors
        if self.is_still or sensor is None or not errors.delayed:
            return []
        return without_displacement(edges, poses, sensor, errors)

    @property
    def _intrinsics(self) -> list[Intrinsics]:
        """Of each keyframe."""
        frames, rows = self.odometry.frames, self.odometry.keyframe_rows
        return [self.cameras[frames.capture[row]] for row in rows]

    def _sensor(self, poses: Array) -> MovingSensor | None:
        if self.depth_of is None or not self.config.optimise.estimate_delays:
            return None
        config = self.config.registration
        return MovingSensor.along(poses, self.odometry, self.cameras, self.depth_of, config)

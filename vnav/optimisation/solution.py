"""Final poses of all frames from their edges and landmarks: claim 3, S7."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import compress

import numpy as np
from numpy.typing import NDArray

from vnav.config import Config
from vnav.core.arrays import Array
from vnav.core.camera import Intrinsics
from vnav.core.frame import Edge
from vnav.core.mapping import Odometry
from vnav.core.progress import Progress, silent
from vnav.optimisation import pose_graph
from vnav.optimisation.adjustment import Adjustment, RoughKeyframes
from vnav.optimisation.bundle_problem import PosePrior
from vnav.optimisation.displacement import without_displacement
from vnav.optimisation.landmarks import AdjustedBundle
from vnav.optimisation.mending import with_edges
from vnav.optimisation.parts import (
    Parts,
    attach_degenerate_frames,
    follow_keyframes,
    joined_by,
    split_parts,
)
from vnav.optimisation.pose_noise import pose_noise
from vnav.optimisation.robust_graph import RobustGraph, robust_pose_graph
from vnav.optimisation.second_look import SecondLook
from vnav.optimisation.self_calibration import SensorCalibration
from vnav.optimisation.sensor_errors import DepthOf, depth_delays


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

    A first adjustment looks for the sensor's delays; where it finds any, odometry and closures are
    joined once more without what they displace. So it is with surfaces that were seen from two
    sides, where these contradict the result.
    ``matches`` (M, 4): keyframe, feature, keyframe, feature; ``cameras``: one a capture. There is
    no pose graph where poses are given: `config.OptimiseConfig.given_poses` says whether they stay
    as they are or are a prior. ``depth_of``: a keyframe's depth image by its row; without these
    nothing is said of delays. ``look``: a second one at stretches that closures contradict.
    """
    unknown = SensorCalibration.unknown(len(cameras))
    measured = Adjustment(odometry, matches, cameras, config, depth_of, unknown)
    if odometry.given:
        return _solve_given(closures, measured)
    found = _joined(measured, closures, look)
    progress("optimise", 1, 3)
    if found.sensor.delayed:
        still, freed = found.undisplaced(measured, closures)
        found = _joined(still, freed, look)
    progress("optimise", 2, 3)
    adjusted, poses = found.adjusted()
    kept = found.closures
    delays_s = depth_delays(adjusted.sensor.errors, odometry.frames)
    surfaces = [] if look is None else _contradicting_surfaces(poses, delays_s, kept, look)
    if surfaces:
        most_sigmas = config.optimise.max_closure_sigmas
        graph = pose_graph.optimise(poses, found.edges, surfaces, most_sigmas)
        surfaces = list(compress(surfaces, graph.kept))
        adjusted, poses = found.with_surfaces(graph.T_world_camera, surfaces).adjusted()
    odometry, most_frames = found.robust.odometry, config.odometry.max_degenerate_frames
    poses, others = attach_degenerate_frames(poses, odometry, found.other_parts, most_frames)
    progress("optimise", 3, 3)
    return Solution(poses, adjusted, found.robust, kept, others, surfaces=tuple(surfaces))


def _solve_given(closures: Sequence[Edge], adjustment: Adjustment) -> Solution:
    """Which closures agree with the given poses, and the landmarks that their matches make."""
    odometry, config = adjustment.odometry, adjustment.config
    poses = odometry.T_segment_camera
    sigmas, fixed = pose_noise(poses, closures), config.optimise.given_poses == "fixed"
    of_two_rad, of_two_m = np.sqrt(2) * sigmas[[0, 3]]
    noisy = [e.with_added_noise(of_two_rad, of_two_m) for e in closures]
    graph = pose_graph.check_closures(poses, noisy, config.optimise.max_closure_sigmas)
    kept = tuple(compress(closures, graph.kept))
    prior = PosePrior(poses[odometry.keyframe_rows], sigmas, fixed)
    adjusted = adjustment.of_keyframes(poses, kept, prior).adjusted()
    if not fixed:
        poses = follow_keyframes(poses, adjusted.T_world_camera, odometry, odometry.edges)
    robust = RobustGraph(odometry, (), graph, odometry.segment)
    return Solution(poses, adjusted, robust, kept, {}, prior)


@dataclass(frozen=True)
class _Joined:
    """One pose graph of odometry and closures, and its keyframes, which are adjusted roughly.

    ``adjustment``: of odometry as the graph left it; ``closures``: those kept; ``poses``
    (N, 4, 4): of the main part, NaN elsewhere.
    """

    adjustment: Adjustment
    robust: RobustGraph
    closures: tuple[Edge, ...]
    poses: Array
    keyframes: RoughKeyframes
    other_parts: Parts

    @property
    def sensor(self) -> SensorCalibration:
        """What the rough adjustment says of each capture's sensor."""
        return self.keyframes.rough.sensor

    @property
    def edges(self) -> list[Edge]:
        """Of odometry and closures, between frames that have a pose."""
        posed = np.isfinite(self.poses[:, 0, 0])
        edges = *self.adjustment.odometry.edges, *self.closures
        return [e for e in edges if posed[e.i] and posed[e.j]]

    def adjusted(self) -> tuple[AdjustedBundle, Array]:
        """The keyframes, and poses (N, 4, 4) of all frames, which follow them."""
        adjusted = self.keyframes.adjusted()
        return adjusted, self._following(adjusted.T_world_camera, self.edges)

    def undisplaced(
        self, measured: Adjustment, closures: Sequence[Edge]
    ) -> tuple[Adjustment, list[Edge]]:
        """Odometry and closures as a sensor without the delays found would have measured them.

        Delays make edges contradict each other, so what was cut for that is freed of them, too.
        """
        edges = measured.odometry.edges
        poses = self._following(self.keyframes.T_world_camera, self.edges)
        poses = self._following(self.keyframes.T_world_camera, self._freed(self.edges, poses))
        poses = joined_by(edges, poses)
        freed = self._freed([*edges, *closures], poses)
        odometry = with_edges(measured.odometry, freed[: len(edges)])
        return replace(measured, odometry=odometry, known=self.sensor), freed[len(edges) :]

    def with_surfaces(self, poses: Array, surfaces: Sequence[Edge]) -> "_Joined":
        """The same from poses (N, 4, 4), with further edges between keyframes."""
        keyframes = self.adjustment.of_keyframes(poses, self.closures, surfaces=surfaces)
        return replace(self, poses=poses, keyframes=keyframes)

    def _following(self, T_keyframes: Array, edges: Sequence[Edge]) -> Array:
        """Poses (N, 4, 4) of all frames by edges, from those of keyframes (K, 4, 4)."""
        return follow_keyframes(self.poses, T_keyframes, self.adjustment.odometry, edges)

    def _freed(self, edges: Sequence[Edge], poses: Array) -> list[Edge]:
        """Edges without what delays displace, from poses (N, 4, 4)."""
        moving = self.adjustment.sensor(poses)
        assert moving is not None  # nothing else tells delays
        return without_displacement(edges, poses, moving, self.sensor.errors)


def _joined(measured: Adjustment, closures: Sequence[Edge], look: SecondLook | None) -> _Joined:
    """The main part of odometry and closures, and the names of the others."""
    robust = robust_pose_graph(measured.odometry, closures, measured.config.optimise, look)
    mended = replace(measured, odometry=robust.odometry)
    in_main, other_parts = split_parts(robust.part, measured.odometry.T_world_before)
    poses = np.where(in_main[:, None, None], robust.graph.T_world_camera, np.nan)
    kept = tuple(compress(closures, robust.graph.kept))
    return _Joined(mended, robust, kept, poses, mended.of_keyframes(poses, kept), other_parts)


def _contradicting_surfaces(
    poses: Array, delays_s: Array, closures: Sequence[Edge], look: SecondLook
) -> list[Edge]:
    """Edges by the surfaces of keyframes that no closure joins; none where these bear poses out."""
    revisits = look.revisits(poses, delays_s)
    if not revisits.contradict:
        return []
    return look.surface_edges(revisits, {(e.i, e.j) for e in closures})

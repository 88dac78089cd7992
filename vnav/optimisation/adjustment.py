"""Keyframes, some or all, adjusted by the matches of closures."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from vnav.config import Config
from vnav.core.arrays import Array
from vnav.core.camera import Intrinsics
from vnav.core.frame import Edge
from vnav.core.mapping import Odometry
from vnav.optimisation.bundle_problem import PosePrior
from vnav.optimisation.culling import needed_keyframes
from vnav.optimisation.feature_tracks import FeatureTracks, merged
from vnav.optimisation.keyframe_edges import by_number, keyframe_edges
from vnav.optimisation.landmarks import AdjustedBundle, RoughBundle, rough_bundle
from vnav.optimisation.self_calibration import SensorCalibration
from vnav.optimisation.sensor_errors import DepthOf, MovingSensor
from vnav.optimisation.sensor_model import SensorModel


@dataclass(frozen=True)
class RoughKeyframes:
    """A bundle of the ``needed`` ones among so many keyframes."""

    rough: RoughBundle
    needed: NDArray[np.intp]
    count: int

    @property
    def T_world_camera(self) -> Array:
        """Poses (K, 4, 4), NaN for those that are not needed."""
        poses = np.full((self.count, 4, 4), np.nan)
        poses[self.needed] = self.rough.bundle.T_world_camera
        return poses

    def adjusted(self) -> AdjustedBundle:
        """After the last round."""
        return self.rough.adjusted().of_all(self.needed, self.count)


@dataclass(frozen=True)
class Adjustment:
    """Bundle adjustment of the keyframes; fields as of `solve`.

    ``known``: what a first adjustment found of the sensors; odometry is without their delays.
    """

    odometry: Odometry
    matches: NDArray[np.int32]
    cameras: Sequence[Intrinsics]
    config: Config
    depth_of: DepthOf | None
    known: SensorCalibration

    def of_keyframes(
        self,
        poses: Array,
        closures: Sequence[Edge],
        prior: PosePrior | None = None,
        surfaces: Sequence[Edge] = (),
    ) -> RoughKeyframes:
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
        rough = among._rough(poses, among_tracks, prior and prior.among(needed), surfaces)
        return RoughKeyframes(rough, needed, len(keyframes))

    def sensor(self, poses: Array) -> MovingSensor | None:
        """Which moves along poses (N, 4, 4) of all frames; None where nothing is said of delays."""
        if self.depth_of is None or not self.config.optimise.estimate_delays:
            return None
        config = self.config.registration
        return MovingSensor.along(poses, self.odometry, self.cameras, self.depth_of, config)

    def _among(self, needed: NDArray[np.intp], matches: NDArray[np.int32]) -> "Adjustment":
        """With some keyframes only, and the matches between these."""
        keyframes = tuple(self.odometry.keyframes[k] for k in needed)
        between = matches[np.isin(matches[:, [0, 2]], needed).all(1)]
        between[:, [0, 2]] = np.searchsorted(needed, between[:, [0, 2]])
        return replace(self, odometry=replace(self.odometry, keyframes=keyframes), matches=between)

    def _rough(
        self,
        poses: Array,
        of_keyframes: Sequence[NDArray[np.int32]],
        prior: PosePrior | None,
        surfaces: Sequence[Edge],
    ) -> RoughBundle:
        """All keyframes, by the tracks of their features, and surfaces between them."""
        rows = self.odometry.keyframe_rows
        keyframes, captures = self.odometry.keyframes, self.odometry.frames.capture[rows]
        tracks = FeatureTracks(keyframes, of_keyframes, self.sensor(poses), captures)
        model = SensorModel(self._intrinsics, self.config.registration)
        closed = set(map(tuple, np.unique(self.matches[:, [0, 2]], axis=0).tolist()))
        edges = keyframe_edges(poses, self.odometry, closed) + by_number(surfaces, rows)
        config = self.config.optimise
        return rough_bundle(poses[rows], tracks, edges, model, config, prior, self.known)

    @property
    def _intrinsics(self) -> list[Intrinsics]:
        """Of each keyframe."""
        frames, rows = self.odometry.frames, self.odometry.keyframe_rows
        return [self.cameras[frames.capture[row]] for row in rows]

"""Tracks of features over keyframes, each of one 3D point."""

import copy
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from vnav.core.arrays import Array, Rows
from vnav.core.mapping import FrameFeatures
from vnav.optimisation.sensor_errors import MovingSensor, Readings, SensorErrors
from vnav.optimisation.sensor_model import Observations, SensorModel
from vnav.optimisation.track_merging import merge

LONG_TRACK = 4  # sightings of a landmark that tells of the sensor
UNMEASURED_TRACK = 3  # sightings of a landmark without depth: two rays meet by chance
MOST_UNKNOWN = 0.1  # share of its distance that such a landmark may be off, before adjustment


def merged(
    keyframes: Sequence[FrameFeatures], matches: NDArray[np.int32]
) -> list[NDArray[np.int32]]:
    """For each keyframe the number of each feature's track, by matches (M, 4) of them.

    A match names keyframe and feature, keyframe and feature.
    """
    counts = np.array([len(k.features) for k in keyframes], np.int32)
    return np.split(merge(matches, counts), np.cumsum(counts)[:-1])


class FeatureTracks:
    """Every feature of every keyframe as an observation of its track's 3D point.

    ``of_keyframes``: for each keyframe the number of each feature's track; see `merged`.
    ``captures`` (K,): the number of each keyframe's; by default all are of one.
    """

    def __init__(
        self,
        keyframes: Sequence[FrameFeatures],
        of_keyframes: Sequence[NDArray[np.int32]],
        sensor: MovingSensor | None = None,
        captures: NDArray[np.int32] | None = None,
    ) -> None:
        counts = np.array([len(k.features) for k in keyframes], np.int32)
        camera = np.repeat(np.arange(len(counts), dtype=np.int32), counts)
        px = np.concatenate([k.features.keypoints_px for k in keyframes]).astype(float)
        self.points_camera = np.concatenate([k.points_camera for k in keyframes]).astype(float)
        self.feature = np.concatenate([np.arange(n, dtype=np.int32) for n in counts])
        _, track = np.unique(np.concatenate(of_keyframes), return_inverse=True)
        self.seen = Observations(track.astype(np.int32), camera, px, 1 / self.points_camera[:, 2])
        self.count = int(track.max(initial=-1)) + 1
        self.sensor = sensor
        self.captures = np.zeros(len(counts), np.int32) if captures is None else captures

    @property
    def uneven_captures(self) -> NDArray[np.intp]:
        """Captures whose depth's stamps are known to vary against colour's."""
        return np.array([] if self.sensor is None else self.sensor.uneven_captures, np.intp)

    def at_rest(self) -> "FeatureTracks":
        """The same of a camera of whose motion nothing is known."""
        tracks = copy.copy(self)
        tracks.sensor = None
        return tracks

    def among(self, rows: Rows) -> "FeatureTracks":
        """Of these features alone, which are in the order of their keyframes."""
        tracks = copy.copy(self)
        tracks.points_camera, tracks.feature = self.points_camera[rows], self.feature[rows]
        tracks.seen = self.seen[rows]
        if self.sensor is not None:
            count = len(self.sensor.keyframes)
            ends = np.searchsorted(tracks.seen.camera, np.arange(1, count))
            tracks.sensor = self.sensor.with_features(
                np.split(tracks.feature.astype(np.intp), ends)
            )
        return tracks

    def measured(self, px: Array) -> "FeatureTracks":
        """The same, seen at other pixels (F, 2)."""
        tracks = copy.copy(self)
        tracks.seen = self.seen.measured(px, self.seen.inverse_depth)
        return tracks

    def without(self, errors: Sequence[SensorErrors]) -> tuple["FeatureTracks", Array]:
        """The same, measured without each capture's errors, and how what is measured grows by them.

        The second is (F, 3, 4) as in `Readings`. These tracks are as measured. At rest, depth's
        offset alone is taken off.
        """
        if self.sensor is None:
            readings = self._without_offsets(np.array([e.depth_offset for e in errors]))
        else:
            readings = self.sensor.readings(errors)
        tracks = copy.copy(self)
        tracks.points_camera = readings.points_camera
        tracks.seen = self.seen.measured(readings.px, 1 / readings.points_camera[:, 2])
        return tracks, readings.by_error

    def corrected(self, errors: Sequence[SensorErrors]) -> "FeatureTracks":
        """The first of these two."""
        moves = any(e.delayed for e in errors)
        return (self if moves else self.at_rest()).without(errors)[0]

    def _without_offsets(self, offsets: Array) -> Readings:
        by_error = np.zeros((len(self.seen), 3, 4))
        by_error[:, 2, 0] = 1
        offset = offsets[self.captures[self.seen.camera], None]
        points = self.points_camera / (1 - offset * self.points_camera[:, 2:])
        return Readings(self.seen.px, points, by_error)

    def points_world(self, T_world_camera: Array, rows: Rows) -> Array:
        """Points (L, 3): the mean of a track's 3D points, weighted by depth's precision.

        Only the given rows count; NaN for a track none of whose features has depth; see `met`.
        """
        T = T_world_camera[self.seen.camera[rows]]
        points = (T[:, :3, :3] @ self.points_camera[rows, :, None])[..., 0] + T[:, :3, 3]
        good = np.isfinite(points[:, 0])
        track, points = self.seen.landmark[rows][good], points[good]
        weight = self.points_camera[rows, 2][good] ** -4
        total = np.bincount(track, weight, self.count)
        sums = [np.bincount(track, weight * p, self.count) for p in points.T]
        with np.errstate(invalid="ignore"):
            return np.stack(sums, 1) / total[:, None]

    def met(self, T_world_camera: Array, rows: Rows, model: SensorModel) -> Array:
        """Points (L, 3) nearest to the rays of tracks without depth that enough keyframes see.

        NaN where these leave the distance open by more than `MOST_UNKNOWN` of itself.
        """
        count, with_depth = self._count(rows)
        rows = rows[(with_depth == 0) & (count >= UNMEASURED_TRACK)]
        seen, points = self.seen[rows], np.full((self.count, 3), np.nan)
        track, of_track = np.unique(seen.landmark, return_inverse=True)
        T = T_world_camera[seen.camera]
        toward = (T[:, :3, :3] @ model.rays(seen)[..., None])[..., 0]
        toward /= np.linalg.norm(toward, axis=1, keepdims=True)
        across = np.eye(3) - toward[:, :, None] * toward[:, None]
        sums, weighted = np.zeros((len(track), 3, 3)), np.zeros((len(track), 3))
        np.add.at(sums, of_track, across)
        np.add.at(weighted, of_track, (across @ T[:, :3, 3:])[..., 0])
        sigma_rad = model.pixel_sigma / model.focal_px.mean()
        known = np.linalg.eigvalsh(sums)[:, 0] > (sigma_rad / MOST_UNKNOWN) ** 2
        points[track[known]] = np.linalg.solve(sums[known], weighted[known][..., None])[..., 0]
        return points

    def shared(self, rows: Rows) -> Rows:
        """Those rows of landmarks that several keyframes see, or more if none has depth."""
        count, with_depth = self._count(rows)
        return rows[count >= np.where(with_depth > 0, 2, UNMEASURED_TRACK)]

    def long(self, rows: Rows) -> Rows:
        """Those rows of landmarks that at least `LONG_TRACK` of the rows see."""
        landmark = self.seen.landmark[rows]
        return rows[np.bincount(landmark)[landmark] >= LONG_TRACK]

    def _count(self, rows: Rows) -> tuple[Rows, Rows]:
        """How many of the rows see the landmark of each (M,), and how many of them with depth."""
        landmark = self.seen.landmark[rows]
        count = np.bincount(landmark)
        with_depth = np.bincount(
            landmark[np.isfinite(self.seen.inverse_depth[rows])], minlength=len(count)
        )
        return count[landmark], with_depth[landmark]

"""Recordings with people composed into them: a real sensor's noise, and what moves at true places.

    python benchmarks/composed.py OUT CAPTURE... [--walkers 4] [--share 0.4] [--seeds 3]

writes each capture, whose truth has z up and the floor at 0, to OUT/captures as it is read, without
and with walkers of each seed, and maps all to OUT/maps, each once. Walkers are hidden by what the
recording measured before them, hide what is behind, and leave a Kinect's shadow in its depth. They
keep off what is higher than ``--above``, and stand in what is lower: in the view, behind the edge
of a desk. The share is what they aim at; what they cover is told. Masks are those of the map's
poses.
Exit code 1 where something wanted is missed.
"""

import argparse
import sys
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import cv2
import numpy as np
from accuracy import built
from masks import measure as measure_masks
from numpy.typing import NDArray
from people import held_against, of_trajectory
from recording import Measurement, add_record_option, conclude
from scipy.spatial.transform import Rotation, Slerp

from vnav.config import Config
from vnav.core import se3
from vnav.core.arrays import Array
from vnav.core.camera import Camera
from vnav.core.frame import Frame
from vnav.core.grid import FREE, OCCUPIED, Grid
from vnav.core.trajectory import Trajectory
from vnav.io.formats.trajectories import write_tum
from vnav.io.recordings.capture_draft import new_capture
from vnav.io.sources.capture import Capture
from vnav.io.sources.open_capture import open_capture, read_truth
from vnav.masking.warps import filled
from vnav.synthetic.crowd import draw_strolls
from vnav.synthetic.figure import dressed
from vnav.synthetic.masks import MASKS, write_mask, write_moving
from vnav.synthetic.people import Moment, Walker
from vnav.synthetic.places import GRID_M, Net, net_on
from vnav.synthetic.raycast import Rectangles, pyramids
from vnav.synthetic.rendered_capture import UNITS_PER_METRE
from vnav.synthetic.sensor import Sensor, measured_depth
from vnav.synthetic.sights import sight_of
from vnav.synthetic.strolls import STEP_S, schedule

HEAD_M = 1.9
STEP_PX = 8  # of the view in which they look for their ways
MIN_POINTS = 3  # of a cell of the grid in which something stands
EXPOSURE_S = (-0.008, -0.004, 0.0, 0.004, 0.008)  # moments of which colour is the mean
LIGHT, COLOR_SIGMA = 0.85, 3.0  # of the walkers, as of the room
SENSOR = Sensor()
NOTHING = Rectangles(*np.zeros((3, 0, 3)))  # of the scene, which the recording shows
NO_POSES = Trajectory(np.zeros(0), np.zeros((0, 4, 4)))
Depth = NDArray[np.float32]
Pixels = NDArray[np.uint8]


@dataclass(frozen=True)
class Recording:
    """A capture and its true way through a world with z up and the floor at 0."""

    capture: Capture
    truth: Trajectory

    @classmethod
    def of(cls, folder: Path) -> "Recording":
        """A capture's folder with groundtruth.txt in it."""
        config = Config().capture
        return cls(open_capture(folder, config), read_truth(folder, config))

    def pose(self, stamp_s: float) -> Array:
        """T_world_camera at a time, between those of the truth; its ends are kept beyond."""
        stamps_s = self.truth.stamps_s
        R = self._turns(np.clip(stamp_s, stamps_s[0], stamps_s[-1])).as_matrix()
        at = [np.interp(stamp_s, stamps_s, along) for along in self.truth.positions.T]
        return se3.make(R, np.array(at))

    def frame_at(self, stamp_s: float) -> Frame:
        """The frame nearest in time."""
        return self.capture.read(int(np.abs(self.capture.stamps_s - stamp_s).argmin()))

    @cached_property
    def times_s(self) -> Array:
        """Every STEP_S of the capture, and beyond its end."""
        stamps_s = self.capture.stamps_s
        return np.arange(stamps_s[0], stamps_s[-1] + STEP_S, STEP_S)

    @cached_property
    def measured(self) -> NDArray[np.bool_]:
        """Pixels (H, W) that ever have depth: a registered depth image has a border without."""
        return np.any([self.frame_at(t).depth_m > 0 for t in self.times_s], 0)

    @cached_property
    def _turns(self) -> Slerp:
        R = self.truth.T_world_camera[:, :3, :3]
        return Slerp(self.truth.stamps_s, Rotation.from_matrix(R))


def room_of(frame: Frame) -> Depth:
    """Depth (H, W) of the room, also where none was measured: that of the nearest pixel."""
    depth_m = filled(frame.depth_m)
    return np.where(depth_m > 0, depth_m, np.float32(SENSOR.max_depth_m))


def net_of(recording: Recording, above_m: float) -> Net:
    """Where nothing that the recording saw stands between a height and that of a head."""
    clouds = []
    for t in recording.times_s:
        frame = recording.frame_at(t)
        v, u = np.nonzero(frame.depth_m)
        points = frame.intrinsics.unproject(np.stack([u, v], -1), frame.depth_m[v, u])[::31]
        clouds.append(se3.transform(recording.pose(t), points))
    points = np.concatenate(clouds)
    low, high = points[:, :2].min(0), points[:, :2].max(0)
    counts = np.zeros(np.ceil((high - low) / GRID_M).astype(int)[::-1] + 1, int)
    tall = points[(points[:, 2] > above_m) & (points[:, 2] < HEAD_M), :2]
    np.add.at(counts, tuple(((tall - low) / GRID_M).astype(int)[:, ::-1].T), 1)
    cells = np.where(counts < MIN_POINTS, FREE, OCCUPIED).astype(np.uint8)
    return net_on(Grid((low[0], low[1]), GRID_M, cells), [*low, *high])


def walkers_in(recording: Recording, asked: argparse.Namespace, seed: int) -> list[Walker]:
    """People whose ways cover about the share of the view that is asked for."""
    times_s, rng = recording.times_s, np.random.default_rng([seed, 6])
    net = net_of(recording, asked.above)
    poses = [recording.pose(t) for t in times_s]
    camera = recording.capture.camera.color
    view = camera.scaled(camera.width // STEP_PX, camera.height // STEP_PX)
    sights = [
        sight_of(room_of(recording.frame_at(t))[::STEP_PX, ::STEP_PX], net, view, pose)
        for t, pose in zip(times_s, poses, strict=True)
    ]
    figures = [dressed(rng, (seed, 7, n)) for n in range(asked.walkers)]
    schedules = [schedule(len(times_s) - 1, False, rng) for _ in figures]
    wanted = np.full(len(times_s), asked.share)
    strolls = draw_strolls(net, sights, np.array(poses)[:, :2, 3], wanted, schedules)
    return list(map(Walker, figures, strolls))


class Composer:
    """Draws walkers into the frames of a recording."""

    def __init__(self, recording: Recording, walkers: Sequence[Walker], seed: int) -> None:
        self._recording, self._walkers, self._seed = recording, walkers, seed
        images = [image for walker in walkers for image in walker.figure.images()]
        self._textures = pyramids(images) if images else None

    def frame(self, row: int) -> tuple[Frame, Pixels]:
        """A frame with everybody in it, and whose (H, W) its pixels are."""
        frame = self._recording.capture.read(row)
        owner = np.zeros(frame.depth_m.shape, np.uint8)
        if self._textures is None:
            return frame, owner
        rng, behind_m = np.random.default_rng([self._seed, 3, row]), room_of(frame)
        color = self._color(frame, behind_m, rng)
        depth_m = self._depth(frame, behind_m, rng)
        moment, pose = self._at(frame.stamp_s), self._recording.pose(frame.stamp_s)
        before = self._before(moment, pose, frame, behind_m)[0]
        owner[before] = moment.render_walkers(frame.intrinsics, pose)[before]
        return replace(frame, color=color, depth_m=depth_m), owner

    def _at(self, stamp_s: float) -> Moment:
        """Everybody at a time, without the room."""
        t_s = stamp_s - self._recording.capture.stamps_s[0]
        return Moment.of([NOTHING, *(w.at(t_s) for w in self._walkers)], self._textures)

    def _before(
        self, moment: Moment, pose: Array, frame: Frame, behind_m: Depth
    ) -> tuple[NDArray[np.bool_], Depth]:
        """Where somebody stands before the room, and the depth there."""
        depth_m = moment.render_depth(frame.intrinsics, pose)
        return (depth_m > 0) & (depth_m < behind_m), depth_m

    def _color(self, frame: Frame, behind_m: Depth, rng: np.random.Generator) -> Pixels:
        """The mean over the exposure."""
        total = np.zeros(frame.color.shape, np.float32)
        for after_s in EXPOSURE_S:
            stamp_s = frame.stamp_s + after_s
            moment, pose = self._at(stamp_s), self._recording.pose(stamp_s)
            before, _ = self._before(moment, pose, frame, behind_m)
            color = LIGHT * moment.render_color(frame.intrinsics, pose)
            color += COLOR_SIGMA * rng.standard_normal(color.shape)
            total += np.where(before[..., None], color, frame.color)
        return np.clip(np.rint(total / len(EXPOSURE_S)), 0, 255).astype(np.uint8)

    def _depth(self, frame: Frame, behind_m: Depth, rng: np.random.Generator) -> Depth:
        """What the sensor measures of walkers, and what it still measures of the room."""
        stamp_s = frame.stamp_s + frame.depth_after_s
        before, depth_m = self._before(
            self._at(stamp_s), self._recording.pose(stamp_s), frame, behind_m
        )
        both_m = np.where(before, depth_m, behind_m)
        measured_m = measured_depth(both_m, frame.intrinsics, SENSOR, rng)
        beside = cv2.dilate(before.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
        room_m = np.where(beside & (measured_m == 0), 0, frame.depth_m)
        found = np.where(before, measured_m, room_m)
        found[~self._recording.measured | (in_shadow(both_m) & ~in_shadow(behind_m))] = 0
        return np.asarray(found, np.float32)


def in_shadow(depth_m: Depth) -> NDArray[np.bool_]:
    """Pixels (H, W) that a Kinect's projector, beside the camera, does not reach."""
    height, width = depth_m.shape
    disparity = SENSOR.focal_baseline_px_m / np.maximum(depth_m, SENSOR.min_depth_m)
    column = np.rint(np.arange(width) + disparity).astype(int)
    row = np.broadcast_to(np.arange(height)[:, None], column.shape)
    nearest = np.full((height, column.max() + 1), np.inf, np.float32)
    np.minimum.at(nearest, (row, column), depth_m)
    nearest = cv2.erode(nearest, np.ones((1, 3), np.uint8))
    return np.asarray(depth_m > (1 + SENSOR.edge_jump) * nearest[row, column])


def write(folder: Path, recording: Recording, walkers: Sequence[Walker], seed: int) -> None:
    """A capture of the recording's frames, as they are read, with walkers and the truth of them."""
    capture, composer = recording.capture, Composer(recording, walkers, seed)
    with new_capture(folder) as draft:
        truth = draft.root / "truth"
        (truth / MASKS).mkdir(parents=True)

        def add(row: int) -> None:
            frame, owner = composer.frame(row)
            depth_s = frame.stamp_s + frame.depth_after_s
            units = np.rint(frame.depth_m * UNITS_PER_METRE).astype(np.uint16)
            draft.add("rgb", round(1e9 * frame.stamp_s), jpeg(frame.color), ".jpg")
            draft.add(
                "depth", round(1e9 * depth_s), cv2.imencode(".png", units)[1].tobytes(), ".png"
            )
            write_mask(truth, row, owner)

        with ThreadPoolExecutor() as pool:
            list(pool.map(add, range(len(capture))))
        write_moving(truth, walkers, capture.stamps_s - capture.stamps_s[0])
        write_tum(draft.root / "groundtruth.txt", recording.truth)
        draft.finish(Camera(capture.read(0).intrinsics, UNITS_PER_METRE), NO_POSES)


def jpeg(color: Pixels) -> bytes:
    """An image file of RGB (H, W, 3)."""
    quality = [cv2.IMWRITE_JPEG_QUALITY, SENSOR.jpeg_quality]
    return bytes(cv2.imencode(".jpg", np.ascontiguousarray(color[..., ::-1]), quality)[1])


def measure(source: Path, asked: argparse.Namespace) -> Iterator[Measurement]:
    """Maps of a recording without and with walkers, and the masks of the latter."""
    recording = Recording.of(source)
    alone = mapped(f"{source.name}_alone", recording, asked, None)
    yield from alone
    for seed in range(asked.seeds):
        name = f"{source.name}_people{asked.walkers}_seed{seed}"
        yield from held_against(alone, mapped(name, recording, asked, seed))
        yield from measure_masks(asked.out / "captures" / name, asked.out / "maps", Config())


def mapped(
    name: str, recording: Recording, asked: argparse.Namespace, seed: int | None
) -> list[Measurement]:
    """What the map is like of a recording with walkers, or without any, both made once."""
    capture, folder = asked.out / "captures" / name, asked.out / "maps" / name
    if not capture.is_dir():
        walkers = [] if seed is None else walkers_in(recording, asked, seed)
        write(capture, recording, walkers, seed or 0)
    built(capture, folder)
    what = "vnav, no people" if seed is None else "vnav, people"
    return of_trajectory(name, what, capture, folder / "optimise" / "trajectory_0.tum")[0]


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("out", type=Path, help="of captures and maps, which are made once")
    parser.add_argument("captures", nargs="+", type=Path, help="each with a groundtruth.txt")
    parser.add_argument("--walkers", type=int, default=4)
    parser.add_argument("--share", type=float, default=0.4, help="of the view, that they aim at")
    parser.add_argument("--above", type=float, default=1.3, help="metres: what they keep off")
    parser.add_argument("--seeds", type=int, default=3)
    add_record_option(parser)
    asked = parser.parse_args(arguments)
    (asked.out / "maps").mkdir(parents=True, exist_ok=True)
    found = [m for source in asked.captures for m in measure(source, asked)]
    return conclude("composed", found, asked, arguments)


if __name__ == "__main__":
    sys.exit(main())

"""Frame-to-frame odometry over a whole capture: claim 3, S1 to S6."""

import dataclasses
import os
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import AbstractContextManager, nullcontext, suppress
from pathlib import Path
from typing import Any

import numpy as np

from vnav.checking.capture_report import require_depth
from vnav.config import Config
from vnav.config.registries import DESCRIPTORS, FILTERS, registered
from vnav.core.camera_motion import velocities
from vnav.core.frame import Frame
from vnav.core.mapping import (
    EVEN_LIGHT,
    LOST,
    FrameFeatures,
    FrameTable,
    Odometry,
    in_short,
    light_texts,
    overlay_text,
)
from vnav.core.progress import Progress, silent
from vnav.core.reduced_frame import ReducedFrame
from vnav.core.report import Report
from vnav.core.trajectory import Trajectory
from vnav.errors import CaptureError
from vnav.features.description import FrameDescriber, undescribed
from vnav.io.formats.trajectories import fingerprint
from vnav.io.sources.capture import Capture
from vnav.io.sources.rectify import rectified, resampled
from vnav.io.sources.repeats import stale_frames
from vnav.io.store.artifacts import save_keyframe, save_keyframe_mask, save_odometry
from vnav.io.store.map_folder import MapFolder
from vnav.io.store.records import MappedCapture
from vnav.io.store.stage_reports import clock, finished, reused, settings_of
from vnav.lighting.flattened import flattened
from vnav.masking.depth_delay import TimedFrame, depth_delay, telling_pairs
from vnav.overlays.overlay import without_overlay
from vnav.registration.reduction import reduced
from vnav.threads import one_blas_thread, one_opencv_thread
from vnav.tracking.given_poses import GivenPoses, poses_at
from vnav.tracking.odometry_builder import OdometryBuilder
from vnav.tracking.visual_odometry import TOO_MUCH, VisualOdometry

SECTIONS = "capture", "features", "registration", "tracking", "masking", "odometry"
MOST_MOVING = 4  # frames that are named
Description = Callable[[int, Frame], FrameFeatures]
Limit = AbstractContextManager[None]  # of the threads that each description takes


@one_blas_thread
def run(
    folder: MapFolder,
    capture: Capture,
    config: Config,
    *,
    given: Trajectory | None = None,
    progress: Progress = silent,
) -> Report:
    """Track every frame of the capture, choose keyframes, name what is lost.

    With ``given`` poses nothing is tracked: they are taken for what they are. CaptureError where
    the capture has no depth, unless the settings do without.
    """
    started = clock()
    if given is not None or config.tracking.has_scale:
        require_depth(capture)
    settings = settings_of(config, *SECTIONS)
    entry = described(0, capture)
    inputs = {"capture_0": entry["fingerprint"]}
    if given is not None:
        inputs["trajectory"] = fingerprint(given)
    if folder.is_current("odometry", settings, inputs):
        return reused(folder, "odometry")
    seen, hidden = capture, 0.0
    if config.capture.overlay == "auto":
        seen, hidden = without_overlay(capture)
    with folder.writing("odometry", settings, inputs) as draft:
        odometry = track(seen, config, draft, progress, given, stale_frames(capture))
        save_odometry(draft, odometry)
        folder.set_captures([entry])
    return finished(folder, report(odometry, hidden), started)


def track(
    capture: Capture,
    config: Config,
    draft: Path,
    progress: Progress = silent,
    given: Trajectory | None = None,
    stale: Mapping[int, str] | None = None,
) -> Odometry:
    """Odometry over all frames; keyframes' images are written into the draft as they are chosen.

    Frames that are ``stale``, by row, are left out, each for the reason given.

    TrajectoryError where hardly any frame has a pose of those ``given``.
    """
    frames = _frame_table(capture)
    builder = _builder(config) if given is None else _given(capture, frames, given, config)
    keeps_all = config.odometry.kept_frames == "all"
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        light = EVEN_LIGHT
        if config.capture.flatten == "auto":
            capture, light = flattened(capture, pool, progress)
        written, description = [], _description(config, given is not None)
        depth_after_s = np.full(len(frames), np.nan)
        for row, seen in _frames(capture, description, pool, stale or {}):
            progress("odometry", row, len(frames))
            if isinstance(seen, str):
                builder.skip(row, seen)
                continue
            depth_after_s[row] = seen.frame.depth_after_s
            if builder.add(seen.features, seen.frame, seen.image) or keeps_all:
                written.append(pool.submit(save_keyframe, draft, row, seen.frame))
        for keyframe in written:
            keyframe.result()
    progress("odometry", len(frames), len(frames))
    frames = dataclasses.replace(frames, depth_after_s=depth_after_s)
    odometry = dataclasses.replace(builder.result(frames), light=light)
    for row, moving in builder.moving.items():
        save_keyframe_mask(draft, row, moving)
    return odometry


def _builder(config: Config) -> OdometryBuilder:
    """What gives frames their poses."""
    if config.tracking.method in FILTERS:
        made: OdometryBuilder = registered(FILTERS, config.tracking.method)(config)
        return made
    return VisualOdometry(config)


def _given(
    capture: Capture, frames: FrameTable, given: Trajectory, config: Config
) -> OdometryBuilder:
    """What takes poses as they are given; a few pairs of frames tell whether depth is late."""
    poses = poses_at(frames.stamp_s, given, config.capture.association_s)
    twists, camera = velocities(poses, frames), rectified(capture.camera)

    def timed(row: int) -> TimedFrame:
        frame = resampled(capture.read(row), camera)
        return TimedFrame(reduced(frame).moving(twists[row]), poses[row], frame.depth_after_s)

    def pairs() -> Iterator[tuple[TimedFrame, TimedFrame]]:
        for i, j in telling_pairs(twists, frames.stamp_s):
            with suppress(CaptureError):  # of an image, which is named when all are read
                yield timed(i), timed(j)

    noise = config.registration.depth_sigma_per_m2, config.masking.depth_margin_m
    return GivenPoses(poses, twists, depth_delay(pairs(), *noise), config)


def _description(config: Config, is_given: bool) -> tuple[Description | None, Limit]:
    """What describes every frame ahead of its use, None where most are not described; its limit.

    Whole frames are described on one core each; else the few whole ones on all.
    """
    describer = FrameDescriber(config)
    if config.tracking.method != DESCRIPTORS and not is_given:
        return None, nullcontext()
    if config.features.half_size and not is_given:
        return describer.describe_coarsely, nullcontext()
    return describer.describe, one_opencv_thread


@dataclasses.dataclass(frozen=True)
class _Seen:
    """A frame, its features, and its pixels in blocks."""

    features: FrameFeatures
    frame: Frame
    image: ReducedFrame


def _frames(
    capture: Capture,
    description: tuple[Description | None, Limit],
    pool: ThreadPoolExecutor,
    stale: Mapping[int, str],
) -> Iterator[tuple[int, _Seen | str]]:
    """Every frame in order, read by the pool a little ahead; or why it cannot be.

    Without features, if nothing describes them.
    """
    camera = rectified(capture.camera)

    def see(row: int) -> _Seen | str:
        if row in stale:
            return stale[row]
        try:
            frame = resampled(capture.read(row), camera)
        except CaptureError as error:
            return str(error)
        features = describe(row, frame) if describe else undescribed(row)
        return _Seen(features, frame, reduced(frame))

    describe, limit = description
    with limit:
        ahead: deque[Future[_Seen | str]] = deque()
        for row in range(len(capture)):
            while len(ahead) < 2 * (os.cpu_count() or 1) and row + len(ahead) < len(capture):
                ahead.append(pool.submit(see, row + len(ahead)))
            yield row, ahead.popleft().result()


def _frame_table(capture: Capture) -> FrameTable:
    index = np.arange(len(capture), dtype=np.int32)
    return FrameTable(np.zeros_like(index), index, capture.stamps_s)


def described(number: int, capture: Capture) -> MappedCapture:
    """A capture as the map lists it."""
    recorded, camera = capture.camera.color, dataclasses.asdict(rectified(capture.camera))
    found = MappedCapture(
        id=number, name=capture.name, fingerprint=capture.fingerprint(), camera=camera
    )
    if any(recorded.distortion):
        found["recorded_camera"] = dataclasses.asdict(recorded)
    return found


def report(odometry: Odometry, hidden: float = 0.0) -> Report:
    """What was tracked, and which frames are lost and why; an overlay hides a share of them."""
    frames, keyframes = odometry.frames, len(odometry.keyframes)
    spans = frames.lost_spans(odometry.reasons)
    tracked = odometry.reasons.count("")
    is_tracked = np.array([not reason for reason in odometry.reasons])
    degenerate = int((is_tracked & (odometry.segment == LOST)).sum())
    segments = np.unique(odometry.segment[is_tracked & (odometry.segment != LOST)])
    values = {
        "frames": len(frames),
        "tracked": tracked,
        "lost": [vars(span) for span in spans],
        "segments": len(segments),
        "keyframes": keyframes,
        "edges": len(odometry.edges),
        "degenerate": degenerate,
        "features_median": float(np.median([len(k.features) for k in odometry.keyframes])),
    }
    how = "have a given pose" if odometry.given else "tracked"
    line = f"{tracked} of {len(frames)} frames {how}, {keyframes} keyframes"
    if degenerate:
        line += f", {degenerate} frames held by degenerate edges alone"
    if len(segments) > 1:
        line += f", in {len(segments)} segments"
    warnings = tuple(
        f"{frames.span_text(span.capture, span.first, span.last)} lost: {span.reason}"
        for span in in_short(spans)
    )
    light, (moving, unmasked) = odometry.taken_off, _moving(odometry)
    lines = line, *_light_lines(light, len(odometry.light)), *_moving_line(moving)
    if hidden:
        lines += (f"{overlay_text(hidden)}: depth there is left out",)
        values["overlay"] = hidden
    values |= {"light": light, "moving": moving}
    return Report("odometry", values, lines, warnings + unmasked)


def _light_lines(light: list[dict[str, Any]], captures: int) -> Iterator[str]:
    """Lines for each capture whose light was evened."""
    for found in light:
        named = f"capture {found['capture']}: " if captures > 1 else ""
        yield from (named + text for text in light_texts(found["corners"], found["bands"]))


def _moving(odometry: Odometry) -> tuple[dict[str, Any], tuple[str, ...]]:
    """How much of the frames moves; warnings about those in which it is too much for a mask."""
    share, frames = odometry.moving_share, odometry.frames
    too_much = np.flatnonzero(np.isnan(share))
    known = np.nan_to_num(share)
    most = np.argsort(-known, kind="stable")[:MOST_MOVING]
    values = {
        "mean": round(float(known.mean()), 4) if len(known) else 0.0,
        "most": round(float(known.max()), 4) if len(known) else 0.0,
        "frames_with_most": [int(row) for row in most if known[row] > 0],
        "frames_without_mask": too_much.tolist(),
    }
    spans = frames.lost_spans(tuple(TOO_MUCH if np.isnan(s) else "" for s in share))
    return values, tuple(
        f"{frames.span_text(s.capture, s.first, s.last)} without a mask: {s.reason}" for s in spans
    )


def _moving_line(moving: dict[str, Any]) -> tuple[str, ...]:
    """One line where something moves, none where nothing does."""
    if not moving["most"]:
        return ()
    where = ", ".join(str(row) for row in moving["frames_with_most"])
    return (
        f"{moving['mean']:.1%} of the pixels move, at most {moving['most']:.0%}: frames {where}",
    )

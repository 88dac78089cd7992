"""Whether a new capture belongs to a map, and how firmly it is joined."""

import dataclasses
from dataclasses import dataclass

import numpy as np

from vnav.core.frame import Edge
from vnav.core.mapping import Odometry
from vnav.core.report import Report
from vnav.errors import CaptureError
from vnav.io.store.artifacts import load_loop_edges, load_loops, load_optimised
from vnav.io.store.map_folder import MapFolder
from vnav.optimisation.pose_graph import AGREEING
from vnav.pipeline.recognise import Recognised, RecognisedKeyframes


def require_seen(seen: Recognised, name: str, folder: MapFolder) -> None:
    """CaptureError where too few keyframes were located, or in places that do not agree."""
    if seen.agreeing >= AGREEING:
        return
    best = ""
    if seen.best:
        best = f"; the best of the others: {seen.best.reason}, {seen.best.inliers} inliers"
    raise CaptureError(
        f"expected {name} to show the place of the map {folder.root}, found {len(seen.located)} of"
        f" {seen.asked} keyframes in it, {seen.agreeing} of which agree where {AGREEING} are needed"
        f"{best}; the map is as it was. Record more of what it shows, or make a map of its own with"
        " 'vnav build-map'"
    )


@dataclass(frozen=True)
class Joined:
    """What became of a new capture.

    Of its ``frames``, those ``posed``; of its keyframes ``asked``, those ``located`` in the map
    before; ``closures`` kept with what was mapped before, and how many put it where it was located.
    """

    frames: int
    posed: int
    asked: int
    located: int
    closures: int
    borne_out: int


def joined(draft: MapFolder, both: Odometry, seen: Recognised) -> Joined:
    """How the last capture hangs on the rest of an optimised map, whose odometry is ``both``."""
    before, is_new = both.T_world_before, both.frames.capture == both.frames.capture[-1]
    assert before is not None
    across = [e for e in _kept(draft) if np.isfinite(before[e.i, 0, 0]) and is_new[e.j]]
    rows = [e.j for e in across]
    T_world_camera = np.array([before[e.i] @ e.T_i_j for e in across]).reshape(-1, 4, 4)
    closed = RecognisedKeyframes(both.segment[rows], both.T_segment_camera[rows], T_world_camera)
    borne_out = closed.agree(seen.located).any(1)
    posed = np.isfinite(load_optimised(draft).T_world_camera[is_new, 0, 0])
    counts = len(posed), int(posed.sum()), seen.asked, len(seen.located)
    return Joined(*counts, len(across), int(borne_out.sum()))


def _kept(folder: MapFolder) -> list[Edge]:
    """The closures that the pose graph bore out."""
    edges, _ = load_loop_edges(folder)
    found, judged = load_loops(folder, "loops"), load_loops(folder, "optimise")
    accepted = [late for early, late in zip(found, judged, strict=True) if early.accepted]
    return [e for e, verdict in zip(edges, accepted, strict=True) if verdict.accepted]


def require_joined(joined: Joined, name: str, folder: MapFolder) -> None:
    """CaptureError where no loop joins the capture there where its keyframes were located."""
    if joined.posed and joined.borne_out >= AGREEING:
        return
    raise CaptureError(
        f"expected loops that join {name} to the map {folder.root} where {joined.located}"
        f" of its keyframes were located, found {joined.closures}, of which {joined.borne_out}"
        " agree with that; the map is as it was. Record more of what it shows"
    )


def told(joined: Joined, whole_map: Report) -> Report:
    """The report of the whole map, and of how it was extended."""
    lines = (
        f"{joined.posed} of {joined.frames} frames joined to the map by {joined.closures} loops;"
        f" {joined.located} of {joined.asked} keyframes asked were located in it",
        *whole_map.lines,
    )
    values = whole_map.values | {"joined": vars(joined)}
    return dataclasses.replace(whole_map, values=values, lines=lines)

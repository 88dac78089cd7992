"""Whether captures belong to one map, and how firmly loop closures connect them."""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vnav.core.frame import Edge
from vnav.core.mapping import Odometry
from vnav.core.report import Report
from vnav.errors import CaptureError
from vnav.io.store.artifacts import load_loop_edges, load_loops, load_odometry, load_optimised
from vnav.io.store.map_folder import MapFolder
from vnav.optimisation.segments import MIN_AGREEING
from vnav.pipeline.relocalise import CaptureRelocalisation, RelocalisedKeyframes


def require_same_place(found: CaptureRelocalisation, name: str, folder: MapFolder) -> None:
    """CaptureError where too few keyframes were located, or in places that do not agree."""
    if found.agreeing >= MIN_AGREEING:
        return
    best = ""
    if found.best:
        best = f"; the best of the others: {found.best.reason}, {found.best.inliers} inliers"
    raise CaptureError(
        f"expected {name} to show the place of the map {folder.root}, found {len(found.located)} of"
        f" {found.tried} keyframes in it, {found.agreeing} of which agree where {MIN_AGREEING} are"
        f" needed{best}; the map is as it was. Record more of what it shows, or make a map of its"
        " own with 'vnav build-map'"
    )


@dataclass(frozen=True)
class Connection:
    """How a new capture is connected to a map.

    Of its ``frames``, those ``posed``; of its keyframes ``tried``, those ``located`` in the map
    before; ``closures`` kept with what was mapped before, and how many of these agree with where
    it was located.
    """

    frames: int
    posed: int
    tried: int
    located: int
    closures: int
    agreeing: int


def connection(draft: MapFolder, both: Odometry, found: CaptureRelocalisation) -> Connection:
    """How the last capture of ``both`` is connected to the rest of the optimised map."""
    before, is_new = both.T_world_before, both.frames.capture == both.frames.capture[-1]
    assert before is not None
    across = [e for e in _kept_closures(draft) if np.isfinite(before[e.i, 0, 0]) and is_new[e.j]]
    rows = [e.j for e in across]
    T_world_camera = np.array([before[e.i] @ e.T_i_j for e in across]).reshape(-1, 4, 4)
    closed = RelocalisedKeyframes(both.segment[rows], both.T_segment_camera[rows], T_world_camera)
    agreeing = closed.agrees_with(found.located).any(1)
    posed = np.isfinite(load_optimised(draft).T_world_camera[is_new, 0, 0])
    counts = len(posed), int(posed.sum()), found.tried, len(found.located)
    return Connection(*counts, len(across), int(agreeing.sum()))


def _kept_closures(folder: MapFolder) -> list[Edge]:
    """The closures that the pose graph kept."""
    edges, _ = load_loop_edges(folder)
    verified, final = load_loops(folder, "loops"), load_loops(folder, "optimise")
    accepted = [late for early, late in zip(verified, final, strict=True) if early.accepted]
    return [e for e, verdict in zip(edges, accepted, strict=True) if verdict.accepted]


def require_connection(found: Connection, name: str, folder: MapFolder) -> None:
    """CaptureError where no loop joins the capture there where its keyframes were located."""
    if found.posed and found.agreeing >= MIN_AGREEING:
        return
    raise CaptureError(
        f"expected loops that join {name} to the map {folder.root} where {found.located}"
        f" of its keyframes were located, found {found.closures}, of which {found.agreeing}"
        " agree with that; the map is as it was. Record more of what it shows"
    )


def with_connection(whole_map: Report, found: Connection) -> Report:
    """The report of the whole map, and of how it was extended."""
    lines = (
        f"{found.posed} of {found.frames} frames joined to the map by {found.closures} loops;"
        f" {found.located} of {found.tried} keyframes tried were located in it",
        *whole_map.lines,
    )
    values = whole_map.values | {"connection": vars(found)}
    return dataclasses.replace(whole_map, values=values, lines=lines)


@dataclass(frozen=True)
class Join:
    """How one of several captures is in their map.

    Of its ``frames``, those ``posed``; ``closures`` kept with the other captures.
    """

    name: str
    frames: int
    posed: int
    closures: int


def joins(folder: MapFolder) -> list[Join]:
    """For each capture of an optimised map, how it is in it."""
    capture = load_odometry(folder).frames.capture
    posed = np.isfinite(load_optimised(folder).T_world_camera[:, 0, 0])
    ends = [(capture[e.i], capture[e.j]) for e in _kept_closures(folder)]
    across = [k for pair in ends if pair[0] != pair[1] for k in pair]
    return [
        Join(
            mapped["name"],
            int((capture == k).sum()),
            int(posed[capture == k].sum()),
            across.count(k),
        )
        for k, mapped in enumerate(folder.captures)
    ]


def with_joins(whole_map: Report, found: Sequence[Join]) -> Report:
    """The report of the whole map, and of how its captures are in it."""
    lines = [
        f"{join.name}: {join.posed} of {join.frames} frames, {join.closures} loops to the others"
        for join in found
        if join.posed
    ]
    apart = [join.name for join in found if not join.posed]
    warnings = [
        f"{name} is kept as a part of its own, for no loop joins it to the others: record the way"
        " between them, and add it with 'vnav extend'"
        for name in apart
    ]
    return dataclasses.replace(
        whole_map,
        values=whole_map.values | {"captures": [vars(join) for join in found]},
        lines=(*lines, *whole_map.lines),
        warnings=(*whole_map.warnings, *warnings),
    )

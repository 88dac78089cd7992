"""What a map holds, read from its folder; of its stages, those that are up to date and whole."""

from dataclasses import asdict
from typing import Any

import numpy as np

from vnav.core.grid import STATES
from vnav.core.mapping import counted
from vnav.io.store.artifacts import (
    load_grid,
    load_loops,
    load_odometry,
    load_optimised,
    map_cameras,
)
from vnav.io.store.map_folder import STAGES, MapFolder
from vnav.io.store.records import VerdictNote, is_kind

UNJOINED = "no loop joins it to the rest of the map"


def overview(folder: MapFolder) -> dict[str, Any]:
    """Plain values for people and JSON.

    Always there: ``captures`` (id, name, frames, image size), ``stages`` (state "current", "stale",
    "missing" or, where files are not as the stage wrote them, "damaged"; size, seconds of the last
    run), ``size_mb`` of these, ``current`` (the last located pose or None), ``quality`` (the
    verdict on the map and its reasons, None before it is finished).
    With odometry: ``frames, tracked, posed, keyframes, lost`` (spans of one capture, with the
    reason), ``light`` that was taken off captures. With loops: ``loops``, as `counted` has them.
    With optimise: ``landmarks, world, path_m``. With fuse: ``grid`` (size, area of each state).
    """
    states = {stage: _state(folder, stage) for stage in STAGES}
    current = {stage for stage, state in states.items() if state == "current"}
    values: dict[str, Any] = {
        "map": str(folder.root),
        "size_mb": folder.size_mb(),
        "stages": {
            stage: {
                "state": state,
                "size_mb": folder.size_mb(stage),
                "seconds": folder.report(stage).get("seconds"),
            }
            for stage, state in states.items()
        },
        "captures": [
            {"id": c["id"], "name": c["name"], "size_px": list(camera.size)}
            for c, camera in zip(folder.captures, map_cameras(folder), strict=True)
        ],
        "current": folder.current(),
        "quality": folder.report("quality")["values"] if has_verdict(folder) else None,
    }
    if "odometry" in current:
        values |= _frames(folder, "optimise" in current)
    if "loops" in current:
        values["loops"] = counted(load_loops(folder))
    if "fuse" in current:
        values |= _grid(folder)
    return values


def has_verdict(folder: MapFolder) -> bool:
    """Whether there is a verdict, and on the map as it is."""
    if not folder.has("optimise"):
        return False
    judged = folder.report("quality").get("values", {})
    is_of_this_map = judged.get("inputs") == folder.inputs_of("optimise")
    return is_of_this_map and is_kind(judged, VerdictNote)


def _state(folder: MapFolder, stage: str) -> str:
    if folder.has(stage):
        return "current" if folder.is_whole(stage) else "damaged"
    return "stale" if (folder.root / stage / "stage.json").is_file() else "missing"


def _frames(folder: MapFolder, is_optimised: bool) -> dict[str, Any]:
    odometry = load_odometry(folder, any_scale=True)
    reasons = list(odometry.reasons)
    tracked = reasons.count("")
    values: dict[str, Any] = {
        "frames": len(reasons),
        "tracked": tracked,
        "keyframes": len(odometry.keyframes),
        "light": odometry.taken_off,
    }
    if is_optimised:
        result = load_optimised(folder)
        posed = np.isfinite(result.T_world_camera[:, 0, 3])
        reasons = [
            reason or (UNJOINED if not has_pose else "")
            for reason, has_pose in zip(reasons, posed, strict=True)
        ]
        steps = np.linalg.norm(np.diff(result.T_world_camera[posed, :3, 3], axis=0), axis=1)
        steps = steps[np.diff(odometry.frames.capture[posed]) == 0]
        values |= {
            "posed": int(posed.sum()),
            "path_m": round(float(steps.sum()), 2),
            "landmarks": len(result.landmarks),
            "world": asdict(result.world),
        }
    return values | {"lost": [vars(span) for span in odometry.frames.lost_spans(reasons)]}


def _grid(folder: MapFolder) -> dict[str, Any]:
    grid = load_grid(folder)
    rows, columns = grid.cells.shape
    return {
        "grid": {
            "size_m": [round(columns * grid.resolution_m, 3), round(rows * grid.resolution_m, 3)],
            "resolution_m": grid.resolution_m,
            "area_m2": {name: grid.area_m2(state) for name, state in STATES.items()},
        }
    }

"""What the optimisation came to, in numbers and in sentences for a person."""

from typing import Any

import numpy as np

from vnav.core.arrays import Array
from vnav.core.mapping import Odometry, OptimisedMap, how_held
from vnav.core.report import Report
from vnav.optimisation.bundle_problem import PosePrior
from vnav.optimisation.landmarks import AdjustedBundle
from vnav.optimisation.mending import CUT, LEFT_OUT, REGISTERED_AGAIN, TAKEN
from vnav.optimisation.self_calibration import SensorCalibration
from vnav.optimisation.sensor_errors import SensorErrors
from vnav.optimisation.solution import Solution


def solution_report(solution: Solution, result: OptimisedMap, odometry: Odometry) -> Report:
    """Counts, errors before and after, and what is doubtful."""
    values = _values(solution, result) | {"keyframes_culled": _culled(solution, odometry)}
    lines = [
        f"{values['posed']} of {values['frames']} frames have a pose;"
        f" {values['closures_kept']} closures kept, {values['closures_rejected']} rejected",
        _landmarks_line(solution.adjusted),
    ]
    if culled := values["keyframes_culled"]:
        of = len(odometry.keyframes)
        lines.append(f"{culled} of {of} keyframes are left out of it: others see what they see")
    lines += _mended_lines(solution, odometry, LEFT_OUT, REGISTERED_AGAIN)
    if surfaces := values["surface_edges"]:
        lines.append(
            f"surfaces seen from two sides disagreed: adjusted once more, by {surfaces} pairs of"
            " keyframes that see one"
        )
    lines += sensor_lines(solution.adjusted.sensor)
    lines += _up_lines(result.world.up_in_images)
    if solution.prior:
        rad, m = solution.prior.sigmas[[0, 3]]
        values |= {"given_sigma_deg": float(np.rad2deg(rad)), "given_sigma_m": float(m)}
        lines.append(_given_line(solution.prior))
    return Report("optimise", values, tuple(lines), tuple(_warnings(solution, result, odometry)))


def _values(solution: Solution, result: OptimisedMap) -> dict[str, Any]:
    adjusted, posed = solution.adjusted, np.isfinite(result.T_world_camera[:, 0, 0])
    parts = np.flatnonzero(posed), *solution.other_parts.values()
    return {
        "frames": len(posed),
        "posed": int(posed.sum()),
        "parts": [{"first": int(r[0]), "last": int(r[-1]), "frames": len(r)} for r in parts],
        "mended": [vars(mend) for mend in solution.robust.mends],
        "closures_kept": len(solution.closures),
        "closures_rejected": len(solution.robust.graph.kept) - len(solution.closures),
        "graph_error_before": solution.robust.graph.error_before,
        "graph_error_after": solution.robust.graph.error_after,
        "sensors": list(map(_sensor_values, adjusted.sensor.errors, adjusted.sensor.sigmas)),
        "camera_fits": [vars(fit) for fit in adjusted.camera_fits],
        "surface_edges": len(solution.surfaces),
        "landmarks": len(adjusted.landmarks),
        "observations": adjusted.observations,
        "rms_px_before": adjusted.rms_px_before if adjusted.observations else None,
        "rms_px_after": adjusted.rms_px_after if adjusted.observations else None,
        "world": result.world.source,
        "floor_points": result.world.floor_points,
    }


def _up_lines(side: str) -> list[str]:
    """That images are not upright, where they are not."""
    held = how_held(side)
    setting = "--set optimise.up_in_images=top"
    return [f"{held}; if not so, name the side that is up: {setting}"] if held else []


def _culled(solution: Solution, odometry: Odometry) -> int:
    """How many keyframes with a pose bundle adjustment did without."""
    posed = np.isfinite(solution.poses[odometry.keyframe_rows, 0, 0])
    return int((posed & np.isnan(solution.adjusted.T_world_camera[:, 0, 0])).sum())


def _mended_lines(solution: Solution, odometry: Odometry, *how: str) -> list[str]:
    """Which frames contradicted what, where these outcomes came of it."""
    lines = []
    for mend in solution.robust.mends:
        frames = odometry.frames.rows_text(np.arange(mend.first, mend.last + 1))
        contradiction = "edges of odometry contradict each other"
        if mend.closures:
            contradiction = f"odometry contradicts {mend.closures} closures"
        if mend.how in how:
            lines.append(f"{frames}: {mend.why or contradiction}: {mend.how}")
    return lines


def _landmarks_line(adjusted: AdjustedBundle) -> str:
    landmarks = f"{len(adjusted.landmarks)} landmarks"
    if not adjusted.observations:
        return landmarks
    if not adjusted.rounds:
        return (
            f"{landmarks}; reprojection {adjusted.rms_px_after:.2f} px, without bundle adjustment"
        )
    return (
        f"{landmarks}; reprojection {adjusted.rms_px_before:.2f} px before,"
        f" {adjusted.rms_px_after:.2f} px after bundle adjustment"
    )


def _sensor_values(errors: SensorErrors, sigmas: Array) -> dict[str, float | None]:
    """Each error of a sensor, and its standard deviation, None where nothing tells it."""
    values: dict[str, float | None] = {}
    for (name, error), sigma in zip(vars(errors).items(), sigmas.tolist(), strict=True):
        values |= {name: error, f"{name}_sigma": sigma if np.isfinite(sigma) else None}
    return values


def sensor_lines(sensor: SensorCalibration) -> list[str]:
    """What is wrong with each capture's sensor, where anything is."""
    of_each = map(_lines_of, sensor.errors, sensor.sigmas)
    named = len(sensor.errors) > 1
    return [
        f"capture {c}: {line}" if named else line
        for c, lines in enumerate(of_each)
        for line in lines
    ]


def _lines_of(errors: SensorErrors, sigmas: Array) -> list[str]:
    (_, depth_sigma_s, line_sigma_s, _), lines = sigmas, []
    if errors.depth_offset:
        how = "short" if errors.depth_offset > 0 else "long"
        off_mm = 1000 * abs(errors.depth_offset) * 4**2
        lines.append(f"depth is {off_mm:.1f} mm too {how} at 4 m")
    if errors.depth_delay_s:
        how = "after" if errors.depth_delay_s > 0 else "before"
        delay_ms = 1000 * abs(errors.depth_delay_s)
        lines.append(
            f"depth is measured {delay_ms:.1f} ms (+- {1000 * depth_sigma_s:.1f}) {how} colour"
        )
    if errors.depth_stamp_share:
        lines.append("stamps of depth vary against colour's, and images bear them out")
    if errors.line_delay_s:
        delay_us = 1e6 * errors.line_delay_s
        lines.append(f"rolling shutter: {delay_us:.1f} us (+- {1e6 * line_sigma_s:.1f}) a row")
    return [f"{line}; poses and landmarks allow for it" for line in lines]


def _given_line(prior: PosePrior) -> str:
    how = "fixed" if prior.fixed else "adjusted"
    if not prior.sigmas.any():
        return f"given poses {how}: loops show no noise in them beyond their own"
    rad, m = prior.sigmas[[0, 3]]
    return f"given poses {how}: loops show noise of {np.rad2deg(rad):.2f} deg and {1000 * m:.0f} mm"


def _warnings(solution: Solution, result: OptimisedMap, odometry: Odometry) -> list[str]:
    found = _mended_lines(solution, odometry, CUT, TAKEN)
    found += [
        f"{odometry.frames.rows_text(rows)} are a part of their own, for no loop joins them to"
        f" the rest: their trajectory is in optimise/{name}, the map is of the main part"
        for name, rows in solution.other_parts.items()
    ]
    closures, kept = len(solution.robust.graph.kept), len(solution.closures)
    if odometry.given and closures - kept > kept:
        found.append(
            f"the given poses contradict the images: {closures - kept} of {closures} pairs of"
            " keyframes stand otherwise to each other; expected metres and camera to world, the"
            " camera's x right, y down, z forward"
        )
    if result.world.doubt:
        found.append(result.world.doubt)
    if result.world.floor_less_stands:
        found.append(
            "more stands on the ceiling than on the floor; if the camera hangs upside down, build"
            " the map again with --set optimise.up_in_images=bottom"
        )
    return found

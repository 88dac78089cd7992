"""What the optimisation came to, in numbers and in sentences for a person."""

from typing import Any

import numpy as np

from vnav.core.mapping import Odometry, OptimisedMap
from vnav.core.report import Report
from vnav.optimisation.bundle_graph import PosePrior
from vnav.optimisation.landmarks import AdjustedBundle
from vnav.optimisation.solution import Solution


def solution_report(solution: Solution, result: OptimisedMap, odometry: Odometry) -> Report:
    """Counts, errors before and after, and what is doubtful."""
    values = _values(solution, result)
    lines = [
        f"{values['posed']} of {values['frames']} frames have a pose;"
        f" {values['closures_kept']} closures kept, {values['closures_rejected']} rejected",
        _landmarks_line(solution.adjusted),
    ]
    if solution.adjusted.depth_offset:
        lines.append(_depth_line(solution.adjusted.depth_offset))
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
        "closures_kept": len(solution.closures),
        "closures_rejected": len(solution.graph.kept) - len(solution.closures),
        "graph_error_before": solution.graph.error_before,
        "graph_error_after": solution.graph.error_after,
        "depth_offset": adjusted.depth_offset,
        "landmarks": len(adjusted.landmarks),
        "observations": adjusted.observations,
        "rms_px_before": adjusted.rms_px_before if adjusted.observations else None,
        "rms_px_after": adjusted.rms_px_after if adjusted.observations else None,
        "world": result.world.source,
        "floor_points": result.world.floor_points,
    }


def _landmarks_line(adjusted: AdjustedBundle) -> str:
    landmarks = f"{len(adjusted.landmarks)} landmarks"
    if not adjusted.observations:
        return landmarks
    return (
        f"{landmarks}; reprojection {adjusted.rms_px_before:.2f} px before,"
        f" {adjusted.rms_px_after:.2f} px after bundle adjustment"
    )


def _depth_line(depth_offset: float) -> str:
    how = "short" if depth_offset > 0 else "long"
    off_mm = 1000 * abs(depth_offset) * 4**2
    return f"depth is {off_mm:.1f} mm too {how} at 4 m; poses and landmarks allow for it"


def _given_line(prior: PosePrior) -> str:
    how = "fixed" if prior.fixed else "adjusted"
    if not prior.sigmas.any():
        return f"given poses {how}: loops show no noise in them beyond their own"
    rad, m = prior.sigmas[[0, 3]]
    return f"given poses {how}: loops show noise of {np.rad2deg(rad):.2f} deg and {1000 * m:.0f} mm"


def _warnings(solution: Solution, result: OptimisedMap, odometry: Odometry) -> list[str]:
    found = [
        f"{odometry.frames.rows_text(rows)} are a part of their own, for no loop joins them to"
        f" the rest: their trajectory is in optimise/{name}, the map is of the main part"
        for name, rows in solution.other_parts.items()
    ]
    closures, kept = len(solution.graph.kept), len(solution.closures)
    if odometry.given and closures - kept > kept:
        found.append(
            f"the given poses contradict the images: {closures - kept} of {closures} pairs of"
            " keyframes stand otherwise to each other; expected metres and camera to world, the"
            " camera's x right, y down, z forward"
        )
    if result.world.doubt:
        found.append(result.world.doubt)
    return found

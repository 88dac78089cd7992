"""A path over a grid from one place to another: claim 5."""

import dataclasses
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from vnav.config import PlanConfig
from vnav.core.arrays import Array
from vnav.core.frame import Rejected
from vnav.core.grid import WALKED, Grid
from vnav.planning.astar import search
from vnav.planning.costmap import Costmap, costmap
from vnav.planning.smoothing import smooth
from vnav.planning.snapping import Point, SnappedPoint, snap_start_and_goal


@dataclass(frozen=True)
class Plan:
    """A path that a robot can follow.

    Parameters
    ----------
    poses
        (K, 3) x and y in metres, yaw in radians, counted from x towards y.
    length_m, clearance_min_m
        Of the path; clearance as in `Costmap`, infinite on a grid without obstacles.
    start, goal
        What was asked for and what it became.
    walked_m
        How much of it leads through walked cells, which nobody saw.
    expanded
        Cells that A* expanded.
    """

    poses: Array
    length_m: float
    clearance_min_m: float
    start: SnappedPoint
    goal: SnappedPoint
    walked_m: float
    expanded: int


def plan_path(
    grid: Grid,
    start: Point,
    goal: Point,
    config: PlanConfig,
    *,
    uncertainty_m: float = 0.0,
    final_yaw_rad: float | None = None,
) -> Plan | Rejected:
    """The cheapest path, smoothed, between two points on the floor; Rejected says why not.

    ``uncertainty_m`` is how far an obstacle may be from where the grid has it; obstacles are
    inflated by it, by the robot's radius and by half a cell's diagonal. ``final_yaw_rad`` is the
    heading at the goal; without one the path's last direction is kept.
    """
    costs = costmap(grid, uncertainty_m, config)
    snapped = snap_start_and_goal(costs, start, goal, config.tolerance_m)
    if isinstance(snapped, Rejected):
        return Rejected(snapped.reason + _remedy(grid, (start, goal), uncertainty_m, config))
    first, last = snapped
    route = search(costs.costs, first.cell, last.cell)
    if isinstance(route, Rejected):
        return route
    inner = grid.centres_of(route.cells[1:-1])
    points = np.concatenate([[first.snapped], inner, [last.snapped]])
    path = _smoothed(points, costs) if config.smooth else points
    poses = _poses(_densified(path, config.spacing_m), final_yaw_rad)
    clearance_m, walked_m = _along(costs, path)
    length_m = float(np.hypot(*np.diff(path, axis=0).T).sum())
    return Plan(poses, length_m, clearance_m, first, last, walked_m, route.expanded)


def heading_rad(T_world_camera: ArrayLike) -> float:
    """Where a camera looks, on the floor: yaw of its optical axis.

    For one that looks within 5 degrees of straight down or up, where its image's top or bottom
    points.
    """
    R = np.asarray(T_world_camera, float)[:3, :3]
    ahead = R[:2, 2] if np.hypot(*R[:2, 2]) > np.sin(np.deg2rad(5)) else R[:2, 1] * np.sign(R[2, 2])
    return float(np.arctan2(ahead[1], ahead[0]))


def _remedy(grid: Grid, ends: tuple[Point, Point], uncertainty_m: float, config: PlanConfig) -> str:
    """What would make a path possible, as the end of a sentence."""
    for change, advice in (
        ({"allow_unknown": True}, "; there is a way through unknown space (--allow-unknown)"),
        (
            {"robot_radius_m": 0.0},
            f"; a robot of less radius than {config.robot_radius_m:g} m could do it",
        ),
    ):
        other = costmap(grid, uncertainty_m, dataclasses.replace(config, **change))
        if not isinstance(snap_start_and_goal(other, *ends, config.tolerance_m), Rejected):
            return advice
    return ""


def _smoothed(points: Array, costs: Costmap) -> Array:
    """A path through points (K, 2) in metres with rounder corners; its ends stay where they are."""
    grid = costs.grid
    path = _in_metres(grid, smooth(_in_cells(grid, points), costs.costs))
    path[0], path[-1] = points[0], points[-1]
    return path


def _in_cells(grid: Grid, points: Array) -> Array:
    """Points (K, 2) as column and row, counted from the corner of the first cell."""
    return (points - grid.origin) / grid.resolution_m


def _in_metres(grid: Grid, points: Array) -> Array:
    return points * grid.resolution_m + grid.origin


def _densified(path: Array, spacing_m: float) -> Array:
    """The same path with points at most a spacing apart, none twice; its corners are kept."""
    parts = [path[:1]]
    for a, b in zip(path, path[1:], strict=False):
        steps = int(np.ceil(np.hypot(*(b - a)) / spacing_m))
        parts.append(a + (b - a) * (np.arange(1, steps + 1)[:, None] / max(steps, 1)))
    return np.concatenate(parts)


def _poses(points: Array, final_yaw_rad: float | None) -> Array:
    """Each point (K, 2) with the direction to the next, the last with the final one."""
    towards = np.diff(points, axis=0)
    yaw = np.arctan2(towards[:, 1], towards[:, 0])
    last = final_yaw_rad if final_yaw_rad is not None else yaw[-1] if len(yaw) else 0.0
    return np.column_stack([points, np.append(yaw, last)])


def _along(costs: Costmap, path: Array) -> tuple[float, float]:
    """The least clearance of the cells that a path passes through, and its way in walked ones."""
    points = _densified(path, costs.grid.resolution_m / 4)
    row, column = costs.grid.cells_at(points).T
    is_walked = costs.grid.cells[row, column] == WALKED
    steps_m = np.hypot(*np.diff(points, axis=0).T)
    walked_m = (steps_m * (is_walked[1:] + is_walked[:-1].astype(float)) / 2).sum()
    return float(costs.clearance_m[row, column].min()), float(walked_m)

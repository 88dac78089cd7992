"""A path over a grid from one place to another: claim 5."""

import dataclasses
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

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

NOWHERE: Mapping[str, Array] = MappingProxyType({})  # that polygons bar


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
    via
        As start and goal, for each point that the path leads over.
    """

    poses: Array
    length_m: float
    clearance_min_m: float
    start: SnappedPoint
    goal: SnappedPoint
    walked_m: float
    expanded: int
    via: tuple[SnappedPoint, ...] = ()


def plan_path(
    grid: Grid,
    start: Point,
    goal: Point,
    config: PlanConfig,
    *,
    uncertainty_m: float = 0.0,
    final_yaw_rad: float | None = None,
    via: Sequence[Point] = (),
    keep_out: Mapping[str, Array] = NOWHERE,
) -> Plan | Rejected:
    """The cheapest path, smoothed, between two points on the floor; Rejected says why not.

    ``uncertainty_m`` is how far an obstacle may be from where the grid has it; obstacles are
    inflated by it, by the robot's radius and by half a cell's diagonal. ``final_yaw_rad`` is the
    heading at the goal; without one the path's last direction is kept. The path leads over ``via``
    in turn, the cheapest way to each. What polygons (N, 2) of ``keep_out`` touch is occupied.
    """
    costs = costmap(grid.blocked(keep_out.values()), uncertainty_m, config)
    legs = list[Plan]()
    for number, target in enumerate((*via, goal), 1):
        ends = (legs[-1].goal.snapped if legs else start), target
        yaw_rad = final_yaw_rad if number > len(via) else None
        leg = _leg(costs, ends, config, yaw_rad)
        if isinstance(leg, Rejected):
            remedy = _remedy(grid, keep_out, ends, uncertainty_m, config)
            where = f"on leg {number} of {len(via) + 1}, " if via else ""
            return Rejected(where + leg.reason + remedy)
        legs.append(leg)
    return _joined(legs)


def _leg(
    costs: Costmap, ends: tuple[Point, Point], config: PlanConfig, final_yaw_rad: float | None
) -> Plan | Rejected:
    """The path from one point to the next, over nothing in between."""
    grid = costs.grid
    snapped = snap_start_and_goal(costs, *ends, config.tolerance_m)
    if isinstance(snapped, Rejected):
        return snapped
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


def _joined(legs: Sequence[Plan]) -> Plan:
    """One path of several; where two meet, the robot turns to where the next one leads."""
    first, last = legs[0], legs[-1]
    return Plan(
        np.concatenate([*(leg.poses[:-1] for leg in legs[:-1]), last.poses]),
        sum(leg.length_m for leg in legs),
        min(leg.clearance_min_m for leg in legs),
        first.start,
        last.goal,
        sum(leg.walked_m for leg in legs),
        sum(leg.expanded for leg in legs),
        tuple(leg.goal for leg in legs[:-1]),
    )


def heading_rad(T_world_camera: ArrayLike) -> float:
    """Where a camera looks, on the floor: yaw of its optical axis.

    For one that looks within 5 degrees of straight down or up, where its image's top or bottom
    points.
    """
    R = np.asarray(T_world_camera, float)[:3, :3]
    ahead = R[:2, 2] if np.hypot(*R[:2, 2]) > np.sin(np.deg2rad(5)) else R[:2, 1] * np.sign(R[2, 2])
    return float(np.arctan2(ahead[1], ahead[0]))


def _remedy(
    grid: Grid,
    keep_out: Mapping[str, Array],
    ends: tuple[Point, Point],
    uncertainty_m: float,
    config: PlanConfig,
) -> str:
    """What would make a path possible, as the end of a sentence."""

    def is_way(names: Iterable[str], **change: Any) -> bool:
        barred = grid.blocked(keep_out[name] for name in names)
        other = costmap(barred, uncertainty_m, dataclasses.replace(config, **change))
        return not isinstance(snap_start_and_goal(other, *ends, config.tolerance_m), Rejected)

    for name in keep_out:
        if is_way(keep_out.keys() - {name}):
            return f"; the keep-out '{name}' is in the way"
    if keep_out and is_way(()):
        return f"; several keep-outs are in the way: {', '.join(keep_out)}"
    for change, advice in (
        ({"allow_unknown": True}, "; there is a way through unknown space (--allow-unknown)"),
        (
            {"robot_radius_m": 0.0},
            f"; a robot of less radius than {config.robot_radius_m:g} m could do it",
        ),
    ):
        if is_way(keep_out, **change):
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

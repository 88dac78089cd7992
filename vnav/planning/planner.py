"""A path over a grid from one place to another: claim 5."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from vnav.core.arrays import Array
from vnav.core.frame import Rejected
from vnav.core.grid import WALKED
from vnav.planning.costmap import Costmap
from vnav.planning.narrowest import NoPath
from vnav.planning.remedy import why_not
from vnav.planning.routes import followed, snapped_route
from vnav.planning.snapping import Point, SnappedPoint, Yaws


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
    costs: Costmap,
    start: Point,
    goal: Point,
    *,
    final_yaw_rad: float | None = None,
    via: Sequence[Point] = (),
) -> Plan | NoPath:
    """The cheapest path, smoothed, between two points on the floor; NoPath says why not.

    ``final_yaw_rad`` is the heading at the goal; without one the path's last direction is kept. The
    path leads over ``via`` in turn, the cheapest way to each.
    """
    legs = list[Plan]()
    for number, target in enumerate((*via, goal), 1):
        ends = (legs[-1].goal.snapped if legs else start), target
        yaws = (
            float(legs[-1].poses[-1, 2]) if legs else None,
            final_yaw_rad if number > len(via) else None,
        )
        leg = _leg(costs, ends, yaws, leaves=number <= len(via))
        if isinstance(leg, Rejected):
            where = f"on leg {number} of {len(via) + 1}, " if via else ""
            return why_not(costs, ends, yaws, where + leg.reason)
        legs.append(leg)
    return _joined(legs)


def _leg(
    costs: Costmap, points: tuple[Point, Point], yaws: Yaws, *, leaves: bool
) -> Plan | Rejected:
    """The path from one point to the next, over nothing in between."""
    found = snapped_route(costs, points, yaws, leaves=leaves)
    if isinstance(found, Rejected):
        return found
    ends, route = found
    path = followed(costs, route, ends, yaws)
    poses = _poses(_densified(path, costs.config.spacing_m), yaws)
    clearance_m, walked_m = _along(costs, path)
    length_m = float(np.hypot(*np.diff(path, axis=0).T).sum())
    return Plan(poses, length_m, clearance_m, *ends, walked_m, route.expanded)


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


def _densified(path: Array, spacing_m: float) -> Array:
    """The same path with points at most a spacing apart, none twice; its corners are kept."""
    parts = [path[:1]]
    for a, b in zip(path, path[1:], strict=False):
        steps = int(np.ceil(np.hypot(*(b - a)) / spacing_m))
        parts.append(a + (b - a) * (np.arange(1, steps + 1)[:, None] / max(steps, 1)))
    return np.concatenate(parts)


def _poses(points: Array, yaws: Yaws) -> Array:
    """Each point (K, 2) with the direction to the next, the last with the final one.

    One that is alone keeps the yaw before it, where there is no other.
    """
    towards = np.diff(points, axis=0)
    yaw = np.arctan2(towards[:, 1], towards[:, 0])
    before = yaw[-1] if len(yaw) else yaws[0] or 0.0
    last = before if yaws[1] is None else yaws[1]
    return np.column_stack([points, np.append(yaw, last)])


def _along(costs: Costmap, path: Array) -> tuple[float, float]:
    """The least clearance of the cells that a path passes through, and its way in walked ones."""
    points = _densified(path, costs.grid.resolution_m / 4)
    row, column = costs.grid.cells_at(points).T
    is_walked = costs.grid.cells[row, column] == WALKED
    steps_m = np.hypot(*np.diff(points, axis=0).T)
    walked_m = (steps_m * (is_walked[1:] + is_walked[:-1].astype(float)) / 2).sum()
    return float(costs.clearance_m[row, column].min()), float(walked_m)

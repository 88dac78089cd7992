"""What closes the way where there is no path, and what would open it."""

import dataclasses
import math
from collections.abc import Callable

from vnav.core.frame import Rejected
from vnav.core.places import Zones
from vnav.planning.costmap import Costmap, costmap
from vnav.planning.narrowest import NarrowPlace, NoPath, narrowest_place
from vnav.planning.routes import snapped_route
from vnav.planning.snapping import Point, Yaws, reachable_cells

UNKNOWN_SPACE = "there is a way through unknown space (--allow-unknown)"
FARTHER = 2.0  # times the tolerance, up to which moving start and goal is proposed
Points = tuple[Point, Point]


def why_not(costs: Costmap, points: Points, yaws: Yaws, reason: str) -> NoPath:
    """The reason, and what stands in the way: zones, unknown space, or what is too narrow.

    A goal that lies a little too far inside something has a way to beside it.
    """

    def is_way(other: Costmap) -> bool:
        return not isinstance(snapped_route(other, points, yaws), Rejected)

    opened = _shut_by(costs, is_way) or _farther(costs, points, yaws)
    if opened:
        return NoPath(f"{reason}; {opened}")
    allowed = costs.config.allow_unknown
    for allow, through in ((allowed, ""), (True, " through unknown space")):
        place = _narrowest(costs, points, allow)
        if place is not None:
            no_width = costs.changed(robot_radius_m=0.0, footprint="", allow_unknown=allow)
            could = f"; {_smaller(costs)} could do it{through}" if is_way(no_width) else ""
            return NoPath(f"{reason}{could}; {place.text}", narrowest=place)
    return NoPath(reason)


def _shut_by(costs: Costmap, is_way: Callable[[Costmap], bool]) -> str:
    """The zones or the unknown space without which there is a way, empty where that is not it."""
    kinds = costs.zones.kinds()
    for name, kind in kinds.items():
        if is_way(costs.changed(costs.zones.without({name}))):
            return f"the {kind} '{name}' is in the way"
    if len(kinds) > 1 and is_way(costs.changed(Zones())):
        several = " and ".join(f"{kind}s" for kind in dict.fromkeys(kinds.values()))
        return f"several {several} are in the way: {', '.join(kinds)}"
    if is_way(costs.changed(allow_unknown=True)):
        return UNKNOWN_SPACE
    if kinds and is_way(costs.changed(Zones(), allow_unknown=True)):
        return f"{UNKNOWN_SPACE}, without {', '.join(map(repr, kinds))}"
    return ""


def _farther(costs: Costmap, points: Points, yaws: Yaws) -> str:
    """How far start and goal are moved where there is a way so, empty where there is none."""
    moved = costs.changed(tolerance_m=FARTHER * costs.config.tolerance_m)
    found = snapped_route(moved, points, yaws)
    if isinstance(found, Rejected):
        return ""
    away_m = math.ceil(100 * max(end.moved_m for end in found[0])) / 100
    return f"there is a way from and to where the robot can be (--tolerance {away_m:.2f})"


def _smaller(costs: Costmap) -> str:
    if costs.footprint is not None:
        return "a smaller robot"
    return f"a robot of less radius than {costs.config.robot_radius_m:g} m"


def _narrowest(costs: Costmap, points: Points, allow_unknown: bool) -> NarrowPlace | None:
    """Where the widest way is narrowest, None where there is none of any width.

    It leads between the cells that the points may be moved to; from the points themselves, where
    the robot fits nowhere near them or has room all along, and only its turns lack it.
    """
    config = dataclasses.replace(
        costs.config, robot_radius_m=0.0, footprint="", allow_unknown=allow_unknown
    )
    wide = costmap(costs.seen, 0.0, config, costs.zones)
    near, exact = (
        [reachable_cells(c, p, config.tolerance_m) for p in points] for c in (costs, wide)
    )
    if not all(len(cells) for cells in exact):
        return None
    first, last = (
        cells if len(cells) else other[:1] for cells, other in zip(near, exact, strict=True)
    )
    place = narrowest_place(wide, costs, first, last)
    return place or narrowest_place(wide, costs, *(cells[:1] for cells in exact))

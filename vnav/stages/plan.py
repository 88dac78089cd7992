"""A path from one place in a map to another: claims 1 and 5."""

import logging
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from vnav.config import PlanConfig
from vnav.core.arrays import Array
from vnav.core.frame import Rejected
from vnav.core.mapping import OptimisedMap
from vnav.core.places import GOAL, point_of
from vnav.errors import MapError, VnavError
from vnav.io.store.artifacts import load_grid, load_optimised
from vnav.io.store.map_folder import MapFolder
from vnav.io.store.places_file import known_names, load_places, load_zones, require_placed
from vnav.io.store.records import PoseNote, is_kind
from vnav.planning.costmap import Costmap, costmap
from vnav.planning.narrowest import NarrowPlace, NoPath
from vnav.planning.planner import Plan, heading_rad, plan_path
from vnav.planning.snapping import Point, SnappedPoint
from vnav.planning.storeys import is_over_floor
from vnav.planning.tour import MOST, best_order

log = logging.getLogger(__name__)

CURRENT = "current"
Pose = Array | Rejected  # T_world_camera of a photo, or why it is not known
Place = Pose | Point | str | Path  # or a point; "current", "X,Y", the file of a photo, a name
Locate = Callable[[Path], Pose]


@dataclass(frozen=True)
class FloorPose:
    """A point on the floor and, where a photo was taken there, its heading."""

    point: Point
    yaw_rad: float | None = None


@dataclass(frozen=True)
class PlanAnswer:
    """A path, or why there is none; ``places`` are start and goal as far as they are known.

    ``via``: the places that it leads over, ``order``: which of those asked for each is; ``costs``:
    what it was planned on. ``warnings`` say what is doubtful about the photos' camera.
    """

    plan: Plan | Rejected
    places: tuple[FloorPose | Rejected, FloorPose | Rejected]
    costs: Costmap
    seconds: dict[str, float]
    warnings: tuple[str, ...] = ()
    via: tuple[FloorPose | Rejected, ...] = ()
    order: tuple[int, ...] = ()

    @property
    def found(self) -> Plan | None:
        """The path, if there is one."""
        return self.plan if isinstance(self.plan, Plan) else None

    @property
    def reason(self) -> str:
        """Why there is none, empty where there is one."""
        return self.plan.reason if isinstance(self.plan, Rejected) else ""

    @property
    def narrowest(self) -> NarrowPlace | None:
        """Where the widest way is too narrow, if that is why there is no path."""
        return self.plan.narrowest if isinstance(self.plan, NoPath) else None

    def as_dict(self) -> dict[str, Any]:
        """Plain values for JSON; null for what is not known."""
        plan = self.found
        clearance_m = plan.clearance_min_m if plan else np.inf
        points = (plan.start, plan.goal) if plan else (None, None)
        start, goal = (_plain(*each) for each in zip(self.places, points, strict=True))
        over = plan.via if plan else (None,) * len(self.via)
        return {
            "found": plan is not None,
            "reason": self.reason or None,
            "path_m": plan.poses.tolist() if plan else [],
            "length_m": plan.length_m if plan else None,
            "clearance_min_m": clearance_m if np.isfinite(clearance_m) else None,
            "walked_m": plan.walked_m if plan else None,
            "start": start,
            "goal": goal,
            "via": [_plain(*each) for each in zip(self.via, over, strict=True)],
            "expanded": plan.expanded if plan else None,
            "narrowest": _plain_place(self.narrowest),
            "seconds": self.seconds,
        }


def plan(
    folder: MapFolder,
    start: Place,
    goal: Place,
    config: PlanConfig,
    locate: Locate,
    *,
    via: Sequence[Place] = (),
    any_order: bool = False,
) -> PlanAnswer:
    """A path between two places over others, or why there is none.

    ``current`` is the pose of this map's last located photo, which is left as it is. The last yaw
    of the path is where the goal's photo looks, or that of a goal with a name. The map's keep-outs
    are kept out of, and its one-ways are not driven against. ``via`` are passed in turn, or in the
    cheapest order where ``any_order`` is right. MapError where the map has no grid, no current pose
    or no such name; whatever ``locate`` raises for a photo that cannot be read.
    """
    clock = [time.monotonic()]
    grid, zones = load_grid(folder), load_zones(folder)
    uncertainty_m = min(map_uncertainty_m(load_optimised(folder)), config.max_uncertainty_m)
    clock.append(time.monotonic())
    first, *between, last = (_floor_pose(folder, p, locate) for p in (start, *via, goal))
    clock.append(time.monotonic())
    costs = costmap(grid, uncertainty_m, config, zones)
    order = tuple(range(len(between)))
    if any_order:
        order = _cheapest_order(costs, (first, *between, last))
    between = [between[k] for k in order]
    found = _plan_over(costs, (first, *between, last))
    clock.append(time.monotonic())
    spent = np.round(np.diff(clock), 3).tolist()
    seconds = dict(zip(("load", "locate", "plan"), spent, strict=True))
    log.info(found.reason if isinstance(found, Rejected) else f"a path of {found.length_m:.2f} m")
    return PlanAnswer(found, (first, last), costs, seconds, (), tuple(between), order)


def remember_path(folder: MapFolder, answer: PlanAnswer) -> str | None:
    """Make a path that was found the map's last one; why not, where the map cannot be written."""
    if answer.found is None:
        return None
    try:
        folder.write_planned(answer.as_dict())
    except OSError as error:
        return f"the path could not be remembered in {folder.root}: {error.strerror}"
    return None


def map_uncertainty_m(optimised: OptimisedMap) -> float:
    """How far the map's surfaces may be off, one standard deviation: 0 where it is not known.

    Medians of the landmarks' and of the keyframes' variances, per axis, added up: a landmark's
    says how well it stands to the keyframes, a keyframe's how well that stands in the map.
    """
    position = np.einsum("kii->k", optimised.keyframe_covariance[:, 3:, 3:]) / 3
    landmarks = optimised.landmarks.sigma_m.astype(float) ** 2
    variances = [
        np.median(v[np.isfinite(v)]) for v in (position, landmarks) if np.isfinite(v).any()
    ]
    return float(np.sqrt(sum(variances)))


def _floor_pose(folder: MapFolder, place: Place, locate: Locate) -> FloorPose | Rejected:
    """Where a place is on the floor; why that is not known, where a photo was not located."""
    if isinstance(place, Rejected):
        return place
    if isinstance(place, tuple):
        return FloorPose(place)
    if isinstance(place, np.ndarray):
        return _seen_from(folder, place, "the photo")
    if place == CURRENT:
        return _seen_from(folder, _current(folder), "the current photo")
    point = point_of(str(place))
    if point is not None:
        return FloorPose(point)
    if isinstance(place, str) and not Path(place).exists():
        named = _named(folder, place)
        if named is not None:
            return named
    T_world_camera = locate(Path(place))
    if isinstance(T_world_camera, Rejected):
        return Rejected(f"the photo {place} was not located: {T_world_camera.reason}")
    return _seen_from(folder, T_world_camera, f"the photo {place}")


def elsewhere(folder: MapFolder, T_world_camera: Array) -> str:
    """Why a camera is not over the floor that the map's grid is of; empty where it is.

    Also where the map's heights are in doubt.
    """
    floor_m = float(folder.settings("fuse").get("fuse", {}).get("floor_m", 0.0))
    height_m = float(T_world_camera[2, 3]) - floor_m
    if is_over_floor(height_m) or load_optimised(folder).world.doubt:
        return ""
    return (
        f"was taken on another storey, {abs(height_m):.1f} m {'above' if height_m > 0 else 'below'}"
        f" the floor of the grid, which is at {floor_m:g} m; 'vnav fuse' makes a grid of another"
        " floor with --set fuse.floor_m=..., and says at which height there is one"
    )


def _named(folder: MapFolder, name: str) -> FloorPose | None:
    """A goal of that name; None where the map has no places at all, and it looks like a file's."""
    places = load_places(folder)
    if not places and Path(name).suffix:
        return None
    found = places.get(name)
    if found is None or found.kind != GOAL:
        goals = [known for known, place in places.items() if place.kind == GOAL]
        raise MapError(
            f"expected X,Y, a photo's file or the name of a goal of {folder.root}, found '{name}';"
            f" {known_names(goals)}"
        )
    goal = require_placed(folder, name, found)
    x, y = goal.points_m[0].tolist()
    return FloorPose((x, y), goal.yaw_rad)


def _current(folder: MapFolder) -> Array:
    pose = (folder.current() or {}).get("T_world_camera")
    if not is_kind(pose, PoseNote):
        raise MapError(
            f"expected a photo located alone in {folder.root} as it is now, found none; run"
            f" 'vnav locate PHOTO --map {folder.root}' with one photo, or say where from with"
            " --from PHOTO or --from X,Y"
        )
    return np.array(pose, float)


def _seen_from(folder: MapFolder, T_world_camera: Array, what: str) -> FloorPose | Rejected:
    reason = elsewhere(folder, T_world_camera)
    if reason:
        return Rejected(f"{what} {reason}")
    x, y = T_world_camera[:2, 3].tolist()
    return FloorPose((x, y), heading_rad(T_world_camera))


def _cheapest_order(costs: Costmap, places: Sequence[FloorPose | Rejected]) -> tuple[int, ...]:
    """How places between the first and the last are visited; as they are, where one is unknown."""
    if len(places) - 2 > MOST:
        raise VnavError(f"expected {MOST} places to visit at most, found {len(places) - 2}")
    points = [place.point for place in places if isinstance(place, FloorPose)]
    if len(points) < len(places):
        return tuple(range(len(places) - 2))
    start, *visits, goal = points
    return best_order(costs, start, visits, goal)


def _plan_over(costs: Costmap, places: Sequence[FloorPose | Rejected]) -> Plan | Rejected:
    """The path from the first place over the others to the last; why there is none."""
    known = list[FloorPose]()
    for place in places:
        if isinstance(place, Rejected):
            return place
        known.append(place)
    start, *via, goal = known
    over = [each.point for each in via]
    return plan_path(costs, start.point, goal.point, final_yaw_rad=goal.yaw_rad, via=over)


def _plain_place(place: NarrowPlace | None) -> dict[str, Any] | None:
    if place is None:
        return None
    return {"at": list(place.at), "width_m": place.width_m, "needed_m": place.needed_m}


def _plain(place: FloorPose | Rejected, point: SnappedPoint | None) -> dict[str, Any]:
    return {
        "asked": list(place.point) if isinstance(place, FloorPose) else None,
        "snapped": list(point.snapped) if point else None,
        "moved_m": point.moved_m if point else None,
    }

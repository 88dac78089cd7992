"""A path from one place in a map to another: claims 1 and 5."""

import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from vnav.config import Config, PlanConfig
from vnav.core.frame import Rejected
from vnav.core.grid import Grid
from vnav.core.mapping import OptimisedMap
from vnav.errors import MapError, VnavError
from vnav.io.formats.grid_files import read_grid
from vnav.io.store.artifacts import load_optimised
from vnav.io.store.map_folder import MapFolder, write_text
from vnav.planning.ends import End, Point
from vnav.planning.planner import Plan, heading_rad, plan_path

if TYPE_CHECKING:
    from vnav.stages.locate import Locator

CURRENT = "current"
Locate = Callable[[Path], NDArray[np.float64] | Rejected]  # a photo's T_world_camera


@dataclass(frozen=True)
class PlanEnd:
    """A point on the floor and, where a photo was taken there, its heading."""

    point: Point
    yaw_rad: float | None = None


@dataclass(frozen=True)
class PlanAnswer:
    """A path, or why there is none; ``places`` are start and goal as far as they are known."""

    plan: Plan | Rejected
    places: tuple[PlanEnd | Rejected, PlanEnd | Rejected]
    grid: Grid
    uncertainty_m: float
    seconds: dict[str, float]

    def as_dict(self) -> dict[str, Any]:
        """Plain values for JSON; null for what is not known."""
        plan = self.plan if isinstance(self.plan, Plan) else None
        clearance_m = plan.clearance_min_m if plan else np.inf
        ends = (plan.start, plan.goal) if plan else (None, None)
        start, goal = (_plain(*each) for each in zip(self.places, ends, strict=True))
        return {
            "found": plan is not None,
            "reason": self.plan.reason if isinstance(self.plan, Rejected) else None,
            "path_m": plan.poses.tolist() if plan else [],
            "length_m": plan.length_m if plan else None,
            "clearance_min_m": clearance_m if np.isfinite(clearance_m) else None,
            "start": start,
            "goal": goal,
            "expanded": plan.expanded if plan else None,
            "seconds": self.seconds,
        }


def plan(
    folder: MapFolder, start: str, goal: str, config: PlanConfig, locate: Locate
) -> PlanAnswer:
    """A path between two places, each ``current``, ``X,Y`` in metres or the file of a photo.

    ``current`` is the pose of this map's last located photo, which is left as it is. The last yaw
    of the path is where the goal's photo looks. MapError where the map has no grid or no current
    pose; whatever ``locate`` raises for a photo that cannot be read.
    """
    clock = [time.monotonic()]
    grid = read_grid(folder.stage("fuse") / "grid.yaml")
    uncertainty_m = min(map_uncertainty_m(load_optimised(folder)), config.max_uncertainty_m)
    clock.append(time.monotonic())
    places = _place(folder, start, locate), _place(folder, goal, locate)
    clock.append(time.monotonic())
    found = _between(places, grid, uncertainty_m, config)
    clock.append(time.monotonic())
    spent = np.round(np.diff(clock), 3).tolist()
    seconds = dict(zip(("load", "locate", "plan"), spent, strict=True))
    return PlanAnswer(found, places, grid, uncertainty_m, seconds)


def photo_locator(
    folder: MapFolder, config: Config, camera: Path | str | None, warn: Callable[[str], None]
) -> Locate:
    """Find photos in a map, which is loaded with the first of them; what is found is not kept.

    ``camera``: of all photos, a camera.toml or "auto"; None where each has its own. ``warn`` is
    told what is doubtful about a photo's camera.
    """

    @cache
    def locator() -> "Locator":
        from vnav.stages.locate import Locator

        return Locator(folder, config, camera)

    def locate(photo: Path) -> NDArray[np.float64] | Rejected:
        answer = locator().locate(photo)
        for warning in answer.warnings:
            warn(warning)
        return answer.best.view.T_world_camera if answer.best else Rejected(answer.reason)

    return locate


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


def summary(answer: PlanAnswer, start: str, goal: str) -> list[str]:
    """Lines for a person."""
    if isinstance(answer.plan, Rejected):
        return [f"no path: {answer.plan.reason}"]
    found = answer.plan
    lines = [f"path       {found.length_m:.2f} m, {len(found.poses)} points"]
    if np.isfinite(found.clearance_min_m):
        lines.append(f"clearance  {found.clearance_min_m:.2f} m at least")
    for name, text, end in (("start", start, found.start), ("goal", goal, found.goal)):
        moved = f", moved {end.moved_m:.2f} m to {_text(end.snapped)}" if end.moved_m else ""
        lines.append(f"{name:11}{_text(end.asked)}{moved}  {text}")
    return lines


def write_csv(path: Path, plan: Plan) -> None:
    """Write a header and a line x,y,yaw for each pose: metres, radians."""
    rows = "".join(f"{x:.6f},{y:.6f},{yaw:.6f}\n" for x, y, yaw in plan.poses)
    try:
        write_text(path, f"x,y,yaw\n{rows}")
    except OSError as error:
        raise VnavError(
            f"expected to write {path}, found: {error.strerror}; name another file with --csv"
        ) from error


def _place(folder: MapFolder, text: str, locate: Locate) -> PlanEnd | Rejected:
    if text == CURRENT:
        return _seen_from(_current(folder))
    point = _point(text)
    if point is not None:
        return PlanEnd(point)
    T_world_camera = locate(Path(text))
    if isinstance(T_world_camera, Rejected):
        return Rejected(f"the photo {text} was not located: {T_world_camera.reason}")
    return _seen_from(T_world_camera)


def _point(text: str) -> Point | None:
    """Two finite numbers with a comma between them, else None."""
    try:
        x, y = (float(word) for word in text.split(","))
    except ValueError:
        return None
    return (x, y) if np.isfinite([x, y]).all() else None


def _current(folder: MapFolder) -> NDArray[np.float64]:
    pose = folder.current()
    if pose is None:
        raise MapError(
            f"expected a photo located in {folder.root} as it is now, found none; run"
            f" 'vnav locate PHOTO --map {folder.root}' first, or say where from with"
            " --from PHOTO or --from X,Y"
        )
    return np.array(pose["T_world_camera"], float)


def _seen_from(T_world_camera: NDArray[np.float64]) -> PlanEnd:
    x, y = T_world_camera[:2, 3].tolist()
    return PlanEnd((x, y), heading_rad(T_world_camera))


def _between(
    places: tuple[PlanEnd | Rejected, PlanEnd | Rejected],
    grid: Grid,
    uncertainty_m: float,
    config: PlanConfig,
) -> Plan | Rejected:
    start, goal = places
    if isinstance(start, Rejected):
        return start
    if isinstance(goal, Rejected):
        return goal
    return plan_path(
        grid,
        start.point,
        goal.point,
        config,
        uncertainty_m=uncertainty_m,
        final_yaw_rad=goal.yaw_rad,
    )


def _plain(place: PlanEnd | Rejected, end: End | None) -> dict[str, Any]:
    return {
        "asked": list(place.point) if isinstance(place, PlanEnd) else None,
        "snapped": list(end.snapped) if end else None,
        "moved_m": end.moved_m if end else None,
    }


def _text(point: Point) -> str:
    return f"({point[0]:.2f}, {point[1]:.2f})"

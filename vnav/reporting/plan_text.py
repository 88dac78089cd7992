"""What is said of a path: for people, and as a table for other programs."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from vnav.core.frame import Rejected
from vnav.errors import VnavError
from vnav.io.files import write_text
from vnav.planning.planner import Plan
from vnav.planning.snapping import Point
from vnav.stages.plan import PlanAnswer

FRAME = "map"  # ROS' name for the world of a map


def summary(answer: PlanAnswer, start: str, goal: str, via: Sequence[str] = ()) -> list[str]:
    """Lines for a person; what was asked for is told as it was."""
    if isinstance(answer.plan, Rejected):
        return [f"no path: {answer.plan.reason}"]
    found = answer.plan
    lines = [f"path       {found.length_m:.2f} m, {len(found.poses)} points"]
    if np.isfinite(found.clearance_min_m):
        lines.append(f"clearance  {found.clearance_min_m:.2f} m at least")
    if found.walked_m:
        lines.append(f"walked     {found.walked_m:.2f} m of it, over floor that no frame shows")
    over = (("via", via[k], end) for k, end in zip(answer.order, found.via, strict=True))
    ends = (("start", start, found.start), *over, ("goal", goal, found.goal))
    for name, text, end in ends:
        moved = f", moved {end.moved_m:.2f} m to {_text(end.snapped)}" if end.moved_m else ""
        lines.append(f"{name:11}{_text(end.asked)}{moved}  {text}")
    return lines


def write_csv(path: Path, plan: Plan) -> None:
    """Write a header and a line x,y,yaw for each pose: metres, radians."""
    rows = "".join(f"{x:.6f},{y:.6f},{yaw:.6f}\n" for x, y, yaw in plan.poses)
    _write(path, f"x,y,yaw\n{rows}", "--csv")


def write_ros_path(path: Path, plan: Plan) -> None:
    """Write a message nav_msgs/Path as YAML, as 'ros2 topic pub' takes it and Nav2 follows it.

    Frame "map", that of grid.yaml; metres; no time, as for a path that is given now. Fields are
    those of docs.ros.org, package nav_msgs.
    """
    header = f"{{stamp: {{sec: 0, nanosec: 0}}, frame_id: {FRAME}}}"
    lines = [f"header: {header}", "poses:"]
    for x, y, yaw in plan.poses.tolist():
        position = f"{{x: {x:.6f}, y: {y:.6f}, z: 0.0}}"
        turned = f"{{x: 0.0, y: 0.0, z: {np.sin(yaw / 2):.9f}, w: {np.cos(yaw / 2):.9f}}}"
        lines.append(f"- header: {header}")
        lines.append(f"  pose: {{position: {position}, orientation: {turned}}}")
    _write(path, "\n".join([*lines, ""]), "--yaml")


def _write(path: Path, text: str, option: str) -> None:
    try:
        write_text(path, text)
    except OSError as error:
        raise VnavError(
            f"expected to write {path}, found: {error.strerror}; name another file with {option}"
        ) from error


def _text(point: Point) -> str:
    return f"({point[0]:.2f}, {point[1]:.2f})"

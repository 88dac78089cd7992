"""The whole chain on a rendered apartment, and how true its answers are."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from vnav.config import Config
from vnav.core import se3
from vnav.core.arrays import Array
from vnav.core.frame import Rejected
from vnav.core.grid import OCCUPIED, Grid
from vnav.core.progress import Progress, silent
from vnav.core.report import Report
from vnav.evaluation import metrics
from vnav.evaluation.score import Score, score
from vnav.io.formats.grid_files import read_grid
from vnav.io.formats.trajectories import read_photo_poses, read_tum
from vnav.io.sources.open_capture import open_capture
from vnav.io.store.artifacts import load_trajectory
from vnav.io.store.map_folder import MapFolder
from vnav.io.store.map_lock import only_writer
from vnav.localisation.verdict.answer import PhotoAnswer
from vnav.pipeline.build import build_map
from vnav.planning.planner import Plan
from vnav.reporting import map_page as report
from vnav.reporting import overlay, plan_picture
from vnav.stages import plan
from vnav.stages.locate import Locator, locate, remember
from vnav.synthetic.rendered_capture import DEMO, CaptureSpec, cached_capture

TRUTH = "photos/groundtruth.txt"
STEP_M = 0.01  # along a path, where its clearance is measured


@dataclass(frozen=True)
class Demo:
    """What was made and answered; ``photos`` in order, ``ends`` the two that the path joins."""

    capture: Path
    folder: MapFolder
    reports: list[Report]
    photos: list[PhotoAnswer]
    ends: tuple[PhotoAnswer, PhotoAnswer]
    path: plan.PlanAnswer

    @property
    def succeeded(self) -> bool:
        """Whether both photos were located and joined by a path."""
        return isinstance(self.path.plan, Plan)


def run(
    out: Path,
    config: Config,
    *,
    spec: CaptureSpec = DEMO,
    cache: Path | None = None,
    progress: Progress = silent,
) -> Demo:
    """Render a capture, map it, locate its photos, plan a path between the two farthest apart.

    Writes the map to ``out``/map, photo.jpg and path.png beside it. What is there and up to date
    is kept. MapError where ``out`` cannot be written.
    """
    capture = cached_capture(spec, cache, progress)
    with only_writer(out / "map"):
        folder = MapFolder.create(out / "map")
        source = open_capture(capture, config.capture)
        reports = build_map(folder, source, config, progress=progress)
        report.write(folder)

    locator = Locator.open(folder, config)
    files = sorted((capture / "photos").glob("*.jpg"))
    photos = [a for a in locate(locator, files, progress=progress) if isinstance(a, PhotoAnswer)]
    ends = _farthest_apart(photos, read_photo_poses(capture / TRUTH))
    remember(folder, ends[0])
    overlay.draw(ends[0], locator.database, out / "photo.jpg")

    poses = {answer.path: _pose(answer) for answer in ends}
    start, goal = (str(answer.path) for answer in ends)
    path = plan.plan(folder, start, goal, config.plan, poses.__getitem__)
    plan_picture.write_picture(out / "path.png", path)
    return Demo(capture, folder, reports, photos, ends, path)


def truth(demo: Demo) -> list[str]:
    """Lines that say how far the map, the photos and the path are from what was rendered."""
    scored = score(load_trajectory(demo.folder), read_tum(demo.capture / "groundtruth.txt"), 0.02)
    return [
        _about_map(scored),
        _about_photos(demo, scored.ate.T_truth_world),
        _about_path(demo, scored.ate.T_truth_world),
    ]


def clearance_m(path: Array, T_truth_world: Array, grid: Grid) -> float:
    """Distance between a path (K, 2 or more: x, y) of the map and what the true grid has occupied.

    Measured to the cells' nearest edges; infinite on a grid without obstacles, 0 inside one.
    """
    steps = np.hypot(*np.diff(path[:, :2], axis=0).T)
    along = np.append(0.0, np.cumsum(steps))
    at = np.arange(0, along[-1] + STEP_M, STEP_M)
    points = np.stack([np.interp(at, along, path[:, k]) for k in (0, 1)] + [0 * at], 1)
    xy = se3.transform(T_truth_world, points)[:, None, :2]
    blocked = grid.centres_of(np.argwhere(grid.cells == OCCUPIED))
    gaps = np.maximum(np.abs(xy - blocked) - grid.resolution_m / 2, 0)
    return float(np.hypot(gaps[..., 0], gaps[..., 1]).min(initial=np.inf))


def _about_map(scored: Score) -> str:
    ate = scored.ate
    return (
        f"map     {scored.pairs} of {scored.truth_poses} frames have a pose, off by"
        f" {1000 * ate.translation_m.rmse:.1f} mm (ATE RMSE) on a walk of {scored.paths_m[0]:.1f} m"
    )


def _about_photos(demo: Demo, T_truth_world: Array) -> str:
    found = [answer for answer in demo.photos if answer.best is not None]
    line = f"photos  {len(found)} of {len(demo.photos)} located"
    if not found:
        return line
    true_poses = read_photo_poses(demo.capture / TRUTH)
    off_m, off_deg = metrics.relocalisation_error(
        [T_truth_world @ a.best.view.T_world_camera for a in found if a.best],
        [true_poses[a.path.name] for a in found],
    )
    return (
        f"{line}, off by {100 * np.median(off_m):.1f} cm and {np.median(off_deg):.2f} deg in the"
        f" median, {100 * off_m.max():.1f} cm and {off_deg.max():.2f} deg at most"
    )


def _about_path(demo: Demo, T_truth_world: Array) -> str:
    found = demo.path.plan
    start, goal = (answer.path.name for answer in demo.ends)
    if isinstance(found, Rejected):
        return f"path    from {start} to {goal}: none, {found.reason}"
    grid = read_grid(demo.capture / "truth" / "grid.yaml")
    return (
        f"path    from {start} to {goal}: {found.length_m:.2f} m, never nearer than"
        f" {clearance_m(found.poses, T_truth_world, grid):.2f} m to what really stands there"
    )


def _pose(answer: PhotoAnswer) -> Array | Rejected:
    return answer.best.view.T_world_camera if answer.best else Rejected(answer.reason)


def _farthest_apart(
    photos: list[PhotoAnswer], true_poses: dict[str, Array]
) -> tuple[PhotoAnswer, PhotoAnswer]:
    positions = np.array([true_poses[answer.path.name][:3, 3] for answer in photos])
    apart = np.linalg.norm(positions[:, None] - positions, axis=-1)
    i, j = np.unravel_index(int(apart.argmax()), apart.shape)
    return photos[i], photos[j]

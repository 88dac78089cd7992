"""A map that is there: what it holds, where photos were taken, and paths on it."""

import dataclasses
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from os import PathLike
from pathlib import Path
from threading import Lock
from typing import TYPE_CHECKING, Any

import numpy as np

from vnav.api.arguments import (
    AnyPath,
    CameraSource,
    ConfigSource,
    PhotoSource,
    PlaceSource,
    config_of,
    photo_camera_of,
    photo_of,
    xy_of,
)
from vnav.config import Config
from vnav.core.arrays import Array
from vnav.core.frame import Rejected
from vnav.core.grid import Grid
from vnav.core.mapping import Landmarks
from vnav.core.places import GOAL, KEEP_OUT, ONE_WAY, LostPlace, NamedPlace
from vnav.core.point_cloud import Mesh, PointCloud
from vnav.core.progress import Progress, silent
from vnav.core.trajectory import Trajectory
from vnav.errors import MapError, PhotoError
from vnav.io.photos.photo_files import PhotoCameraSource, require_readable
from vnav.io.store.map_folder import MapFolder
from vnav.localisation.verdict.answer import PhotoAnswer, UnreadablePhoto

if TYPE_CHECKING:
    from vnav.localisation.database import LandmarkDatabase
    from vnav.pipeline.build import BuiltMap
    from vnav.reporting.map_server import MapServer
    from vnav.stages.locate import Locator
    from vnav.stages.plan import Place, PlanAnswer


class Map:
    """A map in a folder; photos may be located from several threads at once.

    ``built``: what building it has just found, None for a map that was opened. What is read is as
    it is on disk; the index for locating is loaded with the first photo, and kept.
    """

    def __init__(self, folder: MapFolder, built: "BuiltMap | None" = None) -> None:
        self.built = built
        self._folder = folder
        self._lock = Lock()
        self._loaded: Locator | None = None

    def __repr__(self) -> str:
        return f"vnav.open_map({str(self.root)!r})"

    @property
    def root(self) -> Path:
        """The folder."""
        return self._folder.root

    def trajectory(self, capture: int = 0) -> Trajectory:
        """Final poses of a capture's tracked frames; StaleArtifact where there are none yet."""
        from vnav.io.store.artifacts import load_trajectory

        self._folder.stage("optimise")
        if f"trajectory_{capture}.tum" not in self._folder.files("optimise"):
            count = len(self._folder.captures)
            raise MapError(
                f"expected a capture from 0 to {count - 1} of {self.root}, found {capture}"
            )
        return load_trajectory(self._folder, capture)

    def landmarks(self) -> Landmarks:
        """3D points of the map, and which keyframes saw them."""
        from vnav.io.store.artifacts import load_optimised

        return load_optimised(self._folder).landmarks

    def cloud(self) -> PointCloud:
        """The filtered, coloured cloud."""
        from vnav.io.store.artifacts import load_cloud

        return load_cloud(self._folder)

    def mesh(self) -> Mesh:
        """The coloured surface."""
        from vnav.io.store.artifacts import load_mesh

        return load_mesh(self._folder)

    def grid(self) -> Grid:
        """The grid of free, occupied and unknown floor."""
        from vnav.io.store.artifacts import load_grid

        return load_grid(self._folder)

    def config(self) -> Config:
        """The settings that the map was made with; StaleArtifact where it is not finished."""
        from vnav.pipeline.extend import made_with

        return made_with(self._folder)

    def info(self) -> dict[str, Any]:
        """What the map holds, and which of its stages are up to date, as plain values."""
        from vnav.io.store.overview import overview

        return overview(self._folder)

    def locate(
        self,
        photo: PhotoSource,
        *,
        camera: CameraSource = None,
        config: ConfigSource = None,
        remember: bool = False,
    ) -> PhotoAnswer:
        """Where a photo, a file or pixels (H, W, 3) uint8 RGB, was taken, or why that is not known.

        ``camera``: its own, a camera.toml or "auto"; None: camera.toml beside the file, EXIF, the
        map's where the size is the same, else estimated. ``remember`` makes the pose the map's
        current place; what stands against that is in the warnings. PhotoError or CameraError where
        the photo cannot be asked.
        """
        answer = self._locator(config_of(config), photo_camera_of(camera)).locate(photo_of(photo))
        return self._remembered(answer) if remember else answer

    def locate_all(
        self,
        photos: Sequence[AnyPath],
        *,
        camera: CameraSource = None,
        config: ConfigSource = None,
        jobs: int = 0,
        scheduler: str = "",
        remember: bool = False,
        progress: Progress = silent,
    ) -> Iterator[PhotoAnswer | UnreadablePhoto]:
        """Answers in the order of the photos, all cores at work, or shared out among processes.

        ``jobs`` and ``scheduler`` as for `vnav.batch.run`. A photo that cannot be read is named
        with the reason; the others are answered. ``remember`` has the report show the poses.
        """
        if remember:
            from vnav.stages.locate import remembering

            asked: dict[str, Any] = {"camera": camera, "config": config, "progress": progress}
            answers = self.locate_all(photos, jobs=jobs, scheduler=scheduler, **asked)
            return self._keeping_overlays(remembering(self._folder, answers))
        settings, source = config_of(config), photo_camera_of(camera)
        paths = tuple(Path(photo).absolute() if scheduler else Path(photo) for photo in photos)
        if jobs or scheduler:
            from vnav.api.locate_many import LocateTask, share_out

            task = LocateTask(paths, self.root.absolute(), settings, source)
            return share_out(task, jobs=jobs, scheduler=scheduler, progress=progress)
        from vnav.stages.locate import locate

        return locate(self._locator(settings, source), paths, progress=progress)

    def locate_each(
        self,
        photos: Iterable[AnyPath],
        *,
        camera: CameraSource = None,
        config: ConfigSource = None,
        sequence: bool = False,
    ) -> Iterator[PhotoAnswer | UnreadablePhoto]:
        """The answer to each photo before the next is asked for, of a source that may never end.

        The map is loaded at once. A photo that is still being written is waited for. One that
        cannot be asked is named with the reason. ``sequence``: they are taken one after the other,
        and where the ones before were taken helps; what it holds is said to be so.
        """
        from vnav.stages.locate import locate_each

        locator = self._locator(config_of(config), photo_camera_of(camera))
        return locate_each(locator, map(Path, photos), sequence=sequence)

    def plan(
        self,
        start: PlaceSource,
        goal: PlaceSource,
        *,
        via: Sequence[PlaceSource] = (),
        any_order: bool = False,
        camera: CameraSource = None,
        config: ConfigSource = None,
        remember: bool = False,
    ) -> "PlanAnswer":
        """A path from one place to another, over others, or why there is none.

        A place is x, y in metres of the map's world, a located photo, a photo to be located, the
        name of a goal, or "current": where the last remembered photo was taken. The last yaw of the
        path is where the goal's photo looks. ``via`` are passed in turn, or, in ``any_order``, as
        is cheapest: 10 at most. The map's keep-outs are kept out of, its one-ways not driven
        against. The robot is described in ``config``, section plan. ``remember`` has the report
        show the path; what stands against that is in the warnings. MapError where the map has no
        grid, no current place, or no such goal.
        """
        from vnav.stages.plan import plan, remember_path

        settings, warnings = config_of(config), list[str]()

        def pose_of(photo: PhotoSource) -> Array | Rejected:
            answer = self.locate(photo, camera=camera, config=settings)
            warnings.extend(answer.warnings)
            return _pose(answer)

        first, last, *over = (_place(place, pose_of) for place in (start, goal, *via))
        answer = plan(
            self._folder, first, last, settings.plan, pose_of, via=over, any_order=any_order
        )
        problem = remember_path(self._folder, answer) if remember else None
        warnings += [problem] if problem else []
        return dataclasses.replace(answer, warnings=tuple(warnings))

    def places(self) -> dict[str, NamedPlace | LostPlace]:
        """Goals, keep-outs and one-ways by name: where they lie in the map now, or why nowhere."""
        from vnav.io.store.places_file import load_places

        return load_places(self._folder)

    def add_goal(
        self,
        name: str,
        place: PlaceSource,
        *,
        camera: CameraSource = None,
        config: ConfigSource = None,
    ) -> None:
        """Name a goal: x, y, or where a photo was taken, and which way it looks.

        It is tied to the nearest keyframe, and moves with that. PhotoError where the photo is not
        located; MapError where the name is taken, or the map cannot be written.
        """
        from vnav.io.store.places_file import add_place
        from vnav.planning.planner import heading_rad
        from vnav.stages.plan import elsewhere

        xy = xy_of(place)
        if xy:
            return add_place(self._folder, name, GOAL, np.array([xy]))
        if not isinstance(place, PhotoAnswer):
            photo = place if isinstance(place, str | PathLike) else np.asarray(place)
            place = self.locate(photo, camera=camera, config=config)
        T_world_camera = place.T_world_camera
        if T_world_camera is None:
            raise PhotoError(f"expected a photo that shows the map, found none: {place.reason}")
        reason = elsewhere(self._folder, T_world_camera)
        if reason:
            raise PhotoError(f"expected a photo of where the grid is, found one that {reason}")
        point = T_world_camera[None, :2, 3]
        return add_place(self._folder, name, GOAL, point, heading_rad(T_world_camera))

    def keep_out(self, name: str, corners: Sequence[tuple[float, float]]) -> None:
        """Name a polygon of floor, x and y of each corner, that no path enters.

        It is tied to the nearest keyframe, and moves with that; errors as `add_goal`.
        """
        from vnav.io.store.places_file import add_place

        add_place(self._folder, name, KEEP_OUT, _polygon(corners))

    def one_way(
        self, name: str, corners: Sequence[tuple[float, float]], heading_rad: float
    ) -> None:
        """Name a polygon of floor, x and y of each corner, that no path crosses against a heading.

        The heading is counted from x towards y. Errors and what it is tied to are as for
        `keep_out`.
        """
        from vnav.io.store.places_file import add_place

        add_place(self._folder, name, ONE_WAY, _polygon(corners), heading_rad)

    def remove_place(self, name: str) -> None:
        """Forget a goal, a keep-out or a one-way; MapError where there is none of that name."""
        from vnav.io.store.places_file import remove_place

        remove_place(self._folder, name)

    def draw_photo(self, answer: PhotoAnswer, path: AnyPath) -> None:
        """Write a picture of a photo's file with what was found in it, the map beside it."""
        from vnav.reporting import overlay

        overlay.draw(answer, self._database(), Path(path))

    def draw_plan(self, answer: "PlanAnswer", path: AnyPath) -> None:
        """Write a PNG of a path on the grid."""
        from vnav.reporting.plan_picture import write_picture

        write_picture(Path(path), answer)

    def report(self) -> Path:
        """Write reports/report.html, all about the map on one page; where it is."""
        from vnav.reporting import map_page

        return map_page.write(self._folder)

    def server(self, port: int = 0) -> "MapServer":
        """What serves that page, with the whole cloud and surface, to browsers of this machine.

        ``with flat.server() as server``, then ``server.serve_forever()``; ``server.address`` is
        where. ``port`` 0 takes one that is free. MapError where the port cannot be had.
        """
        from vnav.reporting.map_server import MapServer

        return MapServer(self._folder, port)

    def export(
        self, out: AnyPath, wanted: Mapping[str, str | Sequence[str]]
    ) -> dict[str, list[Path]]:
        """Write parts of the map for other programs, {"cloud": "ply"}; the files of each part.

        A part may be wanted in several formats, {"octomap": ["bt", "ot"]}.
        """
        from vnav.io.store.export import export

        forms = {k: (v,) if isinstance(v, str) else v for k, v in wanted.items()}
        return export(self._folder, Path(out), forms)

    def _locator(self, config: Config, camera: PhotoCameraSource) -> "Locator":
        from vnav.stages.locate import Locator

        require_readable(camera)
        with self._lock:
            if self._loaded is None:
                self._loaded = Locator.open(self._folder, config, camera)
            loaded = self._loaded
        return dataclasses.replace(loaded, config=config, camera=camera)

    def _keeping_overlays(
        self, answers: Iterable[PhotoAnswer | UnreadablePhoto]
    ) -> Iterator[PhotoAnswer | UnreadablePhoto]:
        """Answers as they come; the report shows overlays of those that were located."""
        from vnav.reporting.located_photos import keeping_overlays

        return keeping_overlays(self._folder, self._database, answers)

    def _database(self) -> "LandmarkDatabase":
        return self._locator(Config(), None).database

    def _remembered(self, answer: PhotoAnswer) -> PhotoAnswer:
        """The answer, with a warning where the map cannot be written."""
        from vnav.stages.locate import remember

        problem = remember(self._folder, answer)
        if problem is None:
            if answer.located:
                list(self._keeping_overlays([answer]))
            return answer
        return dataclasses.replace(answer, warnings=(*answer.warnings, problem))


def open_map(map_dir: AnyPath = "map") -> Map:
    """The map in a folder; MapError where there is none, or one of another format."""
    return Map(MapFolder.open(Path(map_dir)))


def _place(place: PlaceSource, pose_of: Callable[[PhotoSource], Array | Rejected]) -> "Place":
    """A place as the stage takes it, who is given the poses of answers and of pixels."""
    if isinstance(place, PhotoAnswer):
        return _pose(place)
    if isinstance(place, str):
        return place
    if isinstance(place, PathLike):
        return Path(place)
    return xy_of(place) or pose_of(np.asarray(place))


def _polygon(corners: Sequence[Sequence[float]]) -> Array:
    """Corners (N, 2); MapError where one is no x and y."""
    return np.array([xy_of(tuple(corner)) for corner in corners]).reshape(-1, 2)


def _pose(answer: PhotoAnswer) -> Array | Rejected:
    T_world_camera = answer.T_world_camera
    return Rejected(answer.reason) if T_world_camera is None else T_world_camera

"""Where photos were taken, asked of a finished map: claim 4."""

import dataclasses
import logging
import os
import time
from collections.abc import Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from vnav.checking.quality import BLURRED, DARK, blur
from vnav.compiled import load_compiler
from vnav.config import Config, FeaturesConfig, LocateConfig, updated
from vnav.core.camera import Intrinsics, PhotoCamera
from vnav.core.frame import Features, Frame
from vnav.core.mapping import FrameTable
from vnav.core.progress import Progress, silent
from vnav.errors import CameraError, PhotoError
from vnav.features import FrontEnd, front_end
from vnav.io.photos.arriving import wait_until_written
from vnav.io.photos.photo_files import (
    PhotoCameraSource,
    estimated_camera,
    photo_camera,
    read_photo,
)
from vnav.io.store.artifacts import (
    keyframe_rows,
    load_frame_table,
    load_keyframe,
    recorded_camera,
)
from vnav.io.store.index_file import load_index
from vnav.io.store.map_folder import MapFolder
from vnav.io.store.tree_file import load_tree
from vnav.localisation.database import LandmarkDatabase
from vnav.localisation.localise import localise
from vnav.localisation.photo import prepare
from vnav.localisation.pixels import Pixels
from vnav.localisation.prior import PlacePrior
from vnav.localisation.query import Query, missing_levels
from vnav.localisation.verdict.answer import IMAGE, PhotoAnswer, UnreadablePhoto, summary
from vnav.localisation.verdict.decision import Located, NotLocated
from vnav.localisation.verdict.uncertainty import focal_length_check
from vnav.threads import one_blas_thread

log = logging.getLogger(__name__)

DOUBTFUL = 0.03  # relative error of an assumed focal length that is told, if it is significant
SIGNIFICANT = 3.0  # standard deviations
BRIGHTEST = 0.99  # share of the levels below the one that exposure is told by
UNDEREXPOSED = 128.0  # a photo whose brightest parts are darker


@dataclass(frozen=True)
class Locator:
    """Finds photos in one map, which is loaded once; may be asked from several threads.

    ``camera``: of all photos; a camera.toml, "auto" or intrinsics; None: see `photo_camera`.
    ``loading``: what becomes the ``database``; ``map_cameras``: those that recorded the map's
    captures; ``features``: its settings.
    """

    folder: MapFolder
    loading: Future[LandmarkDatabase]
    map_cameras: tuple[Intrinsics, ...]
    features: FeaturesConfig
    config: Config
    camera: PhotoCameraSource = None

    @classmethod
    def open(cls, folder: MapFolder, config: Config, camera: PhotoCameraSource = None) -> "Locator":
        """Begin to load what is needed of a map; StaleArtifact where it has no index.

        Features of the first photo are found meanwhile.
        """
        folder.stage("index")
        pool = ThreadPoolExecutor(2)
        pool.submit(load_compiler)
        loading = pool.submit(_database, folder)
        pool.shutdown(wait=False)
        cameras = tuple(recorded_camera(folder, k) for k in range(len(folder.captures)))
        recorded = {"features": folder.settings("odometry")["features"]}
        features = updated(Config(), recorded, f"the stage odometry of {folder.root}").features
        return cls(folder, loading, cameras, features, config, camera)

    @property
    def database(self) -> LandmarkDatabase:
        """The map's landmarks and tree, once they are loaded; MapError where they are damaged."""
        return self.loading.result()

    @one_blas_thread
    def locate(
        self, photo: Path | NDArray[np.uint8], prior: PlacePrior | None = None
    ) -> PhotoAnswer:
        """Where a photo, a file or an image (H, W, 3) RGB, was taken.

        ``prior``: where it follows others. PhotoError or CameraError where it cannot be asked.
        """
        clock = [time.monotonic()]
        path = photo if isinstance(photo, Path) else None
        image = read_photo(photo) if isinstance(photo, Path) else photo
        size = image.shape[1], image.shape[0]
        camera = photo_camera(path, size, self.camera, self._map_camera(size))
        clock.append(time.monotonic())
        image = scaled_down(image, self._longest_px(camera.intrinsics))
        features = self._front_end.extract(brightened(image))
        clock.append(time.monotonic())
        query, result = self._asked(features, camera, image, prior)
        if camera.source == "exif" and not _bears_out(result, query):
            camera = estimated_camera(size)
            query, result = self._asked(features, camera, image, prior)
        clock.append(time.monotonic())
        spent = np.round(np.diff(clock), 4).tolist()
        seconds = dict(zip(("read", "features", "search_and_pose"), spent, strict=True))
        answer = _answer(path or IMAGE, image, camera, query, result, seconds)
        answer = dataclasses.replace(answer, prior=prior)
        log.info(summary(answer))
        return answer

    def _asked(
        self,
        features: Features,
        camera: PhotoCamera,
        image: NDArray[np.uint8],
        prior: PlacePrior | None,
    ) -> tuple[Query, Located | NotLocated]:
        """What is asked of a photo's features by a camera, and the answer."""
        prior_of_camera = camera.prior.scaled(image.shape[1], image.shape[0])
        prepared = prepare(features, prior_of_camera, self.database.tree)
        pixels = Pixels(image, prior_of_camera.intrinsics, self.keyframe)
        query = Query(prepared, self.database, self.config.locate, pixels)
        rng = np.random.default_rng(self.config.seed)
        return query, localise(query, rng, prior)

    def keyframe(self, number: int) -> Frame:
        """A keyframe of the map by its number."""
        frames, rows = self._kept
        return load_keyframe(self.folder, rows[number], frames)

    @cached_property
    def _kept(self) -> tuple[FrameTable, list[int]]:
        """Every frame of the map, and the rows of its keyframes."""
        frames = load_frame_table(self.folder)
        return frames, keyframe_rows(self.folder, len(frames.index))

    @cached_property
    def _front_end(self) -> FrontEnd:
        """That of the map, with as many features as are asked of a photo."""
        wanted = dataclasses.replace(self.features, max_features=self.config.locate.max_features)
        return front_end(wanted)

    def _longest_px(self, photo: Intrinsics) -> int:
        """How long the longer side of a photo may be.

        Where features do not know their scale, things must be as large as in the map's images.
        """
        longest = self.config.locate.max_size_px
        if self._front_end.space.has_scales:
            return longest
        return min(longest, round(max(photo.size) * self.map_cameras[0].fx / photo.fx))

    def _map_camera(self, size: tuple[int, int]) -> Intrinsics:
        """The camera of a capture whose images have this size, else the first's."""
        same = [camera for camera in self.map_cameras if camera.size == size]
        return (same or self.map_cameras)[0]


def _database(folder: MapFolder) -> LandmarkDatabase:
    tree = load_tree(folder)
    return LandmarkDatabase(load_index(folder, tree), tree)


def locate(
    locator: Locator, photos: Iterable[Path], *, progress: Progress = silent
) -> Iterator[PhotoAnswer | UnreadablePhoto]:
    """Answers in the order of the photos, as they are found, all cores at work."""
    paths = list(photos)
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        for done, found in enumerate(pool.map(partial(_asked_of, locator), paths), 1):
            progress("locate", done, len(paths))
            yield found


def locate_each(
    locator: Locator, photos: Iterable[Path], *, sequence: bool = False
) -> Iterator[PhotoAnswer | UnreadablePhoto]:
    """The answer to each photo before the next is asked for; those being written are waited for.

    ``sequence``: they are taken one after the other, so that each tells of the next. A map that is
    damaged is told before the first is asked for.
    """
    locator.loading.result()
    prior: PlacePrior | None = None
    for path in photos:
        wait_until_written(path)
        answer = _asked_of(locator, path, prior)
        yield answer
        prior = _prior_after(answer, prior, locator.config.locate) if sequence else None


def _prior_after(
    answer: PhotoAnswer | UnreadablePhoto, before: PlacePrior | None, config: LocateConfig
) -> PlacePrior | None:
    """What a photo tells of the next one; the longer none was located, the farther it may be."""
    if isinstance(answer, UnreadablePhoto) or isinstance(answer.result, NotLocated):
        return before and before.after_another()
    name, view, sure = str(answer.path), answer.result.best.view, answer.result.confidence
    if before:
        return before.after(name, view, sure, alone=not answer.held_by_prior)
    return PlacePrior(name, view.centre_world, sure, config.sequence_step_m)


def _asked_of(
    locator: Locator, path: Path, prior: PlacePrior | None = None
) -> PhotoAnswer | UnreadablePhoto:
    """The answer, also where the photo cannot be asked."""
    try:
        return locator.locate(path, prior)
    except (PhotoError, CameraError) as error:
        return UnreadablePhoto(path, str(error))


def remember(folder: MapFolder, answer: PhotoAnswer | UnreadablePhoto) -> str | None:
    """Make a located photo the map's current pose; why not, where the map cannot be written."""
    if isinstance(answer, UnreadablePhoto) or answer.best is None:
        return None
    try:
        folder.write_current(answer.as_dict())
    except OSError as error:
        return f"the pose could not be remembered in {folder.root}: {error.strerror}"
    return None


def remembering(
    folder: MapFolder, answers: Iterable[PhotoAnswer | UnreadablePhoto]
) -> Iterator[PhotoAnswer | UnreadablePhoto]:
    """Answers as they come; after the last, the photos that were located become the map's photos.

    A map that cannot be written is told in the log.
    """
    located = list[dict[str, Any]]()
    for answer in answers:
        yield answer
        if answer.located:
            told = answer.as_dict()
            located.append({key: told[key] for key in ("photo", "T_world_camera", "intrinsics")})
    try:
        folder.write_photos(located)
    except OSError as error:
        log.warning(f"the poses could not be remembered in {folder.root}: {error.strerror}")


def scaled_down(image: NDArray[np.uint8], longest_px: int) -> NDArray[np.uint8]:
    """The image, made smaller where its longer side is longer than that."""
    height, width = image.shape[:2]
    factor = longest_px / max(height, width)
    if factor >= 1:
        return image
    size = max(1, round(width * factor)), max(1, round(height * factor))
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), np.uint8)


def brightened(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """An underexposed photo as bright as its brightest parts allow; any other as it is."""
    counts = cv2.calcHist([image.reshape(len(image), -1)], [0], None, [256], (0, 256)).ravel()
    high = int(np.searchsorted(counts.cumsum(dtype=float), BRIGHTEST * image.size))
    if not 0 < high < UNDEREXPOSED:
        return image
    return np.asarray(cv2.convertScaleAbs(image, alpha=UNDEREXPOSED / high), np.uint8)


def _answer(
    path: Path,
    image: NDArray[np.uint8],
    camera: PhotoCamera,
    query: Query,
    result: Located | NotLocated,
    seconds: dict[str, float],
) -> PhotoAnswer:
    warnings = missing_levels(query.config, query.database.tree)
    if isinstance(result, NotLocated):
        reason = result.reason + _flaw(image)
        return PhotoAnswer(path, query.photo, camera, result, reason, warnings, seconds)
    warnings += _doubts(path, result, query) if camera.source == "assumed" else ()
    return PhotoAnswer(path, query.photo, camera, result, "", warnings, seconds)


def _flaw(image: NDArray[np.uint8]) -> str:
    """What is wrong with a photo that was not located, empty where nothing is."""
    gray = np.asarray(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), np.uint8)
    if gray.mean() < DARK:
        return f"; the photo is dark (mean grey level {gray.mean():.0f} of 255)"
    return "; the photo is blurred" if blur(gray) > BLURRED else ""


def _bears_out(result: Located | NotLocated, query: Query) -> bool:
    """Whether a photo was located, by a focal length that its matches alone agree with."""
    if isinstance(result, NotLocated):
        return False
    told, used = query.photo.camera, result.best.view.intrinsics
    factor, sigma = focal_length_check(result.best, query)
    off = np.log(factor * used.fx / told.intrinsics.fx)
    return bool(abs(off) <= SIGNIFICANT * np.hypot(told.focal_sigma, sigma))


def _doubts(path: Path, result: Located, query: Query) -> tuple[str, ...]:
    """A warning where the matches contradict the camera that was assumed."""
    factor, sigma = focal_length_check(result.best, query)
    if abs(np.log(factor)) < max(DOUBTFUL, SIGNIFICANT * sigma):
        return ()
    return (
        f"{path}: taken by the map's camera as it seems by the size, but the focal length rather"
        f" is {factor:.2f} times as long; name the camera with --camera, or --camera auto",
    )

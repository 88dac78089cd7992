"""Photos shared out among processes or machines, each of which loads the map once."""

import logging
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from vnav.config import Config
from vnav.core.progress import Progress, silent
from vnav.core.report import Failed
from vnav.io.photos.photo_files import PhotoCameraSource
from vnav.io.store.map_folder import MapFolder
from vnav.localisation.verdict.answer import PhotoAnswer, UnreadablePhoto
from vnav.stages.locate import Locator, locate

log = logging.getLogger(__name__)
MOST = 16  # photos of one task: loading the map takes about as long as a few of them


@dataclass(frozen=True)
class LocateTask:
    """Some of the photos that one map is asked for; ``camera`` as for `Locator`."""

    photos: tuple[Path, ...]
    map_dir: Path
    config: Config
    camera: PhotoCameraSource

    @property
    def name(self) -> str:
        """For people."""
        return f"{len(self.photos)} from {self.photos[0].name} on"


def share_out(
    task: LocateTask, *, jobs: int = 0, scheduler: str = "", progress: Progress = silent
) -> Iterator[PhotoAnswer | UnreadablePhoto]:
    """Answers in the order of the task's photos, as processes or a Dask cluster find them.

    Photos whose process fails are unreadable, with its reason.
    """
    from vnav import batch

    tasks = [replace(task, photos=share) for share in shares(task.photos, jobs)]
    found: dict[int, list[PhotoAnswer | UnreadablePhoto]] = {}
    done, told = 0, 0  # photos, and tasks whose answers were given
    for k, result in batch.run(locate_photos, tasks, jobs=jobs, scheduler=scheduler):
        found[k] = _unreadable(tasks[k], result) if isinstance(result, Failed) else result
        done += len(found[k])
        progress("locate", done, len(task.photos))
        while told in found:
            yield from found.pop(told)
            told += 1


def shares(photos: Sequence[Path], jobs: int) -> list[tuple[Path, ...]]:
    """The photos in order, shared out evenly among jobs (0: any number), a few at once."""
    size = max(1, min(MOST, math.ceil(len(photos) / max(jobs, 1))))
    return [tuple(photos[k : k + size]) for k in range(0, len(photos), size)]


def locate_photos(
    task: LocateTask, progress: Progress = silent
) -> list[PhotoAnswer | UnreadablePhoto]:
    """Answers in the order of the photos."""
    locator = Locator.open(MapFolder.open(task.map_dir), task.config, task.camera)
    return list(locate(locator, task.photos, progress=progress))


def _unreadable(task: LocateTask, failed: Failed) -> list[PhotoAnswer | UnreadablePhoto]:
    if failed.traceback:
        log.error(failed.traceback)
    return [UnreadablePhoto(path, failed.reason) for path in task.photos]

"""Photos shared out among processes or machines, each of which loads the map once."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from vnav.config import Config
from vnav.core.progress import Progress, silent
from vnav.io.store.map_folder import MapFolder
from vnav.localisation.answer import PhotoAnswer, UnreadablePhoto
from vnav.stages.locate import Locator, locate

MOST = 16  # photos at once: loading the map takes about as long as a few of them


@dataclass(frozen=True)
class LocateTask:
    """Some of the photos that one map is asked for; ``camera`` as for `Locator`."""

    photos: tuple[Path, ...]
    map_dir: Path
    config: Config
    camera: Path | str | None

    @property
    def name(self) -> str:
        """For people."""
        return f"{len(self.photos)} from {self.photos[0].name} on"


def shares(photos: Sequence[Path], jobs: int) -> list[tuple[Path, ...]]:
    """The photos in order, shared out evenly among jobs (0: any number), a few at once."""
    size = max(1, min(MOST, math.ceil(len(photos) / max(jobs, 1))))
    return [tuple(photos[k : k + size]) for k in range(0, len(photos), size)]


def locate_photos(
    task: LocateTask, progress: Progress = silent
) -> list[PhotoAnswer | UnreadablePhoto]:
    """Answers in the order of the photos."""
    locator = Locator(MapFolder.open(task.map_dir), task.config, task.camera)
    return list(locate(locator, task.photos, progress=progress))

"""Small overlays of the photos located last, which a map keeps for its report."""

import logging
from collections.abc import Callable, Iterable, Iterator

import cv2

from vnav.errors import PhotoError
from vnav.io.store.map_folder import MapFolder
from vnav.localisation.database import LandmarkDatabase
from vnav.localisation.verdict.answer import IMAGE, PhotoAnswer, UnreadablePhoto
from vnav.reporting.overlay import over_photo

log = logging.getLogger(__name__)

MOST = 12  # of the photos that are located together
LONGEST_PX = 480
MOST_BYTES = 30_000  # of each, where the lowest quality allows it
QUALITIES = (80, 65, 50, 35, 20)  # of JPEG

Answer = PhotoAnswer | UnreadablePhoto


def keeping_overlays(
    folder: MapFolder, database: Callable[[], LandmarkDatabase], answers: Iterable[Answer]
) -> Iterator[Answer]:
    """Answers as they come; after the last, the map keeps overlays of the first located photos.

    Photos that are no files have none. A map that cannot be written is told in the log.
    """
    kept = list[tuple[str, bytes]]()
    for answer in answers:
        yield answer
        if isinstance(answer, PhotoAnswer) and answer.located and len(kept) < MOST:
            small = _small(answer, database)
            kept += [(answer.path.name, small)] if small else []
    try:
        folder.write_overlays(kept)
    except OSError as error:
        log.info(f"overlays could not be kept in {folder.root}: {error.strerror}")


def _small(answer: PhotoAnswer, database: Callable[[], LandmarkDatabase]) -> bytes:
    """A JPEG of a photo with what was found in it, empty where its file is no longer there."""
    if answer.path == IMAGE:
        return b""
    try:
        drawn = over_photo(answer, database())
    except PhotoError:
        return b""
    factor = min(1.0, LONGEST_PX / max(drawn.shape[:2]))
    small = cv2.resize(drawn, None, fx=factor, fy=factor, interpolation=cv2.INTER_AREA)
    for quality in QUALITIES:
        data = cv2.imencode(".jpg", small, (cv2.IMWRITE_JPEG_QUALITY, quality))[1].tobytes()
        if len(data) <= MOST_BYTES:
            break
    return data

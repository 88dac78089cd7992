"""Photos that are asked about: any size and format, and the camera that took them."""

from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from vnav.core.camera import Intrinsics
from vnav.errors import CaptureError, PhotoError
from vnav.io.camera_file import read_color
from vnav.io.images import read_image

LARGEST_PX = 1600  # of the longer side; larger photos are scaled down before features are found
GUESSED_FOCAL = 1.0  # of the longer side: a phone's wide lens has 0.75, a long one 1.5
FILM_WIDTH_MM = 36.0
SUFFIXES = {".jpg", ".jpeg", ".png", ".bmp", ".tif", ".tiff", ".webp"}


@dataclass(frozen=True)
class PhotoFile:
    """A photo as features are sought in it.

    ``color`` (H, W, 3) uint8 RGB, upright; ``intrinsics`` of that image; ``source``: "camera",
    "camera.toml", "exif", "map" (assumed, as the size is the same) or "auto" (a guess to be
    estimated). ``scale``: its size as a share of the file's.
    """

    path: Path
    color: NDArray[np.uint8]
    intrinsics: Intrinsics
    source: str
    scale: float

    @property
    def is_known(self) -> bool:
        """Whether the intrinsics are more than a guess."""
        return self.source != "auto"


def read_photo(path: Path, camera: str | None, map_camera: Intrinsics) -> PhotoFile:
    """A photo and its camera; PhotoError where it is no image.

    The camera is ``camera`` (a camera.toml, or "auto"), else the camera.toml beside the photo, else
    its EXIF, else the map's where the size is the same, else unknown.
    """
    try:
        color = read_image(path)
    except CaptureError as error:
        raise PhotoError(f"{error}; give a photo as JPEG, PNG, TIFF, BMP or WebP") from error
    height, width = color.shape[:2]
    intrinsics, source = _camera_of(path, (width, height), camera, map_camera)
    scale = min(1.0, LARGEST_PX / max(width, height))
    if scale < 1:
        size = round(width * scale), round(height * scale)
        color = np.asarray(cv2.resize(color, size, interpolation=cv2.INTER_AREA), np.uint8)
        intrinsics = intrinsics.scaled(*size)
    return PhotoFile(path, color, intrinsics, source, scale)


def photos_in(paths: tuple[Path, ...]) -> list[Path]:
    """The files named, and all photos in the folders named; PhotoError where a folder has none."""
    photos: list[Path] = []
    for path in paths:
        if not path.is_dir():
            photos.append(path)
            continue
        inside = sorted(p for p in path.iterdir() if p.suffix.lower() in SUFFIXES)
        if not inside:
            raise PhotoError(f"expected photos in {path}, found none; name files or another folder")
        photos += inside
    return photos


def _camera_of(
    path: Path, size: tuple[int, int], camera: str | None, map_camera: Intrinsics
) -> tuple[Intrinsics, str]:
    if camera == "auto":
        return _guessed(size), "auto"
    if camera is not None:
        return _of_size(read_color(Path(camera)), size, Path(camera)), "camera"
    beside = path.parent / "camera.toml"
    if beside.is_file():
        return _of_size(read_color(beside), size, beside), "camera.toml"
    focal = _exif_focal(path, max(size))
    if focal is not None:
        return replace(_guessed(size), fx=focal, fy=focal), "exif"
    if size == map_camera.size:
        return map_camera, "map"
    return _guessed(size), "auto"


def _guessed(size: tuple[int, int]) -> Intrinsics:
    focal = GUESSED_FOCAL * max(size)
    return Intrinsics(*size, focal, focal, (size[0] - 1) / 2, (size[1] - 1) / 2)


def _of_size(intrinsics: Intrinsics, size: tuple[int, int], where: Path) -> Intrinsics:
    """The camera at the photo's size, where that is the same image scaled."""
    if intrinsics.size == size:
        return intrinsics
    if intrinsics.width * size[1] == intrinsics.height * size[0]:
        return intrinsics.scaled(*size)
    raise PhotoError(
        f"expected a photo of {intrinsics.width}x{intrinsics.height} as {where} says, found"
        f" {size[0]}x{size[1]}; name its own camera with --camera FILE, or --camera auto"
    )


def _exif_focal(path: Path, longer_side: int) -> float | None:
    """Focal length in pixels from the 35 mm equivalent, None where EXIF does not tell."""
    from PIL import ExifTags, Image

    try:
        with Image.open(path) as image:
            tags = image.getexif().get_ifd(ExifTags.IFD.Exif)
    except (OSError, ValueError, SyntaxError):
        return None
    focal_mm = tags.get(ExifTags.Base.FocalLengthIn35mmFilm)
    return float(focal_mm) / FILM_WIDTH_MM * longer_side if focal_mm else None

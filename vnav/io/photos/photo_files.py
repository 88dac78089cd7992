"""Photos: their pixels, and the camera that may have taken them."""

from collections.abc import Iterable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vnav.core.camera import CameraPrior, Intrinsics, PhotoCamera
from vnav.errors import CameraError, CaptureError, PhotoError
from vnav.io.formats.camera_file import read_color
from vnav.io.formats.images import read_image
from vnav.io.photos.exif import read_exif
from vnav.io.photos.heic import is_heic, read_heic

SUFFIXES = (".jpg", ".jpeg", ".png", ".bmp", ".tif", ".tiff", ".webp", ".heic", ".heif")
AUTO = "auto"  # what --camera says where the focal length is to be estimated
EXIF_SIGMA = 0.05  # relative; EXIF rounds to millimetres, and phones crop
CENTRE_SIGMA = 0.01  # of the principal point about the image centre, over the longer side
DISTORTION_SIGMA = 0.05  # of the first radial coefficient; phones straighten their photos
PhotoCameraSource = Path | str | Intrinsics | None  # of a photo: see `photo_camera`
USUAL_FOCAL = 0.8  # of the longer side: 64 degrees of view; only where search starts


def read_photo(path: Path) -> NDArray[np.uint8]:
    """A photo (H, W, 3) uint8, RGB, upright by its EXIF; PhotoError where it cannot be read."""
    if is_heic(path):
        return read_heic(path)
    try:
        return read_image(path)
    except CaptureError as error:
        unreadable = isinstance(error.__cause__, OSError)
        mend = "name another" if unreadable else "photos are JPEG, PNG or HEIC, convert others"
        raise PhotoError(f"{error}; {mend}") from error


def find_photos(paths: Iterable[Path]) -> list[Path]:
    """Files as given, and the images of folders in order of name; PhotoError for an empty one."""
    found: list[Path] = []
    for path in paths:
        if not path.is_dir():
            found.append(path)
            continue
        images = photos_in(path)
        if not images:
            raise PhotoError(f"expected photos in the folder {path}, found none; name another")
        found += images
    return found


def photos_in(folder: Path) -> list[Path]:
    """The images of a folder in order of name; PhotoError where it cannot be read."""
    try:
        return sorted(p for p in folder.iterdir() if p.suffix.lower() in SUFFIXES)
    except OSError as error:
        raise PhotoError(
            f"expected a folder of photos at {folder}, found: {error.strerror}; name another"
        ) from error


def require_readable(camera: PhotoCameraSource) -> None:
    """CameraError where a camera.toml that is named is none, which no photo could be asked with."""
    if isinstance(camera, Path):
        read_color(camera)


def photo_camera(
    path: Path | None, size: tuple[int, int], camera: PhotoCameraSource, of_map: Intrinsics
) -> PhotoCamera:
    """The camera of a photo of this size (width, height); ``path`` None where it has no file.

    ``camera``: a camera.toml, "auto", intrinsics, or None. Without it: camera.toml beside the
    photo, EXIF, the map's camera if the size is the same, else not known. CameraError where the
    camera does not fit the photo.
    """
    if camera is None and path is not None:
        beside = path.parent / "camera.toml"
        camera = beside if beside.is_file() else None
    if camera == AUTO:
        return estimated_camera(size)
    if isinstance(camera, Intrinsics):
        return _exactly(_fitting(camera, "the camera given", path, size), "given")
    if camera is not None:
        return _exactly(_fitting(read_color(Path(camera)), camera, path, size), "file")
    focal = read_exif(path).focal_px(*size) if path is not None and path.is_file() else None
    if focal:
        return _centred(size, focal, EXIF_SIGMA, "exif")
    if of_map.size == size:
        return _exactly(of_map, "assumed")
    return estimated_camera(size)


def _fitting(
    camera: Intrinsics, source: Path | str, photo: Path | None, size: tuple[int, int]
) -> Intrinsics:
    """The camera, scaled to a photo of the same shape."""
    if abs(camera.width * size[1] - camera.height * size[0]) > max(size):
        raise CameraError(
            f"expected a camera for {size[0]} x {size[1]} pixels, the size of"
            f" {photo or 'the image'}, found {camera.width} x {camera.height} in {source}; name"
            " another with --camera, or --camera auto"
        )
    return camera.scaled(*size)


def estimated_camera(size: tuple[int, int]) -> PhotoCamera:
    """A camera of which nothing is known but the size (width, height) of its images."""
    return _centred(size, USUAL_FOCAL * max(size), float("inf"), "estimated")


def _exactly(camera: Intrinsics, source: str) -> PhotoCamera:
    return PhotoCamera(CameraPrior(camera), source)


def _centred(
    size: tuple[int, int], focal_px: float, focal_sigma: float, source: str
) -> PhotoCamera:
    width, height = size
    k = Intrinsics(width, height, focal_px, focal_px, (width - 1) / 2, (height - 1) / 2)
    return PhotoCamera(CameraPrior(k, focal_sigma, CENTRE_SIGMA, DISTORTION_SIGMA), source)

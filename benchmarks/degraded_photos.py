"""Are photos still found, and never wrongly, when they are bad?

    python benchmarks/degraded_photos.py MAP CAPTURE [--every 1] [--record]

asks the map for the capture's photos as they are and spoilt in each way of WAYS, and prints a
table. Right: within 5 cm and 2 degrees; wrong: over 30 cm or 10 degrees. Exit code 1 where one is
wrong. The camera of a photo that is rotated, cropped or scaled is changed with it, or not told.
"""

import argparse
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
from calibrate_confidence import photos_of, true_poses
from numpy.typing import NDArray
from recording import Measurement, add_record_option, missed, record, table

from vnav.config import Config
from vnav.core import se3
from vnav.core.camera import Intrinsics
from vnav.io.formats.camera_file import read_color
from vnav.io.photos.photo_files import AUTO
from vnav.io.store.map_folder import MapFolder
from vnav.localisation.verdict.answer import PhotoAnswer
from vnav.stages.locate import Locator, locate

Image = NDArray[np.uint8]
Spoilt = tuple[
    Image, Intrinsics, NDArray[np.float64]
]  # with the rotation of the new camera in the old


def _same(change: Callable[[Image], Image]) -> Callable[[Image, Intrinsics], Spoilt]:
    return lambda image, k: (change(image), k, np.eye(3))


def _jpeg(image: Image) -> Image:
    _, data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, 15])
    return np.asarray(cv2.imdecode(data, cv2.IMREAD_COLOR), np.uint8)


def _covered(image: Image) -> Image:
    """A black box over the middle, a third of the area."""
    height, width = (round(n / 3**0.5) for n in image.shape[:2])
    top, left = (image.shape[0] - height) // 2, (image.shape[1] - width) // 2
    image = image.copy()
    image[top : top + height, left : left + width] = 0
    return image


def _rotated(image: Image, k: Intrinsics) -> Spoilt:
    camera = Intrinsics(k.height, k.width, k.fy, k.fx, k.height - 1 - k.cy, k.cx)
    R_old_new = np.array([[0.0, 1, 0], [-1, 0, 0], [0, 0, 1]])
    return np.asarray(cv2.rotate(image, cv2.ROTATE_90_CLOCKWISE), np.uint8), camera, R_old_new


def _part(image: Image, k: Intrinsics, corner: tuple[int, int], size: tuple[int, int]) -> Spoilt:
    """From this corner (left, top), of this size (width, height)."""
    (left, top), (width, height) = corner, size
    camera = Intrinsics(width, height, k.fx, k.fy, k.cx - left, k.cy - top)
    return image[top : top + height, left : left + width].copy(), camera, np.eye(3)


def _cropped(image: Image, k: Intrinsics) -> Spoilt:
    """The middle, half of the width and of the height."""
    width, height = k.width // 2, k.height // 2
    return _part(image, k, (width // 2, height // 2), (width, height))


def _cropped_aside(image: Image, k: Intrinsics) -> Spoilt:
    """A part of six to nine tenths of the width and of the height, drawn by the image's sum."""
    rng = np.random.default_rng(int(image.sum()))
    width, height = (int(n * rng.uniform(0.6, 0.9)) for n in k.size)
    left, top = rng.integers(0, [k.width - width + 1, k.height - height + 1]).tolist()
    return _part(image, k, (left, top), (width, height))


def _small(image: Image, k: Intrinsics) -> Spoilt:
    size = 320, round(320 * k.height / k.width)
    small = np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), np.uint8)
    return small, k.scaled(*size), np.eye(3)


WAYS: dict[str, Callable[[Image, Intrinsics], Spoilt]] = {
    "as taken": _same(lambda image: image),
    "darkened to a quarter": _same(lambda image: (image // 4).astype(np.uint8)),
    "blurred by 5 px": _same(lambda image: cv2.GaussianBlur(image, (0, 0), 5).astype(np.uint8)),
    "rotated by 90 deg": _rotated,
    "cropped to half": _cropped,
    "scaled to 320 px": _small,
    "a third covered": _same(_covered),
    "JPEG quality 15": _same(_jpeg),
    "camera unknown": _same(lambda image: image),
    "cropped off the centre, camera unknown": _cropped_aside,
}


def spoil(photos: Sequence[Path], k: Intrinsics, way: str, out: Path) -> NDArray[np.float64]:
    """Write the photos and their camera into a folder; that camera's rotation in the old."""
    for photo in photos:
        image = np.asarray(cv2.imread(str(photo)), np.uint8)
        image, camera, R_old_new = WAYS[way](image, k)
        cv2.imwrite(str(out / f"{photo.stem}.png"), image)
    keys = ("width", "height", "fx", "fy", "cx", "cy")
    values = [f"{key} = {getattr(camera, key)}" for key in keys]
    (out / "camera.toml").write_text("\n".join(["[color]", *values]) + "\n", "utf-8")
    return R_old_new


def errors(
    answers: Iterator[PhotoAnswer],
    truth: dict[str, NDArray[np.float64]],
    R_old_new: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Metres and degrees (N, 2), NaN where a photo was not located."""
    found = []
    for answer in answers:
        true = truth[f"{answer.path.stem}.jpg"] @ se3.make(R_old_new, [0, 0, 0])
        T = se3.inverse(true) @ answer.best.view.T_world_camera if answer.best else None
        off = (
            (np.linalg.norm(T[:3, 3]), np.rad2deg(se3.rotation_angle(T)))
            if T is not None
            else (np.nan,) * 2
        )
        found.append(off)
    return np.array(found)


def measured(name: str, way: str, asked: int, off: NDArray[np.float64]) -> list[Measurement]:
    """Counts of photos spoilt in one way by the errors (N, 2) of those located, and medians."""
    what = f"its photos, {way}"
    right = int(((off[:, 0] <= 0.05) & (off[:, 1] <= 2)).sum())
    wrong = int(((off[:, 0] > 0.30) | (off[:, 1] > 10)).sum())
    found = [
        Measurement(name, what, "asked", asked),
        Measurement(name, what, "answered", len(off)),
        Measurement(name, what, "within 5 cm and 2 deg", right),
        Measurement(name, what, "wrong", wrong, "", "at most 0"),
    ]
    if len(off):
        middle_m, middle_deg = np.median(off, 0).tolist()
        found.append(Measurement(name, what, "median error", 100 * middle_m, "cm"))
        found.append(Measurement(name, what, "median error", middle_deg, "deg"))
    return found


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("map", type=Path)
    parser.add_argument("capture", type=Path)
    parser.add_argument("--every", type=int, default=1, help="take every so many photos only")
    add_record_option(parser)
    options = parser.parse_args(arguments)
    folder = MapFolder.open(options.map)
    truth, locator = true_poses(folder, options.capture), Locator.open(folder, Config())
    photos = photos_of(options.capture)[:: options.every]
    k = read_color(options.capture / "photos" / "camera.toml")
    found: list[Measurement] = []
    for way in WAYS:
        with tempfile.TemporaryDirectory() as out:
            R_old_new = spoil(photos, k, way, Path(out))
            files = sorted(Path(out).glob("*.png"))
            asked = replace(locator, camera=AUTO if way.endswith("camera unknown") else None)
            off = errors(locate(asked, files), truth, R_old_new)  # type: ignore[arg-type]
        off = off[np.isfinite(off[:, 0])]
        found += measured(options.capture.name, way, len(photos), off)
        print(f"{way}: {len(off)} of {len(photos)} located", flush=True)
    print(f"\n{table(found)}")
    if options.record:
        name = f"photos_{options.capture.name}_spoilt"
        record(name, "how often right", found, arguments)
    return int(bool(missed(found)))


if __name__ == "__main__":
    sys.exit(main())

"""Photos in all formats that vnav reads: cut, altered, with EXIF of every kind."""

import os
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from attacks.attempt import Attempt, anything, near
from attacks.ground import replace
from attacks.maps import LOCATE, PLAN, QUICK, drawn
from attacks.mutations import flip, spoilt

Random = np.random.Generator
FORMATS = (".jpg", ".jpg", ".png", ".bmp", ".tif", ".webp", ".heic")
TAGS = (0x0112, 0x8769, 0x920A, 0xA405, 0xA20E, 0xA210, 0xA002, 0xA003, 0x010F)
ORIENTATION = 0x0112
LONG_MAX = 2**32 - 1


def attempt(rng: Random, folder: Path) -> Attempt:
    """A photo that is spoilt, asked where it was taken."""
    hows = (altered, altered, with_exif, other_pixels, no_file, camera_of_photo)
    return hows[rng.integers(len(hows))](rng, folder)


def asked(photo: str, *options: str) -> tuple[str, ...]:
    return ("locate", photo, "--map", "map", "--json", *QUICK, *options)


def pixels_of(folder: Path) -> Any:
    return cv2.imread(str(folder / "photos" / "000.jpg"))


def written(pixels: Any, path: Path) -> None:
    """Write a photo in the format that its name says."""
    if path.suffix == ".heic":
        import pillow_heif

        heif = pillow_heif.from_bytes("BGR", pixels.shape[1::-1], pixels.tobytes())
        heif.save(str(path), quality=90)
    else:
        path.write_bytes(cv2.imencode(path.suffix, pixels)[1].tobytes())


def altered(rng: Random, folder: Path) -> Attempt:
    """Its bytes are not what they were: a pose must be the right one nevertheless."""
    path = folder / "photos" / f"photo{drawn(rng, FORMATS)}"
    written(pixels_of(folder), path)
    how, content = spoilt(path.read_bytes(), rng)
    path.write_bytes(content)
    command = asked(f"photos/{path.name}")
    return Attempt(f"{how} of a {path.suffix}", command, near, reference=LOCATE)


def with_exif(rng: Random, folder: Path) -> Attempt:
    """EXIF that says anything, without a camera beside it."""
    data = (folder / "photos" / "000.jpg").read_bytes()
    how, exif = any_exif(rng)
    segment = b"Exif\0\0" + exif
    replace(
        folder / "photos" / "000.jpg",
        data[:2] + b"\xff\xe1" + struct.pack(">H", len(segment) + 2) + segment + data[2:],
    )
    (folder / "photos" / "camera.toml").unlink()
    turned = f"{ORIENTATION:04x}" in how or "flipped" in how
    judge = anything if turned else near
    return Attempt(f"EXIF {how}", asked("photos/000.jpg"), judge, reference=LOCATE)


def any_exif(rng: Random) -> tuple[str, bytes]:
    """What a TIFF block says, and the block."""
    order = drawn(rng, ["<", ">"])
    head = (b"II*\0" if order == "<" else b"MM\0*") + struct.pack(order + "I", 8)
    tags = sorted(int(t) for t in rng.choice(TAGS, size=rng.integers(1, 6)))
    entries, said = b"", []
    for tag in tags:
        kind, count = drawn(rng, [1, 2, 3, 4, 5, 5, 7, 10, 99]), drawn(rng, [1, 1, 2, LONG_MAX])
        value = drawn(rng, [0, 1, 8, 35, 50, 4000, 65535, LONG_MAX, int(rng.integers(8, 200))])
        entries += struct.pack(order + "HHII", tag, kind, count, value)
        said.append(f"{tag:04x}={kind}:{value}")
    block = head + struct.pack(order + "H", len(tags)) + entries
    block += struct.pack(order + "I", 0) + rng.bytes(64)
    if rng.random() < 0.3:
        return f"{' '.join(said)}, flipped", flip(block, rng)
    return " ".join(said), block


PIXELS: dict[str, Callable[[Any, Random], Any]] = {
    "one pixel": lambda p, rng: p[:1, :1],
    "a row": lambda p, rng: p[:1],
    "a column": lambda p, rng: p[:, :1],
    "20 pixels wide": lambda p, rng: p[:20, :20],
    "black": lambda p, rng: np.zeros_like(p),
    "noise": lambda p, rng: rng.integers(0, 256, p.shape).astype(np.uint8),
    "grey": lambda p, rng: p[..., 0],
    "16 bits": lambda p, rng: p.astype(np.uint16) * 257,
    "with alpha": lambda p, rng: np.dstack([p, p[..., 0]]),
    "mirrored": lambda p, rng: np.ascontiguousarray(p[:, ::-1]),
    "twice as wide": lambda p, rng: np.hstack([p, p]),
    "a strip of 20,000": lambda p, rng: np.tile(p[:2], (1, 50, 1)),
    "a chessboard": lambda p, rng: np.tile(
        np.kron([[0, 255], [255, 0]], np.ones((8, 8))), (20, 30)
    ),
}


def other_pixels(rng: Random, folder: Path) -> Attempt:
    """A photo that is whole, and shows little or nonsense; for planning, too."""
    how = drawn(rng, list(PIXELS))
    pixels = PIXELS[how](pixels_of(folder), rng)
    suffix = drawn(rng, [".png", ".tif"]) if pixels.dtype == np.uint16 else drawn(rng, FORMATS[1:4])
    if pixels.ndim > 2 and pixels.shape[2] == 4:
        suffix = ".png"
    path = folder / "photos" / f"photo{suffix}"
    written(pixels.astype(pixels.dtype if pixels.dtype == np.uint16 else np.uint8), path)
    name = f"photos/{path.name}"
    overlay = ("--overlay", "out/drawn.jpg", "--csv", "out/found.csv")
    way = drawn(rng, [asked(name), asked(name, "--camera", "auto"), asked(name, *overlay)])
    command = drawn(rng, [way, way, (*PLAN[:3], "--from", name, "--to", "2,2", "--json")])
    return Attempt(f"photo: {how} as {suffix}; {' '.join(command)}", command, anything)


def no_file(rng: Random, folder: Path) -> Attempt:
    """Something else in the place of a photo."""
    path = folder / "photos" / drawn(rng, ["photo.jpg", "photo.heic", "photo\x1b[2J.png"])
    changes: dict[str, Callable[[], Any]] = {
        "missing": lambda: None,
        "empty": path.touch,
        "an empty folder": path.mkdir,
        "a pipe": lambda: os.mkfifo(path),
        "a link to /dev/zero": lambda: path.symlink_to("/dev/zero"),
        "a link to itself": lambda: path.symlink_to(path.name),
        "8 GB of nothing": lambda: (path.touch(), os.truncate(path, 2**33)),
        "a text": lambda: path.write_text("no photo"),
        "the head of HEIC": lambda: path.write_bytes(b"\0\0\0\x18ftypheic" + rng.bytes(50)),
        "a JPEG that promises much": lambda: path.write_bytes(
            b"\xff\xd8\xff\xc0\0\x11\x08"
            + b"\xff\xff" * 2
            + b"\x03\x01\x22\0\x02\x11\x01\x03\x11\x01\xff\xd9"
        ),
        "fill bytes": lambda: path.write_bytes(b"\xff\xd8" + b"\xff" * 200_000),
    }
    how = drawn(rng, list(changes))
    changes[how]()
    alone = asked(f"photos/{path.name}")
    command = drawn(rng, [alone, alone, asked("photos")])
    return Attempt(f"photo is {how}: {command[1]!r}", command, anything)


def camera_of_photo(rng: Random, folder: Path) -> Attempt:
    """The camera beside it is spoilt."""
    from attacks.mutations import spoilt_text

    path = folder / "photos" / "camera.toml"
    how, content = spoilt_text(path.read_bytes(), rng)
    replace(path, content)
    return Attempt(f"{how} of a photo's camera", asked("photos/000.jpg"), anything)

"""Makes the pictures of README.md and the tutorial from the demo, as small PNGs.

    python docs/make_pictures.py [--demo DIR]

DIR is the folder that `vnav demo --out` writes; what is missing or stale in it is made.
"""

import argparse
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

import vnav
from vnav.config import Config
from vnav.synthetic import demo

OUT = Path(__file__).parent / "pictures"
WIDTHS_PX = {"trajectory": 760, "cloud": 640, "grid": 640, "path": 760, "overlay": 900}
PHOTOGRAPHIC = {"cloud", "overlay"}
STEP = 17  # between their 16 grey levels a channel: a third of the bytes, and white stays white


def main() -> None:
    """Run the demo where it is not up to date, and write every picture."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--demo", type=Path, default=Path("demo"))
    for name, source in drawn(parser.parse_args().demo).items():
        image = np.asarray(cv2.imread(str(source)), np.uint8)
        small = narrowed(image, WIDTHS_PX[name])
        if name in PHOTOGRAPHIC:
            small = posterised(small)
        cv2.imwrite(str(OUT / f"{name}.png"), small, [cv2.IMWRITE_PNG_COMPRESSION, 9])


def drawn(out: Path) -> dict[str, Path]:
    """The pictures that the demo has drawn, and the overlay of the photo that is its goal."""
    found = demo.run(out, Config())
    vnav.open_map(out / "map").draw_photo(found.ends[1], out / "goal.png")
    of_map = {name: out / "map/reports" / f"{name}.png" for name in ("trajectory", "cloud", "grid")}
    return of_map | {"path": out / "path.png", "overlay": out / "goal.png"}


def narrowed(image: NDArray[np.uint8], width_px: int) -> NDArray[np.uint8]:
    """The image (H, W, 3), shrunk to a width."""
    height_px = round(image.shape[0] * width_px / image.shape[1])
    small = cv2.resize(image, (width_px, height_px), interpolation=cv2.INTER_AREA)
    return np.asarray(small, np.uint8)


def posterised(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """The image with fewer colours, which compresses better."""
    return (np.rint(image / STEP) * STEP).astype(np.uint8)


if __name__ == "__main__":
    main()

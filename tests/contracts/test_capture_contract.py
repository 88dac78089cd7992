"""What every capture reader must hold, whatever the format; a new one adds a row to WRITERS."""

import os
import shutil
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import cv2
import numpy as np
import pytest

from vnav.config import CaptureConfig
from vnav.errors import CaptureError
from vnav.io.sources.capture import FORMATS, Capture, open_capture

FRAMES = 5
WIDTH, HEIGHT = 32, 24
CAMERA = """
[color]
width = 32
height = 24
fx = 30.0
fy = 30.0
cx = 15.5
cy = 11.5
distortion = [0.1, -0.05, 0.001, 0.001]
[depth]
units_per_metre = 1000
fx = 33.0
fy = 33.0
cx = 15.5
cy = 11.5
T_color_depth = [[1, 0, 0, -0.02], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
"""


def images(k: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(k)
    color = rng.integers(0, 256, (HEIGHT, WIDTH, 3), np.uint8)
    depth = np.full((HEIGHT, WIDTH), 2000 + 10 * k, np.uint16) + rng.integers(0, 9, dtype=np.uint16)
    depth[:4, :4] = 0
    return color, depth


def write(root: Path, k: int, color_name: str, depth_name: str) -> None:
    for name, image in zip((color_name, depth_name), images(k), strict=True):
        (root / name).parent.mkdir(exist_ok=True)
        cv2.imwrite(str(root / name), image)


def write_tum(root: Path) -> None:
    for k in range(FRAMES):
        write(root, k, f"rgb/{1 + k / 10:.6f}.png", f"depth/{1.004 + k / 10:.6f}.png")
    for kind, first in (("rgb", 1.0), ("depth", 1.004)):
        stamps = [f"{first + k / 10:.6f}" for k in range(FRAMES)]
        (root / f"{kind}.txt").write_text("".join(f"{s} {kind}/{s}.png\n" for s in stamps))


def write_seven_scenes(root: Path) -> None:
    for k in range(FRAMES):
        write(root, k, f"frame-{k:06d}.color.png", f"frame-{k:06d}.depth.png")


def write_color_depth(root: Path) -> None:
    for k in range(FRAMES):
        write(root, k, f"color/{k:05d}.png", f"depth/{k:05d}.png")


WRITERS: dict[str, Callable[[Path], None]] = {
    "TUM RGB-D": write_tum,
    "7-Scenes": write_seven_scenes,
    "colour and depth folders": write_color_depth,
}


@pytest.fixture(params=WRITERS)
def root(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    folder = tmp_path / "capture"
    folder.mkdir()
    WRITERS[request.param](folder)
    (folder / "camera.toml").write_text(CAMERA)
    return folder


@pytest.fixture
def capture(root: Path) -> Capture:
    return opened(root)


def opened(root: Path) -> Capture:
    return open_capture(root, CaptureConfig())


def depth_file(capture: Capture, index: int) -> Path:
    return capture.frames.pairs[index].depth.path


def test_every_format_is_held_to_this() -> None:
    assert [reader.NAME for reader in FORMATS] == list(WRITERS)


def test_frames_are_counted_named_and_in_order_of_time(capture: Capture) -> None:
    assert capture.name == "capture"
    assert len(capture) == FRAMES
    stamps = [capture.stamp_s(k) for k in range(FRAMES)]
    assert stamps == sorted(set(stamps))


def test_a_frame_is_colour_in_bytes_and_depth_in_metres_that_cannot_be_changed(
    capture: Capture,
) -> None:
    frame = capture.read(3)
    assert (frame.index, frame.stamp_s) == (3, capture.stamp_s(3))
    assert frame.color.shape == (HEIGHT, WIDTH, 3)
    assert frame.color.dtype == np.uint8
    assert frame.depth_m.shape == (HEIGHT, WIDTH)
    assert frame.depth_m.dtype == np.float32
    assert np.median(frame.depth_m[frame.depth_m > 0]) == pytest.approx(2.034, abs=0.005)
    assert not frame.color.flags.writeable
    assert not frame.depth_m.flags.writeable


def test_colour_is_undistorted_and_depth_registered(capture: Capture) -> None:
    color, depth = images(0)
    frame = capture.read(0)
    assert (frame.color != color[..., ::-1]).mean() > 0.5
    # Where colour sees beyond the depth camera's narrower view there is nothing.
    assert not frame.depth_m[:, -1].any()
    assert (frame.depth_m > 0).mean() < (depth > 0).mean()


def test_threads_read_the_same_frames(root: Path, capture: Capture) -> None:
    alone = [capture.read(k) for k in range(FRAMES)]
    with ThreadPoolExecutor(8) as pool:
        together = list(pool.map(opened(root).read, [k % FRAMES for k in range(4 * FRAMES)]))
    for k, frame in enumerate(together):
        np.testing.assert_array_equal(frame.color, alone[k % FRAMES].color)
        np.testing.assert_array_equal(frame.depth_m, alone[k % FRAMES].depth_m)


def test_a_damaged_file_is_named_and_the_other_frames_are_read(capture: Capture) -> None:
    for damaged in (capture.frames.pairs[1].color.path, depth_file(capture, 2)):
        damaged.write_bytes(damaged.read_bytes()[:-30])
    depth_file(capture, 3).unlink()
    for index, kind in ((1, "color"), (2, "depth"), (3, "depth")):
        with pytest.raises(CaptureError) as error:
            capture.read(index)
        assert str(getattr(capture.frames.pairs[index], kind).path) in str(error.value)
    assert capture.read(4).depth_m.any()


def test_an_image_of_another_size_is_named(capture: Capture) -> None:
    path = depth_file(capture, 1)
    cv2.imwrite(str(path), np.ones((8, 8), np.uint16))
    with pytest.raises(CaptureError, match=f"expected 32 x 24 pixels in {path}.*found 8 x 8"):
        capture.read(1)


def test_the_fingerprint_is_that_of_the_content_wherever_it_lies(
    root: Path, capture: Capture
) -> None:
    copy = root.parent / "elsewhere"
    shutil.copytree(root, copy)
    os.utime(copy / "camera.toml", (0, 0))
    (copy / "notes.txt").write_text("not part of the frames")
    assert opened(copy).fingerprint() == capture.fingerprint()


def test_the_fingerprint_changes_with_an_image_and_with_the_camera(
    root: Path, capture: Capture
) -> None:
    before = capture.fingerprint()
    write_camera = (root / "camera.toml").write_text
    write_camera(CAMERA.replace("cx = 15.5", "cx = 15.6"))
    assert opened(root).fingerprint() != before
    write_camera(CAMERA)
    assert opened(root).fingerprint() == before
    path = depth_file(capture, 2)
    path.write_bytes(path.read_bytes() + b"\0")
    assert opened(root).fingerprint() != before

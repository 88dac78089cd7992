from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

import vnav as library
from vnav.core.frame import Frame
from vnav.errors import CaptureError
from vnav.io.sources.capture import Capture
from vnav.reporting import depth_picture
from vnav.reporting.depth_picture import DIMMED, EDGE, TITLE_PX, draw

Run = Callable[..., tuple[int, str, str]]
WIDTH, HEIGHT, COUNT = 480, 60, 20


@pytest.fixture
def capture() -> Capture:
    """A near box on a wall, grey; its number is its level of grey."""
    depth_m = np.full((HEIGHT, WIDTH), 3, np.float32)
    depth_m[10:20, 100:200] = 1
    color = np.zeros((COUNT, HEIGHT, WIDTH, 3), np.uint8)
    color += np.arange(0, 10 * COUNT, 10, dtype=np.uint8)[:, None, None, None]
    camera = library.Camera(library.Intrinsics(WIDTH, HEIGHT, 400, 400, 239.5, 29.5), 1000)
    return library.frames(color, [depth_m] * COUNT, camera)


def panel(picture: np.ndarray, number: int) -> np.ndarray:
    """One of the frames of a picture, without its title."""
    line, side = divmod(number, 2)
    top = TITLE_PX + line * (HEIGHT + TITLE_PX) + TITLE_PX
    return picture[top : top + HEIGHT, side * WIDTH : (side + 1) * WIDTH]


def test_frames_from_all_of_the_capture_are_drawn_with_the_rim_of_what_is_near(
    capture: Capture, tmp_path: Path
) -> None:
    draw(capture, tmp_path / "edges.png")
    picture = cv2.imread(str(tmp_path / "edges.png"))
    expected = np.zeros((HEIGHT, WIDTH), bool)
    expected[10:20, 100:200] = True
    expected[11:19, 101:199] = False
    greys = []
    for number in range(6):
        seen = panel(picture, number)
        assert ((seen == EDGE).all(2) == expected).all()
        greys.append(int(seen[0, 0, 0]))
    # Six of twenty frames, neither the first nor the last.
    assert greys == [int(DIMMED * 10 * k) for k in (3, 5, 8, 11, 14, 16)]


def test_a_frame_that_cannot_be_read_is_left_out(
    capture: Capture, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole, unreadable = capture.read, range(10)

    def read(_: Capture, row: int) -> Frame:
        if row in unreadable:
            raise CaptureError(f"frame {row} is damaged")
        return whole(row)

    monkeypatch.setattr(depth_picture, "SHOWN", 2)
    monkeypatch.setattr(type(capture), "read", read)
    draw(capture, tmp_path / "edges.png")
    picture = cv2.imread(str(tmp_path / "edges.png"))
    assert (panel(picture, 0) == EDGE).all(2).any()
    assert not panel(picture, 1).any()
    unreadable = range(COUNT)
    with pytest.raises(CaptureError, match="is damaged"):
        draw(capture, tmp_path / "none.png")


def test_check_draws_nothing_of_a_capture_that_is_unfit(
    vnav: Run, tiny_capture: Path, tmp_path: Path
) -> None:
    wide = (tiny_capture / "camera.toml").read_text().replace("width = 320", "width = 330")
    (tmp_path / "wide.toml").write_text(wide)
    camera = ("--camera", tmp_path / "wide.toml")
    code, out, _ = vnav("check", tiny_capture, *camera, "--png", tmp_path / "edges.png")
    assert code == 1
    assert "FATAL    expected colour images of 330 x 240" in out
    assert not (tmp_path / "edges.png").exists()


def test_check_draws_where_it_is_asked_to(vnav: Run, tiny_capture: Path, tmp_path: Path) -> None:
    code, out, _ = vnav("check", tiny_capture, "--png", tmp_path / "edges.png")
    assert (code, out.splitlines()[-1]) == (0, "fit to be mapped")
    # Two frames of 320 px beside each other, doubled.
    assert cv2.imread(str(tmp_path / "edges.png")).shape[1] == 2 * 2 * 320
    assert vnav("check", tiny_capture, "--png", tmp_path / "edges.jpg")[0] == 2

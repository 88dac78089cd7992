import json
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from vnav.checking.capture_report import inspect, problems, require_usable, summary
from vnav.checking.quality import BLURRED, blur
from vnav.cli import main as entry
from vnav.config import CaptureConfig
from vnav.errors import CaptureError
from vnav.io.sources.capture import Capture
from vnav.io.sources.open_capture import open_capture

FRAMES, WIDTH, HEIGHT = 6, 160, 120
CAMERA = f"""
[color]
width = {WIDTH}
height = {HEIGHT}
fx = 131.0
fy = 131.0
cx = 79.5
cy = 59.5
[depth]
units_per_metre = 5000
"""


def texture(seed: int) -> NDArray[np.uint8]:
    """Overlapping rectangles, whose edges are like those of a room."""
    rng = np.random.default_rng(seed)
    image = np.full((HEIGHT, WIDTH, 3), 128, np.uint8)
    for x, y, w, h, grey in rng.integers((0, 0, 8, 8, 30), (WIDTH, HEIGHT, 50, 50, 226), (80, 5)):
        image[y : y + h, x : x + w] = grey
    return image


def wall(metres: float = 2.0) -> NDArray[np.uint16]:
    """A wall seen at a slant, from half to one and a half times this depth; a tenth is missing."""
    depth = np.tile(np.linspace(0.5, 1.5, WIDTH) * metres * 5000, (HEIGHT, 1)).astype(np.uint16)
    depth[: HEIGHT // 10] = 0
    return depth


class Folder:
    """A TUM folder that a test can spoil."""

    def __init__(self, root: Path) -> None:
        self.root = root
        for kind in ("rgb", "depth"):
            (root / kind).mkdir()
        self.camera(CAMERA)
        self.times([k / 10 for k in range(FRAMES)])
        for k in range(FRAMES):
            self.color(k, texture(k))
            self.depth(k, wall(2.0 - k / 1000))

    def path(self, kind: str, k: int) -> Path:
        return self.root / kind / f"{k}.png"

    def camera(self, text: str) -> None:
        (self.root / "camera.toml").write_text(text)

    def times(self, stamps_s: list[float], depth_later_s: float = 0.004) -> None:
        for kind, later_s in (("rgb", 0.0), ("depth", depth_later_s)):
            lines = [f"{s + later_s:.6f} {kind}/{k}.png\n" for k, s in enumerate(stamps_s)]
            (self.root / f"{kind}.txt").write_text("".join(lines))

    def color(self, k: int, image: NDArray[np.uint8]) -> None:
        cv2.imwrite(str(self.path("rgb", k)), image)

    def depth(self, k: int, image: NDArray[np.uint16]) -> None:
        cv2.imwrite(str(self.path("depth", k)), image)

    def damage_all_but_the_ends(self) -> None:
        """Of the colour images."""
        for k in range(1, FRAMES - 1):
            self.path("rgb", k).write_bytes(b"no image")

    def capture(self, config: CaptureConfig | None = None) -> Capture:
        return open_capture(self.root, config or CaptureConfig())


@pytest.fixture
def folder(tmp_path: Path) -> Folder:
    root = tmp_path / "room"
    root.mkdir()
    return Folder(root)


def test_a_good_capture_is_usable_and_measured(folder: Folder) -> None:
    report = require_usable(folder.capture())
    assert (report.name, report.frames) == ("room", FRAMES)
    assert report.files is not None
    assert report.files.truth is None
    assert report.files.color_sizes == {(WIDTH, HEIGHT): FRAMES} == report.files.depth_sizes
    assert (report.warnings, problems(report), report.fitting_units) == ((), (), 5000)
    assert report.timing.duration_s == pytest.approx(0.5)
    assert report.timing.median_step_s == pytest.approx(0.1)
    assert report.timing.largest_gap_s == pytest.approx(0.1)
    assert report.files.median_offset_s == pytest.approx(0.004)
    assert report.look is not None
    assert report.look.sampled == FRAMES
    assert report.look.valid_depth_share == pytest.approx(0.9)
    # The depths are spread evenly from 1 to 3 m.
    assert report.look.depth_m == pytest.approx((1.1, 2.0, 2.9), abs=0.01)
    assert (report.look.blurred_share, report.look.dark_share) == (0, 0)


def test_the_noise_of_depth_is_measured_at_its_median(folder: Folder) -> None:
    sigma = 0.003  # of inverse depth, 1/m
    for k in range(FRAMES):
        noise = np.random.default_rng(k).normal(0, sigma, (HEIGHT, WIDTH))
        folder.depth(k, np.rint(5000 / (0.5 + noise)).astype(np.uint16))
    look = require_usable(folder.capture()).look
    assert look is not None
    # 4 m2 of inverse depth's; the smoothest quarter shows 7 % less than all.
    assert look.depth_noise_m == pytest.approx(0.93 * 4 * sigma, rel=0.06)


def test_a_damaged_frame_is_named_and_does_no_harm(folder: Folder) -> None:
    damaged, missing = folder.path("depth", 2), folder.path("rgb", 4)
    damaged.write_bytes(damaged.read_bytes()[:-20])
    missing.unlink()
    report = require_usable(folder.capture())
    assert len(report.files.unreadable) == 2
    for path in (damaged, missing):
        assert any(str(path) in warning for warning in report.warnings)


def test_every_damaged_file_is_found_not_only_among_the_frames_measured(
    folder: Folder, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("vnav.checking.quality.SAMPLES", 2)
    folder.damage_all_but_the_ends()
    report = inspect(folder.capture())
    assert report.look is not None
    assert report.look.sampled == 2
    assert len(report.files.unreadable) == FRAMES - 2


def test_of_many_damaged_files_the_first_are_named_and_all_are_counted(
    folder: Folder, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("vnav.checking.rules.NAMED", 2)
    folder.damage_all_but_the_ends()
    report = inspect(folder.capture())
    named = [w for w in report.warnings if str(folder.root / "rgb") in w]
    assert len(named) == 2
    assert any(w.startswith(f"{FRAMES - 4} more cannot be read") for w in report.warnings)
    assert len(report.files.unreadable) == FRAMES - 2


def test_depth_of_another_size_than_colour_is_told_what_its_camera_lacks(folder: Folder) -> None:
    for k in range(FRAMES):
        folder.depth(k, np.ones((HEIGHT // 2, WIDTH // 2), np.uint16))
    (found,) = inspect(folder.capture()).fatal
    assert "like colour's" in found
    assert "add its width and height to [depth]" in found


def test_depth_of_the_wrong_kind_is_found_by_decoding(folder: Folder) -> None:
    cv2.imwrite(str(folder.path("depth", 3)), np.ones((HEIGHT, WIDTH), np.uint8))
    report = inspect(folder.capture())
    assert report.files.unreadable == ()
    assert any("16-bit" in warning for warning in report.warnings)


@pytest.mark.parametrize("kind", ["rgb", "depth"])
def test_two_sizes_are_not_mixed_and_the_odd_one_is_named(folder: Folder, kind: str) -> None:
    path = folder.path(kind, 3)
    cv2.imwrite(str(path), cv2.imread(str(path), cv2.IMREAD_UNCHANGED)[::2, ::2])
    with pytest.raises(CaptureError, match=f"one size, found 5 of 160 x 120, 1 of 80 x 60.*{path}"):
        require_usable(folder.capture(), force=True)


def test_images_have_the_size_that_the_camera_says(folder: Folder) -> None:
    folder.camera(CAMERA.replace("width = 160", "width = 320"))
    with pytest.raises(CaptureError, match="320 x 120, as .color. of the camera says, found 6 of"):
        require_usable(folder.capture(), force=True)


def test_depth_that_is_zero_everywhere_stops_a_map_whatever_is_forced(folder: Folder) -> None:
    for k in range(FRAMES):
        folder.depth(k, np.zeros((HEIGHT, WIDTH), np.uint16))
    with pytest.raises(CaptureError, match="found only zeros in 6 frames"):
        require_usable(folder.capture(), force=True)


def test_a_capture_of_which_nothing_can_be_read_is_not_usable(folder: Folder) -> None:
    for k in range(FRAMES):
        folder.path("rgb", k).write_bytes(b"")
    with pytest.raises(CaptureError, match="expected colour images, found none that can be read"):
        require_usable(folder.capture(), force=True)


@pytest.mark.parametrize(("said", "factor"), [(1, 5000), (1000, 5), (25_000, 0.2), (100_000, 0.05)])
def test_implausible_depth_units_are_named_with_a_value_that_fits(
    folder: Folder, said: int, factor: float
) -> None:
    config = CaptureConfig(units_per_metre=float(said))
    with pytest.raises(CaptureError, match=f"units_per_metre = {said:g} is probably wrong"):
        require_usable(folder.capture(config))
    report = require_usable(folder.capture(config), force=True)
    assert report.look is not None
    assert report.look.depth_m is not None
    assert report.look.depth_m[1] == pytest.approx(2.0 * factor, rel=0.01)
    # 1000 per metre would put the wall at 10 m; of the usual values 5000 is the next.
    assert report.fitting_units == 5000


@pytest.mark.parametrize("metres", [0.6, 1.0, 2.0, 4.0])
def test_walls_at_the_depths_of_rooms_are_plausible(folder: Folder, metres: float) -> None:
    for k in range(FRAMES):
        folder.depth(k, wall(metres))
    assert inspect(folder.capture()).implausible_units is None


def test_a_long_gap_and_many_dropped_images_are_warned_of(folder: Folder) -> None:
    folder.times([0.0, 0.1, 0.2, 2.9, 3.0, 3.1])
    assert inspect(folder.capture()).warnings == ("no frames for 2.7 s after frame 2 (0.200 s)",)
    (folder.root / "depth.txt").write_text("0.0 depth/0.png\n0.1 depth/1.png\n")
    report = inspect(folder.capture())
    assert report.files is not None
    assert (report.frames, report.files.dropped_color) == (2, 4)
    assert "4 images have no partner in time" in report.warnings[0]


def test_images_that_come_twice_are_warned_of(folder: Folder) -> None:
    for k in (1, 3):
        folder.color(k, texture(k - 1))
    folder.depth(4, wall(1.997))
    assert inspect(folder.capture()).warnings == (
        f"3 of {FRAMES} frames have the colour or the depth image of the frame before, and will be"
        " left out; record colour and depth at one rate",
    )


def test_frames_that_come_twice_are_warned_of(folder: Folder) -> None:
    folder.color(3, texture(2))
    folder.depth(3, wall(1.998))
    (warning,) = inspect(folder.capture()).warnings
    assert warning.startswith(f"1 of {FRAMES} frames are the frame before once more")


def test_dark_and_blurred_frames_are_told_by_their_share(folder: Folder) -> None:
    for k in range(2):
        folder.color(k, texture(k) // 8)
    for k in range(2, 5):
        folder.color(k, cv2.blur(texture(k), (15, 1)).astype(np.uint8))
    report = inspect(folder.capture())
    assert report.look is not None
    assert report.look.dark_share == pytest.approx(2 / 6)
    assert report.look.blurred_share == pytest.approx(3 / 6)
    assert any("blurred" in warning for warning in report.warnings)
    assert any("dark" in warning for warning in report.warnings)


def test_blur_grows_with_the_smear_and_a_blank_image_has_none() -> None:
    grey = texture(0)[..., 0]
    smeared = [blur(cv2.blur(grey, (length, 1))) for length in (1, 5, 9, 17)]
    assert smeared == sorted(smeared)
    assert blur(np.full((120, 160), 7, np.uint8)) == 0.0


@pytest.mark.parametrize("sigma", [5, 15, 30])
def test_blur_is_seen_however_heavy_it_is(sigma: float) -> None:
    # Where hardly anything is left, the steps of 8-bit grey levels look like sharp edges.
    rng = np.random.default_rng(0)
    scene = cv2.resize(rng.uniform(0, 255, (6, 8)).astype(np.float32), (640, 480))
    blurred = cv2.GaussianBlur(np.where(scene > 128, 150.0, 100.0), (0, 0), sigma)
    assert blur(np.rint(blurred).astype(np.uint8)) > BLURRED


def test_the_summary_tells_counts_depth_and_truth(folder: Folder) -> None:
    (folder.root / "groundtruth.txt").write_text("0 0 0 0 0 0 0 1\n")
    text = "\n".join(summary(inspect(folder.capture())))
    for part in ("room", "6 over 0.5 s", "160 x 120", "100 ms", "+4.0 ms", "median 2.00 m"):
        assert part in text
    assert "groundtruth.txt" in text


def check(monkeypatch: pytest.MonkeyPatch, *arguments: object) -> int:
    monkeypatch.setattr(sys, "argv", ["vnav", "check", *map(str, arguments)])
    return entry.main()


def test_the_last_line_says_that_something_is_warned_of(
    folder: Folder, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    folder.times([0, 0.1, 0.2, 2.9, 3.0, 3.1])
    assert check(monkeypatch, folder.root) == 0
    out = capsys.readouterr().out
    assert "warning  no frames for 2.7 s" in out
    assert out.splitlines()[-1] == "fit to be mapped, but for what is warned of"


def test_the_command_exits_with_0_or_where_a_map_would_be_stopped_with_1(
    folder: Folder, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert check(monkeypatch, folder.root) == 0
    assert capsys.readouterr().out.splitlines()[-1] == "fit to be mapped"
    assert check(monkeypatch, folder.root, "--set", "capture.units_per_metre=1") == 1
    assert "5000 would fit" in capsys.readouterr().out


def test_the_command_prints_one_json_object(
    folder: Folder, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    folder.path("rgb", 1).unlink()
    assert check(monkeypatch, folder.root, "--json") == 0
    found = json.loads(capsys.readouterr().out)
    assert found["files"]["depth_sizes"] == {"160x120": FRAMES}
    assert found["problems"] == []
    assert len(found["files"]["unreadable"]) == 1
    assert found["camera"]["units_per_metre"] == 5000

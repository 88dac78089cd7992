"""The hard versions are what they say: above all the rolled one, exactly."""

from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import cv2
import numpy as np
import pytest

from vnav.config import CaptureConfig
from vnav.core import se3
from vnav.core.camera import Camera, Intrinsics
from vnav.io.formats.trajectories import read_tum
from vnav.io.sources.open_capture import open_capture


@pytest.fixture(scope="module")
def hard(script: Callable[[str], ModuleType]) -> ModuleType:
    return script("hard_versions")


@pytest.fixture
def version(hard: ModuleType, tiny_capture: Path, tmp_path: Path):
    """Writes a version of the small room by its name, and opens it."""

    def make(name: str):
        hard.VERSIONS[name](hard.Source.open(tiny_capture), tmp_path / name)
        return open_capture(tmp_path / name, CaptureConfig())

    return make


@pytest.fixture(scope="module")
def original(tiny_capture: Path):
    return open_capture(tiny_capture, CaptureConfig())


def changed(original, version) -> list[int]:
    """Frames whose colour or depth is not the original's."""
    pairs = [(original.read(k), version.read(k)) for k in range(len(original))]
    return [
        k
        for k, (a, b) in enumerate(pairs)
        if (a.color != b.color).any() or (a.depth_m != b.depth_m).any()
    ]


def test_the_clean_version_is_the_original_and_takes_no_room(original, version) -> None:
    clean = version("clean")
    assert changed(original, clean) == []
    assert clean.files.pairs[5].color.path.samefile(original.files.pairs[5].color.path)
    assert not [p for p in clean.root.rglob("*.png") if not p.is_symlink()]


def test_every_third_frame_is_there(original, version) -> None:
    np.testing.assert_array_equal(version("every_third").stamps_s, original.stamps_s[::3])


@pytest.mark.parametrize(("name", "left"), [("dropped_20", 48), ("dropped_2_seed_3", 59)])
def test_a_share_of_the_frames_is_dropped(original, version, name: str, left: int) -> None:
    stamps = version(name).stamps_s
    assert len(stamps) == left
    assert set(stamps) < set(original.stamps_s)


def test_other_seeds_drop_other_frames(version) -> None:
    left = {tuple(version(f"dropped_2_seed_{seed}").stamps_s) for seed in range(5)}
    assert len(left) > 1


def test_three_seconds_are_cut_out_of_the_middle(original, version) -> None:
    stamps = version("cut").stamps_s
    gap = int(np.argmax(np.diff(stamps)))
    middle = (original.stamps_s[0] + original.stamps_s[-1]) / 2
    assert stamps[gap] == pytest.approx(middle - 1.5, abs=0.21)  # frames are 0.2 s apart
    assert stamps[gap + 1] == pytest.approx(middle + 1.5, abs=0.21)
    assert np.delete(np.diff(stamps), gap).max() == pytest.approx(0.2)


def test_only_the_first_frame_is_black(original, version) -> None:
    black = version("black_first")
    assert changed(original, black) == [0]
    assert not black.read(0).color.any()
    assert (black.root / "unusable.txt").read_text() == f"{black.stamps_s[0]:.6f}\n"


def test_every_tenth_frame_is_blurred(original, version) -> None:
    assert changed(original, version("blurred")) == list(range(9, 60, 10))


def test_blur_spreads_a_point_along_a_line_of_nine_pixels(hard: ModuleType) -> None:
    for angle_rad in np.linspace(0, np.pi, 7):
        kernel = hard.line_kernel(9, angle_rad)
        row, column = np.mgrid[-4:5, -4:5]
        along = row * np.sin(angle_rad) + column * np.cos(angle_rad)
        across = row * np.cos(angle_rad) - column * np.sin(angle_rad)
        assert kernel.sum() == pytest.approx(1)
        assert (kernel * along).sum() == pytest.approx(0, abs=1e-12)
        # an even line of 8 px between its ends has variance 8^2 / 12; bilinear weights add 1/6
        assert (kernel * along**2).sum() == pytest.approx(8**2 / 12 + 1 / 6, abs=0.4)
        assert (kernel * across**2).sum() < 0.35


def test_exposure_jumps_by_a_factor_of_two_and_clips(original, version) -> None:
    exposed = version("exposed")
    assert changed(original, exposed) == [*range(15, 30), *range(45, 60)]
    a, b = (c.read(50).color.astype(int) for c in (original, exposed))
    np.testing.assert_array_equal(b, np.minimum(2 * a, 255))
    a, b = (c.read(20).color.astype(int) for c in (original, exposed))
    assert np.abs(2 * b - a).max() <= 1


def test_a_lamp_leaves_the_centre_as_it_is_and_three_tenths_of_the_corners(
    original, version
) -> None:
    lit = version("lamp")
    assert changed(original, lit) == list(range(60))
    frames = [(original.read(k).color.astype(float), lit.read(k).color) for k in range(0, 60, 2)]
    for corner, left in ((slice(0, 8), 0.305), (slice(116, 124), 1.0)):  # exp(-4.97) = 0.007 there
        columns = corner if left < 1 else slice(156, 164)
        a, b = (np.mean([f[k][corner, columns] for f in frames]) for k in (0, 1))
        assert b / a == pytest.approx(left, abs=0.01)  # 5760 values of noise 2 / 100


def test_a_frame_is_unusable_where_nearly_all_of_it_is_black_or_clipped(hard: ModuleType) -> None:
    image = np.zeros((100, 100, 3), np.uint8)
    image[:50] = 255
    assert not hard.usable(image)
    image[:4, :, 0] = 200
    assert not hard.usable(image)
    image[:5, :, 0] = 200
    assert hard.usable(image)


def test_half_of_all_depth_is_missing_and_the_rest_is_as_it_was(original, version) -> None:
    half = version("half_depth")
    kept = [half.read(k).depth_m > 0 for k in range(60)]
    there = [original.read(k).depth_m > 0 for k in range(60)]
    assert np.sum(kept) / np.sum(there) == pytest.approx(0.5, abs=0.05)
    a, b = original.read(7).depth_m, half.read(7).depth_m
    np.testing.assert_array_equal(b[b > 0], a[b > 0])
    assert (kept[7] != kept[8]).any()


def test_the_rolled_versions_poses_camera_and_images_agree_with_the_originals(
    original, version
) -> None:
    rolled = version("rolled")
    T_world_camera = read_tum(original.truth).T_world_camera
    T_world_rolled = read_tum(rolled.truth).T_world_camera
    camera, turned = original.camera.color, rolled.camera.color
    assert turned.size == camera.size[::-1]
    for k in (0, 31):
        a, b = original.read(k), rolled.read(k)
        v, u = np.nonzero(a.depth_m)
        points = camera.unproject(np.stack([u, v], -1), a.depth_m[v, u])
        seen = se3.transform(se3.inverse(T_world_rolled[k]) @ T_world_camera[k], points)
        px = turned.project(seen)
        row, column = np.rint(px[:, 1]).astype(int), np.rint(px[:, 0]).astype(int)
        assert np.abs(px - np.stack([column, row], -1)).max() < 1e-6  # what files are rounded to
        np.testing.assert_array_equal(b.depth_m[row, column], a.depth_m[v, u])
        np.testing.assert_allclose(seen[:, 2], a.depth_m[v, u], rtol=1e-6)
        np.testing.assert_array_equal(b.color[row, column], a.color[v, u])


def test_a_rolled_camera_with_distortion_and_a_depth_camera_beside_it_sees_turned_pixels(
    hard: ModuleType,
) -> None:
    rng = np.random.default_rng(0)
    color = Intrinsics(64, 48, 52.0, 53.0, 30.5, 25.0, (0.2, -0.1, 0.003, -0.002, 0.01))
    depth = Intrinsics(60, 40, 58.0, 57.0, 29.0, 18.0)
    rotation, _ = cv2.Rodrigues(np.array([0.02, -0.03, 0.01]))
    T_color_depth = se3.make(rotation, np.array([-0.025, 0.001, 0.002]))
    camera = Camera(color, 1000.0, depth, tuple(map(tuple, T_color_depth.tolist())))
    rolled = hard.rolled_camera(camera)
    points_depth = rng.uniform((-0.4, -0.3, 1), (0.4, 0.3, 3), (50, 3))
    points_rolled = points_depth @ hard.R_ROLLED_CAMERA.T
    u, v = depth.project(points_depth).T
    turned = np.stack([depth.height - 1 - v, u], -1)
    np.testing.assert_allclose(rolled.depth.project(points_rolled), turned, atol=1e-9)
    u, v = distorted(color, se3.transform(T_color_depth, points_depth)).T
    seen = se3.transform(np.array(rolled.T_color_depth), points_rolled)
    turned = np.stack([color.height - 1 - v, u], -1)
    np.testing.assert_allclose(distorted(rolled.color, seen), turned, atol=1e-9)


def distorted(camera: Intrinsics, points_camera: np.ndarray) -> np.ndarray:
    """Pixels (N, 2) of points (N, 3) in camera coordinates, distortion applied."""
    still = np.zeros(3)
    px, _ = cv2.projectPoints(points_camera, still, still, camera.K, np.array(camera.distortion))
    return px.reshape(-1, 2)


def test_a_camera_file_says_what_the_camera_is(hard: ModuleType, tmp_path: Path) -> None:
    from vnav.io.formats.camera_file import read_camera

    color = Intrinsics(64, 48, 52.0, 53.0, 30.5, 25.0, (0.2, -0.1, 0.003, -0.002, 0.01))
    identity = tuple(map(tuple, np.eye(4).tolist()))
    for camera in (Camera(color, 5000.0), Camera(color, 1000.0, color.scaled(32, 24), identity)):
        (tmp_path / "camera.toml").touch()
        hard.write_camera(tmp_path / "camera.toml", camera)
        assert read_camera(tmp_path / "camera.toml") == camera


def test_the_suite_lists_versions_that_lie_beside_it(
    hard: ModuleType, tiny_capture: Path, tmp_path: Path
) -> None:
    from vnav.io.datasets.suite_file import files_of, read_suite

    source = hard.Source.open(tiny_capture)
    for name in ("clean", "cut"):
        hard.VERSIONS[name](source, tmp_path / f"room_{name}")
    hard.write_suite(tmp_path / "suite.toml", ["room"], ["clean", "cut"])
    suite = read_suite(str(tmp_path / "suite.toml"))
    assert [entry.name for entry in suite.entries] == ["room/clean", "room/cut"]
    found = [files_of(entry, suite.folder).capture for entry in suite.entries]
    assert found == [tmp_path / "room_clean", tmp_path / "room_cut"]

from pathlib import Path

import cv2
import numpy as np
import pytest

from vnav.config import CaptureConfig
from vnav.core import se3
from vnav.errors import CameraError, CaptureError, ConfigError
from vnav.io.sources.open_capture import open_capture, read_truth, truth_of

CONFIG = CaptureConfig()
CAMERA = """
[color]
width = 8
height = 6
fx = 7.0
fy = 7.0
cx = 3.5
cy = 2.5
[depth]
units_per_metre = 1000
"""
APART = """
fx = 8.0
fy = 8.0
cx = 3.5
cy = 2.5
T_color_depth = [[0, -1, 0, -0.03], [1, 0, 0, 0], [0, 0, 1, 0.01], [0, 0, 0, 1]]
"""


def write_color(path: Path) -> str:
    path.parent.mkdir(exist_ok=True)
    cv2.imwrite(str(path), np.full((6, 8, 3), 99, np.uint8))
    return f"{path.parent.name}/{path.name}"


def write_depth(path: Path) -> str:
    path.parent.mkdir(exist_ok=True)
    cv2.imwrite(str(path), np.full((6, 8), 1500, np.uint16))
    return f"{path.parent.name}/{path.name}"


def write_tum(root: Path, color_s: list[str], depth_s: list[str]) -> Path:
    colors = [f"{s} {write_color(root / 'rgb' / f'{s}.png')}" for s in color_s]
    depths = [f"{s} {write_depth(root / 'depth' / f'{s}.png')}" for s in depth_s]
    (root / "rgb.txt").write_text("\n".join(["# timestamp filename", *colors]))
    (root / "depth.txt").write_text("\n".join(["# timestamp filename", *depths]))
    (root / "camera.toml").write_text(CAMERA)
    return root


def write_folders(root: Path, colors: list[str], depths: list[str]) -> Path:
    for name in colors:
        write_color(root / "color" / name)
    for name in depths:
        write_depth(root / "depth" / name)
    (root / "camera.toml").write_text(CAMERA)
    return root


def write_seven_scenes(root: Path, numbers: list[int], camera: str) -> Path:
    for number in numbers:
        write_color(root / f"frame-{number:06d}.color.png")
        write_depth(root / f"frame-{number:06d}.depth.png")
    (root / "camera.toml").write_text(camera)
    return root


def write_poses(root: Path, poses: dict[int, np.ndarray]) -> None:
    for number, T in poses.items():
        np.savetxt(root / f"frame-{number:06d}.pose.txt", T, fmt="%.7e", delimiter="\t")


def test_a_tum_folder_needs_no_association_file(tmp_path: Path) -> None:
    root = write_tum(tmp_path, ["1.00", "1.03", "1.06"], ["1.01", "1.041", "9.00"])
    frames = open_capture(root, CONFIG).files
    assert frames.stamps_s.tolist() == [1.00, 1.03]
    np.testing.assert_allclose(frames.offsets_s, [0.01, 0.011])
    assert [image.stamp_s for image in frames.dropped_color] == [1.06]
    assert [image.stamp_s for image in frames.dropped_depth] == [9.00]


def test_a_frame_tells_how_much_later_its_depth_is_stamped(tmp_path: Path) -> None:
    root = write_tum(tmp_path, ["1.00", "1.03"], ["1.01", "1.018"])
    capture = open_capture(root, CONFIG)
    assert [capture.read(k).depth_after_s for k in (0, 1)] == pytest.approx([0.01, -0.012])


def test_the_largest_time_between_colour_and_depth_is_a_setting(tmp_path: Path) -> None:
    root = write_tum(tmp_path, ["1.00"], ["1.10"])
    with pytest.raises(CaptureError, match=r"less than 0.02 s apart .*capture.association_s"):
        open_capture(root, CONFIG)
    assert len(open_capture(root, CaptureConfig(association_s=0.2))) == 1


@pytest.mark.parametrize(
    ("color_s", "depth_s", "told"),
    [
        (["1000", "1100", "1200"], ["1033", "1133", "1233"], "100 s .*in seconds"),
        (["1.0", "1.1", "1.2"], ["3601.0", "3601.1", "3601.2"], "3600.000 s later .*take"),
        (["9.0", "9.1", "9.2"], ["5.5", "5.6", "5.7"], "3.500 s earlier .*add"),
    ],
)
def test_lists_that_have_no_time_in_common_say_what_is_wrong(
    tmp_path: Path, color_s: list[str], depth_s: list[str], told: str
) -> None:
    root = write_tum(tmp_path, color_s, depth_s)
    with pytest.raises(CaptureError, match=told):
        open_capture(root, CONFIG)


def test_a_list_of_one_time_for_all_is_refused(tmp_path: Path) -> None:
    root = write_tum(tmp_path, ["1.0", "1.1", "1.2"], ["1.0", "1.1", "1.2"])
    text = (root / "rgb.txt").read_text()
    (root / "rgb.txt").write_text(text.replace("1.1 ", "1.0 ").replace("1.2 ", "1.0 "))
    with pytest.raises(CaptureError, match=r"rgb.txt, found one for 3"):
        open_capture(root, CONFIG)


@pytest.mark.parametrize("line", ["1.0", "rgb/1.png 1.0", "nan rgb/1.png"])
def test_a_wrong_line_of_a_tum_list_is_named(tmp_path: Path, line: str) -> None:
    root = write_tum(tmp_path, ["1.0"], ["1.0"])
    (root / "rgb.txt").write_text(f"# comment\n{line}\n")
    with pytest.raises(CaptureError, match="rgb.txt, line 2"):
        open_capture(root, CONFIG)


def test_folders_are_matched_by_the_times_in_their_files_names(tmp_path: Path) -> None:
    colors = ["1305031102.175.jpg", "1305031102.208.jpg", "1305031102.30.jpg"]
    root = write_folders(tmp_path, colors, ["1305031102.21.png", "1305031102.18.png"])
    frames = open_capture(root, CONFIG).files
    assert frames.stamps_s.tolist() == [1305031102.175, 1305031102.208]
    assert [pair.depth.path.name for pair in frames.pairs] == [
        "1305031102.18.png",
        "1305031102.21.png",
    ]
    assert len(frames.dropped_color) == 1


@pytest.mark.parametrize(
    ("first", "second"),
    [("1305031102175", "1305031102208"), ("1305031102175.30", "1305031102208.10")],
)
def test_times_in_milliseconds_become_seconds(tmp_path: Path, first: str, second: str) -> None:
    names = [f"{first}.png", f"{second}.png"]
    stamps_s = open_capture(write_folders(tmp_path, names, names), CONFIG).stamps_s
    np.testing.assert_allclose(stamps_s, [1305031102.175, 1305031102.208], atol=5e-4)


@pytest.mark.parametrize(
    ("first", "second"),
    [
        ("20261130_120059_800", "20261130_120100_000"),
        ("2026-11-30_12-00-59.800", "2026-11-30_12-01-00.000"),
        ("rgb_2026-11-30T12.00.59.8", "rgb_2026-11-30T12.01.00.0"),
        ("20261130120059800", "20261130120100000"),
    ],
)
def test_a_date_and_the_time_of_day_are_a_time(tmp_path: Path, first: str, second: str) -> None:
    """2026-11-30 12:00:59.8 UTC, and 0.2 s later, beyond the minute."""
    names = [f"{first}.png", f"{second}.png"]
    stamps_s = open_capture(write_folders(tmp_path, names, names), CONFIG).stamps_s
    np.testing.assert_allclose(stamps_s, [1796040059.8, 1796040060.0], atol=1e-6)


def test_a_number_that_names_several_files_does_not_tell_frames_apart(tmp_path: Path) -> None:
    names = ["12h01_take1.png", "12h02_take1.png", "12h03_take1.png"]
    frames = open_capture(write_folders(tmp_path, names, names), CONFIG).files
    assert [pair.depth.path.name for pair in frames.pairs] == names


def test_folders_are_matched_by_number_and_a_missing_number_leaves_a_gap(tmp_path: Path) -> None:
    colors = ["color_0001.jpg", "color_0002.jpg", "color_0004.jpg"]
    root = write_folders(tmp_path, colors, ["4.png", "1.png", "3.png"])
    frames = open_capture(root, CaptureConfig(frame_rate_hz=10.0)).files
    np.testing.assert_allclose(frames.stamps_s, [0.1, 0.4])
    assert [pair.depth.path.name for pair in frames.pairs] == ["1.png", "4.png"]
    assert [image.path.name for image in frames.dropped_color] == ["color_0002.jpg"]
    assert [image.path.name for image in frames.dropped_depth] == ["3.png"]


def test_folders_with_other_names_are_matched_by_order_if_they_hold_as_many(tmp_path: Path) -> None:
    root = write_folders(tmp_path, ["a.png", "b.png"], ["c.png", "d.png"])
    frames = open_capture(root, CaptureConfig(frame_rate_hz=10.0)).files
    np.testing.assert_allclose(frames.stamps_s, [0.0, 0.1])
    (root / "depth" / "d.png").unlink()
    with pytest.raises(CaptureError, match="found 2 and 1"):
        open_capture(root, CONFIG)


def test_two_depth_folders_are_one_too_many(tmp_path: Path) -> None:
    root = write_folders(tmp_path, ["1.png"], ["1.png"])
    write_depth(root / "depth_aligned" / "1.png")
    with pytest.raises(CaptureError, match="found depth/ and depth_aligned/"):
        open_capture(root, CONFIG)


def test_frames_of_7_scenes_are_a_thirtieth_of_a_second_apart(tmp_path: Path) -> None:
    root = write_seven_scenes(tmp_path, [0, 1, 3], CAMERA)
    (root / "frame-000001.depth.png").unlink()
    capture = open_capture(root, CONFIG)
    np.testing.assert_allclose(capture.stamps_s, [0, 0.1])
    assert len(capture.files.dropped_color) == 1


def test_poses_of_7_scenes_are_moved_to_the_colour_camera(tmp_path: Path) -> None:
    root = write_seven_scenes(tmp_path, [0, 1, 2], CAMERA + APART)
    T_world_depth = se3.exp(np.random.default_rng(0).normal(size=(2, 6)))
    write_poses(root, {0: T_world_depth[0], 2: T_world_depth[1]})
    truth = read_truth(root, CONFIG)
    assert truth_of(root, CONFIG) == root / "frame-000000.pose.txt"
    np.testing.assert_allclose(truth.stamps_s, [0, 2 / 30])
    capture = open_capture(root, CONFIG)
    origin_color = se3.transform(se3.inverse(capture.camera.T_color_depth), [[0.0, 0, 0]])
    expected = [se3.transform(T, origin_color)[0] for T in T_world_depth]
    np.testing.assert_allclose(truth.positions, expected, atol=1e-6)  # poses print 8 digits


def test_poses_of_7_scenes_where_tracking_was_lost_are_left_out(tmp_path: Path) -> None:
    root = write_seven_scenes(tmp_path, [0, 1], CAMERA)
    write_poses(root, {0: np.full((4, 4), np.nan), 1: np.eye(4)})
    assert read_truth(root, CONFIG).stamps_s.tolist() == [1 / 30]


def test_the_truth_of_a_tum_folder_is_its_groundtruth(tmp_path: Path) -> None:
    root = write_tum(tmp_path, ["1.0"], ["1.0"])
    assert truth_of(root, CONFIG) is None
    with pytest.raises(CaptureError, match="expected a true trajectory"):
        read_truth(root, CONFIG)
    (root / "groundtruth.txt").write_text("1.0 1 2 3 0 0 0 1\n")
    assert truth_of(root, CONFIG) == root / "groundtruth.txt"
    for path in (root, root / "groundtruth.txt"):
        assert read_truth(path, CONFIG).positions.tolist() == [[1, 2, 3]]


def test_what_is_no_capture_is_said_and_what_would_be_one(tmp_path: Path) -> None:
    for path, found in (
        (tmp_path / "missing", "found nothing"),
        (tmp_path, "rgb.txt and depth.txt .*found an empty folder"),
    ):
        with pytest.raises(CaptureError, match=found):
            open_capture(path, CONFIG)
    (tmp_path / "notes.txt").write_text("")
    with pytest.raises(CaptureError, match="found notes.txt"):
        open_capture(tmp_path, CONFIG)
    with pytest.raises(CaptureError, match="found a file"):
        open_capture(tmp_path / "notes.txt", CONFIG)


def test_a_tum_folder_without_depth_is_a_capture_of_colour(tmp_path: Path) -> None:
    tum = write_tum(tmp_path, ["2.0", "1.0"], ["1.0", "2.0"])
    (tum / "depth.txt").unlink()
    (tum / "camera.toml").write_text(CAMERA.partition("[depth]")[0])
    capture = open_capture(tum, CONFIG)
    assert not capture.has_depth
    assert capture.stamps_s.tolist() == [1.0, 2.0]
    assert not capture.read(1).depth_m.any()
    assert capture.read(1).color.shape == (6, 8, 3)
    assert len(capture.fingerprint()) == 64


def test_colour_without_depth_is_an_error(tmp_path: Path) -> None:
    tum = write_tum(tmp_path, ["1.0"], ["1.0"])
    (tum / "depth.txt").unlink()
    (tum / "rgb.txt").unlink()
    (tum / "depth" / "1.0.png").unlink()
    with pytest.raises(CaptureError, match=r"expected images \(.png\) in .*depth, found none"):
        open_capture(tum, CONFIG)
    (tum / "depth").rmdir()
    with pytest.raises(CaptureError, match="expected one folder of depth/, depth_aligned/"):
        open_capture(tum, CONFIG)


def test_7_scenes_without_depth_is_an_error(tmp_path: Path) -> None:
    root = write_seven_scenes(tmp_path, [0], CAMERA)
    (root / "frame-000000.depth.png").unlink()
    with pytest.raises(CaptureError, match=r"found none among 1 \*.color.png and 0 \*.depth.png"):
        open_capture(root, CONFIG)


def test_the_camera_is_the_named_file_else_the_captures_own_else_the_named_preset(
    tmp_path: Path,
) -> None:
    root = write_tum(tmp_path, ["1.0"], ["1.0"])
    named = tmp_path / "named.toml"
    named.write_text(CAMERA.replace("fx = 7.0", "fx = 9.0"))
    preset = CaptureConfig(preset_camera="tum_fr3")
    assert open_capture(root, preset, named).camera.color.fx == 9.0
    assert open_capture(root, preset).camera.color.fx == 7.0
    (root / "camera.toml").unlink()
    assert open_capture(root, preset).camera.color.fx == 535.4


def test_a_missing_camera_is_never_guessed_from_the_folders_name(tmp_path: Path) -> None:
    root = tmp_path / "rgbd_dataset_freiburg1_xyz"
    root.mkdir()
    (write_tum(root, ["1.0"], ["1.0"]) / "camera.toml").unlink()
    with pytest.raises(CameraError, match="no camera.toml .*--camera FILE.*tum_fr1"):
        open_capture(root, CONFIG)


def proposed(root: Path) -> Path:
    """The camera.toml that the error of a capture without one proposes, saved."""
    (root / "camera.toml").unlink()
    with pytest.raises(CameraError, match="save the proposed lines as") as told:
        open_capture(root, CONFIG)
    (root / "camera.toml").write_text("\n".join(told.value.__notes__))
    return root / "camera.toml"


def test_a_capture_without_a_camera_is_proposed_one_that_can_be_saved(tmp_path: Path) -> None:
    root = write_tum(tmp_path, ["1.0"], ["1.0"])
    text = proposed(root).read_text()
    for key in ("fx", "fy", "cx", "cy", "units_per_metre"):
        assert f"\n{key} = " in text
        assert "a guess" in next(line for line in text.splitlines() if line.startswith(f"{key} ="))
    capture = open_capture(root, CONFIG)
    assert capture.camera.color.size == (8, 6)
    assert capture.camera.is_registered
    assert capture.read(0).depth_m.max() == 1.5


def test_depth_of_another_size_is_proposed_a_camera_of_its_own(tmp_path: Path) -> None:
    root = write_tum(tmp_path, ["1.0"], ["1.0"])
    cv2.imwrite(str(root / "depth" / "1.0.png"), np.full((3, 4), 1500, np.uint16))
    proposed(root)
    camera = open_capture(root, CONFIG).camera
    assert camera.depth == camera.color.scaled(4, 3)


def test_sizes_are_proposed_of_the_first_images_that_are_whole(tmp_path: Path) -> None:
    root = write_tum(tmp_path, ["1.0", "2.0"], ["1.0", "2.0"])
    (root / "rgb" / "1.0.png").write_bytes(b"")
    assert "width = 8" in proposed(root).read_text()


def test_depth_units_that_nothing_has_are_refused(tmp_path: Path) -> None:
    root = write_tum(tmp_path, ["1.0"], ["1.0"])
    with pytest.raises(ConfigError, match=r"units_per_metre to be 0 or at least 0\.001"):
        open_capture(root, CaptureConfig(units_per_metre=1e-320))


def test_depth_units_can_be_set(tmp_path: Path) -> None:
    root = write_tum(tmp_path, ["1.0"], ["1.0"])
    depth_m = open_capture(root, CaptureConfig(units_per_metre=5000.0)).read(0).depth_m
    np.testing.assert_allclose(depth_m, 0.3, rtol=1e-6)

"""Odometry past something that moves: a board that somebody carries through the view."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from vnav.config import CaptureConfig, load
from vnav.core import se3
from vnav.core.camera import Camera
from vnav.core.frame import Frame
from vnav.core.mapping import FrameFeatures, Odometry
from vnav.core.report import Report
from vnav.io.formats.trajectories import read_tum
from vnav.io.sources.capture import Capture
from vnav.io.sources.open_capture import open_capture
from vnav.io.store.artifacts import (
    copy_keyframes,
    kept_rows,
    load_keyframe,
    load_keyframe_mask,
    load_odometry,
)
from vnav.io.store.map_folder import MapFolder
from vnav.reporting.moving_picture import moving_figure
from vnav.stages import odometry

FRAMES, PAINTED = 30, 45  # of the capture: those that are seen, the one that the board shows
BOARD_M, STEP_PX, ALONE = 0.7, 12, 3  # its depth, its way a frame, the frames before it
STEP_M = STEP_PX * BOARD_M / 260  # of the board, by the focal length of the capture
SETTINGS = ["masking.method=motion", "features.max_features=700"]


class PastABoard:
    """The first frames of a capture, and a board of some columns that enters from the left."""

    name, has_depth, poses = "past a board", True, None

    def __init__(self, whole: Capture, width_px: int) -> None:
        self._whole, self._width_px = whole, width_px
        self._picture = whole.read(PAINTED).color[:, :width_px]

    @property
    def camera(self) -> Camera:
        return self._whole.camera

    @property
    def stamps_s(self) -> np.ndarray:
        return self._whole.stamps_s[:FRAMES]

    def __len__(self) -> int:
        return FRAMES

    def columns(self, index: int) -> np.ndarray:
        """Of the image, that the board is in."""
        first = self._first(index)
        return np.arange(max(first, 0), min(first + self._width_px, self.camera.color.width))

    def _first(self, index: int) -> int:
        return STEP_PX * (index - ALONE) - self._width_px

    def read(self, index: int) -> Frame:
        frame, columns = self._whole.read(index), self.columns(index)
        color, depth_m = frame.color.copy(), frame.depth_m.copy()
        color[:, columns] = self._picture[:, columns - self._first(index)]
        depth_m[:, columns] = BOARD_M
        return replace(frame, color=color, depth_m=depth_m)

    def fingerprint(self) -> str:
        return f"a board of {self._width_px} columns before {self._whole.fingerprint()}"


def tracked(capture: Capture, folder: Path, *settings: str) -> tuple[MapFolder, Report]:
    made = MapFolder.create(folder)
    return made, odometry.run(made, capture, load(settings=[*SETTINGS, *settings]))


@pytest.fixture(scope="module")
def capture(tiny_capture: Path) -> PastABoard:
    return PastABoard(open_capture(tiny_capture, CaptureConfig()), 100)


@pytest.fixture(scope="module")
def run(
    capture: PastABoard, tmp_path_factory: pytest.TempPathFactory
) -> tuple[MapFolder, Report, Odometry]:
    made, report = tracked(capture, tmp_path_factory.mktemp("masked") / "map")
    return made, report, load_odometry(made)


@pytest.fixture(scope="module")
def unmasked(
    capture: PastABoard, tmp_path_factory: pytest.TempPathFactory
) -> tuple[MapFolder, Report]:
    """With a mask that may cover next to nothing."""
    folder = tmp_path_factory.mktemp("unmasked") / "map"
    return tracked(capture, folder, "masking.max_share=0.02")


def past_the_board(
    capture: PastABoard, tracked: Odometry
) -> list[tuple[FrameFeatures, np.ndarray]]:
    """Keyframes before which the board is, and its columns there."""
    seen = [(keyframe, capture.columns(keyframe.row)) for keyframe in tracked.keyframes]
    return [(keyframe, columns) for keyframe, columns in seen if len(columns)]


def on(columns: np.ndarray, keyframe: FrameFeatures) -> np.ndarray:
    x = keyframe.features.keypoints_px[:, 0]
    return (x > columns[0] - 0.5) & (x < columns[-1] + 0.5)


def test_no_edge_follows_what_moves(
    run: tuple[MapFolder, Report, Odometry], tiny_capture: Path
) -> None:
    T = read_tum(tiny_capture / "groundtruth.txt").T_world_camera
    tracked = run[2]
    assert not tracked.segment.any()
    for edge in tracked.edges:
        error = se3.inverse(se3.inverse(T[edge.i]) @ T[edge.j]) @ edge.T_i_j
        assert np.linalg.norm(error[:3, 3]) < STEP_M / 3


def test_keyframes_have_no_features_and_no_depth_of_what_moves(
    run: tuple[MapFolder, Report, Odometry], capture: PastABoard
) -> None:
    made, _, tracked = run
    seen = past_the_board(capture, tracked)
    assert len(seen) > 3
    for keyframe, columns in seen:
        depth_m = load_keyframe(made, keyframe.row, tracked.frames).depth_m
        assert on(columns, keyframe).mean() < 0.02
        assert (depth_m[:, columns] > 0).mean() < 0.05
        assert (np.delete(depth_m, columns, 1) > 0).mean() > 0.8


def test_the_report_says_how_much_moves_and_where_most(
    run: tuple[MapFolder, Report, Odometry], capture: PastABoard
) -> None:
    _, report, tracked = run
    whole = 100 / capture.camera.color.width
    assert report.values["moving"]["most"] == pytest.approx(whole, abs=0.02)
    assert report.values["moving"]["frames_without_mask"] == []
    assert all(tracked.moving_share[k] > 0.28 for k in report.values["moving"]["frames_with_most"])
    assert "of the pixels move, at most 32%" in report.lines[1]


def test_a_picture_shows_the_keyframes_with_most(
    run: tuple[MapFolder, Report, Odometry], capture: PastABoard
) -> None:
    made, _, tracked = run
    figure = moving_figure(made, tracked)
    assert figure is not None
    assert len(figure.axes) == 4
    assert [axes.get_title() for axes in figure.axes][0].startswith("frame 27: 3")


def test_above_the_largest_share_there_is_no_mask_and_that_is_said(
    unmasked: tuple[MapFolder, Report], capture: PastABoard
) -> None:
    made, report = unmasked
    tracked = load_odometry(made)
    without = report.values["moving"]["frames_without_mask"]
    assert len(without) > FRAMES / 2
    assert any("without a mask: most of what is seen moves" in line for line in report.warnings)
    assert moving_figure(made, tracked) is None
    for keyframe, columns in past_the_board(capture, tracked):
        depth_m = load_keyframe(made, keyframe.row, tracked.frames).depth_m
        if keyframe.row in without:
            assert not load_keyframe_mask(made, keyframe.row, depth_m.shape).any()
            assert (depth_m[:, columns] > 0).all()


def test_masks_keep_their_keyframes_when_a_map_grows(
    run: tuple[MapFolder, Report, Odometry], tmp_path: Path
) -> None:
    made, _, tracked = run
    for first_row in (0, FRAMES):
        copy_keyframes(made, tmp_path, first_row)
    row = tracked.keyframes[-1].row
    first, again = (
        (tmp_path / "keyframes" / f"{k:06d}.mask.png").read_bytes() for k in (row, row + FRAMES)
    )
    assert first == again


def test_where_all_frames_are_kept_so_are_their_masks(tiny_capture: Path, tmp_path: Path) -> None:
    """What is fused of a frame that is no keyframe must not show what moves in it, either."""
    capture = PastABoard(open_capture(tiny_capture, CaptureConfig()), 100)
    folder, _ = tracked(capture, tmp_path / "map", "odometry.kept_frames=all")
    assert kept_rows(folder, FRAMES) == list(range(FRAMES))
    keyframes = {k.row for k in load_odometry(folder).keyframes}
    shape = capture.camera.color.height, capture.camera.color.width
    masked = [row for row in range(FRAMES) if load_keyframe_mask(folder, row, shape).any()]
    assert set(masked) - keyframes

"""Odometry over the tiny capture, and over captures cut out of it and damaged."""

import dataclasses
import os
import shutil
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from tests.lighting.lamp import LampLit, lamp
from tests.overlays.marked import Marked
from vnav.config import CaptureConfig, Config, FeaturesConfig, load
from vnav.config.registries import DESCRIPTORS, ESTIMATORS, TRACKERS
from vnav.core import se3
from vnav.core.camera import Camera
from vnav.core.frame import Edge, Frame
from vnav.core.graph import chain
from vnav.core.mapping import LOST, Odometry
from vnav.errors import CaptureError
from vnav.io.formats.trajectories import read_tum
from vnav.io.sources.capture import Capture
from vnav.io.sources.memory import ArrayCapture, frames
from vnav.io.sources.open_capture import open_capture
from vnav.io.sources.rectify import resampled
from vnav.io.sources.subset import Subset
from vnav.io.store.artifacts import load_keyframe, load_odometry, map_camera
from vnav.io.store.map_folder import MapFolder
from vnav.stages import odometry
from vnav.synthetic import MINIATURE, SCENES
from vnav.synthetic.sensor import measured_color, measured_depth

CONFIG = Config(features=FeaturesConfig(max_features=700))  # half: quick
DRIFT = 0.03  # rad, m: of a few frames. Over all 60 the edges' noise adds up to 6 mm at the worst.


class Cut:
    """Some frames of a capture, in the order given; one black, one covered, or one damaged."""

    name, has_depth, poses = "cut", True, None

    def __init__(
        self,
        whole: Capture,
        indices: Sequence[int],
        black: int = -1,
        covered: int = -1,
        damaged: int = -1,
    ) -> None:
        self._whole, self._indices = whole, list(indices)
        self._black, self._covered, self._damaged = black, covered, damaged

    @property
    def camera(self) -> Camera:
        return self._whole.camera

    @property
    def stamps_s(self) -> np.ndarray:
        return np.arange(len(self)) / 5

    def __len__(self) -> int:
        return len(self._indices)

    def read(self, index: int) -> Frame:
        if index == self._damaged:
            raise CaptureError(f"expected a whole image in rgb/{index}.png, found a truncated file")
        frame = self._whole.read(self._indices[index])
        color, depth_m = frame.color, frame.depth_m
        if index in (self._black, self._covered):
            color = np.zeros_like(color)
        if index == self._covered:
            depth_m = np.zeros_like(depth_m)
        return Frame(0, index, self.stamps_s[index], color, depth_m, frame.intrinsics)

    def fingerprint(self) -> str:
        return f"{self._indices} {self._black} {self._covered} {self._damaged}"


@pytest.fixture(scope="module")
def truth(tiny_capture: Path) -> np.ndarray:
    return read_tum(tiny_capture / "groundtruth.txt").T_world_camera


@pytest.fixture(scope="module")
def tiny(tiny_map: Path) -> Odometry:
    return load_odometry(MapFolder(tiny_map))


def tracked(capture: Capture, folder: Path) -> Odometry:
    return odometry.track(capture, CONFIG, folder)


def true_motion(truth: np.ndarray, i: int, j: int) -> np.ndarray:
    return se3.inverse(truth[i]) @ truth[j]


def normalised(T_i_j: np.ndarray, edge: Edge) -> float:
    """Squared error of an edge by its own information, per degree of freedom."""
    error = se3.inverse(T_i_j) @ edge.T_i_j
    xi = np.concatenate([se3.log_so3(error[:3, :3]), error[:3, 3]])
    return float(xi @ edge.information @ xi) / 6


def ate_m(poses: np.ndarray, truth: np.ndarray) -> float:
    """Absolute trajectory error: root mean square after the best rigid alignment."""
    positions = poses[:, :3, 3]
    aligned = se3.transform(se3.align(truth[:, :3, 3], positions), positions)
    return float(np.sqrt(((aligned - truth[:, :3, 3]) ** 2).sum(1).mean()))


def test_every_frame_of_a_good_capture_is_tracked(tiny: Odometry) -> None:
    assert len(tiny.frames) == 60
    assert not tiny.segment.any()
    assert not any(tiny.reasons)
    assert se3.is_rigid(tiny.T_segment_camera)
    np.testing.assert_array_equal(tiny.T_segment_camera[0], np.eye(4))


def test_the_frame_table_says_how_much_later_depth_is_stamped(
    tiny: Odometry, tiny_capture: Path
) -> None:
    offsets_s = open_capture(tiny_capture, CaptureConfig()).files.offsets_s
    assert offsets_s.all()
    np.testing.assert_allclose(tiny.frames.depth_after_s, offsets_s)


def test_edges_are_as_good_as_they_say(tiny: Odometry, truth: np.ndarray) -> None:
    # 1 on average where keypoints err by the pixel of the settings; rendered frames err by less.
    errors = [normalised(true_motion(truth, e.i, e.j), e) for e in tiny.edges]
    assert np.mean(errors) < 1
    assert max(errors) < 4  # chi-squared of 6 beyond 24: once in 2000


def drift_of_noise_m(odometry: Odometry, truth: np.ndarray) -> float:
    """The greatest absolute error of 20 trajectories with the noise that the edges say."""
    rng = np.random.default_rng(0)

    def drawn(edge: Edge) -> Edge:
        """The same edge with another error, as its information says errors are."""
        scatter = np.linalg.cholesky(np.linalg.inv(edge.information))
        T_i_j = true_motion(truth, edge.i, edge.j) @ se3.exp(scatter @ rng.standard_normal(6))
        return dataclasses.replace(edge, T_i_j=T_i_j)

    walks = [chain(len(truth), [drawn(e) for e in odometry.edges], [0])[0] for _ in range(20)]
    return max(ate_m(walk, truth) for walk in walks)


def test_drift_is_no_more_than_the_noise_of_the_edges_adds_up_to(
    tiny: Odometry, truth: np.ndarray
) -> None:
    assert ate_m(tiny.T_segment_camera, truth) < drift_of_noise_m(tiny, truth)


@pytest.mark.parametrize(
    "setting",
    [
        *(f"tracking.method={name}" for name in sorted(TRACKERS.keys() - {DESCRIPTORS})),
        *(f"registration.estimator={name}" for name in sorted(ESTIMATORS.keys() - {"points3d"})),
    ],
)
def test_other_trackers_and_estimators_drift_no_more_than_their_edges_say(
    setting: str, capture: Capture, truth: np.ndarray, tmp_path: Path
) -> None:
    config = load(settings=["features.max_features=700", setting])
    result = odometry.track(Subset(capture, range(16)), config, tmp_path)
    assert not any(result.reasons)
    assert not result.segment.any()
    assert ate_m(result.T_segment_camera, truth[:16]) < drift_of_noise_m(result, truth[:16])


def test_keyframes_are_fewer_than_frames_and_never_far_apart(
    tiny: Odometry, truth: np.ndarray
) -> None:
    rows = [k.row for k in tiny.keyframes]
    assert rows[0] == 0
    assert rows == sorted(rows)
    assert 10 <= len(rows) <= 30
    settings = CONFIG.odometry
    step_m = np.linalg.norm(np.diff(truth[:, :3, 3], axis=0), axis=1).max()
    step_deg = np.rad2deg(max(se3.rotation_angle(true_motion(truth, k, k + 1)) for k in range(59)))
    for i, j in zip(rows[:-1], rows[1:], strict=True):
        motion = true_motion(truth, i, j)
        # The limits, and one step more: a keyframe is made once they are passed.
        assert np.linalg.norm(motion[:3, 3]) < settings.keyframe_translation_m + step_m
        assert np.rad2deg(se3.rotation_angle(motion)) < settings.keyframe_rotation_deg + step_deg


def test_keyframes_keep_their_images(tiny: Odometry, tiny_map: Path, capture: Capture) -> None:
    row = tiny.keyframes[3].row
    kept = load_keyframe(MapFolder(tiny_map), row, tiny.frames)
    frame = capture.read(row)
    assert (kept.index, kept.stamp_s) == (frame.index, frame.stamp_s)
    np.testing.assert_allclose(kept.depth_m, frame.depth_m, atol=1.01e-4)  # steps of 0.2 mm
    stored = list((tiny_map / "odometry" / "keyframes").glob("*.jpg"))
    assert len(stored) == len(tiny.keyframes)


def test_keyframe_points_are_their_features_lifted(tiny: Odometry, tiny_map: Path) -> None:
    camera = map_camera(MapFolder(tiny_map))
    for keyframe in tiny.keyframes[::5]:
        good = keyframe.has_depth
        assert good.mean() > 0.5
        px = camera.project(keyframe.points_camera[good])
        np.testing.assert_allclose(px, keyframe.features.keypoints_px[good], atol=1e-3)


def test_a_black_frame_is_followed_by_its_depth_from_both_sides(
    capture: Capture, truth: np.ndarray, tmp_path: Path
) -> None:
    result = tracked(Cut(capture, range(8), black=4), tmp_path)
    assert result.reasons == ("",) * 8
    assert [(e.i, e.j) for e in result.degenerate_edges] == [(3, 4), (4, 5)]
    for edge in result.degenerate_edges:
        # Squared error by the information of 6 degrees of freedom: 99.9 % are below 22.5.
        assert 6 * normalised(true_motion(truth, edge.i, edge.j), edge) < 22.5
    assert result.segment.tolist() == [0, 0, 0, 0, LOST, 0, 0, 0]


def test_a_covered_frame_is_named_and_the_next_is_connected(
    capture: Capture, truth: np.ndarray, tmp_path: Path
) -> None:
    result = tracked(Cut(capture, range(8), covered=4), tmp_path)
    assert result.segment.tolist() == [0, 0, 0, 0, LOST, 0, 0, 0]
    assert result.reasons[4] == "0 features with depth"
    assert not any(result.reasons[:4] + result.reasons[5:])
    assert np.isnan(result.T_segment_camera[4]).all()
    np.testing.assert_allclose(result.T_segment_camera[7], true_motion(truth, 0, 7), atol=DRIFT)


def test_a_damaged_frame_is_skipped_and_told_as_the_reader_tells_it(
    capture: Capture, tmp_path: Path
) -> None:
    result = tracked(Cut(capture, range(6), damaged=0), tmp_path)
    assert result.segment.tolist() == [LOST, 0, 0, 0, 0, 0]
    assert result.reasons[0] == "expected a whole image in rgb/0.png, found a truncated file"
    assert result.keyframes[0].row == 1
    assert np.isnan(result.frames.depth_after_s).tolist() == [True, *[False] * 5]
    assert not result.frames.uneven_s.any()  # the others' depth is as late as each other's


def test_two_walks_that_share_no_view_are_two_segments(
    capture: Capture, truth: np.ndarray, tmp_path: Path
) -> None:
    # The second walk looks the other way, from the other end of the room.
    result = tracked(Cut(capture, [*range(5), *range(28, 33)]), tmp_path)
    assert result.segment.tolist() == [0] * 5 + [1] * 5
    assert not any(result.reasons)
    np.testing.assert_array_equal(result.T_segment_camera[5], np.eye(4))
    within = result.T_segment_camera[9]
    np.testing.assert_allclose(within, true_motion(truth, 28, 32), atol=DRIFT)


def test_a_walk_that_comes_back_goes_on_in_its_old_segment(
    capture: Capture, truth: np.ndarray, tmp_path: Path
) -> None:
    result = tracked(Cut(capture, [*range(4), 28, 29, 3, 4]), tmp_path)
    assert result.segment.tolist() == [0, 0, 0, 0, 1, 1, 0, 0]
    np.testing.assert_allclose(result.T_segment_camera[7], true_motion(truth, 0, 4), atol=DRIFT)


def test_a_frame_that_matches_nothing_is_lost_and_told(capture: Capture, tmp_path: Path) -> None:
    result = tracked(Cut(capture, [0, 1, 30, 2, 3]), tmp_path)
    assert result.reasons[2] == "no frame before it matches"
    assert [r for k, r in enumerate(result.reasons) if k != 2] == [""] * 4
    assert [result.segment[k] for k in (0, 1, 3, 4)] == [0] * 4


def test_a_camera_that_stands_still_needs_one_keyframe(capture: Capture, tmp_path: Path) -> None:
    result = tracked(Cut(capture, [10] * 4), tmp_path)
    assert [k.row for k in result.keyframes] == [0]
    expected = np.broadcast_to(np.eye(4), (4, 4, 4))
    np.testing.assert_allclose(result.T_segment_camera, expected, atol=1e-6)


def test_one_frame_alone_is_a_capture(capture: Capture, tmp_path: Path) -> None:
    result = tracked(Cut(capture, [10]), tmp_path)
    assert result.segment.tolist() == [0]
    assert result.reasons == ("",)
    assert len(result.edges) == 0


def test_a_capture_that_shows_nothing_is_an_error(capture: Capture, tmp_path: Path) -> None:
    with pytest.raises(CaptureError, match=r"expected frames with .* found none in 1 frames"):
        tracked(Cut(capture, [10], black=0), tmp_path)
    with pytest.raises(CaptureError, match="vnav check"):
        tracked(Cut(capture, [10], damaged=0), tmp_path)


def test_depth_beyond_the_limit_is_not_used(capture: Capture, tmp_path: Path) -> None:
    near = dataclasses.replace(CONFIG.odometry, max_depth_m=2.0)
    config = dataclasses.replace(CONFIG, odometry=near)
    result = odometry.track(Cut(capture, [0]), config, tmp_path)
    assert np.nanmax(result.keyframes[0].points_camera[:, 2]) < 2.1  # a plane through a window


def stage_bytes(folder: MapFolder) -> dict[str, bytes]:
    files = [p for p in (folder.root / "odometry").rglob("*") if p.is_file()]
    return {str(p.relative_to(folder.root)): p.read_bytes() for p in files}


def test_the_stage_writes_the_same_bytes_whatever_the_number_of_cores(
    capture: Capture, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    cut = Cut(capture, range(7), black=2, covered=4)
    written = []
    for cores in (1, 5):
        monkeypatch.setattr(os, "cpu_count", lambda n=cores: n)
        folder = MapFolder.create(tmp_path / f"map_{cores}")
        odometry.run(folder, cut, CONFIG)
        written.append(stage_bytes(folder))
    assert written[0] == written[1]
    assert len(written[0]) > 6


def test_the_report_names_what_is_lost(capture: Capture, tmp_path: Path) -> None:
    folder = MapFolder.create(tmp_path / "map")
    report = odometry.run(folder, Cut(capture, range(5), covered=2), CONFIG)
    assert report.values["frames"] == 5
    assert report.values["tracked"] == 4
    lost = [{"capture": 0, "first": 2, "last": 2, "reason": "0 features with depth"}]
    assert report.values["lost"] == lost
    assert report.warnings == ("frame 2 lost: 0 features with depth",)
    assert report.lines[0].startswith("4 of 5 frames tracked")
    assert folder.report("odometry")["values"]["lost"] == lost


def test_a_finished_stage_is_reused_until_capture_or_settings_change(
    capture: Capture, tmp_path: Path
) -> None:
    folder = MapFolder.create(tmp_path / "map")
    cut = Cut(capture, range(2))
    first = odometry.run(folder, cut, CONFIG)
    again = odometry.run(folder, cut, CONFIG)
    assert (first.reused, again.reused) == (False, True)
    assert again.values == first.values
    assert not odometry.run(folder, cut, dataclasses.replace(CONFIG, seed=1)).reused
    other = dataclasses.replace(CONFIG, seed=1)
    assert not odometry.run(folder, Cut(capture, range(1, 3)), other).reused


def test_progress_ends_at_the_last_frame(capture: Capture, tmp_path: Path) -> None:
    seen: list[tuple[str, int, int]] = []

    def progress(task: str, done: int, total: int) -> None:
        seen.append((task, done, total))

    odometry.track(Cut(capture, range(2)), CONFIG, tmp_path, progress)
    assert seen[-1] == ("odometry", 2, 2)
    assert [done for _, done, _ in seen] == sorted(done for _, done, _ in seen)


def zooming(truth: np.ndarray, count: int) -> ArrayCapture:
    """The first frames of the tiny capture, by a lens whose focal length changes by 10 %."""
    scene, spec = SCENES[MINIATURE.scene](MINIATURE.seed), MINIATURE
    seen, cameras = [], []
    for k in range(count):
        rng, factor = np.random.default_rng([1, k]), (1.0, 1.1, 1.0, 0.9)[k % 4]
        fx, fy = factor * spec.camera.fx, factor * spec.camera.fy
        intrinsics = dataclasses.replace(spec.camera, fx=fx, fy=fy)
        color, depth_m = scene.render(intrinsics, truth[k])
        color = measured_color(color, np.ones(3), spec.sensor, rng)
        seen.append((color, measured_depth(depth_m, intrinsics, spec.sensor, rng)))
        cameras.append(Camera(intrinsics, 1.0))
    color, depth = zip(*seen, strict=True)
    return frames(color, depth, cameras, np.arange(count) / spec.rate_hz)


def test_a_focal_length_that_changes_from_frame_to_frame_makes_no_drift(
    tiny: Odometry, truth: np.ndarray, tmp_path: Path
) -> None:
    capture = zooming(truth, 20)
    result = tracked(capture, tmp_path)
    assert not result.segment.any()
    # No more than noise adds up to where the focal length stays; ignored, it would be 10 cm.
    constant = dataclasses.replace(tiny, edges=tuple(e for e in tiny.edges if e.j < 20))
    assert ate_m(result.T_segment_camera, truth[:20]) < drift_of_noise_m(constant, truth[:20])
    errors = [normalised(true_motion(truth, e.i, e.j), e) for e in result.edges]
    assert np.mean(errors) < 1


def test_keyframes_of_any_focal_length_are_kept_as_the_captures_camera_sees_them(
    truth: np.ndarray, tmp_path: Path
) -> None:
    whole = zooming(truth, 4)
    zoomed = Subset(whole, [3])
    folder = MapFolder.create(tmp_path / "map")
    odometry.run(folder, zoomed, CONFIG)
    kept = load_keyframe(folder, 0, load_odometry(folder).frames)
    assert map_camera(folder) == kept.intrinsics == whole.camera.color
    expected = resampled(zoomed.read(0), kept.intrinsics).depth_m
    np.testing.assert_allclose(kept.depth_m, expected, atol=1.01e-4)


def test_a_capture_without_depth_is_refused_before_it_is_read(
    truth: np.ndarray, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    camera = Camera(MINIATURE.camera, 1.0)
    color_only = frames(np.zeros((2, 240, 320, 3), np.uint8), None, camera, name="video")
    monkeypatch.setattr(ArrayCapture, "read", None)
    monkeypatch.setattr(ArrayCapture, "fingerprint", None)
    folder = MapFolder.create(tmp_path / "map")
    with pytest.raises(CaptureError, match="expected frames with depth, found video with colour"):
        odometry.run(folder, color_only, CONFIG)
    assert not (folder.root / "odometry").exists()


def test_arrays_make_the_same_odometry_as_the_folder_they_were_read_from(
    capture: Capture, tmp_path: Path
) -> None:
    read = [capture.read(k) for k in range(6)]
    images = [f.color for f in read], [f.depth_m for f in read]
    depth_s = [f.stamp_s + f.depth_after_s for f in read]
    arrays = frames(*images, capture.camera, capture.stamps_s[:6], depth_stamps_s=depth_s)
    folders = {"files": Subset(capture, range(6)), "arrays": arrays}
    for name, source in folders.items():
        odometry.run(MapFolder.create(tmp_path / name), source, CONFIG)
    made = sorted(path for path in (tmp_path / "files/odometry").rglob("*") if path.is_file())
    compared = [path for path in made if path.name != "stage.json"]  # which has the fingerprint
    assert {path.name for path in compared} >= {"frames.npz", "edges.npz", "000000.jpg"}
    for path in compared:
        other = tmp_path / "arrays" / path.relative_to(tmp_path / "files")
        assert other.read_bytes() == path.read_bytes(), path


@pytest.fixture(scope="module")
def by_a_lamp(capture: Capture, tmp_path_factory: pytest.TempPathFactory) -> MapFolder:
    folder = MapFolder.create(tmp_path_factory.mktemp("maps") / "by_a_lamp")
    odometry.run(folder, LampLit(capture), CONFIG)
    return folder


def test_odometry_by_a_lamp_is_as_good_as_without(by_a_lamp: MapFolder, truth: np.ndarray) -> None:
    # Without the lamp it drifts by 1.2 mm, with its noise alone by 2.4 mm; with the lamp's light
    # taken for the room's by 0.66 m. See DRIFT for the noise.
    result = load_odometry(by_a_lamp)
    assert not any(result.reasons)
    assert not result.segment.any()
    assert ate_m(result.T_segment_camera, truth) < 0.006


def test_the_report_says_what_light_was_taken_off(by_a_lamp: MapFolder) -> None:
    report = by_a_lamp.report("odometry")
    (found,) = report["values"]["light"]
    assert found["capture"] == 0
    off = np.log(found["corners"] / lamp(np.array(1.0)))
    assert abs(off) < 4 * found["sigma"] + 0.005  # half a grey level of 100: they are rounded
    assert (
        f"brightness falls to {found['corners']:.0%} at the corners: taken off" in report["lines"]
    )


def test_even_light_is_not_told_of_and_leaves_no_trace(tiny_map: Path) -> None:
    folder = MapFolder(tiny_map)
    with np.load(folder.file("odometry", "frames.npz")) as stored:
        assert "light" not in stored
    assert folder.report("odometry")["values"]["light"] == []
    assert not any("brightness" in line for line in folder.report("odometry")["lines"])


def test_keyframes_are_kept_without_the_lamps_light(by_a_lamp: MapFolder, capture: Capture) -> None:
    frame = load_keyframe(by_a_lamp, 0, load_odometry(by_a_lamp).frames)
    off = frame.color.astype(float).mean((0, 1)) - capture.read(0).color.mean((0, 1))
    assert np.abs(off).max() < 1  # of 255; the lamp takes a third of the light


def test_the_light_may_be_left_as_it_is(
    capture: Capture, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(odometry, "flattened", None)  # not even looked for
    config = dataclasses.replace(CONFIG, capture=CaptureConfig(flatten="off"))
    result = odometry.track(Cut(capture, [10]), config, tmp_path)
    assert odometry.report(result).values["light"] == []


def test_odometry_with_text_and_a_robot_in_view_is_as_good_as_without(
    capture: Capture, truth: np.ndarray, tmp_path: Path
) -> None:
    # 1.2 mm without; with both taken for the scene they hold the camera where it is.
    folder = MapFolder.create(tmp_path / "map")
    odometry.run(folder, Marked(capture), CONFIG)
    result, report = load_odometry(folder), folder.report("odometry")
    assert not any(result.reasons)
    assert ate_m(result.T_segment_camera, truth) < 0.006
    assert report["values"]["overlay"] > 0.1
    assert any("shows the same in all views" in line for line in report["lines"])


@pytest.mark.parametrize(("kind", "name"), [("rgb", "colour"), ("depth", "depth")])
def test_where_a_camera_is_slow_frames_with_an_image_of_the_frame_before_are_left_out(
    kind: str, name: str, tiny_capture: Path, truth: np.ndarray, tmp_path: Path
) -> None:
    # 1.2 mm without; with two moments in a frame it drifts by centimetres.
    shutil.copytree(tiny_capture, tmp_path / "slow")
    listed = tmp_path / "slow" / f"{kind}.txt"
    lines = [line.split() for line in listed.read_text().splitlines() if line[0] != "#"]
    twice = [f"{stamp} {lines[k // 2 * 2][1]}\n" for k, (stamp, _) in enumerate(lines)]
    listed.write_text("".join(twice))
    folder = MapFolder.create(tmp_path / "map")

    odometry.run(folder, open_capture(tmp_path / "slow", CaptureConfig()), CONFIG)

    result, report = load_odometry(folder), folder.report("odometry")
    assert [bool(reason) for reason in result.reasons] == [False, True] * (len(lines) // 2)
    assert ate_m(result.T_segment_camera[::2], truth[::2]) < 0.006
    (warning,) = report["warnings"]
    assert warning.startswith(f"frames 1 to 59 lost: 30 of them, its {name} image is that of the")
    assert len(report["values"]["lost"]) == 30

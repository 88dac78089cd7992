"""Keyframes of a furnished room by a sensor that moves, its depth late and its shutter rolling."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from vnav.config import RegistrationConfig
from vnav.core import se3
from vnav.core.frame import Edge, Features
from vnav.core.mapping import FrameFeatures
from vnav.features.lifting import lift
from vnav.features.sift import SPACE
from vnav.optimisation.displacement import without_displacement
from vnav.optimisation.feature_tracks import FeatureTracks, merged
from vnav.optimisation.observation_selection import ObservationSelection
from vnav.optimisation.self_calibration import (
    CONVERGED_SHARE,
    LARGEST,
    SURE_SIGMAS,
    SensorCalibration,
    calibrated,
)
from vnav.optimisation.sensor_errors import MovingCamera, MovingSensor, SensorErrors
from vnav.optimisation.sensor_model import Bundle, SensorModel
from vnav.optimisation.solution_report import sensor_lines
from vnav.registration.correspondences import Correspondences
from vnav.synthetic import MINIATURE, Scene, one_room
from vnav.synthetic.rendered_capture import camera_poses

CAMERA = MINIATURE.camera
CONFIG = RegistrationConfig()
KEYFRAMES, POINTS = 8, 400
PIXEL_SIGMA = 0.2
TURN_RAD_PER_S, SPEED_M_PER_S = 1.5, 0.4
ERRORS = SensorErrors(0.0, 0.02, 8e-5)  # 8e-5 s a row: 19 ms from the first to the last
UNKNOWN = SensorCalibration.unknown(1)
EVEN = np.zeros(KEYFRAMES)
UNEVEN = np.linspace(-0.016, 0.016, KEYFRAMES)  # seconds, as two clocks that drift apart


@dataclass
class MovingScene:
    """True poses (K, 4, 4), twists (K, 6), the pixels (K, P, 2) without errors, and the tracks."""

    T_world_camera: np.ndarray
    twists: np.ndarray
    still_px: np.ndarray
    tracks: FeatureTracks
    sensor: MovingSensor

    @property
    def bundle(self) -> Bundle:
        """True poses, points where the keyframes' own depth has them."""
        rows = np.arange(len(self.tracks.seen))
        points = self.tracks.points_world(self.T_world_camera, rows)
        return Bundle(self.T_world_camera, points)

    @property
    def selection(self) -> ObservationSelection:
        """All of them, with the noise of the settings."""
        rows = np.flatnonzero(np.isfinite(self.bundle.points_world[self.tracks.seen.landmark, 0]))
        model = SensorModel([CAMERA] * KEYFRAMES, CONFIG)
        return ObservationSelection(rows, model, [], None, 0)


def moving_scene(
    errors: SensorErrors,
    seed: int = 0,
    moves: float = 1.0,
    other: SensorErrors | None = None,
    uneven_s: np.ndarray = EVEN,
    stamped_s: np.ndarray = EVEN,
) -> MovingScene:
    """Every second frame's place of a walk; each camera turns and moves in a direction of its own.

    ``moves``: times `TURN_RAD_PER_S` and `SPEED_M_PER_S`; ``other``: every second keyframe is of
    another capture, whose sensor has these errors; ``uneven_s`` (K,): how much later than that
    depth is measured, and ``stamped_s`` (K,): how much later its stamps say.
    """
    captures = np.arange(KEYFRAMES, dtype=np.int32) % 2 * (other is not None)
    of_keyframes = [(errors, other or errors)[capture] for capture in captures]
    rng, room = np.random.default_rng(seed), one_room(0)
    T = camera_poses(room, MINIATURE)[: 2 * KEYFRAMES : 2]
    sizes = moves * np.repeat([TURN_RAD_PER_S, SPEED_M_PER_S], 3)
    twists = sizes * rng.uniform(-1, 1, (KEYFRAMES, 6))
    points = _points(room, T, rng)
    keyframes, depths, still = [], [], []
    for k, errors in enumerate(of_keyframes):
        late_s = errors.depth_delay_s + uneven_s[k]
        depth_m = room.render_depth(CAMERA, T[k] @ se3.exp(late_s * twists[k]))
        inverse = np.where(depth_m > 0, 1 / np.maximum(depth_m, 1e-3) + errors.depth_offset, np.inf)
        depths.append((1 / inverse).astype(np.float32))
        px = rolling_px(points, T[k], twists[k], errors.line_delay_s)
        still.append(rolling_px(points, T[k], twists[k], 0.0))
        seen = px + PIXEL_SIGMA * rng.standard_normal(px.shape)
        keyframes.append(_frame(k, seen, depths[k], _visible(room, T[k], points)))
    number = np.arange(POINTS)
    matches = [
        np.column_stack([np.full(POINTS, i), number, np.full(POINTS, j), number])
        for i in range(KEYFRAMES)
        for j in range(i + 1, KEYFRAMES)
    ]
    both = np.concatenate(matches).astype(np.int32)
    seen_by = np.array([k.has_depth for k in keyframes])
    both = both[seen_by[both[:, 0], both[:, 1]] & seen_by[both[:, 2], both[:, 3]]]
    told = twists, captures.tolist(), stamped_s.tolist()
    cameras = list(map(MovingCamera, [CAMERA] * KEYFRAMES, *told))
    sensor = MovingSensor(keyframes, cameras, depths.__getitem__, CONFIG)
    return MovingScene(
        T,
        twists,
        np.array(still),
        FeatureTracks(keyframes, merged(keyframes, both), sensor, captures),
        sensor,
    )


def rolling_px(points: np.ndarray, T: np.ndarray, twist: np.ndarray, line_s: float) -> np.ndarray:
    """Pixels (P, 2) where the row that sees a point is exposed just then."""
    after_s = np.zeros(len(points))
    for _ in range(20):
        T_now = T @ se3.exp(after_s[:, None] * twist)
        px = CAMERA.project(se3.transform(se3.inverse(T_now), points[:, None])[:, 0])
        after_s = np.nan_to_num(line_s * (px[:, 1] - (CAMERA.height - 1) / 2))
    return px


def _points(room: Scene, T: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """World points (POINTS, 3) that the keyframes see, as many of each."""
    found = []
    for pose in T:
        px = rng.integers([20, 20], [CAMERA.width - 20, CAMERA.height - 20], (POINTS // len(T), 2))
        z = room.render_depth(CAMERA, pose)[px[:, 1], px[:, 0]]
        found.append(se3.transform(pose, CAMERA.unproject(px, z)))
    return np.concatenate(found)


def _visible(room: Scene, T: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Which points (P,) nothing hides, well inside the image."""
    inside = se3.transform(se3.inverse(T), points)
    px = CAMERA.project(inside)
    good = ((px > 15) & (px < np.array(CAMERA.size) - 16)).all(1)
    x, y = np.rint(np.where(good[:, None], px, 0)).astype(int).T
    z = room.render_depth(CAMERA, T)[y, x]
    return good & (np.abs(inside[:, 2] / np.maximum(z, 1e-3) - 1) < 0.02)


def _frame(row: int, px: np.ndarray, depth_m: np.ndarray, visible: np.ndarray) -> FrameFeatures:
    n = len(px)
    px = np.where(visible[:, None], np.nan_to_num(px), 0).astype(np.float32)
    features = Features(
        px, np.zeros((n, 128), np.uint8), np.ones(n), np.ones(n), np.zeros(n), SPACE
    )
    points = lift(px, depth_m, CAMERA, CONFIG)
    points[~visible] = np.nan
    return FrameFeatures(row, features, points)


@pytest.fixture(scope="module")
def delayed() -> MovingScene:
    return moving_scene(ERRORS)


def seen_with_depth(scene: MovingScene) -> np.ndarray:
    """Which features (F,) have depth and are among those that were drawn inside the image."""
    return np.isfinite(scene.tracks.points_camera[:, 2])


def test_features_are_put_where_they_were_at_the_stamp(delayed: MovingScene) -> None:
    without, _ = delayed.tracks.without([ERRORS])
    known = seen_with_depth(delayed)
    still = delayed.still_px.reshape(-1, 2)[known]
    off = np.linalg.norm(without.seen.px[known] - still, axis=1)
    before = np.linalg.norm(delayed.tracks.seen.px[known] - still, axis=1)
    # A pixel's noise, whose length is 1.18 of its sigma in the median.
    assert np.median(off) == pytest.approx(1.18 * PIXEL_SIGMA, rel=0.15)
    assert np.median(before) > 3 * np.median(off)


def test_depth_is_that_of_the_stamp(delayed: MovingScene) -> None:
    without, _ = delayed.tracks.without([ERRORS])
    known = seen_with_depth(delayed) & np.isfinite(without.points_camera[:, 2])
    truth = moving_scene(SensorErrors())  # the same points by a sensor without errors
    exact = 1 / truth.tracks.points_camera[known, 2]
    late = np.abs(1 / delayed.tracks.points_camera[known, 2] - exact)
    mended = np.abs(1 / without.points_camera[known, 2] - exact)
    assert np.nanmedian(mended) < np.nanmedian(late) / 5


@pytest.mark.parametrize("k", [0, 1, 2])
def test_what_is_measured_grows_with_the_errors_as_told(delayed: MovingScene, k: int) -> None:
    step = np.array([1e-4, 5e-4, 2e-6, 0.1]) * (np.arange(4) == k)
    here, by_error = delayed.tracks.without([ERRORS])
    there, _ = delayed.tracks.without([SensorErrors(*(ERRORS.vector + step))])
    sigmas = np.array([1, 1, CONFIG.depth_sigma_per_m2])
    taken_off = np.column_stack(
        [here.seen.px - there.seen.px, here.seen.inverse_depth - there.seen.inverse_depth]
    )
    known = np.isfinite(taken_off[:, 2])
    told = (by_error @ step / sigmas)[known]
    off = np.linalg.norm(taken_off[known] / sigmas - told, axis=1)
    # Second order: a hundredth of a second at 1.5 rad/s.
    assert np.median(off) < 0.05 * np.median(np.linalg.norm(told, axis=1))


def test_both_delays_are_found(delayed: MovingScene) -> None:
    sensor, bundle = calibrated(delayed.bundle, delayed.tracks, delayed.selection, UNKNOWN)
    off = np.abs(sensor.errors[0].vector - ERRORS.vector)
    assert (off[1:] <= 0.1 * ERRORS.vector[1:]).all()
    assert (off < 4 * sensor.sigmas).all()
    true = delayed.T_world_camera
    found = se3.inverse(bundle.T_world_camera[0]) @ bundle.T_world_camera
    error = se3.inverse(se3.inverse(true[0]) @ true) @ found
    assert np.linalg.norm(error[:, :3, 3], axis=1).max() < 0.01


@pytest.mark.parametrize(("seed", "moves"), [(1, 2.5), (1, 3.0), (2, 3.0)])
def test_delays_are_found_whose_displacement_exceeds_the_noise_by_far(
    seed: int, moves: float
) -> None:
    """What tells most of them stands out then, until they are taken off."""
    errors = SensorErrors(0.0, 0.03, 3e-5)
    scene = moving_scene(errors, seed, moves)
    sensor, _ = calibrated(scene.bundle, scene.tracks, scene.selection, UNKNOWN)
    off = np.abs(sensor.errors[0].vector - errors.vector)
    assert (off[1:] <= 0.1 * errors.vector[1:]).all()


OTHERS = [SensorErrors(), SensorErrors(3e-4, -0.015, 0.0)]


@pytest.mark.parametrize("other", OTHERS)
def test_each_capture_has_errors_of_its_own(other: SensorErrors) -> None:
    scene = moving_scene(ERRORS, other=other)
    unknown = SensorCalibration.unknown(2)
    sensor, _ = calibrated(scene.bundle, scene.tracks, scene.selection, unknown)
    found, true = (np.array([e.vector for e in both]) for both in (sensor.errors, (ERRORS, other)))
    assert (np.abs(found - true)[:, 1:] < 0.1 * np.abs(true)[:, 1:] + 1e-12).all()
    assert (np.abs(found - true) < 4 * sensor.sigmas + [1e-4, 0, 0, 0]).all()


@pytest.mark.parametrize("errors", [ERRORS, SensorErrors()])
def test_stamps_of_depth_that_vary_are_believed_where_images_bear_them_out(
    errors: SensorErrors,
) -> None:
    scene = moving_scene(errors, uneven_s=UNEVEN, stamped_s=UNEVEN)
    sensor, _ = calibrated(scene.bundle, scene.tracks, scene.selection, UNKNOWN)
    (found,) = sensor.errors
    assert found.depth_stamp_share == pytest.approx(1, abs=0.1)
    assert found.depth_delay_s == pytest.approx(errors.depth_delay_s, abs=0.002)
    assert found.line_delay_s == pytest.approx(errors.line_delay_s, rel=0.1)


def test_stamps_of_depth_that_vary_by_themselves_tell_nothing() -> None:
    scene = moving_scene(ERRORS, stamped_s=UNEVEN)
    sensor, _ = calibrated(scene.bundle, scene.tracks, scene.selection, UNKNOWN)
    (found,) = sensor.errors
    assert abs(found.depth_stamp_share) < 0.1
    assert found.depth_delay_s == pytest.approx(ERRORS.depth_delay_s, rel=0.1)


def test_edges_are_freed_of_what_uneven_stamps_displace() -> None:
    """A frame whose depth is late by its stamp is as one whose sensor is late."""
    errors, late = SensorErrors(depth_stamp_share=1.0), SensorErrors(0.0, 0.016)
    scene = moving_scene(SensorErrors(), stamped_s=EVEN + 0.016)
    T = scene.T_world_camera
    edges = [Edge(0, 1, se3.inverse(T[0]) @ T[1], np.eye(6))]
    (by_stamp,) = without_displacement(edges, T, scene.sensor, [errors])
    (by_delay,) = without_displacement(edges, T, scene.sensor, [late])
    np.testing.assert_allclose(by_stamp.T_i_j, by_delay.T_i_j, atol=1e-9)
    assert np.linalg.norm(by_stamp.T_i_j - edges[0].T_i_j) > 1e-3


def test_depth_at_rest_is_without_each_captures_offset() -> None:
    scene = moving_scene(SensorErrors(), other=SensorErrors(3e-4, 0.0, 0.0))
    exact = moving_scene(SensorErrors())
    found, _ = scene.tracks.at_rest().without([SensorErrors(), SensorErrors(3e-4, 0.0, 0.0)])
    np.testing.assert_allclose(found.points_camera, exact.tracks.points_camera, rtol=1e-5)


def test_edges_between_captures_are_freed_of_what_either_displaces() -> None:
    scene = moving_scene(ERRORS, other=SensorErrors())
    T = scene.T_world_camera
    edges = [Edge(k, k + 1, se3.inverse(T[k]) @ T[k + 1], np.eye(6)) for k in range(2)]
    freed = without_displacement(edges, T, scene.sensor, [ERRORS, SensorErrors()])
    of_one = without_displacement(edges, T, scene.sensor, [ERRORS, ERRORS])
    for still, late, edge in zip(freed, of_one, edges, strict=True):
        moved = np.linalg.norm(se3.deviation(se3.inverse(edge.T_i_j) @ still.T_i_j))
        assert moved > 1e-3
        assert np.linalg.norm(still.T_i_j - late.T_i_j) > 1e-3


def test_captures_without_delays_are_not_touched_by_others_delays() -> None:
    scene = moving_scene(SensorErrors(), other=ERRORS)
    T = scene.T_world_camera
    between = [Edge(k, k + 2, se3.inverse(T[k]) @ T[k + 2], np.eye(6)) for k in (0, 2, 4)]
    freed = without_displacement(between, T, scene.sensor, [SensorErrors(), ERRORS])
    for still, edge in zip(freed, between, strict=True):
        np.testing.assert_allclose(still.T_i_j, edge.T_i_j, atol=1e-4)


def test_what_was_found_before_is_found_again_from_there(delayed: MovingScene) -> None:
    first, bundle = calibrated(delayed.bundle, delayed.tracks, delayed.selection, UNKNOWN)
    again, _ = calibrated(bundle, delayed.tracks, delayed.selection, first)
    off = np.abs(again.errors[0].vector - first.errors[0].vector)
    assert (off <= 2 * first.sigmas + CONVERGED_SHARE * first.errors[0].vector).all()


def test_an_error_that_was_refused_before_is_not_looked_for_again(delayed: MovingScene) -> None:
    known = SensorCalibration(
        (replace(ERRORS, line_delay_s=0.0),), np.array([[1e-5, 1e-3, 7e-6, 1.0]])
    )
    again, _ = calibrated(delayed.bundle, delayed.tracks, delayed.selection, known)
    assert again.errors[0].line_delay_s == 0
    assert again.sigmas[0, 2] == known.sigmas[0, 2]
    assert again.errors[0].depth_delay_s != 0


def test_tracks_among_all_are_measured_as_they_are_among_all(delayed: MovingScene) -> None:
    rows = delayed.tracks.long(delayed.selection.rows)
    assert 0 < len(rows) < len(delayed.tracks.seen)
    some, by_error = delayed.tracks.among(rows).without([ERRORS])
    every, by_error_of_all = delayed.tracks.without([ERRORS])
    np.testing.assert_array_equal(some.seen.px, every.seen.px[rows])
    np.testing.assert_array_equal(some.points_camera, every.points_camera[rows])
    np.testing.assert_array_equal(by_error, by_error_of_all[rows])


@pytest.mark.parametrize("seed", [1, 2])
def test_a_sensor_without_delays_gets_none(seed: int) -> None:
    scene = moving_scene(SensorErrors(), seed)
    sensor, _ = calibrated(scene.bundle, scene.tracks, scene.selection, UNKNOWN)
    assert not sensor.delayed
    # And it is known that they are smaller than those of a real sensor.
    assert (SURE_SIGMAS[:3] * sensor.sigmas[:, :3] < [1, 0.01, 2e-5]).all()


def test_a_camera_at_rest_tells_no_delay() -> None:
    scene = moving_scene(ERRORS, moves=0.0)
    sensor, _ = calibrated(scene.bundle, scene.tracks, scene.selection, UNKNOWN)
    assert not sensor.delayed


def test_without_depth_images_no_delay_is_told(delayed: MovingScene) -> None:
    tracks = delayed.tracks.at_rest()
    sensor, _ = calibrated(delayed.bundle, tracks, delayed.selection, UNKNOWN)
    assert not sensor.delayed
    assert np.isinf(sensor.sigmas[0, 1:]).all()


def test_a_delay_beyond_any_sensors_is_none() -> None:
    scene = moving_scene(SensorErrors(line_delay_s=1.5 * LARGEST[2]))
    sensor, _ = calibrated(scene.bundle, scene.tracks, scene.selection, UNKNOWN)
    assert sensor.errors[0].line_delay_s == 0


def test_an_offset_beyond_any_sensors_is_none() -> None:
    """Though little of it is left after errors in common are allowed for."""
    scene = moving_scene(SensorErrors(depth_offset=2 * LARGEST[0]))
    at_rest, selection = scene.tracks.at_rest(), scene.selection
    sensor, _ = calibrated(scene.bundle, at_rest, selection, UNKNOWN)
    assert sensor.errors[0].depth_offset == 0


def test_a_delay_that_is_refused_leaves_no_trace() -> None:
    """Landmarks, those of one sighting too, are where they were had it never been tried."""
    scene = moving_scene(SensorErrors(line_delay_s=1.5 * LARGEST[2]))
    sensor, bundle = calibrated(scene.bundle, scene.tracks, scene.selection, UNKNOWN)
    untried, at_rest = calibrated(scene.bundle, scene.tracks.at_rest(), scene.selection, UNKNOWN)
    assert sensor.errors == untried.errors
    np.testing.assert_array_equal(bundle.points_world, at_rest.points_world)


def test_the_offset_of_depth_is_found_beside_delays() -> None:
    errors = SensorErrors(3e-4, 0.015, 6e-5)
    scene = moving_scene(errors)
    sensor, _ = calibrated(scene.bundle, scene.tracks, scene.selection, UNKNOWN)
    assert (
        np.abs(sensor.errors[0].vector - errors.vector) < 4 * sensor.sigmas + [1e-4, 0, 0, 0]
    ).all()


@pytest.mark.parametrize("apart", [1, 2, 3])
def test_edges_are_freed_of_what_delays_displace(delayed: MovingScene, apart: int) -> None:
    """Those that registration finds; and what is left of it they do not deny."""
    edges = registered(delayed, apart)
    freed = without_displacement(edges, delayed.T_world_camera, delayed.sensor, [ERRORS])
    assert [(e.i, e.j) for e in freed] == [(e.i, e.j) for e in edges]
    before, after = off(delayed, edges), off(delayed, freed)
    assert (np.linalg.norm(after, axis=(0, 2)) < 0.5 * np.linalg.norm(before, axis=(0, 2))).all()
    surprise = [d.ravel() @ e.information @ d.ravel() for d, e in zip(after, freed, strict=True)]
    assert np.mean(surprise) < 6  # the mean of chi-squared with so many degrees of freedom


def test_edges_are_freed_one_by_one_and_keep_their_order(delayed: MovingScene) -> None:
    """As closures come, which are not in the order of their frames."""
    edges = registered(delayed, 2)
    shuffled = [edges[k] for k in np.random.default_rng(0).permutation(len(edges))]
    freed = without_displacement(shuffled, delayed.T_world_camera, delayed.sensor, [ERRORS])
    for edge, found in zip(shuffled, freed, strict=True):
        (alone,) = without_displacement([edge], delayed.T_world_camera, delayed.sensor, [ERRORS])
        assert (found.i, found.j) == (edge.i, edge.j)
        np.testing.assert_array_equal(found.T_i_j, alone.T_i_j)


def test_an_edge_whose_frames_see_nothing_of_the_keyframe_stays(delayed: MovingScene) -> None:
    T = delayed.T_world_camera.copy()
    T[1:] = T[1:] @ se3.make(se3.exp_so3([0, np.pi, 0]), np.zeros(3))
    (edge,) = without_displacement([Edge(0, 1, np.eye(4), np.eye(6))], T, delayed.sensor, [ERRORS])
    np.testing.assert_array_equal(edge.T_i_j, np.eye(4))


def registered(scene: MovingScene, apart: int) -> list[Edge]:
    """Edges between keyframes so far apart, by what both measure of the same points."""
    edges, both = [], [k.has_depth for k in scene.sensor.keyframes]
    for i in range(KEYFRAMES - apart):
        j = i + apart
        rows = np.flatnonzero(both[i] & both[j]).astype(np.int32)
        pair = scene.sensor.keyframes[i], scene.sensor.keyframes[j]
        matches = Correspondences(*pair, np.column_stack([rows, rows]), (CAMERA, CAMERA), CONFIG)
        T_i_j = se3.inverse(scene.T_world_camera[i]) @ scene.T_world_camera[j]
        found, information, _ = matches.refined(T_i_j)
        edges.append(Edge(i, j, found, information))
    return edges


def off(scene: MovingScene, edges: list[Edge]) -> np.ndarray:
    """How far edges are off (E, 2, 3), rad and m."""
    T = scene.T_world_camera
    errors = [se3.deviation(se3.inverse(se3.inverse(T[e.i]) @ T[e.j]) @ e.T_i_j) for e in edges]
    return np.reshape(errors, (-1, 2, 3))


def test_the_summary_tells_what_is_wrong_with_the_sensor() -> None:
    found = SensorCalibration(
        (SensorErrors(0.0, -0.0123, 5.2e-5),), np.array([[1e-4, 3e-4, 2e-6, 1.0]])
    )
    depth, shutter = sensor_lines(found)
    assert depth.startswith("depth is measured 12.3 ms (+- 0.3) before colour")
    assert shutter.startswith("rolling shutter: 52.0 us (+- 2.0) a row")
    assert not sensor_lines(UNKNOWN)


def test_the_summary_names_the_capture_whose_sensor_is_wrong() -> None:
    errors = SensorErrors(), SensorErrors(depth_stamp_share=1.0)
    (line,) = sensor_lines(SensorCalibration(errors, np.full((2, 4), np.inf)))
    assert line.startswith("capture 1: stamps of depth vary")

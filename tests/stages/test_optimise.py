"""The optimised tiny map against the truth, and what becomes of graphs that are cut or lied to."""

import dataclasses
import json
import os
import shutil
from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path

import numpy as np
import pytest

from vnav.config import CaptureConfig, Config
from vnav.core import se3
from vnav.core.camera import Intrinsics
from vnav.core.frame import Edge
from vnav.core.graph import chain, shortest_paths
from vnav.core.mapping import LOST, Odometry, OptimisedMap
from vnav.errors import MapError
from vnav.io.formats.arrays_file import save_arrays
from vnav.io.formats.trajectories import read_tum
from vnav.io.sources.open_capture import open_capture
from vnav.io.store.artifacts import (
    load_loop_edges,
    load_odometry,
    load_optimised,
    save_loops,
    save_odometry,
)
from vnav.io.store.map_folder import MapFolder
from vnav.optimisation import keyframe_edges, solution
from vnav.optimisation.parts import split_parts
from vnav.stages import loops, optimise, vocabulary
from vnav.stages import odometry as odometry_stage
from vnav.synthetic import MINIATURE, one_room

CONFIG = Config()


@pytest.fixture(scope="module")
def result(folder: MapFolder) -> OptimisedMap:
    return load_optimised(folder)


@pytest.fixture(scope="module")
def truth(tiny_capture: Path) -> np.ndarray:
    return read_tum(tiny_capture / "groundtruth.txt").T_world_camera


def aligned(T: np.ndarray, truth: np.ndarray, row: int = 0) -> np.ndarray:
    """Poses moved so that the first, or that of a row, is the true one."""
    return truth[row] @ se3.inverse(T[row]) @ T


def cut(odometry: Odometry, row: int) -> Odometry:
    """The same frames, no edge of which crosses a row."""
    inside = tuple(e for e in odometry.edges if (e.i < row) == (e.j < row))
    roots = [k.row for k in odometry.keyframes]
    poses, segment = chain(len(odometry.frames), inside, roots)
    return dataclasses.replace(odometry, edges=inside, T_segment_camera=poses, segment=segment)


def test_every_frame_has_a_pose(result: OptimisedMap) -> None:
    assert len(result.T_world_camera) == 60
    assert se3.is_rigid(result.T_world_camera)


def test_keyframes_err_as_their_covariances_say(
    result: OptimisedMap, odometry: Odometry, truth: np.ndarray
) -> None:
    # 1 on average where keypoints err by the pixel of the settings; rendered ones err by less,
    # and errors of neighbours hang together: a few independent ones, so up to 2 by chance.
    rows = [k.row for k in odometry.keyframes]
    anchor = np.trace(result.keyframe_covariance, axis1=1, axis2=2).argmin()
    T = aligned(result.T_world_camera, truth, rows[anchor])
    error = np.delete(se3.inverse(truth[rows]) @ T[rows], anchor, 0)
    xi = np.concatenate([se3.log_so3(error[:, :3, :3]), error[:, :3, 3]], 1)
    covariance = np.delete(result.keyframe_covariance, anchor, 0)
    normalised = np.einsum("ki,kij,kj->k", xi, np.linalg.inv(covariance), xi) / 6
    assert normalised.mean() < 2


def test_frames_between_keyframes_are_no_worse_than_their_own_edge(
    result: OptimisedMap, odometry: Odometry, truth: np.ndarray
) -> None:
    # A frame errs by its keyframe's error and that of the edge to it, six standard deviations
    # of which bound both: the keyframe is held by many such edges.
    T = aligned(result.T_world_camera, truth)
    off = np.linalg.norm(T[:, :3, 3] - truth[:, :3, 3], axis=1)
    sigma_m = max(np.sqrt(np.trace(np.linalg.inv(e.information)[3:, 3:])) for e in odometry.edges)
    between = np.setdiff1d(np.arange(60), [k.row for k in odometry.keyframes])
    assert off[between].max() < 6 * sigma_m


def test_the_floor_lies_at_zero_and_z_is_up(result: OptimisedMap, truth: np.ndarray) -> None:
    # The true world has its floor at zero, so heights compare as they are. The depth of a floor
    # 2 m away errs by 6 mm a pixel and is averaged over thousands; the sensor's steps and its
    # bias along slanted rays leave millimetres.
    assert result.world.source == "floor"
    off = result.T_world_camera[:, 2, 3] - truth[:, 2, 3]
    assert np.abs(off).max() < 0.005
    tilt = (truth[:, :3, :3] @ np.swapaxes(result.T_world_camera[:, :3, :3], 1, 2))[:, 2, 2]
    assert np.rad2deg(np.arccos(tilt.clip(-1, 1))).max() < 0.3


def test_landmarks_lie_on_the_surfaces_of_the_room(
    result: OptimisedMap, odometry: Odometry, truth: np.ndarray
) -> None:
    # Exact depth at the pixel of a landmark that a keyframe sees, half a pixel aside: in standard
    # deviations of the landmark, most are within 2 (95 %); some lie at edges.
    room, landmarks = one_room(MINIATURE.seed), result.landmarks
    T = aligned(result.T_world_camera, truth)
    points = se3.transform(T[0] @ se3.inverse(result.T_world_camera[0]), landmarks.points_world)
    off = []
    for k in (2, 9, 15):
        row = odometry.keyframes[k].row
        depth = room.render_depth(MINIATURE.camera, truth[row])
        seen = landmarks.landmark[landmarks.keyframe == k]
        in_camera = se3.transform(se3.inverse(truth[row]), points[seen])
        x, y = np.rint(MINIATURE.camera.project(in_camera)).astype(int).T
        inside = (x >= 0) & (x < 320) & (y >= 0) & (y < 240)
        surface = depth[y[inside], x[inside]]
        sigma = np.sqrt(3) * landmarks.sigma_m[seen][inside]  # nearly all of it along the ray
        off.append((in_camera[inside, 2] - surface) / sigma)
    within = np.abs(np.concatenate(off)) < 2
    assert len(within) > 500
    assert within.mean() > 0.9


def test_the_map_holds_one_observation_a_feature_at_most(
    result: OptimisedMap, odometry: Odometry
) -> None:
    landmarks = result.landmarks
    seen = set(zip(landmarks.keyframe.tolist(), landmarks.feature.tolist(), strict=True))
    assert len(seen) == len(landmarks.landmark)
    for k, feature in zip(landmarks.keyframe, landmarks.feature, strict=True):
        assert feature < len(odometry.keyframes[k].features)
    assert (np.bincount(landmarks.landmark) > 1).sum() > 1000
    assert np.isfinite(landmarks.points_world).all()


def test_files_for_other_programs_hold_the_same_poses(
    folder: MapFolder, result: OptimisedMap, odometry: Odometry
) -> None:
    stage = folder.stage("optimise")
    written = read_tum(stage / "trajectory_0.tum")
    np.testing.assert_array_equal(written.stamps_s, odometry.frames.stamp_s)
    np.testing.assert_allclose(written.T_world_camera, result.T_world_camera, atol=1e-9)
    assert json.loads((stage / "world.json").read_text())["source"] == "floor"
    lines = (stage / "graph.g2o").read_text().splitlines()
    assert sum(line.startswith("VERTEX_SE3:QUAT") for line in lines) == 60
    closures = folder.report("optimise")["values"]["closures_kept"]
    edges = sum(line.startswith("EDGE_SE3:QUAT") for line in lines)
    assert edges == len(odometry.edges) + closures


def test_wrong_loops_are_refused_and_do_no_harm(
    folder: MapFolder, odometry: Odometry, camera: Intrinsics, result: OptimisedMap
) -> None:
    # One in ten: opposite ends of the room are claimed to be one place, with every confidence.
    right, matches = load_loop_edges(folder)
    rows = [k.row for k in odometry.keyframes]
    n = len(rows)
    pairs = [(k, k + n // 2) for k in range(0, n // 2, max(1, 5 * n // len(right)))]
    wrong = [Edge(rows[i], rows[j], np.eye(4), right[0].information) for i, j in pairs]
    assert len(wrong) >= 0.1 * len(right) - 1
    solved = solution.solve(odometry, [*wrong, *right], matches, [camera], CONFIG)
    assert not solved.robust.graph.kept[: len(wrong)].any()
    assert solved.robust.graph.kept[len(wrong) :].all()
    clean = result.T_world_camera
    np.testing.assert_allclose(aligned(solved.poses, clean), clean, atol=1e-3)


def test_of_parts_that_nothing_joins_the_largest_is_the_map(
    folder: MapFolder, odometry: Odometry, camera: Intrinsics
) -> None:
    split = cut(odometry, 40)
    closures, matches = load_loop_edges(folder)
    number = {k.row: n for n, k in enumerate(odometry.keyframes)}
    inside = [e for e in closures if (e.i < 40) == (e.j < 40)]
    kept = {(number[e.i], number[e.j]) for e in inside}
    matches = matches[[(i, j) in kept for i, j in matches[:, [0, 2]].tolist()]]
    solved = solution.solve(split, inside, matches, [camera], CONFIG)
    assert [rows.tolist() for rows in solved.other_parts.values()] == [list(range(40, 60))]
    assert np.isfinite(solved.poses[:40]).all()
    assert np.isnan(solved.poses[40:]).all()
    outside = [n for row, n in number.items() if row >= 40]
    assert not np.isin(solved.adjusted.landmarks.keyframe, outside).any()


def test_closures_join_segments_and_all_of_them_are_the_map(
    folder: MapFolder, odometry: Odometry, camera: Intrinsics, truth: np.ndarray
) -> None:
    closures, matches = load_loop_edges(folder)
    solved = solution.solve(cut(odometry, 30), closures, matches, [camera], CONFIG)
    assert not solved.other_parts
    off = np.linalg.norm(aligned(solved.poses, truth)[:, :3, 3] - truth[:, :3, 3], axis=1)
    assert off.max() < 0.03  # the drift of all 60 frames adds up to 6 mm at the worst


def test_the_stage_writes_the_same_bytes_again(
    folder: MapFolder, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    copy = MapFolder(tmp_path / "map")
    shutil.copytree(folder.root, copy.root)
    shutil.rmtree(copy.root / "optimise")
    monkeypatch.setattr(os, "cpu_count", lambda: 7)
    assert not optimise.run(copy, CONFIG).reused
    for path in (folder.root / "optimise").iterdir():
        assert path.read_bytes() == (copy.root / "optimise" / path.name).read_bytes(), path.name
    assert optimise.run(copy, CONFIG).reused


def test_a_capture_of_one_place_is_a_map(tiny_capture: Path, tmp_path: Path) -> None:
    # Three frames that hardly move: one keyframe, no loop, nothing to adjust.
    still = tmp_path / "still"
    shutil.copytree(tiny_capture, still, ignore=shutil.ignore_patterns("photos"))
    for name in ("rgb.txt", "depth.txt"):
        lines = (still / name).read_text().splitlines()
        (still / name).write_text("\n".join(lines[:4]) + "\n")
    folder = MapFolder.create(tmp_path / "map")
    odometry_stage.run(folder, open_capture(still, CaptureConfig()), CONFIG)
    vocabulary.run(folder, CONFIG)
    loops.run(folder, CONFIG)
    report = optimise.run(folder, CONFIG)
    assert len(load_odometry(folder).keyframes) == 1
    assert report.values["posed"] == 3
    assert report.values["rms_px_after"] is None
    assert len(load_optimised(folder).landmarks) > 100


def in_two_parts(folder: MapFolder, odometry: Odometry, tmp_path: Path) -> MapFolder:
    """A map of which no edge crosses row 40, and that has no loops."""
    torn = MapFolder.create(tmp_path / "map")
    torn.set_captures(folder.captures)
    with torn.writing("odometry", {}, {}) as draft:
        save_odometry(draft, cut(odometry, 40))
        shutil.copytree(folder.root / "odometry" / "keyframes", draft / "keyframes")
    with torn.writing("loops", {}, torn.inputs_of("odometry")) as draft:
        save_loops(draft, [], [], np.zeros((0, 4), np.int32))
    return torn


def test_a_smaller_part_keeps_its_trajectory(
    folder: MapFolder, odometry: Odometry, truth: np.ndarray, tmp_path: Path
) -> None:
    torn = in_two_parts(folder, odometry, tmp_path)
    optimise.run(torn, CONFIG)
    kept = read_tum(torn.root / "optimise" / "part_2" / "trajectory_0.tum").T_world_camera
    off = np.linalg.norm(aligned(kept, truth[40:])[:, :3, 3] - truth[40:, :3, 3], axis=1)
    assert len(kept) == 20
    assert off.max() < 0.03  # as above: the drift of three times as many frames


def test_parts_that_nothing_joins_are_a_warning(
    folder: MapFolder, odometry: Odometry, tmp_path: Path
) -> None:
    torn = in_two_parts(folder, odometry, tmp_path)
    report = optimise.run(torn, CONFIG)
    assert report.warnings[0].startswith("frames 40 to 59 are a part of their own")
    assert report.values["posed"] == 40
    assert [part["frames"] for part in report.values["parts"]] == [40, 20]
    assert len(read_tum(torn.root / "optimise" / "trajectory_0.tum")) == 40
    assert np.isnan(load_optimised(torn).T_world_camera[40:]).all()


def test_the_report_of_a_good_map_warns_of_nothing(folder: MapFolder) -> None:
    report = folder.report("optimise")
    values = report["values"]
    assert report["warnings"] == []
    assert values["posed"] == values["frames"] == 60
    assert values["world"] == "floor"
    assert values["graph_error_after"] <= values["graph_error_before"]
    assert values["rms_px_after"] <= values["rms_px_before"]


def test_the_summary_says_how_far_off_depth_is(folder: MapFolder) -> None:
    report = folder.report("optimise")
    off_mm = 1000 * report["values"]["sensors"][0]["depth_offset"] * 4**2
    how = "short" if off_mm > 0 else "long"
    assert f"depth is {abs(off_mm):.1f} mm too {how} at 4 m" in " ".join(report["lines"])


def test_a_keyframe_that_nothing_joins_does_not_part_those_around_it(
    odometry: Odometry, camera: Intrinsics
) -> None:
    # The odometry goes on from the keyframe before the one that is lost: no neighbour of either.
    first, lost, after = (k.row for k in odometry.keyframes[2:5])
    gone = range(lost, after)
    edges = [e for e in odometry.edges if e.i not in gone and e.j not in gone]
    T_first_after = se3.inverse(odometry.T_segment_camera[first]) @ odometry.T_segment_camera[after]
    edges.append(Edge(first, after, T_first_after, 1e4 * np.eye(6)))
    roots = [k.row for k in odometry.keyframes]
    poses, segment = chain(len(odometry.frames), edges, roots)
    torn = dataclasses.replace(
        odometry, edges=tuple(edges), T_segment_camera=poses, segment=segment
    )
    solved = solution.solve(torn, [], np.zeros((0, 4), np.int32), [camera], CONFIG)
    posed = np.isfinite(solved.poses[:, 0, 0])
    assert posed[after:].all()
    assert not posed[lost:after].any()


def test_the_main_part_of_an_extended_map_is_what_was_mapped_before() -> None:
    part = np.array([0, 0, 1, 1, 1, LOST], np.int32)
    before = np.full((6, 4, 4), np.nan)
    before[:2] = np.eye(4)
    main, others = split_parts(part, before)
    assert main.tolist() == [True, True, False, False, False, False]
    assert {name: rows.tolist() for name, rows in others.items()} == {"part_2": [2, 3, 4]}
    assert split_parts(part)[0].tolist() == [False, False, True, True, True, False]


def along(odometry: Odometry, first: int, last: int) -> tuple[Edge, ...]:
    """Edges from each frame to the next, in a row of frames, as loose edges would tell them."""
    T = odometry.T_segment_camera
    return tuple(
        Edge(k, k + 1, se3.inverse(T[k]) @ T[k + 1], 1e4 * np.eye(6)) for k in range(first, last)
    )


def without(odometry: Odometry, rows: range) -> Odometry:
    """The odometry as if features had told nothing of some frames, but loose edges had."""
    edges = tuple(e for e in odometry.edges if e.i not in rows and e.j not in rows)
    poses, segment = odometry.T_segment_camera.copy(), odometry.segment.copy()
    poses[rows], segment[rows] = np.nan, LOST
    keyframes = tuple(k for k in odometry.keyframes if k.row not in rows)
    return dataclasses.replace(
        odometry,
        T_segment_camera=poses,
        segment=segment,
        edges=edges,
        keyframes=keyframes,
        degenerate_edges=along(odometry, rows[0] - 1, rows[-1] + 1),
    )


def between_keyframes(odometry: Odometry) -> range:
    """Two frames in a row, none of which is a keyframe."""
    keyframes = {k.row for k in odometry.keyframes}
    first = next(k for k in range(1, 50) if not keyframes & {k, k + 1})
    return range(first, first + 2)


def test_frames_that_loose_edges_join_hang_between_their_neighbours(
    odometry: Odometry, camera: Intrinsics
) -> None:
    rows = between_keyframes(odometry)
    none = np.zeros((0, 4), np.int32)
    whole = solution.solve(odometry, (), none, [camera], CONFIG).poses
    hung = solution.solve(without(odometry, rows), (), none, [camera], CONFIG).poses
    # The edges are exact, and those of the neighbours as good as the odometry's: 6 mm at the worst.
    np.testing.assert_allclose(hung[rows], whole[rows], atol=0.01)


def test_a_long_part_is_not_joined_by_loose_edges(odometry: Odometry, camera: Intrinsics) -> None:
    few = dataclasses.replace(CONFIG.odometry, max_degenerate_frames=1)
    config = dataclasses.replace(CONFIG, odometry=few)
    half = len(odometry.frames) // 2
    apart = dataclasses.replace(
        odometry,
        segment=(np.arange(len(odometry.frames)) >= half).astype(np.int32),
        edges=tuple(e for e in odometry.edges if (e.i < half) == (e.j < half)),
        degenerate_edges=along(odometry, half - 1, half),
    )
    solved = solution.solve(apart, (), np.zeros((0, 4), np.int32), [camera], config)
    assert set(solved.other_parts) == {"part_2"}
    joined = solution.solve(
        dataclasses.replace(apart), (), np.zeros((0, 4), np.int32), [camera], CONFIG
    )
    assert np.isfinite(joined.poses).all()


def test_keyframes_that_share_no_landmark_are_as_sure_as_odometry_between_them(
    odometry: Odometry, camera: Intrinsics
) -> None:
    none = np.zeros((0, 4), np.int32)
    rows = [k.row for k in odometry.keyframes]
    solved = solution.solve(odometry, (), none, [camera], CONFIG)
    (path,) = shortest_paths(odometry.edges, [(rows[0], rows[1])])
    expected = np.linalg.inv(path.information) * keyframe_edges.PATH_NOISE_FACTOR**2
    np.testing.assert_allclose(solved.adjusted.covariance[1], expected, rtol=1e-2, atol=1e-10)


def test_keyframes_on_either_side_of_loose_edges_are_held_by_them(
    odometry: Odometry, camera: Intrinsics
) -> None:
    # The loop that joins the segments is 2 cm off; the way along the edges, and the loose one.
    rows = [k.row for k in odometry.keyframes]
    before, after = rows[len(rows) // 2 - 1], rows[len(rows) // 2]
    poses = odometry.T_segment_camera
    exact = se3.inverse(poses[before]) @ poses[after]
    apart = dataclasses.replace(
        odometry,
        segment=(np.arange(len(odometry.frames)) >= after).astype(np.int32),
        edges=tuple(e for e in odometry.edges if (e.i < after) == (e.j < after)),
        degenerate_edges=along(odometry, after - 1, after),
    )
    loop = Edge(before, after, exact @ se3.exp([0, 0, 0, 0.02, 0, 0]), 1e3 * np.eye(6))
    solved = solution.solve(apart, (loop,), np.zeros((0, 4), np.int32), [camera], CONFIG)
    found = se3.inverse(solved.poses[before]) @ solved.poses[after]
    # Edges between two frames differ by a millimetre or two from the poses they make.
    np.testing.assert_allclose(found, exact, atol=0.005)


def test_crafted_matches_of_loops_are_refused(
    folder: MapFolder,
    altering: Callable[[MapFolder, str], AbstractContextManager[Path]],
    tmp_path: Path,
) -> None:
    copy = MapFolder(tmp_path / "map")
    shutil.copytree(folder.root, copy.root)
    with altering(copy, "loops") as draft:
        save_arrays(draft / "matches.npz", matches=np.array([[0, 10**6, 1, 0]]))
    with pytest.raises(MapError, match=r"features that keyframes have in .*matches\.npz"):
        optimise.run(copy, dataclasses.replace(CONFIG, seed=1))

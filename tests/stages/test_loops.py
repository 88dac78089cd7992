"""Loops of the tiny map, whose walk ends where it began; truth tells right from wrong."""

import dataclasses
import os
from pathlib import Path

import numpy as np
import pytest

from vnav.config import Config
from vnav.core import se3
from vnav.core.camera import Intrinsics
from vnav.core.frame import Edge
from vnav.core.graph import chain
from vnav.core.mapping import FrameTable, LoopVerdict, Odometry
from vnav.core.tree import VocabularyTree
from vnav.io.formats.trajectories import read_tum
from vnav.io.store.artifacts import load_loop_edges, load_loops
from vnav.io.store.map_folder import MapFolder
from vnav.io.store.tree_file import load_tree
from vnav.loop_closing.loop_verification import NEIGHBOURS
from vnav.optimisation.segments import align_segments
from vnav.stages import loops

CONFIG = Config()


@pytest.fixture(scope="module")
def tree(folder: MapFolder) -> VocabularyTree:
    return load_tree(folder)


@pytest.fixture(scope="module")
def verdicts(folder: MapFolder) -> tuple[LoopVerdict, ...]:
    return load_loops(folder)


@pytest.fixture(scope="module")
def edges(folder: MapFolder) -> tuple[Edge, ...]:
    return load_loop_edges(folder)[0]


@pytest.fixture(scope="module")
def T_keyframes(tiny_capture: Path, odometry: Odometry) -> np.ndarray:
    """True poses of the keyframes."""
    truth = read_tum(tiny_capture / "groundtruth.txt").T_world_camera
    return truth[[k.row for k in odometry.keyframes]]


def gap_s(odometry: Odometry, i: int, j: int) -> float:
    first, second = (odometry.frames.stamp_s[odometry.keyframes[k].row] for k in (i, j))
    return float(abs(second - first))


def first_frames(odometry: Odometry, count: int, cut: int | None = None) -> Odometry:
    """The odometry of the first frames, as if the camera had been covered before row ``cut``."""
    table = odometry.frames
    inside = [e for e in odometry.edges if max(e.i, e.j) < count]
    if cut is not None:
        inside = [e for e in inside if (e.i < cut) == (e.j < cut)]
    keyframes = tuple(k for k in odometry.keyframes if k.row < count)
    poses, segment = chain(count, inside, [k.row for k in keyframes])
    return Odometry(
        FrameTable(table.capture[:count], table.index[:count], table.stamp_s[:count]),
        poses,
        segment,
        ("",) * count,
        tuple(inside),
        keyframes,
    )


def test_places_seen_again_are_accepted(
    odometry: Odometry, verdicts: tuple[LoopVerdict, ...], T_keyframes: np.ndarray
) -> None:
    accepted = {(v.i, v.j) for v in verdicts if v.accepted}
    again = []
    for j in range(len(T_keyframes)):
        for i in range(j):
            motion = se3.inverse(T_keyframes[i]) @ T_keyframes[j]
            near = np.linalg.norm(motion[:3, 3]) < 0.5 and se3.rotation_angle(motion) < 0.3
            if near and gap_s(odometry, i, j) > CONFIG.loops.exclude_s:
                again.append((i, j))
    assert again
    assert set(again) <= accepted


def test_a_loop_is_found_by_appearance_before_any_pose_is_known(
    odometry: Odometry, verdicts: tuple[LoopVerdict, ...]
) -> None:
    last = len(odometry.keyframes) - 1
    found = [v for v in verdicts if v.accepted and v.source != "proximity"]
    assert any(v.i <= 2 and v.j >= last - 2 for v in found)


def test_accepted_edges_are_right(
    odometry: Odometry, edges: tuple[Edge, ...], T_keyframes: np.ndarray
) -> None:
    # By their own information, which grants more than the noise of matches: below 1 on average,
    # and beyond 24 / 6, chi-squared of 6, once in 2000.
    number = {k.row: n for n, k in enumerate(odometry.keyframes)}
    errors = []
    for e in edges:
        i, j = number[e.i], number[e.j]
        error = se3.inverse(se3.inverse(T_keyframes[i]) @ T_keyframes[j]) @ e.T_i_j
        xi = np.concatenate([se3.log_so3(error[:3, :3]), error[:3, 3]])
        errors.append(xi @ e.information @ xi / 6)
    assert np.mean(errors) < 1
    assert max(errors) < 4


def test_every_candidate_has_one_verdict_and_every_refusal_a_reason(
    odometry: Odometry, verdicts: tuple[LoopVerdict, ...]
) -> None:
    pairs = [(v.i, v.j) for v in verdicts]
    assert len(set(pairs)) == len(pairs)
    assert all(0 <= i < j < len(odometry.keyframes) for i, j in pairs)
    assert any(not v.accepted for v in verdicts)
    for v in verdicts:
        assert bool(v.reason) != v.accepted
        if v.accepted:
            assert CONFIG.loops.min_inliers <= v.inliers <= v.matches


def test_edges_and_matches_are_those_of_the_accepted(
    folder: MapFolder, odometry: Odometry, verdicts: tuple[LoopVerdict, ...]
) -> None:
    edges, matches = load_loop_edges(folder)
    accepted = [v for v in verdicts if v.accepted]
    rows = [k.row for k in odometry.keyframes]
    assert [(e.i, e.j) for e in edges] == [(rows[v.i], rows[v.j]) for v in accepted]
    for v in accepted:
        of_pair = (matches[:, 0] == v.i) & (matches[:, 2] == v.j)
        assert of_pair.sum() == v.inliers
    assert len(matches) == sum(v.inliers for v in accepted)


def test_matched_features_see_the_same_point(
    folder: MapFolder, odometry: Odometry, camera: Intrinsics, T_keyframes: np.ndarray
) -> None:
    # Registration takes what lies within 3.8 sigma, a pixel each way: 5.4 px; with true poses
    # and the depth's noise on top, hardly one lies farther than 10 px, and most within 2.
    _, matches = load_loop_edges(folder)
    off = []
    for i, m, j, n in matches[:: len(matches) // 500]:
        T_j_i = se3.inverse(T_keyframes[j]) @ T_keyframes[i]
        seen = se3.transform(T_j_i, odometry.keyframes[i].points_camera[m][None])[0]
        off.append(camera.project(seen) - odometry.keyframes[j].features.keypoints_px[n])
    distance = np.linalg.norm(off, axis=1)
    assert np.median(distance) < 2
    assert (distance < 10).mean() > 0.99


def test_keyframes_near_in_time_are_no_loop_by_appearance(
    odometry: Odometry, verdicts: tuple[LoopVerdict, ...]
) -> None:
    for v in verdicts:
        if v.source != "proximity":
            assert gap_s(odometry, v.i, v.j) > CONFIG.loops.exclude_s


def test_the_report_counts_the_verdicts(
    folder: MapFolder, verdicts: tuple[LoopVerdict, ...]
) -> None:
    values = folder.report("loops")["values"]
    closing = [v for v in verdicts if v.is_loop]
    assert values["tried"] == len(closing)
    assert values["accepted"] == sum(v.accepted for v in closing)
    assert values["accepted"] + values["rejected"] == values["tried"]
    assert values["neighbours_tried"] == len(verdicts) - len(closing) > 0
    assert sum(values["reasons"].values()) == values["rejected"]


def test_neighbours_in_time_are_no_loops(
    odometry: Odometry, verdicts: tuple[LoopVerdict, ...]
) -> None:
    stamps_s = odometry.frames.stamp_s[odometry.keyframe_rows]
    apart_s = [stamps_s[v.j] - stamps_s[v.i] for v in verdicts]
    assert [v.is_loop for v in verdicts] == [s > CONFIG.loops.exclude_s for s in apart_s]


def test_segments_are_joined_however_soon_one_follows_the_other(
    odometry: Odometry, tree: VocabularyTree, camera: Intrinsics
) -> None:
    # The camera is covered for a moment; 2.4 s before and 2.4 s after it sees the same.
    half = first_frames(odometry, 24, cut=12)
    assert set(half.segment.tolist()) == {0, 1}
    found = loops.close_loops(half, tree, [camera], CONFIG)
    segments = half.T_segment_camera, half.segment, half.frames.capture
    _, part = align_segments(*segments, found.edges)
    assert set(part.tolist()) == {0}


def strict() -> Config:
    """Settings under which nothing is a loop."""
    return dataclasses.replace(CONFIG, loops=dataclasses.replace(CONFIG.loops, min_inliers=10_000))


def test_keyframes_that_odometry_joined_need_no_more_matches_than_it_demands(
    odometry: Odometry, tree: VocabularyTree, camera: Intrinsics
) -> None:
    found = loops.close_loops(odometry, tree, [camera], strict())
    apart = {v.j - v.i for v in found.verdicts if v.accepted}
    assert apart == set(range(1, NEIGHBOURS + 1))


def test_they_are_matched_across_what_odometry_contradicts_too(
    odometry: Odometry, tree: VocabularyTree, camera: Intrinsics
) -> None:
    """Edges that lead to a frame 10 cm apart from each other leave open which is right."""
    few, row = first_frames(odometry, 24), 12
    across = [e for e in few.edges if e.i < row <= e.j]
    step = next(e for e in across if e.j == row)
    aside = se3.make(np.eye(3), [0.1, 0.0, 0.0])
    wrong = dataclasses.replace(step, T_i_j=step.T_i_j @ aside)
    edges = (*(e for e in few.edges if e not in across), step, wrong)

    found = loops.close_loops(dataclasses.replace(few, edges=edges), tree, [camera], strict())

    joined = [(v.i, v.j) for v in found.verdicts if v.accepted]
    rows = few.keyframe_rows
    assert any(rows[i] < row <= rows[j] for i, j in joined)


def test_segments_are_joined_by_what_a_loop_demands(
    odometry: Odometry, tree: VocabularyTree, camera: Intrinsics
) -> None:
    half = first_frames(odometry, 24, cut=12)
    found = loops.close_loops(half, tree, [camera], strict())
    assert {half.segment[e.i] == half.segment[e.j] for e in found.edges} == {True}


def test_one_keyframe_has_no_loop(
    odometry: Odometry, tree: VocabularyTree, camera: Intrinsics
) -> None:
    found = loops.close_loops(first_frames(odometry, 1), tree, [camera], CONFIG)
    assert found.verdicts == found.edges == []
    assert found.matches.shape == (0, 4)


def test_the_result_is_the_same_whatever_the_number_of_cores(
    odometry: Odometry,
    tree: VocabularyTree,
    camera: Intrinsics,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    part = first_frames(odometry, 16)
    config = dataclasses.replace(CONFIG, loops=dataclasses.replace(CONFIG.loops, exclude_s=1.0))
    results = []
    for cores in (1, 5):
        monkeypatch.setattr(os, "cpu_count", lambda n=cores: n)
        results.append(loops.close_loops(part, tree, [camera], config))
    first, second = results
    assert first.verdicts == second.verdicts
    assert first.matches.tobytes() == second.matches.tobytes()
    assert [e.T_i_j.tobytes() for e in first.edges] == [e.T_i_j.tobytes() for e in second.edges]
    assert first.edges


def test_a_finished_stage_is_reused(folder: MapFolder) -> None:
    assert loops.run(folder, CONFIG).reused

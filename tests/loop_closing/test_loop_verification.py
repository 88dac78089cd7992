"""Loop candidates of the tiny map, verified one by one."""

import dataclasses

import numpy as np
import pytest

from vnav.config import Config
from vnav.core import se3
from vnav.core.camera import Intrinsics
from vnav.core.frame import PoseEstimate
from vnav.core.graph import shortest_paths
from vnav.core.mapping import Odometry
from vnav.loop_closing.loop_candidates import LoopCandidate
from vnav.loop_closing.loop_verification import (
    AMBIGUOUS,
    LOOSE,
    TIMES_LOOSER,
    Closures,
    LoopVerifier,
)
from vnav.registration.points3d import PointRegistration

CONFIG = Config()


@pytest.fixture(scope="module")
def found(odometry: Odometry, camera: Intrinsics) -> Closures:
    """What becomes of a pair of neighbours and of one that looks at opposite walls."""
    far = len(odometry.keyframes) // 2
    closures = Closures()
    verifier = LoopVerifier(odometry, [camera], CONFIG)
    candidates = [LoopCandidate(0, 1, "ends", 0.5), LoopCandidate(0, far, "appearance", 0.25)]
    verifier.verify(candidates, closures)
    return closures


def test_verdicts_come_in_the_order_of_the_candidates(found: Closures) -> None:
    assert [(v.source, v.score, v.accepted) for v in found.verdicts] == [
        ("ends", 0.5, True),
        ("appearance", 0.25, False),
    ]
    assert found.tried == {(v.i, v.j) for v in found.verdicts}


def test_a_rejected_candidate_has_a_reason_and_no_edge(found: Closures) -> None:
    assert found.verdicts[1].reason
    assert len(found.edges) == 1


def test_an_accepted_one_has_an_edge_between_rows_and_its_inliers_as_matches(
    found: Closures, odometry: Odometry
) -> None:
    (edge,), rows = found.edges, odometry.keyframe_rows
    assert (edge.i, edge.j) == (rows[0], rows[1])
    assert len(found.matches) == found.verdicts[0].inliers
    assert set(found.matches[:, 0]) == {0}
    assert set(found.matches[:, 2]) == {1}


def test_an_edge_is_less_certain_than_the_noise_that_is_added(found: Closures) -> None:
    variances = np.diag(np.linalg.inv(found.edges[0].information))
    sigmas = np.deg2rad(CONFIG.loops.sigma_deg), CONFIG.loops.sigma_m
    assert (variances > np.repeat(sigmas, 3) ** 2).all()


def test_without_candidates_there_is_no_match() -> None:
    assert Closures().matches.shape == (0, 4)


SHIFT = se3.make(np.eye(3), [0.2, 0, 0])  # far beyond noise, and within the view


@pytest.mark.parametrize(
    ("in_favour", "sure", "taken"),
    [
        (10.0, 1.0, "found"),
        (-10.0, 0.4, "near"),
        (1.0, 1.0, "neither"),
        (-1.0, 1.0, "near"),
        (-1.0, 0.9, "neither"),
        (None, 1.0, "found"),
    ],
)
def test_pixels_choose_between_the_motion_found_and_the_one_near_the_poses(
    odometry: Odometry,
    camera: Intrinsics,
    monkeypatch: pytest.MonkeyPatch,
    in_favour: float | None,
    sure: float,
    taken: str,
) -> None:
    """What odometry is ``sure`` of between neighbours counts where pixels leave it open."""
    i, j = odometry.keyframe_rows[:2].tolist()
    edges = tuple(dataclasses.replace(e, probability=sure) for e in odometry.edges)
    odometry = dataclasses.replace(odometry, edges=edges)
    T_i_j = se3.inverse(odometry.T_segment_camera[i]) @ odometry.T_segment_camera[j]
    right = PointRegistration.register
    monkeypatch.setattr(
        PointRegistration,
        "register",
        lambda self, a, b, rng, predicted: dataclasses.replace(
            right(self, a, b, rng, predicted), T_a_b=T_i_j @ SHIFT
        ),
    )
    odds = None if in_favour is None else np.array([[0.0, in_favour], [-in_favour, 0.0]])
    verifier = LoopVerifier(
        odometry, [camera], CONFIG, log_odds=None if odds is None else lambda *_: odds
    )
    closures = Closures()
    candidate = LoopCandidate(0, 1, "proximity", 0.5)
    verifier.verify([candidate], closures, odometry.T_segment_camera)
    motions = {"found": T_i_j @ SHIFT, "near": T_i_j}
    assert [v.reason for v in closures.verdicts] == [AMBIGUOUS if taken == "neither" else ""]
    off = [se3.inverse(motions[taken]) @ edge.T_i_j for edge in closures.edges]
    assert all(np.linalg.norm(T[:3, 3]) < 0.02 for T in off)


@pytest.mark.parametrize(
    ("looser", "is_joined", "reason"), [(1.1, True, LOOSE), (0.9, True, ""), (1.1, False, "")]
)
def test_a_loop_is_left_out_that_tells_far_less_than_the_path_that_odometry_has(
    odometry: Odometry,
    camera: Intrinsics,
    monkeypatch: pytest.MonkeyPatch,
    looser: float,
    is_joined: bool,
    reason: str,
) -> None:
    last = len(odometry.keyframes) - 1
    (path,) = shortest_paths(odometry.motions, [odometry.keyframe_rows[[0, last]].tolist()])
    noise = (looser * TIMES_LOOSER) ** 2
    loop = PoseEstimate(path.T_i_j, path.information / noise, np.zeros((30, 2), np.int32), 30)
    monkeypatch.setattr(PointRegistration, "register", lambda *_: loop)
    if not is_joined:
        odometry = dataclasses.replace(odometry, edges=odometry.edges[:1], degenerate_edges=())
    closures = Closures()
    verifier = LoopVerifier(odometry, [camera], CONFIG)
    verifier.verify([LoopCandidate(0, last, "appearance", 0.5)], closures)
    assert [v.reason for v in closures.verdicts] == [reason]
    assert len(closures.edges) == (not reason)

"""Loop candidates of the tiny map, verified one by one."""

import numpy as np
import pytest

from vnav.config import Config
from vnav.core.camera import Intrinsics
from vnav.core.mapping import Odometry
from vnav.loop_closing.loop_candidates import LoopCandidate
from vnav.loop_closing.loop_verification import Closures, LoopVerifier

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

from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from vnav.core import se3
from vnav.core.frame import Edge
from vnav.synthetic.circle import walk


@pytest.fixture(scope="module")
def false_loops(script: Callable[[str], ModuleType]) -> ModuleType:
    return script("false_loops")


def test_false_loops_look_like_accepted_ones_and_join_what_none_joins(
    false_loops: ModuleType,
) -> None:
    rows = np.arange(0, 20, 2)
    edges = tuple(Edge(i, i + 6, np.eye(4) * (i + 1), np.eye(6) * i) for i in (0, 2, 4))
    found = false_loops.false_loops(edges, rows, 7, np.random.default_rng(0))
    assert len(found) == 7
    for e in found:
        assert e.i in rows
        assert e.j in rows
        assert e.i < e.j
        assert (e.i, e.j) not in {(edge.i, edge.j) for edge in edges}
        (like,) = [edge for edge in edges if (edge.information == e.information).all()]
        np.testing.assert_array_equal(e.T_i_j, like.T_i_j)


def test_loops_of_a_false_set_agree_with_each_other_on_a_wrong_place(
    false_loops: ModuleType,
) -> None:
    # Noise of 1 mm and 1 mrad over distances of up to 3 m: 6 sigmas of both together are 0.03 m.
    poses = walk(100)
    like = (Edge(0, 1, np.eye(4), np.eye(6) * 1e6),)
    found = false_loops.false_set(like, np.arange(0, 100, 2), poses, np.random.default_rng(1))
    assert len(found) == 40
    moved = np.stack([poses[e.i] @ e.T_i_j @ se3.inverse(poses[e.j]) for e in found])
    off = moved[:, :3, 3] - moved[0, :3, 3]
    assert np.linalg.norm(off, axis=1).max() < 0.03
    assert np.linalg.norm(moved[0, :3, 3]) > 0.3


def test_none_survives_in_the_small_room(
    false_loops: ModuleType,
    tiny_map: Path,
    tiny_capture: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    arguments = [str(tiny_map), str(tiny_capture), "--seeds", "1"]
    assert false_loops.main(arguments) == 0
    rows = [line.split("|")[3:] for line in capsys.readouterr().out.splitlines()[2:4]]
    (accepted, none, *_), (again, injected, kept, *_) = rows
    assert int(none) == 0
    assert accepted == again
    assert int(injected) == round(0.1 * int(accepted)) > 0
    assert int(kept) == 0

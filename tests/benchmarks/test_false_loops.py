from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from vnav.core.frame import Edge


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

from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from vnav.config import Config
from vnav.io.store.map_folder import MapFolder
from vnav.volumes.octree import Octree


@pytest.fixture(scope="module")
def fusing(script: Callable[[str], ModuleType]) -> ModuleType:
    return script("fusing")


def test_insertion_marks_what_fuse_marks(fusing: ModuleType, fused_map: Path) -> None:
    _, tree = fusing.inserted(MapFolder(fused_map), Config(), discretize=True)
    leaves = Octree.read(fused_map / "fuse" / "occupancy.bt").leaves()
    small = leaves.occupied & (leaves.size_m < 0.06)
    seen = tree.getLabels(np.ascontiguousarray(leaves.centres_world[small]))
    assert (seen == 1).mean() > 0.9


def test_ratios_are_of_one_run_and_medians_over_the_runs(
    fusing: ModuleType, fused_map: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    fuse = iter([[1.0, 2.0], [4.0, 4.0], [9.0, 6.0]])
    raw = {True: iter([2.0, 4.0, 3.0]), False: iter([10.0, 10.0, 10.0])}
    monkeypatch.setattr(fusing, "fused", lambda _: np.array(next(fuse)))
    monkeypatch.setattr(
        fusing, "inserted", lambda *_, discretize: (np.full(2, next(raw[discretize])), None)
    )
    found = fusing.measure(MapFolder(fused_map))
    ratios = [m.value for m in found if m.what == "fuse" and m.quantity == "wall time, ratio"]
    assert ratios == [1.0, 0.4]


def test_a_map_is_copied_and_not_made_anew(
    fusing: ModuleType, fused_map: Path, tmp_path: Path
) -> None:
    copy = fusing.map_of(fused_map, tmp_path)
    assert copy.parent == tmp_path
    assert (copy / "fuse" / "occupancy.ot").is_file()

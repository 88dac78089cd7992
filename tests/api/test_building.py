"""Building from Python: what is drawn, where poses and settings may come from."""

import shutil
from pathlib import Path

import numpy as np
import pytest

import vnav
from vnav.api.building import run_stage
from vnav.config import FeaturesConfig

pytestmark = pytest.mark.slow

PICTURES = {"trajectory.png", "grid.png", "cloud.png"}
SAME = vnav.Config(features=FeaturesConfig(max_features=700))  # as the fixture's map was made


def pictures(root: Path) -> set[str]:
    found = list((root / "reports").glob("*.png"))
    assert all(path.read_bytes().startswith(b"\x89PNG") for path in found)
    return {path.name for path in found}


@pytest.fixture
def copied(whole_map: Path, tmp_path: Path) -> Path:
    """A finished map without its pictures."""
    shutil.copytree(whole_map, tmp_path / "map")
    shutil.rmtree(tmp_path / "map" / "reports", ignore_errors=True)
    return tmp_path / "map"


def test_building_draws_pictures_that_are_gone(copied: Path, tiny_capture: Path) -> None:
    vnav.build_map(tiny_capture, copied, config=SAME)
    assert pictures(copied) == PICTURES


def test_paths_may_be_text_and_the_map_that_is_built_tells_what_was_found(
    copied: Path, tiny_capture: Path
) -> None:
    mapped = vnav.build_map(str(tiny_capture), str(copied), config=SAME)
    assert mapped.root == copied
    assert mapped.built is not None
    assert [report.stage for report in mapped.built.reports][-3:] == ["index", "map", "quality"]


def test_a_capture_that_was_opened_is_taken_as_it_is(copied: Path, tiny_capture: Path) -> None:
    from vnav.io.sources.open_capture import open_capture

    capture = open_capture(tiny_capture, SAME.capture)
    assert vnav.build_map(capture, copied, config=SAME).root == copied


def test_a_preset_is_a_configuration(copied: Path, tiny_capture: Path) -> None:
    with pytest.raises(vnav.ConfigError, match="expected a preset"):
        vnav.build_map(tiny_capture, copied, config="no such preset")


def test_progress_is_told(copied: Path, tiny_capture: Path) -> None:
    told: list[str] = []
    vnav.build_map(
        tiny_capture, copied, config=SAME, progress=lambda task, done, total: told.append(task)
    )
    assert "reading files" in told


def test_poses_may_be_given_as_values(
    tmp_path: Path, tiny_capture: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """They reach the pipeline as they are; that it builds on them is tested there."""
    from vnav.api import building

    class Reached(Exception):
        pass

    def build(*_: object, given: vnav.Trajectory, **__: object) -> None:
        np.testing.assert_array_equal(given.stamps_s, [1.0])
        raise Reached

    monkeypatch.setattr(building, "build", build)
    poses = vnav.Trajectory(np.array([1.0]), np.eye(4)[None])
    with pytest.raises(Reached):
        vnav.build_map(tiny_capture, tmp_path / "map", trajectory=poses)


def test_fusing_draws_pictures(posed_map: Path, tmp_path: Path) -> None:
    shutil.copytree(posed_map, tmp_path / "map")
    run_stage("fuse", tmp_path / "map")
    assert pictures(tmp_path / "map") == PICTURES

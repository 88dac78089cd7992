import shutil
from pathlib import Path

from vnav import api
from vnav.config import Config, FeaturesConfig
from vnav.io.store.map_folder import MapFolder
from vnav.pipeline.build import BuildTask

PICTURES = {"trajectory.png", "grid.png", "cloud.png"}


def pictures(root: Path) -> set[str]:
    found = list((root / "reports").glob("*.png"))
    assert all(path.read_bytes().startswith(b"\x89PNG") for path in found)
    return {path.name for path in found}


def test_building_draws_pictures_that_are_gone(
    whole_map: Path, tiny_capture: Path, tmp_path: Path
) -> None:
    shutil.copytree(whole_map, tmp_path / "map")
    shutil.rmtree(tmp_path / "map" / "reports", ignore_errors=True)
    config = Config(features=FeaturesConfig(max_features=700))  # that of the map that is copied
    api.build_map(BuildTask(tiny_capture, tmp_path / "map", config))
    assert pictures(tmp_path / "map") == PICTURES


def test_fusing_draws_pictures(posed_map: Path, tmp_path: Path) -> None:
    shutil.copytree(posed_map, tmp_path / "map")
    api.fuse(MapFolder(tmp_path / "map"), Config())
    assert pictures(tmp_path / "map") == PICTURES

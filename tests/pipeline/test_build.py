import dataclasses
import shutil
from pathlib import Path

import pytest

from vnav.config import Config, FeaturesConfig, VocabularyConfig
from vnav.core.progress import silent
from vnav.errors import ConfigError, MapError
from vnav.io.sources.capture import Capture
from vnav.io.store.map_folder import STAGES, MapFolder
from vnav.io.store.overview import overview
from vnav.pipeline.build import build, build_map, expect_captures
from vnav.pipeline.joining import in_turn

CONFIG = Config(features=FeaturesConfig(max_features=700))  # that of the map that is copied


@pytest.fixture
def folder(whole_map: Path, tmp_path: Path) -> MapFolder:
    shutil.copytree(whole_map, tmp_path / "map")
    return MapFolder(tmp_path / "map")


def redone(folder: MapFolder, capture: Capture, config: Config = CONFIG) -> list[str]:
    reports = build_map(folder, capture, config)
    assert [report.stage for report in reports] == [*STAGES, "map", "quality"]
    return [report.stage for report in reports[:-2] if not report.reused]


def test_a_finished_map_is_left_as_it_is(folder: MapFolder, capture: Capture) -> None:
    assert redone(folder, capture) == []


def test_only_what_a_setting_touches_is_done_again(folder: MapFolder, capture: Capture) -> None:
    config = dataclasses.replace(CONFIG, fuse=dataclasses.replace(CONFIG.fuse, voxel_m=0.05))
    assert redone(folder, capture, config) == ["fuse", "index"]  # which reads the octree


def test_a_page_about_the_map_before_does_not_outlast_it(
    folder: MapFolder, capture: Capture
) -> None:
    folder.page.write_text("as it was")
    build_map(folder, capture, CONFIG)
    assert folder.page.exists()  # nothing has changed
    config = dataclasses.replace(CONFIG, fuse=dataclasses.replace(CONFIG.fuse, voxel_m=0.05))
    build_map(folder, capture, config)
    assert not folder.page.exists()


def test_a_stage_that_is_gone_is_done_again_and_with_the_same_result_no_other(
    folder: MapFolder, capture: Capture
) -> None:
    shutil.rmtree(folder.root / "loops")
    assert redone(folder, capture) == ["loops"]


def test_a_run_that_finds_all_done_keeps_the_report_of_the_one_that_made_the_map(
    folder: MapFolder, capture: Capture
) -> None:
    """Its memory and seconds are those of the map, not of looking at it."""
    made = folder.report("map") | {"seconds": 123.0}
    folder.write_report("map", made)
    whole = build_map(folder, capture, CONFIG)[-2]
    assert whole.reused
    assert folder.report("map") == made


def test_the_summary_tells_size_and_memory(folder: MapFolder, capture: Capture) -> None:
    whole = build_map(folder, capture, CONFIG)[-2]
    size = sum(path.stat().st_size for path in folder.root.rglob("*") if path.is_file())
    assert whole.values["map_mb"] == pytest.approx(size / 1e6, rel=0.01)
    assert overview(folder)["size_mb"] == whole.values["map_mb"]
    assert whole.values["peak_memory_mb"] > 50  # Python with numpy alone needs as much
    assert folder.report("map")["values"] == whole.values


def test_a_map_of_another_capture_is_refused(folder: MapFolder, capture: Capture) -> None:
    expect_captures(folder, [capture])
    folder.set_captures([folder.captures[0] | {"name": "office"}])
    with pytest.raises(MapError, match="expected office.*found miniature.*--fresh"):
        build_map(folder, capture, CONFIG)


def test_flat_words_of_bits_are_refused_before_work_begins(
    capture: Capture, tmp_path: Path
) -> None:
    config = Config(
        features=FeaturesConfig(front_end="orb"), vocabulary=VocabularyConfig(method="approximate")
    )
    with pytest.raises(ConfigError, match="hierarchical where descriptors are bits"):
        build([capture], tmp_path / "map", config, in_turn(silent))
    assert not (tmp_path / "map").exists()

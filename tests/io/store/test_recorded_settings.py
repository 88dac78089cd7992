from pathlib import Path

import pytest

from vnav.config import Config, RegistrationConfig, load
from vnav.config.listing import changes
from vnav.io.store.map_folder import STAGES, MapFolder
from vnav.io.store.recorded_settings import recorded_settings
from vnav.io.store.stage_reports import settings_of

SECTIONS = {
    "odometry": ("capture", "features", "registration", "odometry"),
    "loops": ("registration", "loops"),
}


@pytest.fixture
def folder(tmp_path: Path) -> MapFolder:
    return MapFolder.create(tmp_path / "map")


def record(folder: MapFolder, stage: str, config: Config) -> None:
    settings = settings_of(config, *SECTIONS[stage]) | {"format": 3}
    with folder.writing(stage, settings, {}):
        pass


def test_a_map_without_stages_has_no_settings(folder: MapFolder) -> None:
    found = recorded_settings(folder)
    assert (found.agreed, found.disagreed, found.missing) == ({}, {}, STAGES)


def test_settings_of_the_stages_that_are_there_are_told(folder: MapFolder) -> None:
    config = load("fast", ["seed=4", "features.sift.few_features=200"])
    record(folder, "odometry", config)
    found = recorded_settings(folder)
    asked = {name: value for name, value in changes(config).items() if name in found.agreed}
    assert {"seed": 4, "features.sift.few_features": 200}.items() <= asked.items()
    assert found.agreed.items() >= asked.items()
    assert "fuse.voxel_m" not in found.agreed
    assert found.missing == tuple(stage for stage in STAGES if stage != "odometry")


def test_a_setting_that_stages_disagree_about_is_told_by_stage(folder: MapFolder) -> None:
    record(folder, "odometry", Config())
    record(folder, "loops", Config(registration=RegistrationConfig(ratio=0.7)))
    found = recorded_settings(folder)
    assert found.disagreed == {"registration.ratio": {"odometry": 0.8, "loops": 0.7}}
    assert "registration.ratio" not in found.agreed
    assert found.agreed["registration.mutual"] is True


def test_a_stale_stage_still_tells_its_settings(folder: MapFolder) -> None:
    record(folder, "odometry", Config())
    settings = settings_of(Config(), *SECTIONS["loops"])
    with folder.writing("loops", settings, folder.inputs_of("odometry")):
        pass
    record(folder, "odometry", Config(seed=1))
    assert not folder.has("loops")
    assert recorded_settings(folder).disagreed == {"seed": {"odometry": 1, "loops": 0}}

"""vnav config as a user calls it."""

import json
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from vnav.cli.main import cli
from vnav.config import SETTINGS, Config, RegistrationConfig
from vnav.errors import ConfigError, MapError
from vnav.io.store.map_folder import MapFolder
from vnav.io.store.stage_reports import settings_of


def run(*arguments: object) -> Result:
    return CliRunner().invoke(
        cli, ["config", *map(str, arguments)], standalone_mode=False, catch_exceptions=False
    )


@pytest.fixture
def folder(tmp_path: Path) -> MapFolder:
    """A map of two stages that were made with another ratio."""
    folder = MapFolder.create(tmp_path / "map")
    for stage, ratio in (("odometry", 0.8), ("loops", 0.7)):
        config = Config(seed=5, registration=RegistrationConfig(ratio=ratio))
        with folder.writing(stage, settings_of(config, "registration"), {}):
            pass
    return folder


def test_all_settings_are_listed() -> None:
    output = run().output
    assert "fuse: Cloud, octree, mesh and grid.\n" in output
    words = next(line for line in output.splitlines() if "octree_m " in line).split()
    assert words == ["octree_m", "0.05", "[0.001,", "1]", "m"]


def test_all_settings_are_one_array_as_json() -> None:
    rows = json.loads(run("--json").output)
    assert {row["name"]: row["default"] for row in rows} == {
        name: setting.default for name, setting in SETTINGS.items()
    }


def test_a_preset_is_what_it_changes() -> None:
    lines = [line.split() for line in run("orb").output.splitlines()]
    assert lines == [["features.front_end", "orb", "default", "sift"]]
    changes = {"features.front_end": "orb"}
    assert json.loads(run("orb", "--json").output) == {"source": "orb", "changes": changes}


def test_a_file_is_what_it_changes(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text("seed = 3\n[plan]\nallow_unknown = true\n")
    lines = [line.split() for line in run(path).output.splitlines()]
    assert lines == [
        ["seed", "3", "default", "0"],
        ["plan.allow_unknown", "true", "default", "false"],
    ]


def test_a_map_is_what_it_was_made_with(folder: MapFolder) -> None:
    lines = run(folder.root).output.splitlines()
    assert lines[0].split() == ["seed", "5", "default", "0"]
    assert ["registration.min_inliers", "15"] in [line.split() for line in lines]
    assert lines[-2] == "stages disagree: registration.ratio is 0.8 in odometry, 0.7 in loops"
    assert lines[-1] == "stages missing: vocabulary, optimise, fuse, index"


def test_a_map_as_json_is_one_object(folder: MapFolder) -> None:
    values = json.loads(run(folder.root, "--json").output)
    assert values["settings"]["seed"] == 5
    assert values["disagree"] == {"registration.ratio": {"odometry": 0.8, "loops": 0.7}}
    assert values["missing"] == ["vocabulary", "optimise", "fuse", "index"]


def test_a_preset_comes_before_a_map_of_its_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    MapFolder.create(Path("patent"))
    assert "locate.level_2d_3d" in run("patent").output
    assert run("./patent").output.startswith("stages missing")


def test_a_folder_without_a_map_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(MapError, match="found no map.json"):
        run(tmp_path)


def test_what_is_neither_preset_nor_file_nor_map_is_an_error() -> None:
    with pytest.raises(ConfigError, match=r"preset \(.*patent.*\), a TOML file or the folder of a"):
        run("no-such")


def test_markdown_of_a_preset_is_a_usage_error() -> None:
    assert CliRunner().invoke(cli, ["config", "fast", "--markdown"]).exit_code == 2

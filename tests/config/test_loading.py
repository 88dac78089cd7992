import dataclasses
from pathlib import Path

import pytest

from vnav import config
from vnav.config import loading
from vnav.errors import ConfigError


def test_without_a_source_the_defaults_are_loaded() -> None:
    assert config.load() == config.Config()


def test_a_preset_changes_only_what_it_names() -> None:
    loaded = config.load("orb")
    assert loaded.features.front_end == "orb"
    features = dataclasses.replace(loaded.features, front_end=config.Config().features.front_end)
    assert dataclasses.replace(loaded, features=features) == config.Config()


@pytest.mark.parametrize("preset", config.presets())
def test_every_preset_that_ships_can_be_loaded(preset: str) -> None:
    assert config.load(preset) != config.Config()


def test_a_file_is_loaded_like_a_preset(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text("seed = 7\n[odometry]\nmax_depth_m = 4\n")
    loaded = config.load(str(path))
    assert loaded.seed == 7
    assert loaded.odometry.max_depth_m == 4.0
    assert isinstance(loaded.odometry.max_depth_m, float)


def test_single_settings_win_over_the_file(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text("[odometry]\nmax_depth_m = 4.0\n")
    assert config.load(str(path), ["odometry.max_depth_m=3"]).odometry.max_depth_m == 3.0


def test_a_single_setting_may_be_text_a_flag_or_a_number() -> None:
    settings = [
        "features.front_end=sift",
        "features.sift.root_sift=false",
        "plan.robot_radius_m=.5",
        "seed=3",
    ]
    with pytest.raises(ConfigError, match="robot_radius_m"):
        config.load(None, settings)  # TOML numbers begin with a digit
    settings[2] = "plan.robot_radius_m=0.5"
    loaded = config.load(None, settings)
    assert not loaded.features.sift.root_sift
    assert (loaded.plan.robot_radius_m, loaded.seed) == (0.5, 3)


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ("odometry.max_depht_m=4", "did you mean 'odometry.max_depth_m'"),
        ("odometri.max_depth_m=4", "did you mean 'odometry.max_depth_m'"),
        ("robot_height_m=1", "did you mean 'fuse.robot_height_m'"),
        ("index.speed=1", "known are: min_shared_landmarks, neighbours"),
        ("a.b={}", "unknown setting 'a.b'"),
        ("odometry.max_depth_m", "section.name=value"),
        ("odometry.max_depth_m=deep", "expected odometry.max_depth_m to be a number above 0"),
        ("odometry=4", "expected a table"),
        ("locate.max_features=2.5", "to be a whole number from 1 to 100000, found 2.5"),
        ("locate.max_features=true", "to be a whole number from 1 to 100000, found True"),
        ("zzz=1", "known are: seed, capture"),
    ],
)
def test_a_setting_that_does_not_fit_is_named(setting: str, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        config.load(None, [setting])


def test_a_source_that_is_neither_preset_nor_file_names_the_presets() -> None:
    with pytest.raises(
        ConfigError, match=r"expected a preset \(.*patent.*\) or a TOML file.*'no-such'"
    ):
        config.load("no-such")


@pytest.mark.parametrize("content", [b"[odometry\n", b"\xff\xfe"])
def test_a_file_that_is_no_toml_is_named(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "broken.toml"
    path.write_bytes(content)
    with pytest.raises(ConfigError, match=r"expected TOML in .*broken\.toml"):
        config.load(str(path))


@pytest.mark.parametrize(("old", "new"), loading.RENAMED.items())
def test_an_old_name_is_answered_by_the_new_one(old: str, new: str) -> None:
    assert old not in config.SETTINGS
    assert new in config.SETTINGS
    with pytest.raises(ConfigError, match=f"unknown setting '{old}'.*called '{new}' now"):
        config.load(None, [f"{old}=1"])


def test_an_old_name_in_a_file_is_named_with_the_file(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text("[features]\nroot_sift = true\n")
    with pytest.raises(ConfigError, match=r"mine\.toml; it is called 'features.sift.root_sift'"):
        config.load(str(path))


def test_a_bad_value_is_named_with_where_it_was_found(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text("[fuse]\nvoxel_m = -1\n")
    with pytest.raises(ConfigError, match=r"expected fuse\.voxel_m .* found -1 in .*mine\.toml"):
        config.load(str(path))
    with pytest.raises(ConfigError, match=r"found 0 in --set fuse\.voxel_m=0"):
        config.load(None, ["fuse.voxel_m=0"])


def test_settings_that_are_allowed_together_only_may_be_given_in_any_order() -> None:
    both = ["fuse.obstacle_min_m=2", "fuse.robot_height_m=3"]
    assert config.load(None, both) == config.load(None, both[::-1])


def test_changes_begin_with_a_base() -> None:
    base = config.load("fast")
    changed = config.load(None, ["features.sift.edge_threshold=12"], base)
    assert changed.features.sift.contrast_threshold == base.features.sift.contrast_threshold
    assert changed.features.sift.edge_threshold == 12.0


def test_a_section_without_changes_changes_nothing() -> None:
    assert config.load(None, ["fuse={}"]) == config.Config()

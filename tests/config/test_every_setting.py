"""What holds for every setting; a new one is tested by being there."""

import dataclasses
import pickle
import re
from collections.abc import Iterator
from typing import Any, get_type_hints

import numpy as np
import pytest

from vnav.config import SETTINGS, Config, FuseConfig, RegistrationConfig, load, presets, updated
from vnav.config.outline import Outline
from vnav.config.setting import Choice, Range, Section, Setting
from vnav.errors import ConfigError

UNITS = {"_m": "m", "_s": "s", "_px": "px", "_deg": "deg", "_hz": "Hz"}
WRONG_TYPES: tuple[Any, ...] = ("", "one", None, [], (1,), {})


def bad_values(setting: Setting) -> Iterator[Any]:
    """At least five values of which none is allowed."""
    yield from (value for value in WRONG_TYPES if value != "" or not _may_be_empty(setting))
    yield float("nan")
    yield float("inf")
    if isinstance(setting.allowed, Choice):
        yield from (0, 1, 2.5, "nonsense")
        return
    if isinstance(setting.allowed, Outline):
        yield from ("1,1 2,2", "1,1 2,1 1,2", "1;1 -1;1 0;-1", "nan,1 -1,1 0,-1", ((1, 1),) * 3)
        return
    yield from (True, -float("inf"), 10**400)
    low, high = setting.allowed.ends
    yield from (low - 1, high + 1)
    if setting.allowed.whole:
        yield low + 0.5
        yield float(setting.default)
    if setting.allowed.odd:
        yield setting.default + 1
    if setting.allowed.text[0] == "(":
        yield int(low)
    if setting.allowed.text[-1] == ")":
        yield int(high)


def _may_be_empty(setting: Setting) -> bool:
    allowed = setting.allowed
    return isinstance(allowed, Outline) or isinstance(allowed, Choice) and "" in allowed.values


def changed(name: str, value: Any) -> Config:
    """A configuration with one setting changed, as a Python caller changes it."""
    config = Config()
    *path, last = name.split(".")
    sections = [config]
    for part in path:
        sections.append(getattr(sections[-1], part))
    made: Any = dataclasses.replace(sections.pop(), **{last: value})
    for part in reversed(path):
        made = dataclasses.replace(sections.pop(), **{part: made})
    assert isinstance(made, Config)
    return made


def section_of(name: str) -> Any:
    """The section that a setting is in, with its defaults."""
    found: Any = Config()
    for part in name.split(".")[:-1]:
        found = getattr(found, part)
    return found


@pytest.mark.parametrize("name", SETTINGS)
def test_bad_values_of_a_setting_are_refused(name: str) -> None:
    setting = SETTINGS[name]
    values = list(bad_values(setting))
    assert len(values) >= 5
    said = re.escape(f"expected {name} to be {setting.allowed}, found ")
    for value in values:
        with pytest.raises(ConfigError, match=said):
            changed(name, value)
        with pytest.raises(ConfigError, match=f"{said}.* in mine"):
            updated(Config(), {name: value}, "mine")
        with pytest.raises(ConfigError, match=said):
            type(section_of(name))(**{name.rpartition(".")[2]: value})


@pytest.mark.parametrize("name", SETTINGS)
def test_the_default_of_a_setting_is_allowed_and_of_its_type(name: str) -> None:
    setting, section = SETTINGS[name], section_of(name)
    last = name.rpartition(".")[2]
    assert setting.checked(name, setting.default) == setting.default
    assert type(setting.default) is get_type_hints(type(section))[last]
    assert getattr(section, last) == setting.default


@pytest.mark.parametrize("name", SETTINGS)
def test_a_setting_says_what_it_means_and_in_what_unit(name: str) -> None:
    setting = SETTINGS[name]
    assert len(setting.meaning) > 10
    assert bool(setting.unit) == isinstance(setting.allowed, Range | Outline)
    for ending, unit in UNITS.items():
        assert not name.endswith(ending) or "_per_" in name or setting.unit == unit


@pytest.mark.parametrize("name", [n for n, s in SETTINGS.items() if isinstance(s.allowed, Range)])
def test_a_range_is_finite_and_its_closed_ends_are_allowed(name: str) -> None:
    allowed = SETTINGS[name].allowed
    assert isinstance(allowed, Range)
    low, high = allowed.ends
    assert low < high
    assert all(np.isfinite(allowed.ends))
    for bracket, end in zip(allowed.text[0] + allowed.text[-1], allowed.ends, strict=True):
        value = int(end) if allowed.whole else end
        assert (allowed.taken(value) == end) == (bracket in "[]")


def test_sections_are_where_they_say_that_they_are() -> None:
    def paths(section: type[Section]) -> Iterator[tuple[str, str]]:
        for name, inner in section.sections():
            yield section.full(name), inner.path
            yield from paths(inner)

    found = list(paths(Config))
    assert len(found) >= 12
    assert all(place == path for place, path in found)


def test_every_field_is_a_setting_or_a_section() -> None:
    def undeclared(section: type[Section]) -> Iterator[str]:
        known = dict(section.settings()).keys() | dict(section.sections()).keys()
        assert dataclasses.is_dataclass(section)
        yield from (f.name for f in dataclasses.fields(section) if f.name not in known)
        for _, inner in section.sections():
            yield from undeclared(inner)

    assert not list(undeclared(Config))


@pytest.mark.parametrize("name", [n for n, setting in SETTINGS.items() if setting.rule])
def test_a_rule_names_another_setting_of_the_section(name: str) -> None:
    other = SETTINGS[name].rule.partition(" ")[2]
    assert other in dict(type(section_of(name)).settings())


def test_a_broken_rule_names_both_settings() -> None:
    said = "fuse.obstacle_min_m to be below fuse.robot_height_m, which is 0.1, found 0.1"
    with pytest.raises(ConfigError, match=said):
        FuseConfig(robot_height_m=0.1)
    said = "refine_radius_px to be at most registration.search_radius_px, which is 7.0, found 8.0"
    with pytest.raises(ConfigError, match=said):
        RegistrationConfig(search_radius_px=7)


def test_a_section_must_be_one_of_its_kind() -> None:
    with pytest.raises(ConfigError, match="expected fuse to be a FuseConfig, found 3"):
        changed("fuse", 3)


def test_a_whole_number_is_kept_as_a_real_one_where_the_setting_is_real() -> None:
    kept = FuseConfig(voxel_m=1).voxel_m
    assert (type(kept), kept) == (float, 1.0)
    assert type(RegistrationConfig(min_inliers=np.int64(20)).min_inliers) is int


@pytest.mark.parametrize("preset", presets())
def test_a_configuration_can_be_pickled(preset: str) -> None:
    config = load(preset)
    assert pickle.loads(pickle.dumps(config)) == config


def test_a_configuration_cannot_be_changed() -> None:
    with pytest.raises(dataclasses.FrozenInstanceError):
        FuseConfig().voxel_m = 0.1  # type: ignore[misc]

"""Configurations from presets, files and single settings, which hold only differences."""

import dataclasses
import difflib
import tomllib
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, TypeVar

from vnav.config.sections import Config
from vnav.config.setting import Section
from vnav.config.shipped import preset_cameras, preset_text, presets
from vnav.errors import ConfigError

__all__ = ["RENAMED", "SETTINGS", "load", "preset_cameras", "presets", "updated"]

SectionT = TypeVar("SectionT", bound=Section)
Values = Mapping[str, Any]

SETTINGS = dict(Config.all_settings())

RENAMED = {
    "features.contrast_threshold": "features.sift.contrast_threshold",
    "features.edge_threshold": "features.sift.edge_threshold",
    "features.few_features": "features.sift.few_features",
    "features.root_sift": "features.sift.root_sift",
    "features.weak_contrast_threshold": "features.sift.weak_contrast_threshold",
    "index.beside_shared": "index.min_shared_landmarks",
    "locate.places": "locate.max_clusters",
    "odometry.keyframe_shared": "odometry.keyframe_min_inlier_share",
    "odometry.max_loose_frames": "odometry.max_degenerate_frames",
    "optimise.weak_landmarks": "optimise.min_shared_landmarks",
    "registration.depth_of_either": "registration.one_sided_depth",
    "registration.polish_radius_px": "registration.refine_radius_px",
    "registration.sure_inlier_share": "registration.search_min_inlier_share",
}


def load(
    source: str | None = None, settings: Iterable[str] = (), base: Config | None = None
) -> Config:
    """A configuration changed by a preset or file, then by ``odometry.max_depth_m=4`` and such.

    It begins with ``base``, else with the defaults. Raises ConfigError for an unknown name, a value
    that is not allowed, or an unreadable file.
    """
    changes = {} if source is None else dict(_checked(read(source), source))
    for setting in settings:
        name, equals, text = setting.partition("=")
        if not equals:
            raise ConfigError(f"expected --set section.name=value, found '{setting}'")
        changes |= _checked({name.strip(): _parse(text)}, f"--set {setting}")
    return _with(base or Config(), changes)


def updated(config: Config, changes: Values, where: str) -> Config:
    """The same configuration with nested changes; ConfigError names what does not fit."""
    return _with(config, dict(_checked(changes, where)))


def read(source: str) -> dict[str, Any]:
    """The differences that a file, or else the preset of that name, holds."""
    path = Path(source)
    try:
        if path.is_file():
            return tomllib.loads(path.read_text("utf-8"))
        if source in presets():
            return tomllib.loads(preset_text(source))
    except (ValueError, RecursionError) as error:
        raise ConfigError(f"expected TOML in {source}, found: {error}") from error
    known = ", ".join(presets())
    raise ConfigError(f"expected a preset ({known}) or a TOML file, found neither: '{source}'")


def flat(values: Values, prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Nested settings by their full names."""
    for key, value in values.items():
        name = prefix + key
        if isinstance(value, Mapping) and value and name not in SETTINGS:
            yield from flat(value, f"{name}.")
        else:
            yield name, value


def _checked(changes: Values, where: str) -> Iterator[tuple[str, Any]]:
    """Changes by their full names; ConfigError where one is unknown or not allowed."""
    for name, value in flat(changes):
        setting = SETTINGS.get(name)
        if setting is not None:
            yield name, setting.checked(name, value, f" in {where}")
        elif not _is_section(name):
            raise ConfigError(f"unknown setting '{name}' in {where}; {_hint(name)}")
        elif value != {}:
            raise ConfigError(f"expected a table for {name} in {where}, found {value!r}")


def _with(section: SectionT, changes: Values) -> SectionT:
    """All changes at once, for one may only be allowed together with another."""
    own: dict[str, Any] = {}
    nested: dict[str, dict[str, Any]] = {}
    for name, value in changes.items():
        head, _, rest = name.partition(".")
        (nested.setdefault(head, {}) if rest else own)[rest or head] = value
    own |= {head: _with(getattr(section, head), part) for head, part in nested.items()}
    return dataclasses.replace(section, **own)  # type: ignore[type-var]  # each section is one


def _is_section(name: str) -> bool:
    return any(known.startswith(f"{name}.") for known in SETTINGS)


def _hint(name: str) -> str:
    """The new name, the nearest one, or where all are found."""
    if name in RENAMED:
        return f"it is called '{RENAMED[name]}' now"
    near = difflib.get_close_matches(name, SETTINGS, 1)
    near = near or [full for full in SETTINGS if full.rpartition(".")[2] == name]
    if near:
        return f"did you mean '{near[0]}'?"
    section = name
    while section and not _is_section(section):
        section = section.rpartition(".")[0]
    start = f"{section}." if section else ""
    names = (full.removeprefix(start) for full in SETTINGS if full.startswith(start))
    return f"known are: {', '.join(dict.fromkeys(n.partition('.')[0] for n in names))}"


def _parse(text: str) -> Any:
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        return text.strip()

"""The settings for people: all of them, what a configuration changes, and docs/settings.md."""

import dataclasses
from collections.abc import Iterator
from typing import Any

from vnav.config.loading import RENAMED, SETTINGS, flat
from vnav.config.sections import Config
from vnav.config.setting import Section, Setting, plain

HEAD = """# Settings

This page is made from `vnav/config/sections.py`: `vnav config --markdown > docs/settings.md`.
`vnav config` prints the same list. `vnav config PRESET` prints what a preset changes.
`vnav config MAP` prints what a map was made with.

`--set section.name=value` changes one setting. `--config` takes a preset or a TOML file of
differences:

```toml
[features]
max_features = 1000
[features.sift]
contrast_threshold = 0.02
```

A range includes its end at a square bracket and excludes it at a round one.
A value outside is an error before any work begins.
"""
OLD_NAMES = """
## Old names

An old name is an error that says the new one.

| old | new |
|---|---|
"""


def rows() -> list[dict[str, Any]]:
    """Every setting as plain values: name, default, what it may be, unit, meaning."""
    return [
        {
            "name": name,
            "default": setting.default,
            "allowed": setting.short,
            "unit": setting.unit,
            "meaning": setting.meaning,
        }
        for name, setting in SETTINGS.items()
    ]


def lines() -> Iterator[str]:
    """Every setting by section: name, default, what it may be, unit; below it the meaning."""
    for path, title, settings in _groups(Config):
        yield f"{path or 'no section'}: {title}"
        for name, setting in settings.items():
            said = f"  {name:24} {plain(setting.default):8} {setting.short:20} {setting.unit}"
            yield said.rstrip()
            yield f"      {setting.meaning}"


def markdown() -> str:
    """docs/settings.md."""
    parts = [HEAD]
    for path, title, settings in _groups(Config):
        parts.append(f"\n## {path or 'No section'}\n\n{title}\n\n")
        parts.append("| setting | default | may be | unit | meaning |\n|---|---|---|---|---|\n")
        for name, setting in settings.items():
            cells = f"`{name}`", f"`{plain(setting.default)}`", setting.short, setting.unit
            parts.append(f"| {' | '.join(cells)} | {setting.meaning} |\n")
    parts.append(OLD_NAMES)
    parts += [f"| `{old}` | `{new}` |\n" for old, new in RENAMED.items()]
    return "".join(parts)


def changes(config: Config) -> dict[str, Any]:
    """The settings that are not the defaults, by their full names."""
    values = flat(dataclasses.asdict(config))
    return {name: value for name, value in values if value != SETTINGS[name].default}


def _groups(section: type[Section]) -> Iterator[tuple[str, str, dict[str, Setting]]]:
    """Path, title and own settings of a section, then of those in it."""
    yield section.path, (section.__doc__ or "").partition("\n")[0], dict(section.settings())
    for _, inner in section.sections():
        yield from _groups(inner)

"""Every setting, with what nobody means, by --set, by a file and by the API."""

import math
import sys
from pathlib import Path
from typing import Any

import numpy as np

from attacks.attempt import Attempt, anything, refused
from attacks.captures import ODOMETRY
from attacks.maps import LOCATE, PLAN, drawn
from vnav.config import SETTINGS
from vnav.config.setting import Range

Random = np.random.Generator
NEVER = ("nan", "inf", "-inf", "1e308", "9" * 400, "[]", "[1]", "{}", "{a = 1}", '"x\\u0000"', '""')
NEVER += ("1979-05-27", "'\x1b'", "1e999", "-1e300", "0x7fffffffffffffffffff", "-" + "9" * 400)
PERHAPS = (
    "-1",
    "0",
    "-0.0",
    "1e-320",
    "1",
    "2",
    "0.5",
    "true",
    "false",
    '"1"',
    "1e6",
    "2147483648",
)
COMMANDS = {"locate": LOCATE, "plan": PLAN, "": LOCATE}
STAGES = ("vocabulary", "loops", "optimise", "fuse", "index")


def attempt(rng: Random, folder: Path) -> Attempt:
    """One setting and one value, given in one way."""
    name = drawn(rng, list(SETTINGS))
    value, judge = drawn(rng, NEVER), refused
    if value == '""' and SETTINGS[name].default == "":
        judge = anything
    if rng.random() < 0.4:
        value, judge = drawn(rng, [*PERHAPS, *ends(name)]), anything
    what = f"{name} = {value[:50]!r}"
    way = drawn(rng, ["--set", "file", "API"])
    if way == "API":
        return Attempt(f"{what} by the API", judge=judge, call=(by_api, (name, value)))
    if way == "--set":
        return Attempt(what, (*command_of(name), "--set", f"{name}={value}"), judge)
    section, _, key = name.rpartition(".")
    head = f"[{section}]\n" if section else ""
    (folder / "settings.toml").write_text(f"{head}{key} = {value}\n", "utf-8")
    return Attempt(f"{what} in a file", (*command_of(name), "--config", "settings.toml"), judge)


def ends(name: str) -> list[str]:
    """Both ends of a setting's range, which may be legal."""
    allowed = SETTINGS[name].allowed
    if not isinstance(allowed, Range):
        return []
    return [str(int(end) if allowed.whole else end) for end in allowed.ends]


def command_of(name: str) -> tuple[str, ...]:
    """A command that uses the setting."""
    section = name.partition(".")[0] if "." in name else ""
    if section in STAGES:
        return (section, "--map", "map")
    return COMMANDS.get(section, ODOMETRY)


def by_api(name: str, text: str) -> int:
    """Make a configuration as a program does, with values that TOML has not, too."""
    from vnav.config import Config, updated
    from vnav.errors import VnavError

    values: dict[str, Any] = {
        "nan": math.nan,
        "inf": np.float64("inf"),
        "-inf": np.float32("-inf"),
        "[]": [],
        "[1]": np.ones(1),
        "{}": object(),
        "{a = 1}": 1j,
        "1979-05-27": None,
    }
    try:
        value = values[text] if text in values else parsed(text)
        config = updated(Config(), {name: value}, "a program")
    except VnavError as error:
        print(f"vnav: {error}", file=sys.stderr)
        return 1
    print(config.seed)
    return 0


def parsed(text: str) -> Any:
    """A number where the text is one, else the text."""
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            continue
    return text

"""How a setting is declared: default, what it may be, unit and meaning, in one line; its check."""

import dataclasses
import numbers
import operator
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar, TypeVar

from vnav.config.outline import Outline
from vnav.errors import ConfigError

RULES = {"<": (operator.lt, "below"), "<=": (operator.le, "at most")}


@dataclass(frozen=True)
class Range:
    """Numbers between two finite ends, as in ``[0, 1)``: a bracket includes its end."""

    text: str
    whole: bool = False
    odd: bool = False

    @property
    def ends(self) -> tuple[float, float]:
        """The lowest and the highest number."""
        low, high = self.text[1:-1].split(",")
        return float(low), float(high)

    def taken(self, value: Any) -> float | None:
        """The value as it is kept, None where it is not allowed; a truth value is no number."""
        kind = numbers.Integral if self.whole else numbers.Real
        a_number = isinstance(value, kind) and not isinstance(value, bool)
        if not (a_number and self._holds(value)):
            return None
        return int(value) if self.whole else float(value)

    def _holds(self, value: Any) -> bool:
        low, high = self.ends
        at_end = self.text[0] == "[" and value == low or self.text[-1] == "]" and value == high
        return (low < value < high or at_end) and not (self.odd and value % 2 == 0)

    @property
    def short(self) -> str:
        """For a table."""
        return f"{self.text} odd" if self.odd else self.text

    def __str__(self) -> str:
        low, high = self.text[1:-1].split(", ")
        kind = "whole number" if self.whole else "number"
        kind = f"an odd {kind}" if self.odd else f"a {kind}"
        if self.text[0] + self.text[-1] == "[]":
            return f"{kind} from {low} to {high}"
        above = "at least" if self.text[0] == "[" else "above"
        return f"{kind} {above} {low} and {'at most' if self.text[-1] == ']' else 'below'} {high}"


@dataclass(frozen=True)
class Choice:
    """One of several values of a type; they are listed when they are asked for."""

    listed: Callable[[], tuple[Any, ...]]
    absent: Mapping[str, str] = field(default_factory=dict)  # what people ask for, and why not

    @property
    def values(self) -> tuple[Any, ...]:
        """All of them."""
        return self.listed()

    def taken(self, value: Any) -> Any:
        """The value, None where it is none of these."""
        values = self.values
        return value if type(value) is type(values[0]) and value in values else None

    @property
    def short(self) -> str:
        """For a table."""
        return ", ".join(plain(value) for value in self.values)

    def __str__(self) -> str:
        *others, last = (plain(value) for value in self.values)
        return f"{', '.join(others)} or {last}" if others else last

    def reason(self, value: Any) -> str:
        """Why this value is not among them, where that is known."""
        return f": {self.absent[value]}" if isinstance(value, str) and value in self.absent else ""


@dataclass(frozen=True)
class Setting:
    """What is known of a setting; ``rule`` relates it to another of its section: ``< name``."""

    default: Any
    allowed: Range | Choice | Outline
    unit: str
    meaning: str
    rule: str = ""

    def checked(self, name: str, value: Any, where: str = "") -> Any:
        """The value as it is kept; ConfigError where it is not allowed."""
        taken = self.allowed.taken(value)
        if taken is None:
            found = " ".join(repr(value).split())
            reason = self.allowed.reason(value) if isinstance(self.allowed, Choice) else ""
            raise ConfigError(f"expected {name} to be {self.allowed}, found {found}{where}{reason}")
        return taken

    @property
    def short(self) -> str:
        """What it may be, for a table."""
        sign, _, other = self.rule.partition(" ")
        return f"{self.allowed.short}, {RULES[sign][1]} {other}" if other else self.allowed.short


def number(default: float, allowed: str, unit: str, meaning: str, *, rule: str = "") -> float:
    """Declare a real number; whole ones are taken and kept as real."""
    setting = Setting(default, Range(allowed), unit, meaning, rule)
    return field(default=default, metadata={"setting": setting})


def whole(
    default: int, allowed: str, unit: str, meaning: str, *, odd: bool = False, rule: str = ""
) -> int:
    """Declare a whole number."""
    setting = Setting(default, Range(allowed, whole=True, odd=odd), unit, meaning, rule)
    return field(default=default, metadata={"setting": setting})


def flag(default: bool, meaning: str) -> bool:
    """Declare something that is so or not."""
    setting = Setting(default, Choice(lambda: (True, False)), "", meaning)
    return field(default=default, metadata={"setting": setting})


def outline(unit: str, meaning: str) -> str:
    """Declare a polygon round the origin, of which there is none by default."""
    return field(default="", metadata={"setting": Setting("", Outline(), unit, meaning)})


def choice(
    default: str,
    listed: Callable[[], tuple[str, ...]],
    meaning: str,
    *,
    absent: Mapping[str, str] | None = None,
) -> str:
    """Declare one of several words; ``absent``: others that are asked for, and why they are not."""
    setting = Setting(default, Choice(listed, absent or {}), "", meaning)
    return field(default=default, metadata={"setting": setting})


SectionT = TypeVar("SectionT", bound="Section")


def section(kind: type[SectionT]) -> SectionT:
    """Declare a section in a section."""
    return field(default_factory=kind, metadata={"section": kind})


class Section:
    """Base of the frozen dataclasses that hold settings, or sections; made only if all is allowed.

    ``path``: its place in the configuration, as in ``features.sift``; empty at the top.
    """

    path: ClassVar[str]

    def __init_subclass__(cls, path: str) -> None:
        cls.path = path

    @classmethod
    def settings(cls) -> Iterator[tuple[str, Setting]]:
        """Each field that is a setting, by its name in this section."""
        for item in dataclasses.fields(cls):  # type: ignore[arg-type]  # each subclass is one
            if "setting" in item.metadata:
                yield item.name, item.metadata["setting"]

    @classmethod
    def sections(cls) -> "Iterator[tuple[str, type[Section]]]":
        """Each field that is a section in this one."""
        for item in dataclasses.fields(cls):  # type: ignore[arg-type]
            if "section" in item.metadata:
                yield item.name, item.metadata["section"]

    @classmethod
    def all_settings(cls) -> Iterator[tuple[str, Setting]]:
        """Those of this section, and of those in it, by their full names."""
        yield from ((cls.full(name), setting) for name, setting in cls.settings())
        for _, section in cls.sections():
            yield from section.all_settings()

    @classmethod
    def full(cls, name: str) -> str:
        """A field's name in the configuration."""
        return f"{cls.path}.{name}" if cls.path else name

    def __post_init__(self) -> None:
        for name, setting in self.settings():
            value = setting.checked(self.full(name), getattr(self, name))
            object.__setattr__(self, name, value)
        for name, setting in self.settings():
            self._expect_rule(name, setting.rule)
        for name, section in self.sections():
            found = getattr(self, name)
            if not isinstance(found, section):
                raise ConfigError(
                    f"expected {self.full(name)} to be a {section.__name__}, found {found!r}"
                )

    def _expect_rule(self, name: str, rule: str) -> None:
        sign, _, other = rule.partition(" ")
        if not rule or RULES[sign][0](getattr(self, name), getattr(self, other)):
            return
        raise ConfigError(
            f"expected {self.full(name)} to be {RULES[sign][1]} {self.full(other)},"
            f" which is {getattr(self, other)}, found {getattr(self, name)}"
        )


def plain(value: Any) -> str:
    """A value as TOML has it, a word without quotes."""
    if isinstance(value, bool):
        return str(value).lower()
    return '""' if value == "" else str(value)

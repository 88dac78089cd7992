"""What is tried on vnav, what comes of it, and whether that is a fault.

A fault is a traceback, a crash, a hang, a refusal that is not one line, the noise of a library, or
an answer that differs from the undisturbed one without a word.
"""

import json
import re
import signal
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

REFUSALS = {1: "vnav: ", 2: "Error: "}  # by exit code, how the one line begins
CODES = (0, 1, 2, 3)
NOISE = re.compile(r"^\[ ?(WARN|ERROR)|\.py:\d+: \w*Warning|terminate called", re.MULTILINE)
INTERRUPTED = 130
OWN_CODE = re.compile(r'File ".*/vnav/(?!__init__)')  # in a traceback: vnav had begun
TRACEBACK = "Traceback (most recent call last)"
VOLATILE = {"seconds", "cpu_seconds", "size_mb", "map", "photo"}  # keys of answers in JSON
MEASURED = re.compile(r"\d+\.\d+ (s|MB)\b")
LACKING = ("missing", "stale", "damaged")  # stages, as `info` and `config` tell of them
FAR_M, FAR_COSINE = 0.30, 0.0872**2  # of a wrong pose; squared sine of half of 10 degrees


@dataclass(frozen=True)
class Result:
    """What became of a command: ``ended`` says what ended it, where that was not itself.

    ``files``: hashes of what it wrote, by name.
    """

    code: int
    out: str
    err: str
    ended: str = ""
    files: Mapping[str, str] = field(default_factory=dict)

    @property
    def answer(self) -> tuple[int, Any, Mapping[str, str]]:
        """What another run must give, too."""
        return self.code, canonical(self.out), self.files


Intact = Callable[[], Result]  # the undisturbed command's
Judge = Callable[[Result, Intact], str]  # what is wrong with a clean result, "" for nothing


@dataclass(frozen=True)
class Disturbance:
    """What a process of its own suffers: environment, limits, streams, a signal.

    ``limits`` by number of the resource; ``streams`` by name of the stream: a file, or "closed";
    ``signal_s``: when the signal comes; ``unprivileged``: permissions hold for root, too.
    """

    environment: Mapping[str, str | None] = field(default_factory=dict)
    limits: Mapping[int, int] = field(default_factory=dict)
    streams: Mapping[str, str] = field(default_factory=dict)
    signal_s: float | None = None
    signal: int = signal.SIGINT
    unprivileged: bool = False


def anything(result: Result, intact: Intact) -> str:
    """Any clean answer will do."""
    return ""


def refused(result: Result, intact: Intact) -> str:
    """It must be refused."""
    return "" if result.code in REFUSALS else "answered what had to be refused"


def same(result: Result, intact: Intact) -> str:
    """It is refused, or the answer is the undisturbed one's."""
    if result.code in REFUSALS or result.answer == intact().answer:
        return ""
    return f"another answer in silence, exit {result.code}"


def less(result: Result, intact: Intact) -> str:
    """As `same`; or what is told is true, and what is lacking is told to be, or left out."""
    if same(result, intact) == "" or is_less(*(canonical(r.out) for r in (result, intact()))):
        return ""
    return f"another answer in silence, exit {result.code}"


def is_less(found: Any, wanted: Any) -> bool:
    if isinstance(found, dict) and isinstance(wanted, dict):
        return all(key in wanted and is_less(found[key], wanted[key]) for key in found)
    if isinstance(found, str) and isinstance(wanted, str):
        lines = set(found.splitlines()) - set(wanted.splitlines())
        return all(any(word in line for word in LACKING) for line in lines)
    return found is None or bool(found == wanted)


def told(name: str) -> Judge:
    """It is refused, or what is told names a file."""

    def judge(result: Result, intact: Intact) -> str:
        is_told = result.code in REFUSALS or name in result.out + result.err
        return "" if is_told else f"nothing is said of {name}"

    return judge


def near(result: Result, intact: Intact) -> str:
    """A photo is refused, not located, or located near to where the undisturbed one is."""
    if result.code != 0:
        return ""
    found, wanted = (json.loads(each.out) for each in (result, intact()))
    apart_m = sum((a - b) ** 2 for a, b in pairs(found, wanted, "position_m")) ** 0.5
    cosine = sum(a * b for a, b in pairs(found, wanted, "quaternion_xyzw"))
    wrong = apart_m > FAR_M or 1 - cosine**2 > FAR_COSINE
    return f"a wrong pose, {apart_m:.2f} m off" if wrong else ""


def pairs(found: dict[str, Any], wanted: dict[str, Any], key: str) -> list[tuple[float, float]]:
    """Numbers of both answers side by side."""
    return list(zip(found[key], wanted[key], strict=True))


@dataclass(frozen=True)
class Attempt:
    """A command in a folder that was spoilt: what was done to it, how its result is judged.

    ``command``: of vnav, with paths below the folder; or ``call``, a function and its arguments,
    that returns an exit code. ``outputs``: folders whose files belong to the answer.
    ``reference``: what is undisturbed, where it is another command. ``again``: the same command
    without the disturbance must then give the undisturbed answer.
    """

    what: str
    command: tuple[str, ...] = ()
    judge: Judge = same
    call: tuple[Callable[..., int], tuple[Any, ...]] | None = None
    outputs: tuple[str, ...] = ("out",)
    reference: tuple[str, ...] = ()
    disturbance: Disturbance | None = None
    again: bool = False

    @property
    def undisturbed(self) -> tuple[str, ...]:
        """The command whose answer this one's is held against."""
        return self.reference or self.command


def fault(attempt: Attempt, result: Result, intact: Intact) -> str:
    """What is wrong with a result, "" where nothing is."""
    return unclean(attempt, result) or attempt.judge(result, intact)


def unclean(attempt: Attempt, result: Result) -> str:
    """What no command may do, whatever it was given."""
    if is_interrupted(attempt, result):
        return ""
    if result.ended:
        return result.ended
    said = result.out + result.err
    if TRACEBACK in said:
        return f"traceback: {said.strip().splitlines()[-1][:200]}"
    if result.code not in CODES:
        return f"exit code {result.code}"
    if noise := NOISE.search(said):
        line = said[noise.start() :].splitlines()[0]
        return f"noise of a library: {line[:200]}"
    return "" if is_one_line(attempt, result) else "refused, and not in one line"


def is_interrupted(attempt: Attempt, result: Result) -> bool:
    """Whether a signal ended it in one line, or before vnav had begun, or after all was done."""
    if attempt.disturbance is None or attempt.disturbance.signal_s is None:
        return False
    if result.code == INTERRUPTED:
        return TRACEBACK not in result.err and is_told(result, "vnav: interrupted")
    return result.code == -signal.SIGINT and not OWN_CODE.search(result.err)


def is_one_line(attempt: Attempt, result: Result) -> bool:
    """Whether what was refused is told in the last line of stderr; an answer "no" is on stdout."""
    answers_no = result.code == 1 and bool(result.out)
    if result.code not in REFUSALS or answers_no or closes_stderr(attempt):
        return True
    start = REFUSALS[result.code]
    return is_told(result, start)


def is_told(result: Result, start: str) -> bool:
    """Whether the last line that is no warning begins so, and is a line."""
    lines = [line for line in result.err.split("\n") if not line.startswith("vnav: warning: ")]
    return lines[-1] == "" and len(lines) > 1 and lines[-2].startswith(start)


def closes_stderr(attempt: Attempt) -> bool:
    """Whether nothing can be told."""
    return attempt.disturbance is not None and "stderr" in attempt.disturbance.streams


def canonical(text: str) -> Any:
    """An answer without what differs from run to run."""
    try:
        return without_volatile(json.loads(text))
    except ValueError:
        return "\n".join(" ".join(line.split()) for line in MEASURED.sub("", text).split("\n"))


def without_volatile(value: Any) -> Any:
    if isinstance(value, dict):
        return {k: without_volatile(v) for k, v in value.items() if k not in VOLATILE}
    return [without_volatile(v) for v in value] if isinstance(value, list) else value

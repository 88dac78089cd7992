"""What a benchmark measured: printed as a table, and recorded for docs/results.md.

A benchmark makes a list of `Measurement`, prints `table` of it, tells by `missed` whether all that
is wanted is there, and where ``--record`` is given writes it with `record`, to
benchmarks/results/NAME.json; `conclude` does all three. docs/results.md is made of these files by
make_results.py.
"""

import argparse
import json
import operator
import os
import shlex
import subprocess
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parent.parent
FOLDER = ROOT / "benchmarks" / "results"
QUESTIONS = ("how accurate", "how often right", "how fast", "how robust", "how large")
LIBRARIES = (
    "vnav-rgbd",
    "gtsam",
    "numba",
    "numpy",
    "octomap-python",
    "open3d",
    "open3d-cpu",
    "opencv-contrib-python-headless",
    "scikit-learn",
    "scipy",
)
DECIMALS = {"m": 4, "cm": 1, "deg": 2, "ms": 1, "s": 2, "MB": 0}  # by unit; 3 digits of others
BOUNDS = {"at most": operator.le, "at least": operator.ge}
SIGNS = {"at most": "≤", "at least": "≥"}


@dataclass(frozen=True)
class Measurement:
    """One quantity of one thing.

    ``on``: a capture, map or setting; ``what``: the system, stage or photos that were measured
    there; ``quantity`` and ``unit`` ("" for a ratio) make the head of a column. ``wanted``: "at
    most 1.5" or "at least 37". ``peer``: what a ratio is held against.
    """

    on: str
    what: str
    quantity: str
    value: float
    unit: str = ""
    wanted: str | None = None
    peer: str | None = None


def add_record_option(parser: argparse.ArgumentParser) -> None:
    """The option that all benchmarks have: by default a run changes no file of the repository."""
    parser.add_argument(
        "--record",
        action="store_true",
        help="write what was measured to benchmarks/results, for `make results`; not on a machine"
        " that is busy otherwise, where times are measured",
    )


def record(
    name: str,
    question: str,
    measurements: Sequence[Measurement],
    arguments: Sequence[str] | None = None,
    *,
    libraries: Sequence[str] = (),
    folder: Path = FOLDER,
) -> Path:
    """Write FOLDER/NAME.json, in place of what was there; the file.

    ``arguments``: of the running script, by default its command line's; ``libraries``: those
    whose versions matter beside vnav's own.
    """
    if question not in QUESTIONS:
        raise ValueError(f"expected one of {', '.join(QUESTIONS)}, found {question!r}")
    values = {
        "question": question,
        "command": command(Path(sys.argv[0]), sys.argv[1:] if arguments is None else arguments),
        "commit": commit(),
        "machine": machine(),
        "date": datetime.now(UTC).date().isoformat(),
        "versions": versions([*LIBRARIES, *libraries]),
        "measurements": [_plain(measurement) for measurement in measurements],
    }
    folder.mkdir(exist_ok=True)
    path = folder / f"{name}.json"
    path.write_text(as_text(values), "utf-8")
    return path


def conclude(
    name: str,
    found: Sequence[Measurement],
    asked: argparse.Namespace,
    arguments: Sequence[str] | None = None,
) -> int:
    """Print how robust a thing is, record it where that is asked for; 1 where something is missed.

    ``asked``: the parsed ``arguments``.
    """
    print(table(found))
    if asked.record:
        record(name, "how robust", found, arguments)
    return int(bool(missed(found)))


def as_text(values: Mapping[str, Any]) -> str:
    """JSON with a line for each key and each measurement, so that changes can be read."""
    lines = [f" {json.dumps(m, ensure_ascii=False)}" for m in values["measurements"]]
    keys = [f'"{k}": {json.dumps(v)}' for k, v in values.items() if k != "measurements"]
    keys.append('"measurements": [\n' + ",\n".join(lines) + "\n]")
    return "{\n" + ",\n".join(keys) + "\n}\n"


def _plain(measurement: Measurement) -> dict[str, Any]:
    return {key: value for key, value in asdict(measurement).items() if value is not None}


def command(script: Path, arguments: Sequence[str]) -> str:
    """The command line, with files and folders by their names only, and without ``--record``."""
    shown = [_without_folders(argument) for argument in arguments if argument != "--record"]
    return shlex.join(["python", f"benchmarks/{script.name}", *shown])


def _without_folders(argument: str) -> str:
    option, equals, value = argument.rpartition("=")
    return option + equals + (Path(value).name if os.sep in value else value)


def commit() -> str:
    """Short id of the commit; "-dirty" where files other than results differ from it."""
    found = _git("rev-parse", "--short", "HEAD").strip()
    others = (".", ":!benchmarks/results", ":!docs/results.md")
    changed = _git("status", "--porcelain", "--", *others)
    return found + "-dirty" * bool(changed.strip())


def _git(*arguments: str) -> str:
    done = subprocess.run(["git", *arguments], cwd=ROOT, text=True, capture_output=True, check=True)
    return done.stdout


def machine() -> dict[str, Any]:
    """Cores, processor and memory."""
    memory = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    return {"cores": os.cpu_count(), "cpu": _cpu(), "memory_gb": round(memory / 2**30)}


def _cpu() -> str:
    path = Path("/proc/cpuinfo")
    lines = path.read_text("utf-8").splitlines() if path.is_file() else []
    models = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return models[0] if models else os.uname().machine


def versions(libraries: Iterable[str]) -> dict[str, str]:
    """Versions of those that are installed, and Python's."""
    found = {"python": sys.version.split()[0]}
    for library in libraries:
        try:
            found[library] = version(library)
        except PackageNotFoundError:
            continue
    return found


def measurements_of(values: Mapping[str, Any]) -> list[Measurement]:
    """Those of a recorded file."""
    return [Measurement(**measurement) for measurement in values["measurements"]]


def missed(measurements: Iterable[Measurement]) -> list[Measurement]:
    """Those whose value is not what is wanted."""
    return [measurement for measurement in measurements if not _is_met(measurement)]


def _is_met(measurement: Measurement) -> bool:
    if measurement.wanted is None:
        return True
    bound, _, limit = measurement.wanted.rpartition(" ")
    return bool(BOUNDS[bound](measurement.value, float(limit)))


def table(
    measurements: Sequence[Measurement], last: Mapping[Measurement, str] | None = None
) -> str:
    """A Markdown table: a row for each thing measured, a column for each quantity.

    After a quantity of which something is wanted, a column says what. ``last``: an entry of a last
    column by measurement, called "run". ValueError where two measurements claim one cell.
    """
    rows = _rows(measurements)
    heads = list(dict.fromkeys((m.quantity, m.unit) for m in measurements))
    with_wanted = {(m.quantity, m.unit) for m in measurements if m.wanted}
    peers = any(m.peer for m in measurements)
    lines = [["on", "what", *["held against"] * peers]]
    for quantity, unit in heads:
        lines[0] += [f"{quantity}, {unit}" if unit else quantity]
        lines[0] += ["wanted"] * ((quantity, unit) in with_wanted)
    lines[0] += ["run"] * (last is not None)
    lines.append(["---"] * len(lines[0]))
    for (on, what, peer), cells in rows.items():
        line = [on, what, *[peer or ""] * peers]
        for head in heads:
            cell = cells.get(head)
            line.append(_number(cell) if cell else "")
            line += [_wanted(cell)] * (head in with_wanted)
        if last is not None:
            line.append(", ".join(dict.fromkeys(last[cell] for cell in cells.values())))
        lines.append(line)
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


Row = tuple[str, str, str | None]
Head = tuple[str, str]


def _rows(measurements: Sequence[Measurement]) -> dict[Row, dict[Head, Measurement]]:
    """Cells by row and head; rows of one ``on`` lie together, where the first of them is."""
    order = list(dict.fromkeys(m.on for m in measurements))
    rows: dict[Row, dict[Head, Measurement]] = {}
    for m in sorted(measurements, key=lambda m: order.index(m.on)):
        cells = rows.setdefault((m.on, m.what, m.peer), {})
        if (m.quantity, m.unit) in cells:
            raise ValueError(f"expected one {m.quantity} of {m.what} on {m.on}, found two")
        cells[m.quantity, m.unit] = m
    return rows


def _number(measurement: Measurement) -> str:
    value, decimals = measurement.value, DECIMALS.get(measurement.unit)
    if isinstance(value, int) and decimals is None:
        return str(value)
    return f"{value:.3g}" if decimals is None else f"{value:.{decimals}f}"


def _wanted(measurement: Measurement | None) -> str:
    if measurement is None or measurement.wanted is None:
        return ""
    bound, _, limit = measurement.wanted.rpartition(" ")
    return f"{SIGNS[bound]} {limit}"

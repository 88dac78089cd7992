"""Where the time of a map goes: the processor's time by stage and by module, and flame graphs.

    python benchmarks/steps.py [CAPTURE...] [--config fast] [--out DIR] [--record]

runs each stage of a map in a process of its own, from nothing. py-spy looks a hundred times a
second at what its threads do. A look counts for the module of vnav that is nearest to the work:
what libraries and compiled loops do counts for whoever called them. DIR gets a flame graph of each
stage, CAPTURE/STAGE.json, to open on https://www.speedscope.app. Without captures: those of
../shared/captures, else a rendered apartment. py-spy slows the run by some per cent.
"""

import argparse
import json
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from recording import Measurement, add_record_option, record, table
from speed import captures

from vnav.config import CaptureConfig
from vnav.io.sources.open_capture import open_capture
from vnav.io.store.map_folder import STAGES

LOOKS_HZ = 100
LEAST = 0.01  # share of the whole: steps that take less are told together
LOADING, OTHERS = "libraries loaded", "the rest"
WAITING = "thread.py", "threading.py"  # files in which a thread waits for work or for another
Seconds = Counter[str]  # by step


def profiled(command: Sequence[str], flame: Path) -> dict[str, Any]:
    """What py-spy saw of all threads at work, as it stands in the flame graph."""
    spy = Path(sys.executable).with_name("py-spy")
    how = ["record", "--format", "speedscope", "--output", str(flame), "--rate", str(LOOKS_HZ)]
    subprocess.run([str(spy), *how, "--", *command], check=True, capture_output=True)
    values: dict[str, Any] = json.loads(flame.read_text("utf-8"))
    return values


def by_step(seen: dict[str, Any]) -> Seconds:
    """The processor's time of each step in what was seen."""
    frames, seconds = [frame["file"] or "" for frame in seen["shared"]["frames"]], Seconds()
    for thread in seen["profiles"]:
        for stack, weight in zip(thread["samples"], thread["weights"], strict=True):
            if not stack or Path(frames[stack[-1]]).name not in WAITING:
                seconds[step_of(frames[k] for k in reversed(stack))] += weight
    return seconds


def step_of(files: Iterable[str]) -> str:
    """The module of vnav that is nearest to the work, whose file comes first."""
    for file in files:
        if "importlib" in file:
            return LOADING
        parts = Path(file.removesuffix(".py")).parts
        if "vnav" in parts and "site-packages" not in parts:
            return "/".join(parts[len(parts) - parts[::-1].index("vnav") :])
    return OTHERS


def steps_of(capture: Path, flames: Path, options: Sequence[str]) -> dict[str, Seconds]:
    """The steps of each stage of a fresh map."""
    found = {}
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch) / "map"
        for stage in STAGES:
            asked = [stage, str(capture)] if stage == STAGES[0] else [stage]
            command = [sys.executable, "-P", "-m", "vnav", *asked, "--map", str(folder), *options]
            found[stage] = by_step(profiled(command, flames / f"{stage}.json"))
    return found


def measurements(name: str, count: int, stages: dict[str, Seconds]) -> list[Measurement]:
    """Every step that takes its share of the whole, the longest of each stage first."""
    whole, found = sum(seconds.total() for seconds in stages.values()), list[Measurement]()
    for stage, steps in stages.items():
        large = {step: s for step, s in steps.most_common() if s >= LEAST * whole}
        large[OTHERS] = large.pop(OTHERS, 0.0) + steps.total() - sum(large.values())
        for step, seconds in ({"all": steps.total()} | large).items():
            on, what = f"{name}, a frame", f"{stage}: {step}"
            found += [
                Measurement(on, what, "CPU time", seconds / count * 1e3, "ms"),
                Measurement(on, what, "share", 100 * seconds / whole, "%"),
            ]
    return found


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("captures", nargs="*", metavar="CAPTURE")
    parser.add_argument("--config", metavar="PRESET|FILE")
    parser.add_argument("--out", type=Path, default=Path("bench/steps"), help="of flame graphs")
    add_record_option(parser)
    asked = parser.parse_args(arguments)
    options = ["--config", asked.config] if asked.config else []
    for path in captures(asked.captures):
        flames = asked.out / path.name
        flames.mkdir(parents=True, exist_ok=True)
        count = len(open_capture(path, CaptureConfig()))
        found = measurements(path.name, count, steps_of(path.resolve(), flames, options))
        print(f"{table(found)}\n\nflame graphs: {flames}", flush=True)
        if asked.record:
            preset = f"_{asked.config}" if asked.config else ""
            record(f"steps_{path.name}{preset}", "how fast", found, arguments)
    return 0


if __name__ == "__main__":
    sys.exit(main())

"""Makes docs/results.md of the files in benchmarks/results: a table for each set of quantities.

python benchmarks/make_results.py [--out docs/results.md]
"""

import argparse
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from recording import FOLDER, QUESTIONS, ROOT, Measurement, measurements_of, table

INTRODUCTION = """\
# Results

This page is for people who choose a system, and for those who change this one. It says what was
measured, with which command, and when. It is made by `make results` from the files in
`benchmarks/results`; `make bench` and `make bench-real` write these anew.

`house` is rendered, with exact truth: 551 frames, a walk of 35.7 m, 40 photos by another camera.
`redkitchen01` is 7-Scenes RedKitchen, sequence 01: 1000 frames, whose truth is good to about 4 cm.
`fr1_desk` is the TUM benchmark's: 573 frames, truth by motion capture. vnav itself renders scenes
such as `apartment`. [Log](log.md): what was tried, what did not pay, known weaknesses.
"""
EXPLAINED = {
    "how accurate": """\
ATE and RPE are those of `vnav score`: root mean squares over all frames with a pose, after one
alignment by rotation and translation. The error of photos is the median of those located.
""",
    "how often right": """\
Answered: located, or a path found. Wrong: located, and off by more than 30 cm or 10 degrees. Frames
of another place are wrong wherever they are located.
""",
    "how fast": """\
Times are medians: for each frame of a capture, or for one photo. A ratio is to what the row is held
against, measured in the same run.
""",
    "how robust": """\
Captures made worse, other seeds, false loops, broken odometry, maps completed later. A frame is
usable where enough of it is neither black nor clipped. Spread: the largest less the smallest ATE,
of the median. "As it is now": the share of places that a map shows so after furniture was moved.
Wrong maps are off by more than 0.5 % of their path, right ones by less than 0.1 %.
""",
    "how large": """\
Finished maps on disk, and the most memory that `vnav build-map` took.
""",
}


def page(folder: Path) -> str:
    """The whole page; ValueError where two files measured the same thing."""
    files = [json.loads(path.read_text("utf-8")) for path in sorted(folder.glob("*.json"))]
    parts = [INTRODUCTION]
    for question in QUESTIONS:
        asked = [values for values in files if values["question"] == question]
        parts.append(f"## {question.capitalize()}\n\n{EXPLAINED[question]}")
        parts += [section(group) for group in alike(asked)]
    return "\n".join(parts)


def alike(files: Sequence[dict[str, Any]]) -> list[list[dict[str, Any]]]:
    """The files in groups, in order: one, and those that have no quantity but its own."""
    groups: list[tuple[set[str], list[int]]] = []
    quantities = [{m.quantity for m in measurements_of(values)} for values in files]
    for k in sorted(range(len(files)), key=lambda k: -len(quantities[k])):
        of_all = next((members for known, members in groups if quantities[k] <= known), None)
        if of_all is None:
            groups.append((quantities[k], [k]))
        else:
            of_all.append(k)
    return [[files[k] for k in members] for members in sorted(sorted(m) for _, m in groups)]


def section(files: Sequence[dict[str, Any]]) -> str:
    """A table, and the runs that its rows come from."""
    runs: list[str] = []
    run_of: dict[Measurement, str] = {}
    for values in files:
        line = source(values)
        runs += [line] * (line not in runs)
        run_of |= dict.fromkeys(measurements_of(values), str(runs.index(line) + 1))
    numbered = "\n".join(f"{k}. {run}" for k, run in enumerate(runs, 1))
    return f"{table(list(run_of), run_of)}\n\n{numbered}\n"


def source(values: dict[str, Any]) -> str:
    """Command, commit, machine and date of a run in one line."""
    machine = values["machine"]
    cpu = f"{machine['cpu']}, " if machine.get("cpu") else ""
    made = f"commit {values['commit']}" if values["commit"] else "commit not noted"
    where = f"{cpu}{machine['cores']} cores, {machine['memory_gb']} GB"
    how = [f"`{values['command']}`"] if values["command"] else []
    how += [values["note"]] if "note" in values else []
    return f"{'; '.join(how)}: {made}, {where}, {values['date']}"


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--out", type=Path, default=ROOT / "docs" / "results.md")
    options = parser.parse_args(arguments)
    options.out.write_text(page(FOLDER), "utf-8")


if __name__ == "__main__":
    main()

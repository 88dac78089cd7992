"""What an evaluation keeps of its runs: OUT/runs/NAME/seed_N/, trajectories as TUM files."""

import json
import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypedDict

import numpy as np

from vnav.core.report import Failed
from vnav.errors import TrajectoryError, VnavError
from vnav.evaluation.sequence import SequenceRun, SequenceTask
from vnav.io.files import write_text
from vnav.io.formats.trajectories import read_tum, write_tum
from vnav.io.store.map_folder import to_json
from vnav.io.store.records import read_json


class _KeptRun(TypedDict):
    """What run.json says."""

    asked: dict[str, Any]
    values: dict[str, Any]
    closures_s: list[tuple[float, float]]


@dataclass(frozen=True)
class Outcome:
    """A run that was asked for, and what became of it."""

    task: SequenceTask
    result: SequenceRun | Failed

    @property
    def summary(self) -> str:
        """A line for a person."""
        if isinstance(self.result, Failed):
            return f"{self.task.name}: failed: {self.result.reason}"
        values = self.result.values
        score = values["score"]
        ate = f"ATE {score['ate_m']['rmse']:.4f} m" if score else "no truth"
        return f"{self.task.name}: {values['posed']} of {values['frames']} frames posed, {ate}"


def prepare(out: Path) -> None:
    """Make the folder; VnavError where it cannot be made, before there is anything to lose."""
    with writing(out):
        (out / "runs").mkdir(parents=True, exist_ok=True)


def save(out: Path, outcome: Outcome) -> None:
    """Keep a run: run.json, trajectory.tum and truth.tum; of one that failed, failure.txt."""
    folder, result = _folder(out, outcome.task), outcome.result
    with writing(out):
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
        if isinstance(result, Failed):
            write_text(folder / "failure.txt", f"{result.reason}\n{result.traceback}")
            return
        write_tum(folder / "trajectory.tum", result.trajectory)
        write_tum(folder / "truth.tum", result.truth)
        kept = {"asked": outcome.task.asked(), "values": result.values}
        kept["closures_s"] = result.closures_s.tolist()
        write_text(folder / "run.json", to_json(kept))  # last: it says that all is there


def finished_before(out: Path, tasks: Sequence[SequenceTask]) -> dict[int, Outcome]:
    """By the number of its task, each run that was kept, is what is asked for, and succeeded."""
    kept = ((k, task, _kept(out, task)) for k, task in enumerate(tasks))
    return {k: Outcome(task, run) for k, task, run in kept if run is not None}


def _kept(out: Path, task: SequenceTask) -> SequenceRun | None:
    folder = _folder(out, task)
    path = folder / "run.json"
    if not path.is_file():
        return None
    try:
        kept = read_json(path, _KeptRun)
        trajectory, truth = read_tum(folder / "trajectory.tum"), read_tum(folder / "truth.tum")
    except (OSError, ValueError, TrajectoryError):  # damaged: it is run again
        return None
    if kept["asked"] != json.loads(to_json(task.asked())):
        return None
    return SequenceRun(
        kept["values"], trajectory, truth, np.array(kept["closures_s"]).reshape(-1, 2)
    )


@contextmanager
def writing(out: Path) -> Iterator[None]:
    """What is written in this block goes to ``out``; VnavError where it cannot."""
    try:
        yield
    except OSError as error:
        raise VnavError(
            f"expected to write to {out}, found: {error.strerror}; make room, give write permission"
            " or name another folder with --out"
        ) from error


def _folder(out: Path, task: SequenceTask) -> Path:
    return out / "runs" / task.entry.name.replace("/", "_") / f"seed_{task.config.seed}"

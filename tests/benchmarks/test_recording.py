"""What benchmarks record, and the tables made of it."""

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def recording(script: Callable[[str], ModuleType]) -> ModuleType:
    return script("recording")


@pytest.fixture(scope="module")
def make_results(recording: ModuleType, script: Callable[[str], ModuleType]) -> ModuleType:
    return script("make_results")


def test_results_are_those_that_were_recorded(tmp_path: Path) -> None:
    command = [sys.executable, ROOT / "benchmarks" / "make_results.py", "--out", tmp_path / "made"]
    subprocess.run(command, check=True)
    made = (tmp_path / "made").read_text("utf-8")
    assert made == (ROOT / "docs" / "results.md").read_text("utf-8"), "run make results"


def test_a_record_comes_back_as_it_was_measured(recording: ModuleType, tmp_path: Path) -> None:
    measured = [
        recording.Measurement("house", "vnav", "ATE RMSE", 0.004, "m", "at most 0.015"),
        recording.Measurement("house", "A*", "wall time, ratio", 1.5, peer="pyastar2d"),
    ]
    path = recording.record("made_up", "how accurate", measured, ["house"], folder=tmp_path)
    values = json.loads(path.read_text("utf-8"))
    assert path == tmp_path / "made_up.json"
    assert recording.measurements_of(values) == measured


def test_a_record_says_where_it_comes_from(recording: ModuleType, tmp_path: Path) -> None:
    values = json.loads(recording.record("x", "how fast", [], [], folder=tmp_path).read_text())
    assert values["question"] == "how fast"
    assert values["machine"]["cores"] >= 1
    assert values["machine"]["memory_gb"] >= 1
    assert values["versions"].keys() >= {"python", "vnav-rgbd", "numpy", "gtsam"}
    assert values["commit"]
    assert len(values["date"]) == len("2026-01-01")


def test_only_known_questions_are_recorded(recording: ModuleType, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="how accurate"):
        recording.record("x", "how nice", [], [], folder=tmp_path)


@pytest.mark.parametrize(
    ("arguments", "shown"),
    [
        (["/data/house", "--record"], "python benchmarks/speed.py house"),
        (["../captures/house", "--every", "2"], "python benchmarks/speed.py house --every 2"),
        (["--peer", "ORB=/x/y/orb.tum"], "python benchmarks/speed.py --peer ORB=orb.tum"),
        (["--out=/x/maps"], "python benchmarks/speed.py --out=maps"),
    ],
)
def test_a_command_names_files_without_their_folders(
    recording: ModuleType, arguments: list[str], shown: str
) -> None:
    assert recording.command(Path("/home/me/vnav/benchmarks/speed.py"), arguments) == shown


@pytest.mark.parametrize(
    ("value", "wanted", "met"),
    [
        (2.0, "at most 2", True),
        (2.1, "at most 2", False),
        (37, "at least 37", True),
        (36, "at least 37", False),
        (float("nan"), "at most 2", False),
        (36, None, True),
    ],
)
def test_what_is_wanted_is_met_or_missed(
    recording: ModuleType, value: float, wanted: str | None, met: bool
) -> None:
    measurement = recording.Measurement("house", "vnav", "x", value, "", wanted)
    assert recording.missed([measurement]) == [measurement] * (not met)


def test_a_table_has_a_row_for_each_thing_and_a_column_for_each_quantity(
    recording: ModuleType,
) -> None:
    M = recording.Measurement
    measured = [
        M("house", "vnav", "frames", 551),
        M("kitchen", "vnav", "frames", 1000),
        M("house", "vnav", "ATE RMSE", 0.004, "m", "at most 0.015"),
        M("house", "ORB-SLAM3", "ATE RMSE", 0.031, "m"),
    ]
    assert recording.table(measured).splitlines() == [
        "| on | what | frames | ATE RMSE, m | wanted |",
        "| --- | --- | --- | --- | --- |",
        "| house | vnav | 551 | 0.0040 | ≤ 0.015 |",
        "| house | ORB-SLAM3 |  | 0.0310 |  |",
        "| kitchen | vnav | 1000 |  |  |",
    ]


def test_a_ratio_tells_what_it_is_held_against(recording: ModuleType) -> None:
    M = recording.Measurement
    pair = [M("grid", "A*", "ratio", 1.658, peer=p) for p in ("pyastar2d", "scikit-image")]
    assert recording.table(pair).splitlines() == [
        "| on | what | held against | ratio |",
        "| --- | --- | --- | --- |",
        "| grid | A* | pyastar2d | 1.66 |",
        "| grid | A* | scikit-image | 1.66 |",
    ]


def test_two_values_of_one_cell_are_refused(recording: ModuleType) -> None:
    M = recording.Measurement
    with pytest.raises(ValueError, match="expected one frames of vnav on house, found two"):
        recording.table([M("house", "vnav", "frames", n) for n in (551, 550)])


def test_every_question_has_a_section_and_every_row_its_run(
    make_results: ModuleType, recording: ModuleType, tmp_path: Path
) -> None:
    M = recording.Measurement
    for name, seconds in (("a", 1), ("b", 2)):
        measured = [M(name, "vnav", "wall time", seconds, "s")]
        recording.record(name, "how fast", measured, [f"/x/{name}"], folder=tmp_path)
    page = make_results.page(tmp_path)
    heads = [line for line in page.splitlines() if line.startswith("## ")]
    assert heads == [f"## {question.capitalize()}" for question in recording.QUESTIONS]
    assert "| a | vnav | 1.00 | 1 |\n| b | vnav | 2.00 | 2 |\n\n1. `python " in page
    first, second = (line for line in page.splitlines() if line.startswith(("1. ", "2. ")))
    assert " a`: commit " in first
    assert " b`: commit " in second


def test_runs_that_share_no_quantity_stand_in_tables_of_their_own(
    make_results: ModuleType, recording: ModuleType, tmp_path: Path
) -> None:
    M = recording.Measurement
    shared = [M("a", "vnav", "edges", 1), M("a", "vnav", "frames", 2)]
    for name, measured in {
        "first": shared[:1],
        "other": [M("a", "vnav", "maps", 3)],
        "last": shared[1:],
        "link": [M("b", "vnav", "edges", 4), M("b", "vnav", "frames", 5)],
    }.items():
        recording.record(name, "how robust", measured, [name], folder=tmp_path)
    page = make_results.page(tmp_path)
    heads = [line for line in page.splitlines() if line.startswith("| on ")]
    assert heads == ["| on | what | edges | frames | run |", "| on | what | maps | run |"]


def test_scripts_that_results_name_exist() -> None:
    for path in (ROOT / "benchmarks" / "results").glob("*.json"):
        for word in json.loads(path.read_text("utf-8"))["command"].split():
            if word.endswith(".py"):
                assert (ROOT / word).is_file(), f"{path.name}: {word}"

"""Runs that never were, as tables."""

import csv
import io
import json
from pathlib import Path

import numpy as np
import pytest

from vnav.config import Config
from vnav.core import se3
from vnav.core.report import Failed
from vnav.core.trajectory import Trajectory
from vnav.evaluation import result_files as run_files
from vnav.evaluation import stored_runs as runs
from vnav.evaluation import table as run_table
from vnav.evaluation.score import score
from vnav.evaluation.sequence import SequenceRun, SequenceTask
from vnav.evaluation.stored_runs import Outcome
from vnav.io.datasets.suite_file import Entry, Peer, Suite
from vnav.io.store.map_folder import STAGES
from vnav.reporting import run_page

PEERS = (Peer("A", "paper", 0.5), Peer("B", "paper", 0.00001))


def walk(offset_m: float = 0.0, count: int = 40) -> Trajectory:
    """A circle of 1 m; every second pose a little off it, along the axis."""
    angle = np.linspace(0, 6, count)
    positions = np.stack([np.cos(angle), np.sin(angle), offset_m * (-1.0) ** np.arange(count)], 1)
    return Trajectory(angle, se3.make(np.eye(3), positions))


def outcome(name: str, seed: int, off_m: float | None, with_truth: bool = True) -> Outcome:
    """A run that is off by that; None: one that failed."""
    task = SequenceTask(Entry(name, "capture", peers=PEERS), Path("/suite"), Config(seed=seed))
    if off_m is None:
        return Outcome(task, Failed("no luck"))
    nothing = Trajectory(np.zeros(0), np.zeros((0, 4, 4)))
    truth, estimate = walk() if with_truth else nothing, walk(off_m)
    values = {
        "frames": 50,
        "tracked": 45,
        "posed": 40,
        "keyframes": 9,
        "lost": [{"capture": 0, "first": 40, "last": 49, "reason": "too <dark>"}],
        "loops": {"tried": 5, "accepted": 2, "rejected": 3, "reasons": {"too few": 3}},
        "landmarks": 100,
        "path_m": 6.0,
        "seconds": {stage: {"wall": 1.0, "cpu": 2.0} for stage in (*STAGES, "map")},
        "peak_memory_mb": 500,
        "map_mb": 3.0,
        "host": "here",
        "cores": 2,
        "score": score(estimate, truth, 0.02).as_dict() if with_truth else None,
        "relocalisation": {},
    }
    return Outcome(task, SequenceRun(values, estimate, truth, np.zeros((0, 2))))


@pytest.fixture
def three_seeds() -> list[Outcome]:
    return [outcome("a", seed, off_m) for seed, off_m in enumerate((0.02, 0.01, 0.04))]


def test_a_sequence_is_summed_up_over_its_seeds(three_seeds: list[Outcome]) -> None:
    (found,) = run_table.summaries([*three_seeds, outcome("a", 3, None)])
    assert (found.runs, found.failed) == (4, 1)
    assert found.ates_m == pytest.approx((0.01, 0.02, 0.04), rel=0.01)
    assert found.median_m == pytest.approx(0.02, rel=0.01)
    assert found.spread_m == pytest.approx(0.03, rel=0.01)


def test_the_text_tells_the_median_of_several_seeds(three_seeds: list[Outcome]) -> None:
    lines = run_files.as_text(three_seeds)
    assert len(lines) == 5
    assert "median ATE 0.0200 m of 3 runs, 0.0100 to 0.0400" in lines[-1]


def test_times_are_a_frame(three_seeds: list[Outcome]) -> None:
    row = run_table.row(three_seeds[0])
    assert (row["wall_ms"], row["cpu_ms_fuse"]) == (20.0, 40.0)


def test_a_run_without_truth_has_all_but_errors() -> None:
    row = run_table.row(outcome("a", 0, 0.01, with_truth=False))
    assert (row["state"], row["posed_share"], row["ate_rmse_m"]) == ("ok", 0.8, None)
    assert "-" in run_files.as_text([outcome("a", 0, 0.01, with_truth=False)])[1].split()


def test_the_csv_is_a_table_also_where_the_first_run_failed() -> None:
    text = run_files.as_csv([outcome("a", 0, None), outcome("b", 0, 0.01)])
    failed, good = csv.DictReader(io.StringIO(text))
    assert (failed["reason"], failed["frames"], good["frames"]) == ("no luck", "", "50")
    assert good["lost"] == "40-49: too <dark>"


def test_the_json_has_no_numbers_that_are_none(three_seeds: list[Outcome]) -> None:
    suite = Suite("S", "", Path("/suite"), (three_seeds[0].task.entry,))
    text = run_files.as_json(suite, [*three_seeds, outcome("b", 0, 0.0, with_truth=False)])
    assert json.loads(text)["sequences"][1]["median_ate_rmse_m"] is None


def test_the_page_shows_all_seeds_and_marks_the_best(three_seeds: list[Outcome]) -> None:
    suite = Suite("S", "", Path("/suite"), (three_seeds[0].task.entry,))
    page = run_page.page(suite, [*three_seeds, outcome("b", 0, 0.1, with_truth=False)])
    assert "0.0200 (0.0100 to 0.0400)" in page
    assert "<b>1e-05</b>" in page
    assert "too &lt;dark&gt;" in page
    assert "no truth" in page
    assert 'alt="error over time of a"' in page
    assert 'alt="error over time of b"' not in page


def test_a_kept_run_is_found_again_by_what_was_asked(tmp_path: Path) -> None:
    kept, other = outcome("a/b", 0, 0.01), outcome("a/b", 1, 0.01)
    runs.save(tmp_path, kept)
    found = runs.finished_before(tmp_path, [other.task, kept.task])
    assert list(found) == [1]
    assert isinstance(run := found[1].result, SequenceRun)
    assert isinstance(kept.result, SequenceRun)
    assert run.values == kept.result.values
    np.testing.assert_allclose(run.trajectory.positions, kept.result.trajectory.positions)


@pytest.mark.parametrize(
    "changed",
    [
        SequenceTask(Entry("a", "another"), Path("/suite"), Config()),
        SequenceTask(Entry("a", "capture"), Path("/elsewhere"), Config()),
        SequenceTask(Entry("a", "capture", hold_out_every=5), Path("/suite"), Config()),
    ],
)
def test_a_run_of_something_else_is_not_taken(tmp_path: Path, changed: SequenceTask) -> None:
    runs.save(tmp_path, outcome("a", 0, 0.01))
    assert not runs.finished_before(tmp_path, [changed])


def test_a_run_of_another_version_is_not_taken(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    kept = outcome("a", 0, 0.01)
    runs.save(tmp_path, kept)
    monkeypatch.setattr("vnav.evaluation.sequence.__version__", "99")
    assert not runs.finished_before(tmp_path, [kept.task])


@pytest.mark.parametrize("text", ["", "[]", "{}", "[" * 10_000, '{"asked": {}, "values": 1}'])
def test_a_damaged_run_is_not_taken(tmp_path: Path, text: str) -> None:
    kept = outcome("a", 0, 0.01)
    runs.save(tmp_path, kept)
    (path,) = tmp_path.rglob("run.json")
    path.write_text(text)
    assert not runs.finished_before(tmp_path, [kept.task])


def test_a_run_without_its_trajectory_is_not_taken(tmp_path: Path) -> None:
    kept = outcome("a", 0, 0.01)
    runs.save(tmp_path, kept)
    (path,) = tmp_path.rglob("trajectory.tum")
    path.write_text("1 2 3")
    assert not runs.finished_before(tmp_path, [kept.task])


def test_a_run_that_failed_is_not_taken_and_replaces_one_that_did_not(tmp_path: Path) -> None:
    runs.save(tmp_path, outcome("a", 0, 0.01))
    runs.save(tmp_path, outcome("a", 0, None))
    assert not runs.finished_before(tmp_path, [outcome("a", 0, None).task])

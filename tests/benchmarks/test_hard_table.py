import csv
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import pytest

FIELDS = ("sequence", "state", "reason", "frames", "posed", "lost", "ate_rmse_m")


@pytest.fixture(scope="module")
def table(script: Callable[[str], ModuleType]) -> ModuleType:
    return script("hard_table")


def results(folder: Path, *rows: tuple[object, ...]) -> None:
    folder.mkdir()
    with (folder / "results.csv").open("w", newline="") as file:
        csv.writer(file).writerows([FIELDS, *rows])
    for row in rows:
        version = folder.parent / str(row[0]).replace("/", "_")
        version.mkdir(exist_ok=True)
        (version / "unusable.txt").write_text("1000.0\n" if "black" in version.name else "")


CLEAN = ("house/clean", "ok", "", 100, 100, "", 0.010)
DROPPED = ("house/dropped_2_seed_0", "ok", "", 98, 98, "", 0.010)
SEEDS = (CLEAN, ("house/clean", "ok", "", 100, 100, "", 0.011))


@pytest.mark.parametrize(
    ("row", "code"),
    [
        (("house/cut", "ok", "", 90, 90, "", 0.020), 0),
        (("house/cut", "ok", "", 90, 90, "", 0.021), 1),
        (("house/cut", "ok", "", 90, 89, "7-7: too dark", 0.010), 1),
        (("house/black_first", "ok", "", 100, 99, "0-0: too few features", 0.010), 0),
        (("house/black_first", "ok", "", 100, 98, "0-1: too few features", 0.010), 1),
        (("house/cut", "failed", "no poses", "", "", "", ""), 1),
    ],
)
def test_every_usable_frame_needs_a_pose_and_at_most_twice_the_clean_error(
    table: ModuleType, tmp_path: Path, row: tuple[object, ...], code: int
) -> None:
    results(tmp_path / "hard", CLEAN, DROPPED, row)
    results(tmp_path / "seeds", *SEEDS)
    assert table.main([str(tmp_path)]) == code


def test_runs_that_lie_too_far_apart_are_told(
    table: ModuleType, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    results(tmp_path / "hard", CLEAN, DROPPED)
    results(tmp_path / "seeds", CLEAN, ("house/clean", "ok", "", 100, 100, "", 0.013))
    assert table.main([str(tmp_path)]) == 1
    assert "house, 2 seeds: ATE 0.0100 to 0.0130 m, 26% of the median" in capsys.readouterr().out

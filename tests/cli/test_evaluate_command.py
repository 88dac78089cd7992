"""A suite of two sequences, one of them broken, evaluated once and looked at from all sides."""

import csv
import json
import os
import re
import shutil
import signal
import time
from dataclasses import dataclass
from pathlib import Path
from threading import Thread
from typing import Any

import pytest
from click.testing import CliRunner, Result

from vnav.cli.main import cli
from vnav.errors import ConfigError, VnavError
from vnav.io.formats.trajectories import read_tum

pytestmark = pytest.mark.slow

FRAMES = 16  # enough for a map; every eighth is held out of it
SUITE = """
[suite]
name = "Two <rooms>"
description = "One of them is not there."

[[sequence]]
name = "rooms/one"
capture = "capture"
queries = "photos"
hold_out_every = 8
settings.features.max_features = 400
settings.fuse = { octree_m = 0.2, mesh_voxel_m = 0.2, voxel_m = 0.1 }
peers = [
    { system = "Peer A", ate_m = 0.123, source = "Somebody et al. 2020" },
    { system = "Peer B", note = "lost", source = "Somebody et al. 2020" },
]

[[sequence]]
name = "rooms/two"
capture = "nowhere"
"""


@dataclass(frozen=True)
class Evaluated:
    """A suite's file, where its results are, and what was printed."""

    suite: Path
    out: Path
    said: Result

    @property
    def results(self) -> dict[str, Any]:
        values: dict[str, Any] = json.loads((self.out / "results.json").read_text())
        return values

    @property
    def page(self) -> str:
        return (self.out / "report.html").read_text("utf-8")


def run(*arguments: object) -> Result:
    return CliRunner().invoke(
        cli,
        ["evaluate", *(str(a) for a in arguments)],
        standalone_mode=False,
        catch_exceptions=False,
    )


@pytest.fixture(scope="module")
def suite(tiny_capture: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("suite")
    (folder / "capture").mkdir()
    for kind in ("rgb", "depth"):
        lines = (tiny_capture / f"{kind}.txt").read_text().splitlines()
        (folder / "capture" / f"{kind}.txt").write_text("\n".join(lines[: FRAMES + 1]))
        (folder / "capture" / kind).symlink_to(tiny_capture / kind)
    for name in ("camera.toml", "groundtruth.txt"):
        shutil.copy(tiny_capture / name, folder / "capture")
    (folder / "capture" / "photos").symlink_to(tiny_capture / "photos")
    (folder / "suite.toml").write_text(SUITE)
    return folder / "suite.toml"


@pytest.fixture(scope="module")
def evaluated(suite: Path, tmp_path_factory: pytest.TempPathFactory) -> Evaluated:
    out = tmp_path_factory.mktemp("evaluation") / "deep" / "out"
    return Evaluated(suite, out, run(suite, "--out", out, "--jobs", 2))


def test_every_run_is_a_row_and_a_failed_one_tells_why(evaluated: Evaluated) -> None:
    head, good, bad = evaluated.said.stdout.splitlines()[:3]
    assert head.split()[:4] == ["sequence", "seed", "posed", "ATE"]
    assert good.split()[:5] == ["rooms/one", "0", "14", "/", "14"]
    assert bad.startswith("rooms/two")
    assert "failed: expected the capture of rooms/two at" in bad


def test_a_failed_run_is_exit_code_1(evaluated: Evaluated) -> None:
    assert evaluated.said.return_value == 1


def test_the_csv_has_the_rows_of_the_table(evaluated: Evaluated) -> None:
    with (evaluated.out / "results.csv").open() as file:
        good, bad = csv.DictReader(file)
    assert (good["state"], good["frames"], good["posed_share"]) == ("ok", "14", "1.0")
    assert 0 < float(good["ate_rmse_m"]) < float(good["ate_max_m"]) < 0.05
    assert (bad["state"], bad["ate_rmse_m"]) == ("failed", "")
    assert "nowhere" in bad["reason"]


def test_the_json_has_all_values_and_the_peers(evaluated: Evaluated) -> None:
    good, bad = evaluated.results["runs"]
    assert (good["frames"], good["tracked"], good["lost"], bad["state"]) == (14, 14, [], "failed")
    assert good["loops"]["tried"] == good["loops"]["accepted"] + good["loops"]["rejected"]
    one, two = evaluated.results["sequences"]
    assert one["median_ate_rmse_m"] == good["score"]["ate_m"]["rmse"]
    assert [peer["ate_m"] for peer in one["peers"]] == [0.123, None]
    assert (two["runs"], two["failed"], two["median_ate_rmse_m"]) == (1, 1, None)


def test_every_stage_has_wall_and_cpu_time_and_the_run_its_memory(evaluated: Evaluated) -> None:
    seconds = evaluated.results["runs"][0]["seconds"]
    assert set(seconds) == {
        *("odometry", "vocabulary", "loops", "optimise", "fuse", "index", "map", "quality")
    }
    assert all(of["wall"] > 0 and of["cpu"] > 0 for of in seconds.values())
    assert sum(seconds[s]["cpu"] for s in seconds if s != "map") <= seconds["map"]["cpu"]
    assert 100 < evaluated.results["runs"][0]["peak_memory_mb"] < 4000


def test_photos_are_held_against_the_truth_of_the_world_they_are_in(evaluated: Evaluated) -> None:
    found = evaluated.results["runs"][0]["relocalisation"]["photos"]
    assert (found["photos"], len(found["answers"])) == (4, 4)
    assert found["located"] >= 1
    assert found["wrong"] == 0
    assert found["median_m"] < 0.05


def test_frames_are_held_out_of_the_map_and_located(evaluated: Evaluated) -> None:
    found = evaluated.results["runs"][0]["relocalisation"]["held-out frames"]
    names = [answer["photo"] for answer in found["answers"]]
    lines = (evaluated.suite.parent / "capture" / "rgb.txt").read_text().splitlines()
    assert names == [Path(lines[k].split()[1]).name for k in (8, 16)]
    assert found["located"] == 2
    assert found["within"] == [1, 1, 1]
    stamps_s = read_tum(evaluated.out / "runs" / "rooms_one" / "seed_0" / "trajectory.tum").stamps_s
    assert not {float(lines[k].split()[0]) for k in (8, 16)} & set(stamps_s)


def test_evo_reads_the_trajectories_and_finds_the_same_error(evaluated: Evaluated) -> None:
    file_interface = pytest.importorskip("evo.tools.file_interface")
    from evo.core import metrics, sync

    folder = evaluated.out / "runs" / "rooms_one" / "seed_0"
    files = folder / "trajectory.tum", evaluated.suite.parent / "capture" / "groundtruth.txt"
    estimate, truth = (file_interface.read_tum_trajectory_file(str(file)) for file in files)
    truth, estimate = sync.associate_trajectories(truth, estimate, max_diff=0.02)
    estimate.align(truth)
    ape = metrics.APE(metrics.PoseRelation.translation_part)
    ape.process_data((truth, estimate))
    values = [evaluated.results["runs"][0]["score"]["ate_m"]["rmse"]]
    said = CliRunner().invoke(cli, ["score", *map(str, files), "--json"], catch_exceptions=False)
    values.append(json.loads(said.stdout)["ate_m"]["rmse"])
    assert values == pytest.approx([ape.get_statistic(metrics.StatisticsType.rmse)] * 2, abs=1e-6)


def test_the_page_has_everything_in_it(evaluated: Evaluated) -> None:
    assert not re.search(r"https?://|url\(|@import|<script|<link", evaluated.page)
    pictures = re.findall(r'<img alt="([^"]+)" src="data:image/png;base64,', evaluated.page)
    kinds = ("trajectories", "loops", "error over time")
    assert pictures == [f"{kind} of rooms/one" for kind in kinds]


def test_the_page_has_the_peers_figures_and_their_source(evaluated: Evaluated) -> None:
    text = re.sub(r"<[^>]+>", " ", evaluated.page)
    assert re.search(r"Peer A\s+Peer B", text)
    assert re.search(r"0\.123\s+1\s+lost\s+1\s", text)
    assert evaluated.page.count("<li>Somebody et al. 2020</li>") == 1


def test_the_page_has_the_failed_run_and_escapes_text(evaluated: Evaluated) -> None:
    assert "Two &lt;rooms&gt;" in evaluated.page
    assert '<span class="rejected">failed</span>: expected the capture of rooms/two' in (
        evaluated.page
    )


def test_the_reason_of_a_failed_run_is_kept(evaluated: Evaluated) -> None:
    folder = evaluated.out / "runs" / "rooms_two" / "seed_0"
    assert [path.name for path in folder.iterdir()] == ["failure.txt"]
    assert "expected the capture of rooms/two" in (folder / "failure.txt").read_text()


def test_resumed_only_what_failed_is_run_again(evaluated: Evaluated, tmp_path: Path) -> None:
    shutil.copytree(evaluated.out, tmp_path / "out")
    again = run(evaluated.suite, "--out", tmp_path / "out", "--resume")
    assert "1 of 2 runs are there already" in again.stderr
    assert again.stdout == evaluated.said.stdout
    for name in ("results.json", "results.csv"):
        assert (tmp_path / "out" / name).read_bytes() == (evaluated.out / name).read_bytes()


def test_on_a_cluster_whose_worker_is_killed_the_table_is_the_same(
    evaluated: Evaluated, cluster: Any, tmp_path: Path
) -> None:
    killer = Thread(target=kill_a_worker_at_work, args=[cluster])
    killer.start()
    said = run(evaluated.suite, "--out", tmp_path, "--scheduler", cluster.scheduler_address)
    killer.join()
    assert said.return_value == 1
    there = Evaluated(evaluated.suite, tmp_path, said)
    assert without_times(there.results) == without_times(evaluated.results)
    name = "runs/rooms_one/seed_0/trajectory.tum"
    assert (tmp_path / name).read_bytes() == (evaluated.out / name).read_bytes()


def kill_a_worker_at_work(cluster: Any) -> None:
    """SIGKILL to the first worker whose task has run for a second."""
    import psutil

    deadline = time.monotonic() + 60
    while time.monotonic() < deadline:
        for worker in list(cluster.workers.values()):
            children = psutil.Process(worker.pid).children()
            if any(time.time() - child.create_time() > 1 for child in children):
                os.kill(worker.pid, signal.SIGKILL)
                return
        time.sleep(0.05)


def without_times(results: dict[str, Any]) -> dict[str, Any]:
    """Results without what differs between two runs of the same."""
    changing = {"seconds", "peak_memory_mb", "host", "map_mb"}
    runs = [{k: v for k, v in one.items() if k not in changing} for one in results["runs"]]
    return results | {"runs": runs}


def test_a_wrong_setting_stops_before_anything_is_run(suite: Path, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="max_feature"):
        run(suite, "--out", tmp_path / "out", "--set", "features.max_feature=1")
    assert not (tmp_path / "out").exists()


def test_a_place_that_cannot_be_written_is_told_before_anything_is_run(
    suite: Path, tmp_path: Path
) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(VnavError, match="expected to write to .*file, found: .*--out"):
        run(suite, "--out", tmp_path / "file")


def test_jobs_and_a_scheduler_are_a_usage_error(suite: Path) -> None:
    arguments = ["evaluate", str(suite), "--jobs", "2", "--scheduler", "tcp://127.0.0.1:1"]
    assert CliRunner().invoke(cli, arguments).exit_code == 2


def test_help_shows_examples_line_by_line() -> None:
    for command in ("evaluate", "build-map", "locate", "plan"):
        lines = CliRunner().invoke(cli, [command, "--help"]).output.splitlines()
        assert sum(line.startswith(f"  vnav {command} ") for line in lines) >= 2
        assert "\b" not in "".join(lines)
        assert "\\b" not in "".join(lines)

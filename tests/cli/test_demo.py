import re
import shutil
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from vnav.cli.demo import demo as command
from vnav.config import Config, FeaturesConfig, PlanConfig
from vnav.core import se3
from vnav.core.grid import FREE, OCCUPIED, Grid
from vnav.io.store.map_folder import STAGES
from vnav.synthetic import MINIATURE, demo


@pytest.fixture
def on_the_miniature(
    tiny_capture: Path, whole_map: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """`vnav demo` on one room, whose map is there already; takes the robot's radius."""
    shutil.copytree(whole_map, tmp_path / "out" / "map")
    run, cache = demo.run, tiny_capture.parent.parent

    def invoke(robot_radius_m: float):
        plan = PlanConfig(robot_radius_m=robot_radius_m)
        config = Config(features=FeaturesConfig(max_features=700), plan=plan)
        miniature = {"spec": MINIATURE, "cache": cache}
        monkeypatch.setattr(demo, "run", lambda out, _, progress: run(out, config, **miniature))
        arguments = ["--out", str(tmp_path / "out")]
        return CliRunner().invoke(command, arguments, standalone_mode=False, catch_exceptions=False)

    return invoke


def test_the_demo_says_how_true_its_answers_are(on_the_miniature, tmp_path: Path) -> None:
    """Depth noise of a centimetre, averaged over hundreds of landmarks, leaves millimetres."""
    result = on_the_miniature(0.2)
    assert result.return_value == 0
    assert (
        result.stdout.count("up to date") == len(STAGES) + 2
    )  # and the map as a whole, and the verdict
    assert "60 of 60 frames have a pose" in result.stdout
    ate_mm = float(re.search(r"off by (\S+) mm \(ATE", result.stdout)[1])
    assert 0 < ate_mm < 20
    photos = re.search(r"(\d) of 4 located, off by (\S+) cm and (\S+) deg", result.stdout)
    assert int(photos[1]) >= 2
    assert 0 < float(photos[2]) < 3
    assert 0 < float(photos[3]) < 1
    # The map's inflation covers its errors; 5 cm are a cell, by which the true grid is too wide.
    clearance_m = float(re.search(r"never nearer than (\S+) m", result.stdout)[1])
    assert clearance_m > 0.15
    for file in ("photo.jpg", "path.png", "map/reports/report.html", "map/state/current.json"):
        assert (tmp_path / "out" / file).stat().st_size > 100


def test_a_demo_without_a_path_says_so_and_exits_with_3(on_the_miniature) -> None:
    result = on_the_miniature(3.0)
    assert result.return_value == 3
    assert re.search(r"^path .*: none, .+", result.stdout, re.M)


def test_clearance_is_measured_along_the_path_in_the_true_world() -> None:
    """The map's world is turned by 90 degrees and shifted; the path passes a cell by 0.7 m."""
    cells = np.full((20, 20), FREE, np.uint8)
    cells[10, 10] = OCCUPIED  # x and y from 1.0 to 1.1 m
    grid = Grid((0.0, 0.0), 0.1, cells)
    T_truth_world = se3.make(se3.exp_so3([0, 0, np.pi / 2]), [5.0, 0.0, 0.0])
    path_truth = np.array([[0.0, 1.8], [2.0, 1.8]])
    path = se3.transform(se3.inverse(T_truth_world), np.pad(path_truth, ((0, 0), (0, 1))))
    assert demo.clearance_m(path, T_truth_world, grid) == pytest.approx(0.7)
    assert demo.clearance_m(path[:1], T_truth_world, grid) == pytest.approx(np.hypot(1.0, 0.7))
    empty = Grid((0.0, 0.0), 0.1, np.full((2, 2), FREE, np.uint8))
    assert demo.clearance_m(path, T_truth_world, empty) == np.inf

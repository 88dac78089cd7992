import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import vnav
from vnav.cli.score import score as command
from vnav.core import se3
from vnav.core.trajectory import Trajectory
from vnav.errors import TrajectoryError
from vnav.evaluation.score import score, table
from vnav.io.formats.trajectories import write_tum
from vnav.io.store.artifacts import load_odometry
from vnav.io.store.map_folder import MapFolder


def _circle(count: int = 100, start_s: float = 0.0) -> Trajectory:
    """Ten seconds once around a circle of 1 m, looking outwards."""
    angle = np.linspace(0, 2 * np.pi, count)
    R = se3.exp_so3(np.outer(angle, [0, 0, 1]))
    return Trajectory(start_s + angle / (2 * np.pi) * 10, se3.make(R, R @ [1.0, 0, 0]))


def test_a_perfect_estimate_scores_zero() -> None:
    result = score(_circle(), _circle(), 0.02)
    assert (result.pairs, result.poses, result.truth_poses) == (100, 100, 100)
    assert result.ate.translation_m.max < 1e-12
    assert [error.translation_m.max < 1e-12 for error in result.rpe.values()] == [True] * 3
    # a hundred chords of a circle, 99 steps: 2 * 99 * sin(pi / 99)
    assert result.paths_m == pytest.approx([2 * 99 * np.sin(np.pi / 99)] * 2)


def test_poses_are_paired_with_the_true_ones_of_their_time() -> None:
    truth, later = _circle(), _circle(start_s=5.0)
    estimate = Trajectory(later.stamps_s[:40] - 5 + 0.004, later.T_world_camera[:40])
    result = score(estimate, truth, 0.02)
    assert result.pairs == 40
    assert result.ate.translation_m.max < 1e-12


def test_frames_between_poses_can_be_chosen() -> None:
    assert list(score(_circle(), _circle(), 0.02).rpe) == ["1 frame", "1 m", "1 s"]
    assert score(_circle(), _circle(), 0.02, frames=30).rpe["30 frames"].pairs == 70


@pytest.mark.parametrize("count", [0, 2])
def test_too_few_pairs_are_an_error_that_says_how_many(count: int) -> None:
    truth = _circle()
    stamps_s = np.append(truth.stamps_s[:count], 99.0)
    estimate = Trajectory(stamps_s, truth.T_world_camera[: count + 1])
    message = rf"within 0\.02 s, found {count} of {count + 1} poses and 100 true ones"
    with pytest.raises(TrajectoryError, match=message):
        score(estimate, truth, 0.02)


def test_an_empty_estimate_is_an_error() -> None:
    nothing = Trajectory(np.zeros(0), np.zeros((0, 4, 4)))
    with pytest.raises(TrajectoryError, match="found 0 of 0 poses"):
        score(nothing, _circle(), 0.02)


def test_a_walk_too_short_for_a_metre_has_no_figure_there() -> None:
    short = Trajectory(_circle().stamps_s[:5], _circle().T_world_camera[:5])
    result = score(short, short, 0.02)
    assert result.as_dict()["rpe"]["1 m"] == {
        "pairs": 0,
        "translation_m": None,
        "rotation_deg": None,
    }
    assert any("RPE over 1 m" in line and line.split()[-2:] == ["-", "0"] for line in table(result))


def test_a_trajectory_without_scale_is_scored_after_a_similarity() -> None:
    small = _circle().T_world_camera.copy()
    small[:, :3, 3] /= 4
    result = score(Trajectory(_circle().stamps_s, small), _circle(), 0.02, align="sim3")
    assert result.scale == pytest.approx(4)
    assert result.ate.translation_m.max < 1e-12
    assert [error.translation_m.max < 1e-12 for error in result.rpe.values()] == [True] * 3
    assert result.paths_m[1] == pytest.approx(result.paths_m[0])
    assert "scale      4.0000 applied" in table(result)


def test_an_estimate_of_one_place_has_no_similarity() -> None:
    still = Trajectory(_circle().stamps_s, np.repeat(np.eye(4)[None], 100, 0))
    with pytest.raises(TrajectoryError, match="--align se3"):
        score(still, _circle(), 0.02, align="sim3")


def test_the_command_prints_a_table_or_json(tmp_path: Path) -> None:
    write_tum(tmp_path / "a.tum", _circle())
    write_tum(tmp_path / "b.tum", _circle(start_s=0.001))
    files = [str(tmp_path / "a.tum"), str(tmp_path / "b.tum")]
    shown = CliRunner().invoke(command, files, catch_exceptions=False)
    assert "pairs      100 of 100 poses" in shown.output
    assert "ATE, SE(3) aligned" in shown.output
    told = CliRunner().invoke(command, [*files, "--json"], catch_exceptions=False)
    values = json.loads(told.output)
    assert values["pairs"] == 100
    assert values["ate_m"]["rmse"] < 1e-9
    assert values["scale"] == pytest.approx(1.0)


def test_a_smaller_difference_in_time_pairs_less(tmp_path: Path) -> None:
    write_tum(tmp_path / "a.tum", _circle())
    write_tum(tmp_path / "b.tum", _circle(start_s=0.001))
    files = [str(tmp_path / "a.tum"), str(tmp_path / "b.tum")]
    with pytest.raises(TrajectoryError, match="within 0.0005 s, found 0 of 100"):
        CliRunner().invoke(command, [*files, "--max-difference", "0.0005"], catch_exceptions=False)


def test_a_maps_folder_stands_for_its_poses(whole_map: Path, tiny_capture: Path) -> None:
    of_folder = vnav.score(whole_map, tiny_capture)
    of_file = vnav.score(whole_map / "optimise" / "trajectory_0.tum", tiny_capture)
    assert of_folder.as_dict() == of_file.as_dict()


def test_a_map_with_odometry_alone_is_scored_by_it(
    tiny_map: Path, tiny_capture: Path, tmp_path: Path
) -> None:
    alone = tmp_path / "odometry"
    shutil.copytree(tiny_map, alone, ignore=shutil.ignore_patterns("vocabulary", "loops", "opti*"))
    result = vnav.score(alone, tiny_capture)
    tracked = load_odometry(MapFolder(tiny_map)).trajectory
    assert result.as_dict() == vnav.score(tracked, tiny_capture).as_dict()
    assert result.as_dict() != vnav.score(tiny_map, tiny_capture).as_dict()


def test_of_a_map_of_two_captures_one_is_to_be_named(
    extended_map: Path, tiny_capture: Path
) -> None:
    with pytest.raises(vnav.MapError, match=r"of 2; name .*trajectory_0.tum to trajectory_1.tum"):
        vnav.score(extended_map, tiny_capture)

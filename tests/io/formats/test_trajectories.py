from pathlib import Path

import numpy as np
import pytest

from vnav.core import se3
from vnav.core.trajectory import Trajectory
from vnav.errors import TrajectoryError
from vnav.io.formats.trajectories import read_photo_poses, read_tum, write_kitti, write_tum


def some_trajectory(count: int = 50) -> Trajectory:
    rng = np.random.default_rng(2)
    stamps = 1305031102.175304 + np.cumsum(rng.uniform(0.01, 0.1, count))
    T = se3.exp(rng.normal(size=(count, 6)) * [2, 2, 2, 10, 10, 10])
    return Trajectory(stamps, T)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "trajectory.tum"


def test_what_is_written_is_read_again(path: Path) -> None:
    trajectory = some_trajectory()
    write_tum(path, trajectory)
    again = read_tum(path)
    # A time in seconds since 1970 has steps of 2.4e-7 s as a double; it comes back as it was.
    np.testing.assert_array_equal(again.stamps_s, trajectory.stamps_s)
    np.testing.assert_allclose(again.T_world_camera, trajectory.T_world_camera, atol=1e-9)


def test_an_empty_trajectory_is_written_and_read(path: Path) -> None:
    write_tum(path, Trajectory(np.zeros(0), np.zeros((0, 4, 4))))
    assert len(read_tum(path)) == 0


def test_comments_commas_tabs_and_empty_lines_are_read(path: Path) -> None:
    path.write_text("\ufeff# stamp tx\n\n1.0, 1,2,3, 0,0,0,1\n  # more\n2.0\t4 5 6 0 0 0 -1\n")
    trajectory = read_tum(path)
    np.testing.assert_allclose(trajectory.positions, [[1, 2, 3], [4, 5, 6]])
    np.testing.assert_allclose(trajectory.T_world_camera[:, :3, :3], [np.eye(3)] * 2)


def test_quaternions_printed_with_few_digits_give_rotations(path: Path) -> None:
    path.write_text("1 0 0 0 0.50 0.50 0.50 0.49\n")
    assert se3.is_rigid(read_tum(path).T_world_camera, 1e-12)


def test_lines_are_sorted_by_time(path: Path) -> None:
    path.write_text("2 2 0 0 0 0 0 1\n1 1 0 0 0 0 0 1\n")
    np.testing.assert_allclose(read_tum(path).positions[:, 0], [1, 2])


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("2 0 0 0 0 0 0", "expected 'stamp tx"),
        ("2 0 0 0 0 0 0 1 5", "expected 'stamp tx"),
        ("2 0 0 zero 0 0 0 1", "expected 'stamp tx"),
        ("2 0 0 nan 0 0 0 1", "expected 'stamp tx"),
        ("2 0 0 0 0 0 0 0", "unit quaternion .*found length 0"),
        ("2 1e300 0 0 0 0 0 1", "positions in metres"),
        ("2 0 0 0 1e308 0 0 1", "unit quaternion .*found length 1e.308"),
        ("2 0 0 0 1 1 1 1", "unit quaternion .*found length 2"),
    ],
)
def test_a_wrong_line_is_named(path: Path, line: str, message: str) -> None:
    path.write_text(f"# a comment\n1 0 0 0 0 0 0 1\n{line}\n")
    with np.errstate(all="raise"), pytest.raises(TrajectoryError, match=message) as error:
        read_tum(path)
    assert f"{path}, line 3" in str(error.value)


def test_two_poses_at_one_time_are_refused(path: Path) -> None:
    path.write_text("1 0 0 0 0 0 0 1\n2 0 0 0 0 0 0 1\n1 1 0 0 0 0 0 1\n")
    with pytest.raises(TrajectoryError, match="found two at 1.0"):
        read_tum(path)


def test_a_missing_file_and_a_binary_one_are_named(path: Path) -> None:
    with pytest.raises(TrajectoryError, match=f"expected a trajectory at {path}"):
        read_tum(path)
    path.write_bytes(b"\x89PNG\xff\xfe")
    with pytest.raises(TrajectoryError, match="found no text"):
        read_tum(path)


def test_evo_reads_what_is_written(tmp_path: Path) -> None:
    evo = pytest.importorskip("evo.tools.file_interface")
    trajectory = some_trajectory()
    write_tum(tmp_path / "a.tum", trajectory)
    write_kitti(tmp_path / "a.kitti", trajectory)
    tum = evo.read_tum_trajectory_file(str(tmp_path / "a.tum"))
    np.testing.assert_array_equal(tum.timestamps, trajectory.stamps_s)
    np.testing.assert_allclose(tum.poses_se3, trajectory.T_world_camera, atol=1e-9)
    kitti = evo.read_kitti_poses_file(str(tmp_path / "a.kitti"))
    np.testing.assert_allclose(kitti.poses_se3, trajectory.T_world_camera, atol=1e-9)


def test_poses_of_photos_are_read_by_name(tmp_path: Path) -> None:
    (tmp_path / "a.txt").write_text("# name pose\nb.jpg 1 2 3 0 0 0 1\na.jpg\t4 5 6 1 0 0 0\n")
    poses = read_photo_poses(tmp_path / "a.txt")
    assert list(poses) == ["b.jpg", "a.jpg"]
    np.testing.assert_array_equal(poses["a.jpg"][:3, 3], [4, 5, 6])
    np.testing.assert_allclose(poses["a.jpg"][:3, :3], np.diag([1, -1, -1]))


def test_a_photo_without_a_whole_pose_is_named_with_its_line(tmp_path: Path) -> None:
    (tmp_path / "a.txt").write_text("a.jpg 1 2 3 0 0 0 1\nb.jpg 1 2 3\n")
    with pytest.raises(TrajectoryError, match="expected 'filename tx .*, line 2, found 'b.jpg 1"):
        read_photo_poses(tmp_path / "a.txt")

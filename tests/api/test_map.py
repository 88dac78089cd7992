"""A map asked from Python."""

import shutil
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import cv2
import numpy as np
import pytest

import vnav
from vnav.core.grid import FREE
from vnav.io.formats.trajectories import read_tum
from vnav.io.store.map_folder import MapFolder

Image = np.ndarray


@pytest.fixture(scope="module")
def mapped(tmp_path_factory: pytest.TempPathFactory, whole_map: Path) -> vnav.Map:
    """A map of its own, as questions may be remembered in it."""
    root = tmp_path_factory.mktemp("maps") / "map"
    shutil.copytree(whole_map, root)
    return vnav.open_map(root)


@pytest.fixture(scope="module")
def photos(tiny_capture: Path) -> list[Path]:
    return sorted((tiny_capture / "photos").glob("*.jpg"))


@pytest.fixture(scope="module")
def camera(tiny_capture: Path) -> vnav.Intrinsics:
    from vnav.io.formats.camera_file import read_color

    return read_color(tiny_capture / "photos" / "camera.toml")


def pixels(path: Path) -> Image:
    return cv2.cvtColor(cv2.imread(str(path)), cv2.COLOR_BGR2RGB)


def pose(answer: vnav.PhotoAnswer) -> Image:
    assert answer.T_world_camera is not None, answer.reason
    return answer.T_world_camera


def test_pixels_have_the_same_answer_as_their_file(
    mapped: vnav.Map, photos: list[Path], camera: vnav.Intrinsics
) -> None:
    of_file = mapped.locate(str(photos[0]))
    of_pixels = mapped.locate(pixels(photos[0]), camera=vnav.Camera(camera, 1000.0))
    np.testing.assert_array_equal(pose(of_pixels), pose(of_file))
    assert of_pixels.camera.source == "given"


def test_pixels_of_another_shape_or_type_are_refused(mapped: vnav.Map) -> None:
    for wrong in (np.zeros((4, 4), np.uint8), np.zeros((4, 4, 3)), np.zeros((0, 4, 3), np.uint8)):
        with pytest.raises(vnav.PhotoError, match=r"expected a photo of shape \(H, W, 3\)"):
            mapped.locate(wrong)


def test_a_camera_of_another_shape_than_the_pixels_is_refused(
    mapped: vnav.Map, photos: list[Path], camera: vnav.Intrinsics
) -> None:
    with pytest.raises(vnav.CameraError, match="the image, found"):
        mapped.locate(pixels(photos[0])[:, :100], camera=camera)


def test_locating_moves_the_current_place_only_when_it_is_to_be_remembered(
    mapped: vnav.Map, photos: list[Path]
) -> None:
    folder = MapFolder(mapped.root)
    before = folder.current()
    answer = mapped.locate(photos[0])
    assert folder.current() == before
    mapped.locate(photos[0], remember=True)
    remembered = folder.current()
    assert remembered is not None
    np.testing.assert_allclose(remembered["T_world_camera"], pose(answer))


def test_several_threads_have_the_answers_of_one(mapped: vnav.Map, photos: list[Path]) -> None:
    """Asked of a map whose index no one has loaded yet."""
    fresh = vnav.open_map(mapped.root)
    with ThreadPoolExecutor(4) as pool:
        found = list(pool.map(fresh.locate, photos * 2))
    for photo, answer in zip(photos * 2, found, strict=True):
        np.testing.assert_array_equal(pose(answer), pose(mapped.locate(photo)))


def test_many_photos_are_answered_in_their_order(mapped: vnav.Map, photos: list[Path]) -> None:
    assert [answer.path for answer in mapped.locate_all(photos)] == photos


def test_the_report_is_told_where_photos_were_taken_only_when_asked(
    mapped: vnav.Map, photos: list[Path], tmp_path: Path
) -> None:
    folder = MapFolder(mapped.root)
    (tmp_path / "broken.jpg").write_text("none")
    list(mapped.locate_all(photos))
    assert folder.photos() == []
    before = folder.current()
    answers = list(mapped.locate_all([tmp_path / "broken.jpg", *photos], remember=True))
    told = [(note["photo"], note["T_world_camera"]) for note in folder.photos()]
    assert told == [(str(a.path), pose(a).tolist()) for a in answers[1:]]
    assert folder.current() == before


def test_a_photo_that_cannot_be_read_is_told_and_the_others_are_answered(
    mapped: vnav.Map, photos: list[Path], tmp_path: Path
) -> None:
    (tmp_path / "broken.jpg").write_text("none")
    broken, answered = mapped.locate_all([tmp_path / "broken.jpg", photos[0]])
    assert isinstance(broken, vnav.UnreadablePhoto)
    assert (broken.located, answered.located) == (False, True)
    assert "broken.jpg" in broken.reason


def test_each_photo_is_answered_before_the_next_is_asked_for(
    mapped: vnav.Map, photos: list[Path], tmp_path: Path
) -> None:
    taken = list[Path]()

    def source() -> Iterator[Path]:
        for photo in (tmp_path / "none.jpg", *photos[:2]):
            taken.append(photo)
            yield photo

    answers = mapped.locate_each(source())
    assert not next(answers).located
    np.testing.assert_array_equal(pose(next(answers)), pose(mapped.locate(photos[0])))
    assert taken[1:] == photos[:1]


def test_a_path_joins_a_located_photo_a_file_pixels_and_a_point(
    mapped: vnav.Map, photos: list[Path], camera: vnav.Intrinsics
) -> None:
    start = mapped.locate(photos[0])
    x, y = pose(start)[:2, 3]
    of_answer = mapped.plan(start, photos[1], camera=camera)
    of_point = mapped.plan((x, y), str(photos[1]), camera=camera)
    of_pixels = mapped.plan(pixels(photos[0]), photos[1], camera=camera)
    assert of_answer.found is not None, of_answer.reason
    for other in (of_point, of_pixels):
        assert other.found is not None
        np.testing.assert_array_equal(other.found.poses[:, :2], of_answer.found.poses[:, :2])


def test_a_goal_is_where_a_photo_was_taken_and_looks(
    mapped: vnav.Map, photos: list[Path], tmp_path: Path
) -> None:
    other = vnav.open_map(shutil.copytree(mapped.root, tmp_path / "map"))
    answer = mapped.locate(photos[1])
    other.add_goal("desk", answer)
    other.keep_out("far", [(90, 90), (91, 90), (91, 91)])
    assert [(name, place.kind) for name, place in other.places().items()] == [
        ("desk", "goal"),
        ("far", "keep-out"),
    ]
    by_name, by_photo = (other.plan(photos[0], goal).found for goal in ("desk", answer))
    assert by_name is not None
    assert by_photo is not None
    np.testing.assert_array_equal(by_name.poses, by_photo.poses)
    black = np.zeros((240, 320, 3), np.uint8)
    with pytest.raises(vnav.PhotoError, match="too few features"):
        other.add_goal("dark", black)


def test_without_a_photo_that_is_located_there_is_no_path_and_the_reason(mapped: vnav.Map) -> None:
    black = np.zeros((240, 320, 3), np.uint8)
    answer = mapped.plan(mapped.locate(black), (0, 0))
    assert answer.found is None
    assert "too few features" in answer.reason


def test_what_is_doubtful_about_a_photos_camera_is_in_the_paths_warnings(
    mapped: vnav.Map, photos: list[Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import dataclasses

    found = dataclasses.replace(mapped.locate(photos[0]), warnings=("camera assumed",))
    monkeypatch.setattr("vnav.stages.locate.Locator.locate", lambda *_: found)
    assert mapped.plan(photos[0], photos[1]).warnings == ("camera assumed",) * 2


def test_what_a_map_holds_are_typed_values(mapped: vnav.Map) -> None:
    trajectory = mapped.trajectory()
    truth = read_tum(mapped.root / "optimise" / "trajectory_0.tum")
    np.testing.assert_array_equal(trajectory.T_world_camera, truth.T_world_camera)
    assert len(mapped.cloud()) > 1000
    assert len(mapped.mesh().triangles) > 1000
    assert (mapped.grid().cells == FREE).any()
    assert mapped.landmarks().points_world.shape == (len(mapped.landmarks()), 3)
    assert mapped.info()["landmarks"] == len(mapped.landmarks())


def test_a_capture_that_the_map_has_not_is_an_error(mapped: vnav.Map) -> None:
    with pytest.raises(vnav.MapError, match="expected a capture from 0 to 0"):
        mapped.trajectory(1)


def test_pictures_of_answers_are_written(
    mapped: vnav.Map, photos: list[Path], tmp_path: Path
) -> None:
    mapped.draw_photo(mapped.locate(photos[0]), tmp_path / "photo.jpg")
    mapped.draw_plan(mapped.plan(photos[0], photos[1]), tmp_path / "path.png")
    assert cv2.imread(str(tmp_path / "photo.jpg")) is not None
    assert cv2.imread(str(tmp_path / "path.png")) is not None


def test_a_folder_without_a_map_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(vnav.MapError, match="found no map.json"):
        vnav.open_map(tmp_path)


@pytest.mark.parametrize(
    "place", [(1.0,), [1, 2, 3], ["a", "b"], np.zeros(3), None, 5, (0, np.nan), (np.inf, 0)]
)
def test_what_is_no_place_is_an_error_that_says_so(mapped: vnav.Map, place: object) -> None:
    with pytest.raises(vnav.MapError, match="expected x, y in metres of the map's world, found"):
        mapped.plan((0, 0), place)  # type: ignore[arg-type]
    with pytest.raises(vnav.MapError, match="expected x, y in metres of the map's world, found"):
        mapped.add_goal("door", place)  # type: ignore[arg-type]


@pytest.mark.parametrize("corner", ["ab", (1, 2, 3), ("a", "b")])
def test_a_corner_that_is_no_point_is_an_error_that_says_so(
    mapped: vnav.Map, corner: object
) -> None:
    with pytest.raises(vnav.MapError, match="expected x, y in metres of the map's world, found"):
        mapped.keep_out("stairs", [(0, 0), (1, 0), corner])  # type: ignore[list-item]


def test_a_point_may_be_a_list_or_an_array(mapped: vnav.Map, photos: list[Path]) -> None:
    x, y = pose(mapped.locate(photos[0]))[:2, 3]
    answers = [mapped.plan(p, photos[1]) for p in ((x, y), [x, y], np.array([x, y]))]
    assert answers[0].found is not None
    for answer in answers:
        assert answer.found is not None
        np.testing.assert_array_equal(answer.found.poses, answers[0].found.poses)


def test_a_part_or_a_format_that_a_map_has_not_is_an_error(
    mapped: vnav.Map, tmp_path: Path
) -> None:
    with pytest.raises(
        vnav.MapError, match="expected a part of a map, of trajectory, cloud, .*'clod'"
    ):
        mapped.export(tmp_path / "out", {"clod": "ply"})
    with pytest.raises(vnav.MapError, match="the part cloud to be ply or las, found 'xyz'"):
        mapped.export(tmp_path / "out", {"cloud": "xyz"})
    assert not (tmp_path / "out").exists()

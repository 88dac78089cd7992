"""vnav locate as a user calls it: what is printed where, and the exit codes."""

import gc
import json
import shutil
import subprocess
import sys
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import click
import cv2
import numpy as np
import pytest
from click.testing import CliRunner, Result

from tests.cli.processes import running, stopped
from vnav.api.locate_many import shares
from vnav.api.map import Map
from vnav.cli.main import cli
from vnav.errors import CameraError, MapError, PhotoError, VnavError
from vnav.io.store.map_folder import MapFolder
from vnav.localisation.verdict.answer import UnreadablePhoto


@pytest.fixture(scope="module")
def indexed(tmp_path_factory: pytest.TempPathFactory, whole_map: Path) -> Path:
    """A map of its own, as questions are remembered in it."""
    root = tmp_path_factory.mktemp("maps") / "map"
    shutil.copytree(whole_map, root)
    return root


@pytest.fixture(scope="module")
def photos(tiny_capture: Path) -> Path:
    return tiny_capture / "photos"


@pytest.fixture
def black(tmp_path: Path) -> Path:
    path = tmp_path / "black.png"
    cv2.imwrite(str(path), np.zeros((240, 320, 3), np.uint8))
    return path


def run(*arguments: object, lines: Iterable[object] = ()) -> Result:
    """The command's result; ``lines``: on its stdin."""
    return CliRunner().invoke(
        cli,
        ["locate", *(str(a) for a in arguments)],
        input="".join(f"{line}\n" for line in lines),
        standalone_mode=False,
        catch_exceptions=False,
    )


def untimed(value: dict[str, object]) -> dict[str, object]:
    return {**value, "seconds": None}


def first_of(photos: Path) -> Path:
    return min(photos.glob("*.jpg"))


def test_a_located_photo_is_a_line_and_exit_code_0(indexed: Path, photos: Path) -> None:
    result = run(first_of(photos), "--map", indexed)
    assert result.return_value == 0
    assert result.stdout.startswith(f"{first_of(photos)}: at ")


def test_one_photo_as_json_is_an_object_and_several_are_an_array(
    indexed: Path, photos: Path
) -> None:
    one = json.loads(run(first_of(photos), "--map", indexed, "--json").stdout)
    many = json.loads(run(photos, "--map", indexed, "--json").stdout)
    assert one["located"]
    assert [Path(value["photo"]) for value in many] == sorted(photos.glob("*.jpg"))


def test_the_pose_of_one_photo_is_remembered_that_of_several_is_not(
    indexed: Path, photos: Path
) -> None:
    said = json.loads(run(first_of(photos), "--map", indexed, "--json").stdout)
    current = MapFolder(indexed).current()
    assert current is not None
    assert current["T_world_camera"] == said["T_world_camera"]
    run(photos, "--map", indexed)
    assert MapFolder(indexed).current() == current


def test_a_photo_that_is_not_located_is_exit_code_3(indexed: Path, black: Path) -> None:
    result = run(black, "--map", indexed)
    assert result.return_value == 3
    assert "not located: too few features; the photo is dark" in result.stdout


def test_one_of_several_not_located_is_exit_code_3(
    indexed: Path, photos: Path, black: Path
) -> None:
    assert run(first_of(photos), black, "--map", indexed).return_value == 3


def test_one_of_several_unreadable_is_exit_code_1_and_the_others_are_answered(
    indexed: Path, photos: Path, tmp_path: Path
) -> None:
    broken = tmp_path / "broken.jpg"
    broken.write_text("none")
    result = run(broken, first_of(photos), "--map", indexed)
    assert result.return_value == 1
    assert f"{first_of(photos)}: at " in result.stdout
    with pytest.raises(PhotoError):
        run(broken, "--map", indexed)


def test_csv_and_overlays_are_written(indexed: Path, photos: Path, tmp_path: Path) -> None:
    table, drawn = tmp_path / "poses.csv", tmp_path / "drawn"
    run(photos, "--map", indexed, "--csv", table, "--overlay", drawn)
    names = sorted(path.name for path in photos.glob("*.jpg"))
    assert len(table.read_text().splitlines()) == 1 + len(names)
    assert sorted(path.name for path in drawn.iterdir()) == names


@pytest.fixture
def interrupted(monkeypatch: pytest.MonkeyPatch) -> None:
    """Ctrl-C after the first of several photos."""

    def locate_all(_: Map, paths: Sequence[Path], **_options: object) -> Iterator[UnreadablePhoto]:
        yield UnreadablePhoto(paths[0], "none")
        raise KeyboardInterrupt

    monkeypatch.setattr(Map, "locate_all", locate_all)


def test_an_interrupt_loses_no_answer(
    indexed: Path, photos: Path, tmp_path: Path, interrupted: None
) -> None:
    table = tmp_path / "poses.csv"
    arguments = [str(a) for a in ("locate", photos, "--map", indexed, "--csv", table)]
    result = CliRunner().invoke(cli, arguments)
    assert result.exit_code == 1  # click's own; main tells 130
    assert result.stdout.startswith(f"{first_of(photos)}: unreadable")
    assert "0 of 1 located" in result.stderr
    assert table.read_text().splitlines()[1].startswith(f"{first_of(photos)},False,none,")


def test_several_photos_are_counted_and_one_is_not(
    indexed: Path, photos: Path, black: Path
) -> None:
    one = first_of(photos)
    assert "1 of 2 located" in run(one, black, "--map", indexed).stderr
    assert "located" not in run(one, "--map", indexed).stderr
    assert "located" not in run(one, black, "--map", indexed, "-q").stderr


def test_garbage_is_sought_while_many_photos_are_located(
    indexed: Path, photos: Path, interrupted: None
) -> None:
    try:
        gc.disable()
        CliRunner().invoke(cli, ["locate", str(photos), "--map", str(indexed)])
        assert gc.isenabled()
    finally:
        gc.enable()
        gc.unfreeze()


def test_a_photo_is_not_written_over_by_the_table(indexed: Path, tmp_path: Path) -> None:
    photos = [tmp_path / "a.jpg", tmp_path / "b.jpg"]
    with pytest.raises(click.UsageError, match="another file for --csv than a photo"):
        run(*photos, "--map", indexed, "--csv", photos[1])


def test_each_line_of_stdin_has_a_line_of_json(indexed: Path, photos: Path, tmp_path: Path) -> None:
    """In their order, as of one photo, whatever a line holds; the current place stays."""
    before = MapFolder(indexed).current()
    lines = ["", first_of(photos), tmp_path / "none.jpg", "x" * 5000, tmp_path, first_of(photos)]
    result = run("--stdin", "--map", indexed, lines=lines)
    answers = [json.loads(line) for line in result.stdout.splitlines()]
    assert [answer["photo"] for answer in answers] == [str(Path(line)) for line in lines]
    assert [answer["located"] for answer in answers] == [False, True, False, False, False, True]
    assert result.return_value == 1
    assert "2 of 6 located" in result.stderr
    assert MapFolder(indexed).current() == before
    alone = json.loads(run(first_of(photos), "--map", indexed, "--json").stdout)
    assert untimed(answers[1]) == untimed(answers[5]) == untimed(alone)


def test_a_sequence_is_answered_in_order_and_its_priors_are_told(
    indexed: Path, photos: Path
) -> None:
    result = run(photos, "--map", indexed, "--sequence", "--json")
    values = json.loads(result.stdout)
    assert [Path(value["photo"]) for value in values] == sorted(photos.glob("*.jpg"))
    assert ["prior" in value for value in values] == [False] + [True] * (len(values) - 1)


def test_a_photo_that_a_camera_does_not_fit_does_not_end_the_others(
    indexed: Path, photos: Path, tmp_path: Path
) -> None:
    square = tmp_path / "square.png"
    cv2.imwrite(str(square), np.zeros((240, 240, 3), np.uint8))
    camera = photos / "camera.toml"
    lines = [square, first_of(photos)]
    result = run("--stdin", "--map", indexed, "--camera", camera, lines=lines)
    bad, good = [json.loads(line) for line in result.stdout.splitlines()]
    assert "expected a camera for 240 x 240 pixels" in bad["reason"]
    assert good["located"]


def test_a_camera_that_is_missing_ends_it_before_the_first_line(indexed: Path) -> None:
    with pytest.raises(CameraError, match=r"nowhere\.toml"):
        run("--stdin", "--map", indexed, "--camera", "nowhere.toml", lines=["a.jpg"])


@pytest.mark.parametrize(
    ("arguments", "found"),
    [
        ([], "found none of them"),
        (["--stdin", "a.jpg"], "found PHOTOS and --stdin"),
        (["--stdin", "--watch", "."], "found --stdin and --watch"),
        (["--stdin", "--jobs", "2"], "expected --jobs with PHOTOS"),
        (["--watch", ".", "--overlay", "."], "expected --overlay with PHOTOS alone"),
        (["a.jpg", "--sequence", "--jobs", "2"], "found it with --stdin, --watch or --sequence"),
    ],
)
def test_photos_are_named_in_one_way(arguments: list[str], found: str) -> None:
    with pytest.raises(click.UsageError, match=found):
        run(*arguments)


def test_a_folder_is_watched_until_it_is_interrupted(
    indexed: Path, photos: Path, tmp_path: Path
) -> None:
    """Each answer arrives before the next photo does; nothing but answers on stdout."""
    shutil.copy(photos / "camera.toml", tmp_path)
    with running("locate", "--watch", tmp_path, "--map", indexed) as process:
        assert process.stdout is not None
        for photo in sorted(photos.glob("*.jpg"))[:2]:
            part = shutil.copy(photo, tmp_path / f"{photo.name}.part")
            Path(part).rename(tmp_path / photo.name)
            answer = json.loads(process.stdout.readline())
            assert (answer["photo"], answer["located"]) == (str(tmp_path / photo.name), True)
        rest, said = stopped(process)
    assert process.returncode == 130
    assert rest == ""
    assert "2 of 2 located" in said.splitlines()
    assert said.splitlines()[-1] == "vnav: interrupted; what was finished is kept"


def test_no_picture_takes_the_place_of_a_photo_or_of_another(
    indexed: Path, photos: Path, tmp_path: Path
) -> None:
    own, others = tmp_path / "own", tmp_path / "others"
    for folder in (own, others):
        folder.mkdir()
        shutil.copy(first_of(photos), folder / "a.jpg")
        shutil.copy(photos / "camera.toml", folder)
    run(own / "a.jpg", others / "a.jpg", "--map", indexed, "--overlay", own)
    assert {path.name for path in own.glob("*.jpg")} == {"a.jpg", "a-2.jpg", "a-3.jpg"}
    assert (own / "a.jpg").read_bytes() == first_of(photos).read_bytes()


def test_one_photo_is_drawn_into_a_folder_that_is_there(
    indexed: Path, photos: Path, tmp_path: Path
) -> None:
    run(first_of(photos), "--map", indexed, "--overlay", tmp_path)
    assert (tmp_path / first_of(photos).name).is_file()


def test_a_photo_is_not_drawn_into_its_own_file(
    indexed: Path, photos: Path, tmp_path: Path
) -> None:
    photo = Path(shutil.copy(first_of(photos), tmp_path / "a.jpg"))
    with pytest.raises(VnavError, match="another file for the picture than its photo"):
        run(photo, "--map", indexed, "--overlay", photo)
    assert photo.read_bytes() == first_of(photos).read_bytes()


def test_several_photos_are_drawn_into_a_folder_not_into_a_picture(
    indexed: Path, photos: Path, tmp_path: Path
) -> None:
    with pytest.raises(click.UsageError, match="expected a folder with --overlay"):
        run(photos, "--map", indexed, "--overlay", tmp_path / "x.png")
    assert not (tmp_path / "x.png").exists()


def test_photos_shared_out_among_processes_have_the_same_answers(
    indexed: Path, photos: Path, tmp_path: Path
) -> None:
    broken = tmp_path / "broken.jpg"
    broken.write_text("none")

    def answers(*options: object) -> list[dict[str, object]]:
        result = run(photos, broken, "--map", indexed, "--json", *options)
        assert result.return_value == 1
        return [untimed(value) for value in json.loads(result.stdout)]

    assert answers("--jobs", 2) == answers()


def test_an_error_of_a_process_is_that_of_its_photos(indexed: Path, photos: Path) -> None:
    result = run(photos, "--map", indexed, "--jobs", 2, "--camera", "nowhere.toml")
    assert result.return_value == 1
    lines = result.stdout.splitlines()
    assert len(lines) == len(list(photos.glob("*.jpg")))
    assert all("unreadable: expected a camera file at" in line for line in lines)


def test_photos_are_shared_out_evenly_and_in_order() -> None:
    photos = [Path(str(k)) for k in range(40)]
    for jobs, sizes in {0: [16, 16, 8], 2: [16, 16, 8], 8: [5] * 8, 100: [1] * 40}.items():
        found = shares(photos, jobs)
        assert [len(share) for share in found] == sizes
        assert [photo for share in found for photo in share] == photos


def test_a_level_that_the_tree_does_not_have_is_said_once(indexed: Path, photos: Path) -> None:
    """By whatever is said of each photo, too."""
    result = run(photos, "--map", indexed, "--set", "locate.level_3d_2d=20")
    assert result.stderr.count("expected locate.level_3d_2d to be a level of") == 1
    assert "expected locate.level" not in run(photos, "--map", indexed).stderr


def test_an_unknown_camera_is_estimated(indexed: Path, photos: Path) -> None:
    value = json.loads(run(first_of(photos), "--map", indexed, "--camera", "auto", "--json").stdout)
    assert value["intrinsics_source"] == "estimated"
    if value["located"]:
        assert value["intrinsics"]["sigma_fx"] > 0


def test_a_camera_file_that_is_missing_is_told(indexed: Path, photos: Path) -> None:
    with pytest.raises(CameraError, match=r"nowhere\.toml"):
        run(first_of(photos), "--map", indexed, "--camera", "nowhere.toml")


def test_without_a_map_the_command_that_makes_one_is_named(photos: Path, tmp_path: Path) -> None:
    with pytest.raises(MapError, match="vnav build-map"):
        run(first_of(photos), "--map", tmp_path / "none")


def test_locate_loads_no_heavy_library(indexed: Path, photos: Path, tmp_path: Path) -> None:
    code = (
        "import sys; from vnav.cli.main import cli\n"
        f"cli.main(['locate', {str(first_of(photos))!r}, '--map', {str(indexed)!r}],"
        " standalone_mode=False)\n"
        "heavy = {'open3d', 'sklearn', 'octomap', 'gtsam', 'matplotlib'}\n"
        "assert not heavy & set(sys.modules), heavy & set(sys.modules)"
    )
    subprocess.run([sys.executable, "-c", code], cwd=tmp_path, check=True)

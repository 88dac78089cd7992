import hashlib
import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

import vnav
from vnav.errors import MapError, StaleArtifact
from vnav.io.store import map_folder
from vnav.io.store.map_folder import FORMAT, MapFolder, to_json
from vnav.io.store.records import MappedCapture

SETTINGS = {"seed": 0, "loops": {"candidates": 8, "share": 0.25, "on": True, "name": "x"}}
INPUTS = {"capture_0": "abc"}
HOUSE = MappedCapture(id=0, name="house", fingerprint="abc", camera={"fx": 525.0})


@pytest.fixture
def folder(tmp_path: Path) -> MapFolder:
    return MapFolder.create(tmp_path / "map")


def write(folder: MapFolder, stage: str, text: str = "made", *made_from: str) -> None:
    inputs = folder.inputs_of(*made_from) if made_from else INPUTS
    with folder.writing(stage, SETTINGS, inputs) as draft:
        (draft / "result.txt").write_text(text)


def names(folder: MapFolder) -> set[str]:
    return {path.name for path in folder.root.iterdir()}


def test_an_empty_folder_and_a_missing_one_become_maps(tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    for name in ("empty", "deep/missing"):
        MapFolder.create(tmp_path / name)
        assert MapFolder.open(tmp_path / name).captures == []


def test_captures_are_remembered(folder: MapFolder) -> None:
    folder.set_captures([HOUSE])
    assert MapFolder.create(folder.root).captures == [HOUSE]


def test_opening_what_is_no_map_says_how_to_make_one(tmp_path: Path) -> None:
    with pytest.raises(MapError, match=r"no map\.json; make one with 'vnav build-map"):
        MapFolder.open(tmp_path)


def test_a_map_of_another_format_version_is_refused(folder: MapFolder) -> None:
    (folder.root / "map.json").write_text('{"format": 99, "captures": []}')
    for use in (MapFolder.open, MapFolder.create):
        with pytest.raises(MapError, match=rf"expected map format {FORMAT} in .*found 99.*--fresh"):
            use(folder.root)


@pytest.mark.parametrize("text", ["", "[1]", "\xff"])
def test_a_damaged_map_json_is_named(folder: MapFolder, text: str) -> None:
    (folder.root / "map.json").write_text(text, "latin-1")
    with pytest.raises(MapError, match=r"expected .*JSON.*map\.json"):
        MapFolder.open(folder.root)


def test_a_folder_with_other_files_is_never_made_a_map(tmp_path: Path) -> None:
    (tmp_path / "thesis.tex").write_text("years of work")
    for fresh in (False, True):
        with pytest.raises(MapError, match=r"found other files \(thesis\.tex\)"):
            MapFolder.create(tmp_path, fresh)
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.tex"]


def test_fresh_leaves_another_programs_map_json_alone(tmp_path: Path) -> None:
    (tmp_path / "map.json").write_text('{"layers": []}')
    (tmp_path / "fuse").mkdir()
    with pytest.raises(MapError, match="deleted nothing"):
        MapFolder.create(tmp_path, fresh=True)
    assert (tmp_path / "fuse").is_dir()


def test_fresh_removes_what_vnav_wrote_and_nothing_else(folder: MapFolder) -> None:
    write(folder, "odometry")
    folder.set_captures([HOUSE])
    folder.write_report("odometry", {"seconds": 1})
    folder.write_current({"x": 1})
    (folder.root / "notes.txt").write_text("mine")
    fresh = MapFolder.create(folder.root, fresh=True)
    assert names(fresh) == {"map.json", "notes.txt"}
    assert fresh.captures == []


@pytest.mark.parametrize("text", ["", "[1]", '{"format": 1'])
def test_fresh_takes_the_place_of_a_map_whose_map_json_is_damaged(
    folder: MapFolder, text: str
) -> None:
    write(folder, "odometry")
    (folder.root / "map.json").write_text(text)
    assert MapFolder.create(folder.root, fresh=True).captures == []
    assert names(folder) == {"map.json"}


def test_fresh_leaves_a_map_json_alone_that_nothing_shows_to_be_vnavs(tmp_path: Path) -> None:
    (tmp_path / "map.json").write_text("[1]")
    (tmp_path / "fuse").mkdir()
    with pytest.raises(MapError, match="deleted nothing"):
        MapFolder.create(tmp_path, fresh=True)
    assert (tmp_path / "fuse").is_dir()


def test_fresh_takes_the_place_of_a_map_of_another_format(folder: MapFolder) -> None:
    (folder.root / "map.json").write_text('{"format": 99, "captures": []}')
    assert MapFolder.open(MapFolder.create(folder.root, fresh=True).root).captures == []


def test_a_written_stage_is_current_and_holds_its_files(folder: MapFolder) -> None:
    write(folder, "odometry")
    assert folder.is_current("odometry", SETTINGS, INPUTS)
    assert (folder.stage("odometry") / "result.txt").read_text() == "made"


def test_a_stage_that_was_not_made_is_not_current(folder: MapFolder) -> None:
    assert not folder.is_current("odometry", SETTINGS, INPUTS)


def test_other_settings_other_inputs_or_another_version_are_not_current(
    folder: MapFolder, monkeypatch: pytest.MonkeyPatch
) -> None:
    write(folder, "odometry")
    assert not folder.is_current("odometry", SETTINGS | {"seed": 1}, INPUTS)
    assert not folder.is_current("odometry", SETTINGS, {"capture_0": "other"})
    assert not folder.is_current("odometry", SETTINGS, {})
    monkeypatch.setattr(map_folder, "__version__", vnav.__version__ + ".1")
    assert not folder.is_current("odometry", SETTINGS, INPUTS)


@pytest.mark.parametrize("harm", ["change", "remove", "add"])
def test_a_stage_whose_files_were_touched_is_not_current(folder: MapFolder, harm: str) -> None:
    write(folder, "odometry")
    path = folder.root / "odometry" / "result.txt"
    if harm == "remove":
        path.unlink()
    else:
        (path if harm == "change" else path.with_name("more.txt")).write_text("Made")
    assert not folder.is_current("odometry", SETTINGS, INPUTS)


def test_a_missing_stage_is_stale_and_names_the_command(folder: MapFolder) -> None:
    with pytest.raises(StaleArtifact, match="run 'vnav build-map' or 'vnav loops --map"):
        folder.stage("loops")


def test_a_stage_made_from_another_input_is_stale(folder: MapFolder) -> None:
    write(folder, "odometry")
    write(folder, "vocabulary", "tree", "odometry")
    folder.stage("vocabulary")
    write(folder, "odometry", "made again, otherwise")
    with pytest.raises(StaleArtifact, match="'vocabulary' .* from another 'odometry'"):
        folder.stage("vocabulary")


def test_a_stage_is_stale_when_its_inputs_input_changed(folder: MapFolder) -> None:
    write(folder, "odometry")
    write(folder, "vocabulary", "tree", "odometry")
    write(folder, "loops", "loops", "vocabulary")
    write(folder, "odometry", "made again, otherwise")
    with pytest.raises(StaleArtifact, match="'vocabulary' .* from another 'odometry'"):
        folder.stage("loops")


def test_a_stage_made_again_with_the_same_result_leaves_the_others_current(
    folder: MapFolder,
) -> None:
    write(folder, "odometry")
    write(folder, "vocabulary", "tree", "odometry")
    write(folder, "odometry")
    assert folder.stage("vocabulary").is_dir()


def test_a_failure_in_the_middle_leaves_the_old_stage(folder: MapFolder) -> None:
    write(folder, "fuse", "old")

    def fail() -> None:
        with folder.writing("fuse", SETTINGS, INPUTS) as draft:
            (draft / "result.txt").write_text("half")
            raise RuntimeError

    with pytest.raises(RuntimeError):
        fail()
    assert (folder.stage("fuse") / "result.txt").read_text() == "old"
    assert folder.is_current("fuse", SETTINGS, INPUTS)


KILLED = """
import os, signal, sys
from pathlib import Path
from vnav.io.store import map_folder
folder = map_folder.MapFolder.create(Path(sys.argv[1]))
calls = 0
def dying(name):
    real = getattr(os, name)
    def call(*args, **options):
        global calls
        calls += 1
        if calls > int(sys.argv[2]):
            os.kill(os.getpid(), signal.SIGKILL)
        return real(*args, **options)
    setattr(os, name, call)
for name in ("mkdir", "rename", "replace", "rmdir", "unlink", "open"):
    dying(name)
with folder.writing("fuse", {"seed": 1}, {}) as draft:
    (draft / "result.txt").write_text("new")
os._exit(0)
"""


def test_killed_at_any_call_a_stage_is_old_or_new_or_absent_and_the_next_run_mends_it(
    folder: MapFolder,
) -> None:
    found = set()
    for calls in range(30):
        write(folder, "fuse", "old")
        killed = subprocess.run(
            [sys.executable, "-c", KILLED, str(folder.root), str(calls)], check=False
        )
        path = folder.root / "fuse" / "result.txt"
        found.add(path.read_text() if path.exists() else "absent")
        again = MapFolder.create(folder.root)
        assert names(again) <= {"map.json", "fuse"}
        write(again, "fuse", "mended")
        assert (again.stage("fuse") / "result.txt").read_text() == "mended"
        if killed.returncode == 0:
            break
    assert killed.returncode == 0
    assert found == {"old", "absent", "new"}


def test_a_folder_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("no folder")
    with pytest.raises(MapError, match=r"expected to write a map at .*file.map, found"):
        MapFolder.create(tmp_path / "file" / "map")


def test_a_read_only_map_can_be_read_but_not_written(
    folder: MapFolder, monkeypatch: pytest.MonkeyPatch
) -> None:
    write(folder, "odometry")

    def refuse(*_: object, **__: object) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "mkdir", refuse)
    monkeypatch.setattr(Path, "write_text", refuse)
    assert MapFolder.open(folder.root).is_current("odometry", SETTINGS, INPUTS)
    with pytest.raises(MapError, match="found: Permission denied; give write permission"):
        MapFolder.create(folder.root)
    with pytest.raises(MapError, match="found: Permission denied; give write permission"):
        write(folder, "odometry")
    with pytest.raises(OSError, match="Permission denied"):
        folder.write_current({})


def test_reports_and_the_current_pose_come_back_as_written(folder: MapFolder) -> None:
    assert folder.report("odometry") == {}
    assert folder.current() is None
    folder.write_report("odometry", {"frames": 3})
    folder.write_current({"x": 1.5})
    assert folder.report("odometry") == {"frames": 3}
    assert folder.current() == {"x": 1.5}


def test_the_record_of_a_stage_holds_no_absolute_path_and_no_time(folder: MapFolder) -> None:
    write(folder, "odometry")
    record = json.loads((folder.root / "odometry" / "stage.json").read_text())
    assert set(record) == {"vnav", "settings", "inputs", "files", "sha256"}
    assert str(folder.root) not in json.dumps(record)


def test_no_number_that_json_cannot_hold_is_written(folder: MapFolder) -> None:
    with pytest.raises(ValueError, match="not JSON compliant"):
        folder.write_report("odometry", {"rms": float("nan")})


@pytest.mark.parametrize("number", ["NaN", "1e999"])
def test_a_number_that_json_cannot_hold_is_another_content(folder: MapFolder, number: str) -> None:
    write(folder, "odometry")
    path = folder.root / "odometry" / "stage.json"
    path.write_text(path.read_text().replace('"seed": 0', f'"seed": {number}'))
    with pytest.raises(StaleArtifact, match="found another content"):
        MapFolder(folder.root).settings("odometry")


def craft(path: Path, **changes: object) -> None:
    """Let a JSON file say something else, under a seal that fits; None takes a key away."""
    values = {k: v for k, v in (json.loads(path.read_text()) | changes).items() if v is not None}
    values.pop("sha256", None)
    seal = hashlib.sha256(to_json(values).encode()).hexdigest()
    path.write_text(to_json({**values, "sha256": seal}))


@pytest.mark.parametrize("key", ["vnav", "settings", "inputs", "files"])
@pytest.mark.parametrize("value", [None, 1, ["a"], {"result.txt": 1}])
def test_a_crafted_record_of_a_stage_is_named(folder: MapFolder, key: str, value: object) -> None:
    if key == "settings" and isinstance(value, dict):
        pytest.skip("settings are checked where they are used")
    write(folder, "odometry")
    craft(folder.root / "odometry" / "stage.json", **{key: value})
    with pytest.raises(MapError, match=r"expected .*stage\.json as vnav writes it, found: "):
        MapFolder(folder.root).stage("odometry")


@pytest.mark.parametrize("name", ["../map.json", "/etc/passwd", "keyframes/../../map.json"])
def test_a_record_names_no_file_outside_its_stage(folder: MapFolder, name: str) -> None:
    write(folder, "odometry")
    craft(folder.root / "odometry" / "stage.json", files={name: "0" * 64})
    with pytest.raises(MapError, match="expected files below their stage"):
        MapFolder(folder.root).files("odometry")


@pytest.mark.parametrize("captures", [None, 1, [1], [{"id": 0}], [{**HOUSE, "camera": []}]])
def test_a_crafted_list_of_captures_is_named(folder: MapFolder, captures: object) -> None:
    craft(folder.root / "map.json", captures=captures)
    with pytest.raises(MapError, match=r"expected .*map\.json as vnav writes it, found: "):
        MapFolder.open(folder.root)


@pytest.mark.parametrize("values", [{"lines": 1}, {"seconds": "x"}, {"values": [1]}])
def test_a_crafted_report_is_none(folder: MapFolder, values: dict[str, object]) -> None:
    folder.write_report("odometry", {"lines": ["10 frames"], "values": {}, "seconds": 1.0})
    craft(folder.root / "reports" / "odometry.json", **values)
    assert folder.report("odometry") == {}


def test_a_record_of_a_huge_size_is_not_read(folder: MapFolder) -> None:
    write(folder, "odometry")
    os.truncate(folder.root / "odometry" / "stage.json", 2**40)
    with pytest.raises(MapError, match="File too large"):
        MapFolder(folder.root).stage("odometry")


def finished(folder: MapFolder) -> MapFolder:
    before: list[str] = []
    for stage in map_folder.STAGES:
        write(folder, stage, "made", *before[-1:])
        before.append(stage)
    return folder


def test_a_finished_map_has_all_stages_of_this_version(
    folder: MapFolder, monkeypatch: pytest.MonkeyPatch
) -> None:
    finished(folder).require_finished()
    monkeypatch.setattr(map_folder, "__version__", "9.9")
    expected = f"expected stages made by vnav 9.9 .*'odometry' made by {vnav.__version__}.*--fresh"
    with pytest.raises(MapError, match=expected):
        folder.require_finished()


def test_a_map_that_lacks_a_stage_or_has_a_stale_one_is_not_finished(folder: MapFolder) -> None:
    finished(folder)
    write(folder, "loops", "made otherwise", "vocabulary")
    with pytest.raises(StaleArtifact, match="run 'vnav optimise"):
        folder.require_finished()
    (folder.root / "index" / "stage.json").unlink()
    write(folder, "optimise", "made", "loops")
    write(folder, "fuse", "made", "optimise")
    with pytest.raises(StaleArtifact, match="the finished stage 'index'"):
        folder.require_finished()


def test_a_current_pose_and_a_path_of_another_world_are_forgotten(tmp_path: Path) -> None:
    folder = MapFolder.create(tmp_path / "map")
    with folder.writing("optimise", {"seed": 0}, {}):
        pass
    folder.write_current({"x": 1.5})
    folder.write_planned({"y": 2.5})
    assert (folder.current(), folder.planned()) == ({"x": 1.5}, {"y": 2.5})
    with folder.writing("optimise", {"seed": 1}, {}):
        pass
    assert (folder.current(), folder.planned()) == (None, None)


@pytest.mark.parametrize("damage", [lambda path: path.write_text("maid"), Path.unlink])
def test_a_file_that_is_not_as_its_stage_wrote_it_is_not_given_out(
    folder: MapFolder, damage: Callable[[Path], object]
) -> None:
    write(folder, "odometry", "made")
    path = folder.file("odometry", "result.txt")
    assert path.read_text() == "made"
    damage(path)
    with pytest.raises(StaleArtifact, match=rf"expected {path} as .* wrote it, found .*build-map"):
        folder.file("odometry", "result.txt")


def test_a_file_that_a_stage_did_not_write_is_not_given_out(folder: MapFolder) -> None:
    write(folder, "odometry")
    (folder.root / "odometry" / "planted.txt").touch()
    with pytest.raises(StaleArtifact, match="found none"):
        folder.file("odometry", "planted.txt")


def test_a_stage_whose_record_was_altered_is_made_again(folder: MapFolder) -> None:
    write(folder, "odometry")
    path = folder.root / "odometry" / "stage.json"
    path.write_text(path.read_text().replace('"seed": 0', '"seed": 1'))
    assert not folder.has("odometry")
    assert not folder.is_current("odometry", SETTINGS | {"seed": 1}, INPUTS)


def test_a_map_whose_cameras_were_altered_is_refused(folder: MapFolder) -> None:
    folder.set_captures([HOUSE])
    path = folder.root / "map.json"
    path.write_text(path.read_text().replace("525.0", "526.0"))
    with pytest.raises(StaleArtifact, match=r"expected .*map\.json as vnav wrote it"):
        MapFolder.open(folder.root)


def test_an_altered_note_is_forgotten(folder: MapFolder) -> None:
    folder.write_current({"x": 1.0})
    folder.write_report("odometry", {"lines": ["10 frames"]})
    for name, old, new in (("state/current", "1.0", "9.0"), ("reports/odometry", "10", "90")):
        path = folder.root / f"{name}.json"
        path.write_text(path.read_text().replace(old, new))
    assert folder.current() is None
    assert folder.report("odometry") == {}


def run_out_of_room(folder: MapFolder) -> None:
    with folder.writing("odometry", SETTINGS, INPUTS) as draft:
        (draft / "half").touch()
        Path("/dev/full").write_text("the other half")


def test_what_a_full_disk_broke_off_takes_no_room(folder: MapFolder) -> None:
    write(folder, "odometry", "made")
    with pytest.raises(MapError, match="room for the stage 'odometry'.*what is finished is kept"):
        run_out_of_room(folder)
    assert names(folder) == {"map.json", "odometry"}
    assert folder.file("odometry", "result.txt").read_text() == "made"

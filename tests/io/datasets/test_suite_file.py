from pathlib import Path

import pytest

from vnav.config import Config
from vnav.errors import CaptureError, ConfigError
from vnav.io.datasets.suite_file import Entry, Peer, files_of, read_suite, shipped_suites
from vnav.io.formats.camera_file import read_color

WHOLE = """
[suite]
name = "All"
description = "Everything that can be said."

[[sequence]]
name = "fr1/desk"
capture = "desk"
camera = "tum_fr1"
truth = "truth.txt"
config = "tum_fr1"
settings.odometry.max_depth_m = 4
queries = "photos"
hold_out_every = 10
peers = [
    { system = "ORB-SLAM2", ate_m = 0.016, source = "Mur-Artal 2017" },
    { system = "X", note = "lost", source = "Y" },
]
"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Where the suite lies; fetched datasets lie elsewhere."""
    monkeypatch.setenv("VNAV_DATASETS", str(tmp_path / "fetched"))
    (tmp_path / "suites").mkdir()
    return tmp_path / "suites"


def written(folder: Path, text: str) -> str:
    (folder / "suite.toml").write_text(text, "utf-8")
    return str(folder / "suite.toml")


def test_everything_that_can_be_said_of_a_sequence_is_read(folder: Path) -> None:
    suite = read_suite(written(folder, WHOLE))
    assert (suite.name, suite.description) == ("All", "Everything that can be said.")
    assert suite.entries == (
        Entry(
            "fr1/desk",
            "desk",
            "tum_fr1",
            "truth.txt",
            "tum_fr1",
            {"odometry": {"max_depth_m": 4}},
            "photos",
            10,
            (Peer("ORB-SLAM2", "Mur-Artal 2017", 0.016), Peer("X", "Y", note="lost")),
        ),
    )


def test_settings_change_the_preset_and_the_preset_the_defaults(folder: Path) -> None:
    suite = read_suite(written(folder, WHOLE))
    config = suite.config_of(suite.entries[0])
    assert config.capture.preset_camera == "tum_fr1"
    assert config.odometry.max_depth_m == 4.0
    assert config.loops == Config().loops


def test_a_file_of_settings_lies_beside_the_suite(folder: Path) -> None:
    (folder / "mine.toml").write_text("[odometry]\nmax_depth_m = 2.5\n")
    suite = read_suite(written(folder, WHOLE.replace('config = "tum_fr1"', 'config = "mine.toml"')))
    assert suite.config_of(Entry("a", "a", config="mine.toml")).odometry.max_depth_m == 2.5


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("queries =", "query =", r"unknown key 'query' in \[\[sequence\]\] 1 of .*suite.toml; did"),
        ("[suite]", "[suit]", r"unknown key 'suit' in .*suite\.toml; did you mean 'suite'"),
        ("ate_m =", "ate =", r"unknown key 'ate' in peers of .*; did you mean 'ate_m'"),
        ('capture = "desk"', "", r"expected capture in \[\[sequence\]\] 1 of .*, found none"),
        ('"desk"', "7", r"expected text for capture in \[\[sequence\]\] 1 of .*, found 7"),
        ("= 10", '= "ten"', "expected a whole number for hold_out_every in .*, found 'ten'"),
        ("= 10", "= true", "expected a whole number for hold_out_every in .*, found True"),
        ("= 10", "= 1", "expected hold_out_every of 2 or more in .*, found 1"),
        ('note = "lost", ', "", r"expected ate_m or note for X in \[\[sequence\]\] 1 of"),
        ("fr1/desk", "../desk", r"expected a name of .*, found '\.\./desk'"),
        ("[[sequence]]", "[[", "expected TOML in .*suite.toml, found"),
    ],
)
def test_what_is_wrong_is_named_with_its_file(
    folder: Path, old: str, new: str, message: str
) -> None:
    with pytest.raises(ConfigError, match=message):
        read_suite(written(folder, WHOLE.replace(old, new)))


def test_an_unknown_setting_is_named_with_its_sequence(folder: Path) -> None:
    suite = read_suite(written(folder, WHOLE.replace("max_depth_m", "max_depth")))
    with pytest.raises(
        ConfigError, match="unknown setting 'odometry.max_depth' in settings of fr1/desk"
    ):
        suite.config_of(suite.entries[0])


def test_two_sequences_of_a_name_are_refused(folder: Path) -> None:
    again = WHOLE[WHOLE.index("[[sequence]]") :]
    with pytest.raises(ConfigError, match="found two 'fr1/desk'"):
        read_suite(written(folder, WHOLE + again))


def test_a_suite_without_sequences_is_refused(folder: Path) -> None:
    with pytest.raises(ConfigError, match=r"expected \[\[sequence\]\] in"):
        read_suite(written(folder, "[suite]\nname = 'none'\n"))


def test_a_suite_that_is_not_there_names_those_that_ship() -> None:
    with pytest.raises(ConfigError, match="tum_fr1.*found neither: 'nowhere'"):
        read_suite("nowhere")


@pytest.mark.parametrize("name", shipped_suites())
def test_a_suite_that_ships_can_be_read_and_its_presets_exist(name: str, folder: Path) -> None:
    suite = read_suite(name)
    assert [suite.config_of(entry) for entry in suite.entries]
    assert suite.folder == folder.parent / "fetched"


def test_a_capture_beside_the_suite_comes_before_a_fetched_one(folder: Path) -> None:
    fetched = folder.parent / "fetched"
    (fetched / "desk").mkdir(parents=True)
    assert files_of(Entry("a", "desk"), folder).capture == fetched / "desk"
    (folder / "desk").mkdir()
    assert files_of(Entry("a", "desk"), folder).capture == folder / "desk"


def test_the_other_files_may_lie_in_the_capture(folder: Path) -> None:
    (folder / "desk" / "photos").mkdir(parents=True)
    (folder / "truth.txt").write_text("")
    found = files_of(Entry("a", "desk", truth="truth.txt", queries="photos"), folder)
    assert (found.truth, found.queries) == (folder / "truth.txt", folder / "desk" / "photos")
    assert found.camera is None


def test_a_camera_is_a_preset_or_a_file(folder: Path) -> None:
    (folder / "desk").mkdir()
    preset = files_of(Entry("a", "desk", camera="tum_fr2"), folder).camera
    assert preset is not None
    assert read_color(preset).fx == 520.9
    (folder / "mine.toml").write_text("")
    mine = files_of(Entry("a", "desk", camera="mine.toml"), folder).camera
    assert mine == folder / "mine.toml"


@pytest.mark.parametrize("key", ["capture", "camera", "truth", "queries"])
def test_a_missing_file_is_named_with_the_places_that_were_searched(folder: Path, key: str) -> None:
    (folder / "desk").mkdir()
    given = {"capture": "desk"} | {key: "missing"}
    with pytest.raises(CaptureError, match=f"expected the {key} of a at ") as caught:
        files_of(Entry("a", **given), folder)  # type: ignore[arg-type]
    for place in (folder, folder.parent / "fetched"):
        assert str(place / "missing") in str(caught.value)

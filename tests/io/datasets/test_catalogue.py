import tomllib
from importlib import resources

import pytest

from vnav.config import Config, load, updated
from vnav.errors import DatasetError
from vnav.io.datasets.catalogue import catalogue, named
from vnav.io.formats.camera_file import preset_camera

KNOWN = {sequence.name: sequence for sequence in catalogue()}
SUITES = [
    tomllib.loads(file.read_text("utf-8"))
    for file in sorted(resources.files("vnav.datasets").iterdir(), key=str)
    if file.name.endswith(".toml") and file.name != "catalogue.toml"
]


def test_the_47_sequences_of_the_benchmarks_table_are_known() -> None:
    with_truth = [name for name, sequence in KNOWN.items() if sequence.truth]
    counts = [sum(f"freiburg{k}_" in name for name in with_truth) for k in (1, 2, 3)]
    assert counts == [9, 18, 20]
    assert len(KNOWN) == len(catalogue())


def test_an_address_is_base_camera_and_name() -> None:
    (sequence,) = named(catalogue("http://mirror/tum/"), ["fr2/desk"])
    assert sequence.url == "http://mirror/tum/freiburg2/rgbd_dataset_freiburg2_desk.tgz"
    assert KNOWN[sequence.name].url.startswith("https://cvg.cit.tum.de/rgbd/dataset/freiburg2/")


def test_every_sequence_has_a_preset_with_its_camera() -> None:
    for name, sequence in KNOWN.items():
        preset = load(sequence.config).capture.preset_camera
        assert preset_camera(preset).units_per_metre == 5000
        assert preset[-1] == name.removeprefix("rgbd_dataset_freiburg")[0]


def test_freiburg2_says_that_its_depth_is_long() -> None:
    wrong = {s.name[21] for s in KNOWN.values() if "4 % long" in s.depth}
    assert wrong == {"2"}


def test_names_short_names_and_patterns_name_sequences_once() -> None:
    chosen = named(KNOWN.values(), ["fr1/desk", "rgbd_dataset_freiburg1_desk", "fr1/desk*"])
    assert [s.short_name for s in chosen] == ["fr1/desk", "fr1/desk2"]


def test_a_sequence_without_truth_is_only_named_outright() -> None:
    assert named(KNOWN.values(), ["fr1/desk_validation"])
    assert all(sequence.truth for sequence in named(KNOWN.values(), ["fr*"]))


def test_an_unknown_name_is_told_with_the_nearest() -> None:
    with pytest.raises(DatasetError, match="did you mean 'fr1/desk'"):
        named(KNOWN.values(), ["fr1/deks"])


def test_the_suites_hold_every_sequence_with_truth() -> None:
    rows = {row["name"]: row for suite in SUITES for row in suite["sequence"]}
    plain = [row["capture"] for row in rows.values() if "settings" not in row]
    assert sorted(plain) == sorted(name for name, s in KNOWN.items() if s.truth)
    for name, row in rows.items():
        sequence = KNOWN[row["capture"]]
        assert name.removesuffix("-5208") == sequence.short_name
        assert row["config"] == sequence.config


def test_freiburg2_is_also_evaluated_with_the_depth_that_its_peer_used() -> None:
    rows = [row for suite in SUITES for row in suite["sequence"] if "settings" in row]
    assert {row["name"] for row in rows} == {"fr2/xyz-5208", "fr2/desk-5208"}
    for row in rows:
        assert updated(Config(), row["settings"], "").capture.units_per_metre == 5208
        assert [peer["system"] for peer in row["peers"]] == ["ORB-SLAM2"]


def test_published_figures_are_metres_and_name_their_source() -> None:
    peers = [p for suite in SUITES for row in suite["sequence"] for p in row.get("peers", [])]
    assert {p["system"] for p in peers} >= {"ORB-SLAM2", "ORB-SLAM3", "RTAB-Map", "DynaSLAM"}
    assert all(0.001 < p["ate_m"] < 1 and p["source"] for p in peers)

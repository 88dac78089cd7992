"""vnav tracks, on a rendered capture."""

import json
from pathlib import Path

from click.testing import CliRunner

from vnav.cli.main import cli
from vnav.config.registries import TRACKERS


def test_a_line_for_each_tracker_is_printed_and_a_picture_drawn(
    tiny_capture: Path, tmp_path: Path
) -> None:
    picture = tmp_path / "tracks.png"
    result = CliRunner().invoke(cli, ["tracks", str(tiny_capture), "3", "4", "--png", str(picture)])
    assert result.exit_code == 0, result.output
    head, *lines = result.stdout.splitlines()
    assert head.split()[:5] == ["tracker", "points", "found", "precision", "recall"]
    assert [line.split()[0] for line in lines] == sorted(TRACKERS)
    assert picture.stat().st_size > 10_000


def test_the_table_is_one_json_array(tiny_capture: Path) -> None:
    result = CliRunner().invoke(cli, ["tracks", str(tiny_capture), "4", "3", "--json"])
    rows = json.loads(result.stdout)
    assert [row["tracker"] for row in rows] == sorted(TRACKERS)
    assert all(0 < row["precision"] <= 1 for row in rows)

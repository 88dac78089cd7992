"""Every command line that README and docs show is run.

A ``console`` block's lines that begin with "$ " are run in order, a document in one folder, where
my_capture, my_other_capture, my_recording.bag, board_photos, photo.jpg, goal.jpg and my_suite.toml
lie; each must exit with 0.
``sh`` blocks need a network, or minutes, and are not run.
"""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.io.recordings.bags import recorded, write_ros1

ROOT = Path(__file__).parent.parent
DOCUMENTS = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]

SUITE = """
[[sequence]]
name = "mine"
capture = "my_capture"
settings.features.max_features = 300
"""


def commands(document: Path) -> list[str]:
    blocks = re.findall(r"^```console\n(.*?)^```", document.read_text("utf-8"), re.M | re.S)
    return [line[2:] for block in blocks for line in block.splitlines() if line.startswith("$ ")]


@pytest.mark.slow
@pytest.mark.parametrize(
    "document", [d for d in DOCUMENTS if commands(d)], ids=lambda document: document.name
)
def test_the_commands_of_a_document_run(
    document: Path, short_capture: Path, other_capture: Path, board_photos: Path, tmp_path: Path
) -> None:
    (tmp_path / "my_capture").symlink_to(short_capture)
    (tmp_path / "my_other_capture").symlink_to(other_capture)
    shutil.copytree(board_photos, tmp_path / "board_photos")
    write_ros1(tmp_path / "my_recording", recorded(short_capture, 12))
    photos = sorted((short_capture / "photos").glob("*.jpg"))
    for name, photo in zip(("photo.jpg", "goal.jpg"), photos, strict=False):
        shutil.copy(photo, tmp_path / name)
    shutil.copy(short_capture / "photos" / "camera.toml", tmp_path)
    (tmp_path / "my_suite.toml").write_text(SUITE)
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    for command in commands(document):
        done = subprocess.run(
            ["bash", "-c", command],
            cwd=tmp_path,
            env=os.environ | {"PATH": path},
            text=True,
            capture_output=True,
        )
        assert done.returncode == 0, f"$ {command}\n{done.stdout}{done.stderr}"


def test_the_readme_shows_commands() -> None:
    assert len(commands(ROOT / "README.md")) >= 4


def test_the_readme_names_every_command() -> None:
    from vnav.cli.main import COMMANDS

    text = (ROOT / "README.md").read_text("utf-8")
    assert not [name for section in COMMANDS.values() for name in section if name not in text]

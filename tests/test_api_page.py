"""Every example of docs/api.md runs, one after the other, as the page says."""

import re
import shutil
from pathlib import Path

import pytest

from tests.io.recordings.bags import recorded, write_ros1

pytestmark = pytest.mark.slow

PAGE = Path(__file__).parent.parent / "docs" / "api.md"


def test_the_examples_of_the_api_page_run(
    tmp_path: Path,
    short_capture: Path,
    other_capture: Path,
    board_photos: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    (tmp_path / "my_capture").symlink_to(short_capture)
    (tmp_path / "my_other_capture").symlink_to(other_capture)
    (tmp_path / "board_photos").symlink_to(board_photos)
    write_ros1(tmp_path / "my_recording", recorded(short_capture, 3))
    for name, source in {"photo": "000", "goal": "001"}.items():
        shutil.copy(short_capture / "photos" / f"{source}.jpg", tmp_path / f"{name}.jpg")
    shutil.copy(short_capture / "photos" / "camera.toml", tmp_path)
    monkeypatch.chdir(tmp_path)
    examples = re.findall(r"^```python\n(.*?)^```$", PAGE.read_text("utf-8"), re.M | re.S)
    assert len(examples) > 8
    names: dict[str, object] = {}
    for example in examples:
        exec(compile(example, str(PAGE), "exec"), names)  # noqa: S102
    assert (tmp_path / "path.png").is_file()
    assert (tmp_path / "out" / "cloud.ply").is_file()
    assert names["answer"].located  # type: ignore[attr-defined]
    assert names["path"].found is not None  # type: ignore[attr-defined]

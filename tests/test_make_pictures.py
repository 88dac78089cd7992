"""docs/make_pictures.py, which `make pictures` runs: with a small map in the demo's place."""

import shutil
from pathlib import Path
from types import ModuleType, SimpleNamespace

import pytest

import vnav
from tests.scripts import loaded

SCRIPT = Path(__file__).parent.parent / "docs" / "make_pictures.py"


@pytest.fixture
def make_pictures() -> ModuleType:
    return loaded(SCRIPT)


def test_every_picture_of_the_docs_can_be_drawn(
    make_pictures: ModuleType,
    whole_map: Path,
    tiny_capture: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    shutil.copytree(whole_map, tmp_path / "map")
    mapped = vnav.open_map(tmp_path / "map")
    mapped.report()
    ends = [mapped.locate(tiny_capture / "photos" / f"00{k}.jpg") for k in (0, 1)]
    mapped.draw_plan(mapped.plan(*ends), tmp_path / "path.png")
    monkeypatch.setattr(make_pictures.demo, "run", lambda *_: SimpleNamespace(ends=ends))

    drawn = make_pictures.drawn(tmp_path)
    assert drawn.keys() == make_pictures.WIDTHS_PX.keys()
    assert all(path.is_file() for path in drawn.values())

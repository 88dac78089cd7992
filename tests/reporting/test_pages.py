"""report.html is one page that needs nothing else."""

import base64
import re
import shutil
from html.parser import HTMLParser
from pathlib import Path

import cv2
import numpy as np
import pytest

from vnav.io.store.map_folder import MapFolder
from vnav.reporting import map_page as report

VOID = {"meta", "img", "br", "input"}
LICENCE = re.compile(r"/\*!.*?\*/", re.DOTALL)


class Page(HTMLParser):
    """Checks that tags close in order; keeps texts and what is linked."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.texts: list[str] = []
        self.links: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.links += [value or "" for name, value in attrs if name in ("src", "href")]
        assert tag not in ("link", "iframe")
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.texts.append(data.strip())


@pytest.fixture(scope="module")
def root(fused_map: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy with a warning in which somebody wrote markup."""
    root = tmp_path_factory.mktemp("reported") / "map"
    shutil.copytree(fused_map, root)
    folder = MapFolder(root)
    warnings = {"warnings": ["<b>bold</b> & loud"], "lines": ["one line"]}
    folder.write_report("odometry", {"stage": "odometry", "seconds": 1.0} | warnings)
    return root


@pytest.fixture(scope="module")
def page(root: Path) -> Page:
    path = report.write(MapFolder(root))
    assert path == root / "reports" / "report.html"
    return Page(path.read_text("utf-8"))


def test_every_tag_is_closed(page: Page) -> None:
    assert page.open == []


def test_pictures_are_inlined(page: Page) -> None:
    kinds = [link.partition(",")[0] for link in page.links]
    assert kinds == [f"data:image/{kind};base64" for kind in ("png", "png", "jpeg")]
    for link in page.links:
        data = base64.b64decode(link.partition(",")[2], validate=True)
        assert cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR).shape[1] > 500


def test_numbers_lost_spans_loops_and_stages_are_told(page: Page) -> None:
    assert {"59 of 60", "1 of 2", "12"} <= set(page.texts)
    assert {"7 to 7", "too dark", "rejected: too few inliers"} <= set(page.texts)
    assert {"odometry", "fuse", "current", "missing", "one line"} <= set(page.texts)


def test_text_is_no_markup(page: Page) -> None:
    assert any("<b>bold</b> & loud" in text for text in page.texts)


def test_the_verdict_stands_first(posed_map: Path, tmp_path: Path) -> None:
    shutil.copytree(posed_map, tmp_path / "map")
    folder = MapFolder(tmp_path / "map")
    for doubts, title in (
        ([], "Good map"),
        (["frames 3 to 9 bend: go there again"], "Doubtful map"),
    ):
        values = {"verdict": "any", "doubts": doubts, "inputs": folder.inputs_of("optimise")}
        folder.write_report("quality", {"stage": "quality", "values": values, "warnings": doubts})
        texts = [text for text in Page(report.page(folder, "", {})).texts if text]
        first = texts.index(title)
        assert texts[first - 2] == "Map of miniature"
        assert [text for text in texts if "bend" in text and "{" not in text] == doubts


def test_nothing_is_loaded_from_elsewhere(root: Path, page: Page) -> None:
    text = LICENCE.sub("", (root / "reports" / "report.html").read_text("utf-8"))
    assert not re.search(r"https?:|url\(|@import|\bimport\b|fetch\(|XMLHttpRequest|WebSocket", text)


def test_the_library_of_the_view_comes_with_its_licence(root: Path, page: Page) -> None:
    found = LICENCE.findall((root / "reports" / "report.html").read_text("utf-8"))
    assert len(found) == 1
    assert "ogl 1.0.11" in found[0]
    assert "released into the public domain" in found[0]


def test_a_name_with_markup_is_text(posed_map: Path, tmp_path: Path) -> None:
    shutil.copytree(posed_map, tmp_path / "map")
    folder, name = MapFolder(tmp_path / "map"), "<script>alert(1)&lt;"
    folder.set_captures([{**folder.captures[0], "name": name}])
    text = report.page(folder, "", {})
    assert "<script>alert" not in text
    assert f"Map of {name}" in Page(text).texts


def test_a_map_that_is_not_fused_is_reported_without_pictures(
    posed_map: Path, tmp_path: Path
) -> None:
    shutil.copytree(posed_map, tmp_path / "map")
    page = Page(report.page(MapFolder(tmp_path / "map"), "", {}))
    assert not page.links
    assert "No pictures: the map is not fused yet." in page.texts


def test_an_empty_map_is_reported(tmp_path: Path) -> None:
    page = Page(report.page(MapFolder.create(tmp_path / "map"), "", {}))
    assert "A map without captures" in page.texts

"""report.html is one page that needs nothing else."""

import base64
import re
import shutil
from html.parser import HTMLParser
from pathlib import Path

import pytest

from vnav.io.store.map_folder import MapFolder
from vnav.reporting import map_page as report

VOID = {"meta", "img", "br"}


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
        assert tag not in ("script", "link", "iframe")
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
    assert len(page.links) == 3
    for link in page.links:
        kind, _, data = link.partition(",")
        assert kind == "data:image/png;base64"
        assert base64.b64decode(data, validate=True).startswith(b"\x89PNG")


def test_numbers_lost_spans_loops_and_stages_are_told(page: Page) -> None:
    assert {"59 of 60", "1 of 2", "12"} <= set(page.texts)
    assert {"7 to 7", "too dark", "rejected: too few inliers"} <= set(page.texts)
    assert {"odometry", "fuse", "current", "missing", "one line"} <= set(page.texts)


def test_text_is_no_markup(page: Page) -> None:
    assert any("<b>bold</b> & loud" in text for text in page.texts)


def test_nothing_is_loaded_from_elsewhere(root: Path, page: Page) -> None:
    text = (root / "reports" / "report.html").read_text("utf-8")
    assert not re.search(r"https?://|url\(|@import", text)


def test_a_map_that_is_not_fused_is_reported_without_pictures(
    posed_map: Path, tmp_path: Path
) -> None:
    shutil.copytree(posed_map, tmp_path / "map")
    page = Page(report.page(MapFolder(tmp_path / "map")))
    assert not page.links
    assert "No pictures: the map is not fused yet." in page.texts


def test_an_empty_map_is_reported(tmp_path: Path) -> None:
    page = Page(report.page(MapFolder.create(tmp_path / "map")))
    assert "A map without captures" in page.texts

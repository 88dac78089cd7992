"""The site of the documentation: every page is in it, and it needs no network."""

import re
import shutil
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
import yaml

from tests.browser import CHROMIUM, Browser
from tests.scripts import loaded
from tests.test_docs import PAGES, ROOT

MISSING = "needs mkdocs-material (pip install '.[docs]')"
LOADED = {"link": "href", "script": "src", "img": "src", "iframe": "src", "source": "src"}


class Page(HTMLParser):
    """What a page loads when it is opened."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.loaded = list[str]()
        self.feed(path.read_text("utf-8"))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.loaded += [value or "" for name, value in attrs if LOADED.get(tag) == name]


def listed(entry: Any) -> Iterator[str]:
    """The pages that a part of the navigation names."""
    if isinstance(entry, str):
        yield entry
    else:
        for part in entry.values() if isinstance(entry, dict) else entry:
            yield from listed(part)


def test_the_navigation_lists_every_page_once() -> None:
    config = yaml.safe_load((ROOT / "docs/site/mkdocs.yml").read_text("utf-8"))
    pages = sorted(page.relative_to(ROOT).as_posix() for page in PAGES)
    assert sorted(listed(config["nav"])) == pages


@pytest.fixture(scope="module")
def make_site() -> ModuleType:
    return loaded(ROOT / "docs" / "make_site.py")


@pytest.fixture(scope="module")
def site(make_site: ModuleType, tmp_path_factory: pytest.TempPathFactory) -> dict[Path, Page]:
    """The pages of the site, built strictly."""
    pytest.importorskip("material", reason=MISSING)
    index = make_site.build(tmp_path_factory.mktemp("site"))
    return {path: Page(path) for path in index.parent.rglob("*.html") if path.stem != "404"}


def test_every_page_is_built(site: dict[Path, Page]) -> None:
    names = {path.stem for path in site}
    assert names == {"index", *(page.stem for page in PAGES if page.name != "README.md")}


def test_a_page_loads_nothing_from_a_network(site: dict[Path, Page]) -> None:
    for path, page in site.items():
        assert page.loaded
        for target in page.loaded:
            assert (path.parent / target.partition("?")[0]).is_file(), f"{path}: {target}"
    (first,) = (path for path in site if path.stem == "index")
    for style in first.parent.rglob("*.css"):
        assert not re.search(r"(?:url\(|@import)\s*[\"']?https?:", style.read_text("utf-8")), style


def test_a_link_to_a_heading_that_is_not_there_stops_the_site(
    make_site: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("material", reason=MISSING)
    shutil.copytree(ROOT / "docs" / "site", tmp_path / "docs" / "site")
    config = tmp_path / "docs" / "site" / "mkdocs.yml"
    nav = re.compile(r"^nav:$.*?(?=^theme:)", re.M | re.S)
    config.write_text(nav.sub("nav: [README.md]\n", config.read_text("utf-8")))
    (tmp_path / "README.md").write_text("# One\n\n## A heading\n\n[well](#a-heading)\n")
    monkeypatch.setattr(make_site, "ROOT", tmp_path)
    make_site.build(tmp_path / "build")
    (tmp_path / "README.md").write_text("# One\n\n## Another heading\n\n[ill](#a-heading)\n")
    with pytest.raises(SystemExit):
        make_site.build(tmp_path / "build")


@pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium (apt install chromium)")
def test_a_phone_shows_the_site_from_the_disk(site: dict[Path, Page], tmp_path: Path) -> None:
    """No page is wider than the screen, none has an error, and the search finds something."""
    browser = Browser(tmp_path)
    for path in site:
        browser.show(path.as_uri(), 375, 800)
        assert browser.run("document.documentElement.scrollWidth") == 375, path
        assert not browser.said, path
    browser.ask("Page.navigate", url=f"{path.as_uri()}?q=keyframe")
    found = "document.querySelector('.md-search-result__item')"
    waiting = f"const wait = () => {found} ? done(true) : setTimeout(wait, 20)"
    assert browser.run(f"new Promise((done) => {{ {waiting}; wait(); }})")
    browser.close()

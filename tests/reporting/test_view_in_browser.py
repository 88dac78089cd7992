"""The 3D view of a map in Chromium, WebGL by software: skipped where there is no Chromium."""

import shutil
from collections.abc import Iterator
from pathlib import Path
from threading import Thread
from urllib.parse import unquote, urlsplit

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.browser import CHROMIUM, LOADED, Browser
from vnav.io.store.map_folder import MapFolder
from vnav.reporting import map_page, map_pictures, map_server, scene
from vnav.reporting.map_server import MapServer

SOFTWARE_GL = ("--use-angle=swiftshader", "--enable-unsafe-swiftshader")
FRAME = "new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))"

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium (apt install chromium)")


@pytest.fixture(scope="module")
def report(fused_map: Path, tmp_path_factory: pytest.TempPathFactory) -> str:
    root = tmp_path_factory.mktemp("viewed") / "map"
    shutil.copytree(fused_map, root)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(scene, "MOST_POINTS", 30_000)  # quick by software
        return map_page.write(MapFolder(root)).as_uri()


@pytest.fixture(scope="module")
def server(fused_map: Path) -> Iterator[MapServer]:
    with MapServer(MapFolder(fused_map)) as server, pytest.MonkeyPatch.context() as patch:
        patch.setattr(map_pictures, "drawn", lambda _folder: {})  # takes long
        thread = Thread(target=server.serve_forever, args=(0.05,))
        thread.start()
        yield server
        server.shutdown()
        thread.join()


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    browser = Browser(tmp_path_factory.mktemp("profile"), *SOFTWARE_GL)
    yield browser
    browser.close()


def view_of(browser: Browser) -> NDArray[np.uint8]:
    """The part of the window that the 3D view fills, BGR."""
    box = browser.run(
        "(() => { const box = document.querySelector('#view canvas')"
        ".getBoundingClientRect(); return [box.x, box.y, box.width, box.height] })()"
    )
    x, y, width, height = (int(value) for value in box)
    return browser.picture()[y : y + height, x : x + width]


def shares(view: NDArray[np.uint8], background: NDArray[np.uint8]) -> float:
    """How much of a view is not background."""
    return float((np.abs(view.astype(int) - background).max(2) > 8).mean())


def test_the_map_is_drawn_and_nothing_complains(report: str, browser: Browser) -> None:
    browser.show(report, 800, 600)
    assert browser.said == []
    view = view_of(browser)
    assert len(np.unique(view.reshape(-1, 3), axis=0)) > 1000  # colours of a cloud
    assert 0.1 < shares(view, view[20, 20]) < 0.9


def test_layers_keys_and_touch_change_what_is_drawn(report: str, browser: Browser) -> None:
    browser.show(report, 800, 600)

    def changed(action: str) -> float:
        before = view_of(browser)
        browser.run(action)
        browser.run(FRAME)
        return shares(view_of(browser), before)

    canvas = "document.querySelector('#view canvas')"
    assert changed("0") == 0
    key = canvas + ".dispatchEvent(new KeyboardEvent('keydown', {key: '%s', shiftKey: %s}))"
    for name, shift in (
        ("t", "false"),
        ("ArrowLeft", "false"),
        ("ArrowUp", "true"),
        ("+", "false"),
    ):
        assert changed(key % (name, shift)) > 0.02, name
    one, two = {"x": 400, "y": 400, "id": 1}, {"x": 300, "y": 400, "id": 2}
    for fingers in ([one], [one, two]):
        before, moved = view_of(browser), [fingers[0] | {"x": 500}, *fingers[1:]]
        for kind, points in (("Start", fingers), ("Move", moved), ("End", [])):
            browser.ask("Input.dispatchTouchEvent", type=f"touch{kind}", touchPoints=points)
        browser.run(FRAME)
        assert shares(view_of(browser), before) > 0.02, fingers
    assert changed("document.querySelector('[data-layer=cloud]').click()") > 0.1
    assert browser.said == []


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_a_narrow_page_does_not_scroll_sideways(report: str, browser: Browser, scheme: str) -> None:
    browser.show(report, 375, 800, scheme)
    assert browser.run("document.documentElement.scrollWidth") <= 375
    assert (view_of(browser)[20, 20].mean() > 128) == (scheme == "light")
    assert browser.said == []


def test_the_surface_of_the_report_is_drawn_when_it_is_switched_on(
    report: str, browser: Browser
) -> None:
    browser.show(report, 800, 600)
    browser.run("document.querySelector('[data-layer=cloud]').click()")
    browser.run(FRAME)
    before = view_of(browser)
    browser.run("document.querySelector('[data-layer=mesh]').click()")
    browser.run(FRAME)
    assert shares(view_of(browser), before) > 0.1
    assert browser.said == []


def test_a_served_cloud_is_drawn_and_its_surface_is_fetched_when_it_is_asked_for(
    server: MapServer, browser: Browser
) -> None:
    browser.show(server.address, 800, 600)
    cloud = view_of(browser)
    assert 0.1 < shares(cloud, cloud[20, 20]) < 0.9
    names = "performance.getEntriesByType('resource').map((a) => a.name.split('/').at(-1))"
    assert "mesh" not in browser.run(names)
    for name in ("mesh", "cloud"):
        browser.run(f"document.querySelector('[data-layer={name}]').click()")
        browser.run(LOADED)
    assert "mesh" in browser.run(names)
    surface = view_of(browser)
    assert 0.1 < shares(surface, surface[20, 20]) < 0.9
    assert browser.said == []


def test_a_served_layer_that_is_gone_is_told(
    server: MapServer, browser: Browser, monkeypatch: pytest.MonkeyPatch
) -> None:
    browser.show(server.address, 800, 600)
    monkeypatch.setattr(map_server, "LARGE", {})  # as if the map had been made anew
    browser.run("document.querySelector('[data-layer=mesh]').click()")
    browser.run(LOADED)
    told = "document.querySelector('#view [role=alert]')"
    assert map_server.GONE in browser.run(f"{told}.innerText")
    assert browser.run(f"{told}.offsetHeight") > 0
    assert not browser.run("document.querySelector('[data-layer=mesh]').checked")


def test_at_rest_the_whole_cloud_is_drawn_again(
    report: str, browser: Browser, tmp_path: Path
) -> None:
    text = Path(unquote(urlsplit(report).path)).read_text("utf-8")
    assert "AT_ONCE = 300_000" in text
    (tmp_path / "thin.html").write_text(text.replace("AT_ONCE = 300_000", "AT_ONCE = 3_000"))
    browser.show((tmp_path / "thin.html").as_uri(), 800, 600)
    before = view_of(browser)
    for name in ("ArrowLeft", "ArrowRight"):
        key = f"new KeyboardEvent('keydown', {{key: '{name}'}})"
        browser.run(f"document.querySelector('#view canvas').dispatchEvent({key})")
        browser.run(FRAME)
    browser.run("new Promise((done) => setTimeout(done, 600))")
    browser.run(FRAME)
    assert shares(view_of(browser), before) == 0


def test_without_webgl_the_sentence_is_read(report: str, tmp_path: Path) -> None:
    browser = Browser(tmp_path / "profile", "--disable-3d-apis")
    try:
        browser.show(report, 800, 600)
        seen = "getComputedStyle(document.querySelector('#view %s')).display"
        assert browser.run(seen % ".instead") == "block"
        assert browser.run(seen % "canvas") == browser.run(seen % ".controls") == "none"
    finally:
        browser.close()

"""The 3D view of report.html in Chromium, WebGL by software: skipped where there is no Chromium."""

import base64
import json
import os
import shutil
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from vnav.io.store.map_folder import MapFolder
from vnav.reporting import map_page, scene

CHROMIUM = shutil.which("chromium") or shutil.which("google-chrome")
FLAGS = ("--headless=new", "--no-sandbox", "--disable-dev-shm-usage", "--remote-debugging-pipe")
SOFTWARE_GL = ("--use-angle=swiftshader", "--enable-unsafe-swiftshader")
LATEST_S = 60.0  # for an answer of a browser on a busy machine

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium (apt install chromium)")


class Browser:
    """One page of a Chromium, led by the DevTools protocol over its pipes: JSON and a zero byte."""

    def __init__(self, profile: Path, *flags: str) -> None:
        assert CHROMIUM is not None
        theirs_in, self._out = os.pipe()
        self._in, theirs_out = os.pipe()
        command = [CHROMIUM, *FLAGS, *flags, f"--user-data-dir={profile}"]
        wired = ["bash", "-c", f'exec "$@" 3<&{theirs_in} 4>&{theirs_out}', "bash", *command]
        self._process = subprocess.Popen(
            wired, pass_fds=(theirs_in, theirs_out), stderr=subprocess.DEVNULL
        )
        os.close(theirs_in)
        os.close(theirs_out)
        self._rest, self._count, self._session = b"", 0, {}
        self.said: list[str] = []  # what the page wrote to its console, and its exceptions
        target = self.ask("Target.createTarget", url="about:blank")["targetId"]
        found = self.ask("Target.attachToTarget", targetId=target, flatten=True)
        self._session = {"sessionId": found["sessionId"]}
        for domain in ("Page", "Runtime", "Log"):
            self.ask(f"{domain}.enable")

    def ask(self, method: str, **parameters: Any) -> Any:
        """The answer to one command; what the page says meanwhile is kept."""
        self._count += 1
        asked = {"id": self._count, "method": method, "params": parameters, **self._session}
        os.write(self._out, json.dumps(asked).encode() + b"\0")
        latest = time.monotonic() + LATEST_S
        while time.monotonic() < latest:
            message = self._message()
            if message.get("id") == self._count:
                assert "error" not in message, message
                return message["result"]
            if message["method"] in ("Runtime.exceptionThrown", "Runtime.consoleAPICalled"):
                self.said.append(json.dumps(message["params"]))
            if message["method"] == "Log.entryAdded":
                self.said.append(message["params"]["entry"]["text"])
        raise TimeoutError(method)

    def _message(self) -> dict[str, Any]:
        while b"\0" not in self._rest:
            more = os.read(self._in, 1 << 20)
            assert more, "Chromium has ended"
            self._rest += more
        text, self._rest = self._rest.split(b"\0", 1)
        return dict(json.loads(text))

    def run(self, code: str) -> Any:
        """The value of an expression in the page; promises are waited for."""
        asked = {"expression": code, "awaitPromise": True, "returnByValue": True}
        found = self.ask("Runtime.evaluate", **asked)
        assert "exceptionDetails" not in found, found
        return found["result"].get("value")

    def show(self, page: Path, width: int, height: int, scheme: str = "light") -> None:
        """Load a page into a window of that size, and wait until it is drawn."""
        screen = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": width < 500}
        self.ask("Emulation.setDeviceMetricsOverride", **screen)
        features = [{"name": "prefers-color-scheme", "value": scheme}]
        self.ask("Emulation.setEmulatedMedia", features=features)
        self.said.clear()
        self.ask("Page.navigate", url=page.as_uri())
        self.run(
            "new Promise((done) => { const wait = () => document.readyState === 'complete' &&"
            " location.protocol === 'file:' ? requestAnimationFrame(() =>"
            " requestAnimationFrame(done)) : setTimeout(wait, 20); wait(); })"
        )

    def picture(self, whole: bool = False) -> NDArray[np.uint8]:
        """What is seen, BGR; of the whole page, or in the window."""
        shot = self.ask("Page.captureScreenshot", captureBeyondViewport=whole)
        data = np.frombuffer(base64.b64decode(shot["data"]), np.uint8)
        return np.asarray(cv2.imdecode(data, cv2.IMREAD_COLOR), np.uint8)

    def view(self) -> NDArray[np.uint8]:
        """The part of the window that the 3D view fills, BGR."""
        box = self.run(
            "(() => { const box = document.querySelector('#view canvas')"
            ".getBoundingClientRect(); return [box.x, box.y, box.width, box.height] })()"
        )
        x, y, width, height = (int(value) for value in box)
        return self.picture()[y : y + height, x : x + width]

    def close(self) -> None:
        """End the browser."""
        self._process.terminate()
        self._process.wait(LATEST_S)
        os.close(self._out)
        os.close(self._in)


@pytest.fixture(scope="module")
def report(fused_map: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("viewed") / "map"
    shutil.copytree(fused_map, root)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(scene, "MOST_POINTS", 30_000)  # quick by software
        return map_page.write(MapFolder(root))


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    browser = Browser(tmp_path_factory.mktemp("profile"), *SOFTWARE_GL)
    yield browser
    browser.close()


def shares(view: NDArray[np.uint8], background: NDArray[np.uint8]) -> float:
    """How much of a view is not background."""
    return float((np.abs(view.astype(int) - background).max(2) > 8).mean())


def test_the_map_is_drawn_and_nothing_complains(report: Path, browser: Browser) -> None:
    browser.show(report, 800, 600)
    assert browser.said == []
    view = browser.view()
    assert len(np.unique(view.reshape(-1, 3), axis=0)) > 1000  # colours of a cloud
    assert 0.1 < shares(view, view[20, 20]) < 0.9


def test_layers_keys_and_touch_change_what_is_drawn(report: Path, browser: Browser) -> None:
    browser.show(report, 800, 600)
    frame = "new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))"

    def changed(action: str) -> float:
        before = browser.view()
        browser.run(action)
        browser.run(frame)
        return shares(browser.view(), before)

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
        before, moved = browser.view(), [fingers[0] | {"x": 500}, *fingers[1:]]
        for kind, points in (("Start", fingers), ("Move", moved), ("End", [])):
            browser.ask("Input.dispatchTouchEvent", type=f"touch{kind}", touchPoints=points)
        browser.run(frame)
        assert shares(browser.view(), before) > 0.02, fingers
    assert changed("document.querySelector('[data-layer=cloud]').click()") > 0.1
    assert browser.said == []


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_a_narrow_page_does_not_scroll_sideways(
    report: Path, browser: Browser, scheme: str
) -> None:
    browser.show(report, 375, 800, scheme)
    assert browser.run("document.documentElement.scrollWidth") <= 375
    assert (browser.view()[20, 20].mean() > 128) == (scheme == "light")
    assert browser.said == []


def test_without_webgl_the_sentence_is_read(report: Path, tmp_path: Path) -> None:
    browser = Browser(tmp_path / "profile", "--disable-3d-apis")
    try:
        browser.show(report, 800, 600)
        seen = "getComputedStyle(document.querySelector('#view %s')).display"
        assert browser.run(seen % ".instead") == "block"
        assert browser.run(seen % "canvas") == browser.run(seen % ".controls") == "none"
    finally:
        browser.close()

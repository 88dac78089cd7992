"""A Chromium that tests lead, where there is one."""

import base64
import json
import os
import shutil
import subprocess
import time
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

CHROMIUM = shutil.which("chromium") or shutil.which("google-chrome")
FLAGS = ("--headless=new", "--no-sandbox", "--disable-dev-shm-usage", "--remote-debugging-pipe")
LOADED = (
    "new Promise((done) => { const wait = () => document.querySelector('.loading') ?"
    " setTimeout(wait, 20) : requestAnimationFrame(() => requestAnimationFrame(done)); wait(); })"
)
LATEST_S = 60.0  # for an answer of a browser on a busy machine


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

    def show(self, page: str, width: int, height: int, scheme: str = "light") -> None:
        """Load the page of an address into a window of that size, and wait until it is drawn."""
        screen = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": width < 500}
        self.ask("Emulation.setDeviceMetricsOverride", **screen)
        features = [{"name": "prefers-color-scheme", "value": scheme}]
        self.ask("Emulation.setEmulatedMedia", features=features)
        self.said.clear()
        self.ask("Page.navigate", url="about:blank")
        self.ask("Page.navigate", url=page)
        self.run(
            "new Promise((done) => { const wait = () => document.readyState === 'complete' &&"
            f" location.href === '{page}' ? done() : setTimeout(wait, 20); wait(); }})"
        )
        self.run(LOADED)

    def picture(self, whole: bool = False) -> NDArray[np.uint8]:
        """What is seen, BGR; of the whole page, or in the window."""
        shot = self.ask("Page.captureScreenshot", captureBeyondViewport=whole)
        data = np.frombuffer(base64.b64decode(shot["data"]), np.uint8)
        return np.asarray(cv2.imdecode(data, cv2.IMREAD_COLOR), np.uint8)

    def close(self) -> None:
        """End the browser."""
        self._process.terminate()
        self._process.wait(LATEST_S)
        os.close(self._out)
        os.close(self._in)

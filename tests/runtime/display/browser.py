"""Headless Chromium, driven over its own debugging line."""

import base64
import json
import os
import shutil
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import httpx
import pytest
from websockets.sync.client import ClientConnection, connect


def chromium() -> str:
    """The program; without it the test skips, except on the build server, where it must be there."""
    found = shutil.which("chromium")
    if found is None:
        if os.environ.get("CI"):
            pytest.fail("chromium is not installed: the page cannot be tested")
        pytest.skip("chromium is not installed: the page was NOT tested in a browser")
    return found


class Tab:
    """One page of a browser.

    Attributes:
        requested: addresses that were asked for since the tab was opened, data addresses left out.
        complaints: what the page wrote to its console, and exceptions.
    """

    def __init__(self, line: ClientConnection) -> None:
        self._line = line
        self._number = 0
        self.requested: list[str] = []
        self.complaints: list[str] = []
        for domain in ("Page", "Network", "Runtime", "Log"):
            self.call(f"{domain}.enable")

    def call(self, method: str, **parameters: Any) -> dict[str, Any]:
        """A command of the debugging protocol, and its result."""
        self._number += 1
        self._line.send(json.dumps({"id": self._number, "method": method, "params": parameters}))
        while True:
            said = json.loads(self._line.recv(timeout=30.0))
            if said.get("id") == self._number:
                assert "error" not in said, said["error"]
                result: dict[str, Any] = said["result"]
                return result
            self._note(said)

    def open(self, url: str, width: int, height: int, *, dark: bool = False) -> None:
        """Go to an address in a window of a size in pixels."""
        self.call("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=False)
        scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        self.call("Emulation.setEmulatedMedia", features=[scheme])
        self.call("Page.navigate", url=url)

    def evaluate(self, expression: str) -> Any:
        """The value of an expression in the page."""
        result = self.call("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        assert "exceptionDetails" not in result, result["exceptionDetails"]
        return result["result"].get("value")

    def wait_for(self, expression: str, most_s: float = 10.0) -> None:
        """Until an expression is true in the page."""
        end_s = time.monotonic() + most_s
        # While a page is loading there is nothing to ask.
        guarded = f"(() => {{ try {{ return Boolean({expression}) }} catch {{ return false }} }})()"
        while not self.evaluate(guarded):
            assert time.monotonic() < end_s, f"{expression} did not come true: {self.text('body')}"
            time.sleep(0.02)

    def text(self, selector: str) -> str:
        """What can be read in an element."""
        return str(self.evaluate(f"document.querySelector({json.dumps(selector)}).innerText"))

    def picture(self) -> bytes:
        """The window as PNG."""
        return base64.b64decode(self.call("Page.captureScreenshot", format="png")["data"])

    def _note(self, said: dict[str, Any]) -> None:
        parameters = said.get("params", {})
        if said["method"] == "Network.requestWillBeSent":
            self.requested.append(parameters["request"]["url"])
        elif said["method"] == "Network.webSocketCreated":
            self.requested.append(parameters["url"])
        elif said["method"] == "Log.entryAdded":
            self.complaints.append(parameters["entry"]["text"])
        elif said["method"] == "Runtime.exceptionThrown":
            self.complaints.append(json.dumps(parameters["exceptionDetails"]))
        self.requested = [url for url in self.requested if not url.startswith("data:")]


@contextmanager
def open_tab() -> Iterator[Tab]:
    """A browser with one page, for as long as the block lasts."""
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        command = [chromium(), "--headless", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage"]
        command += ["--disable-background-networking", "--no-first-run", "--remote-debugging-port=0"]
        command += [f"--user-data-dir={folder}", "about:blank"]
        browser = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        try:
            port = _port(Path(folder), browser)
            with connect(f"ws://127.0.0.1:{port}/devtools/page/{_page(port)}", max_size=None) as line:
                yield Tab(line)
        finally:
            browser.terminate()
            browser.wait(20.0)


def _port(folder: Path, browser: subprocess.Popen[bytes]) -> int:
    end_s = time.monotonic() + 60.0
    said = folder / "DevToolsActivePort"
    while not said.exists() or "\n" not in said.read_text():
        assert browser.poll() is None, f"chromium ended with {browser.returncode}"
        assert time.monotonic() < end_s, "chromium does not start"
        time.sleep(0.05)
    return int(said.read_text().split("\n")[0])


def _page(port: int) -> str:
    end_s = time.monotonic() + 30.0
    while True:
        for target in httpx.get(f"http://127.0.0.1:{port}/json/list", trust_env=False).json():
            if target["type"] == "page":
                return str(target["id"])
        assert time.monotonic() < end_s, "chromium opened no page"
        time.sleep(0.05)

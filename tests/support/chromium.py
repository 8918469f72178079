"""A Chromium without a window, driven over the DevTools protocol."""

import base64
import json
import shutil
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from urllib.request import Request, urlopen

from websockets.sync.client import connect

PROGRAM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
SECONDS = 300.0  # for anything to happen


class Tab:
    """One page of the browser."""

    def __init__(self, url):
        self._socket = connect(url, max_size=None, compression=None).__enter__()
        self._number = 0
        self.errors = []
        for domain in ("Page", "Runtime", "Log"):
            self.call(f"{domain}.enable")
        self.call("Page.bringToFront")

    def call(self, method, **parameters):
        self._number += 1
        self._socket.send(json.dumps({"id": self._number, "method": method, "params": parameters}))
        while True:
            message = json.loads(self._socket.recv(SECONDS))
            if message.get("method") == "Runtime.exceptionThrown":
                self.errors.append(message["params"]["exceptionDetails"])
            if message.get("method") == "Log.entryAdded" and message["params"]["entry"]["level"] == "error":
                self.errors.append(message["params"]["entry"])
            if message.get("id") == self._number:
                assert "error" not in message, message
                return message["result"]

    def go(self, url):
        self.call("Page.navigate", url=url)

    def value(self, expression):
        """Return the value of an expression of JavaScript; None if it cannot be evaluated, as before a page loads."""
        result = self.call("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        return None if "exceptionDetails" in result else result["result"].get("value")

    def text(self, selector):
        return self.value(f"document.querySelector({json.dumps(selector)})?.textContent ?? ''")

    def wait(self, expression):
        """Return the value of an expression once it is true."""
        end = time.monotonic() + SECONDS
        while not (value := self.value(expression)):
            assert time.monotonic() < end, f"never true: {expression}; {self.errors}"
        return value

    def size(self, width, height, *, dark=False, mobile=False):
        self.call("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=mobile)
        feature = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        self.call("Emulation.setEmulatedMedia", features=[feature])

    def picture(self, path):
        Path(path).write_bytes(base64.b64decode(self.call("Page.captureScreenshot")["data"]))

    def mouse(self, kind, x, y, button="none", buttons=0):
        clicks = int(kind != "mouseMoved")
        self.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, button=button, buttons=buttons, clickCount=clicks)

    def click(self, x, y, button="left"):
        self.mouse("mousePressed", x, y, button, 1)
        self.mouse("mouseReleased", x, y, button)

    def key(self, code, key, down=True, up=True):
        if down:
            self.call("Input.dispatchKeyEvent", type="rawKeyDown", code=code, key=key)
        if up:
            self.call("Input.dispatchKeyEvent", type="keyUp", code=code, key=key)

    def choose(self, selector, path):
        """Choose a file for an input."""
        found = self.call("Runtime.evaluate", expression=f"document.querySelector({json.dumps(selector)})")
        self.call("DOM.setFileInputFiles", objectId=found["result"]["objectId"], files=[path])

    def close(self):
        self.call("Page.close")
        self._socket.close()


class Chromium:
    """A running browser, at its DevTools port."""

    def __init__(self, port):
        self._port = port

    def tab(self):
        request = Request(f"http://127.0.0.1:{self._port}/json/new?about:blank", method="PUT")
        return Tab(json.load(urlopen(request, timeout=SECONDS))["webSocketDebuggerUrl"])


@contextmanager
def chromium(folder) -> Iterator[Chromium]:
    """Run a browser with its profile in a folder."""
    assert PROGRAM
    options = [
        "--headless=new",
        "--no-sandbox",
        "--disable-gpu",
        "--no-first-run",
        "--remote-debugging-port=0",
        "--remote-allow-origins=*",
        "--disable-background-networking",
        "--disable-dev-shm-usage",
    ]
    process = subprocess.Popen([PROGRAM, *options, f"--user-data-dir={folder}"], stderr=subprocess.PIPE, text=True)
    try:
        assert process.stderr is not None
        line = next(line for line in process.stderr if line.startswith("DevTools listening on "))
        yield Chromium(int(line.split(":")[2].split("/")[0]))
    finally:
        process.terminate()
        process.wait(SECONDS)
        if process.stderr:
            process.stderr.close()

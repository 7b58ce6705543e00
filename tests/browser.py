"""A page in a headless Chromium, over its debugging pipe (DevTools protocol): what a script of a page does for a reader."""

import base64
import json
import os
import select
import shutil
import subprocess
import time
from pathlib import Path
from tempfile import TemporaryDirectory

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
WAIT = 60.0  # s


class Page:
    """An open page; `with Page(path, width) as page`, where the path is a file's or an address.

    Attributes
    ----------
    said : texts that the page's script or policy complained about
    """

    def __init__(self, path, width=1400, height=1000, dark=False, address=""):
        self._options = path, width, height, dark, address
        self.said: list[str] = []

    def __enter__(self):
        path, width, height, dark, address = self._options
        self._folder = TemporaryDirectory(ignore_cleanup_errors=True)
        (theirs, self._write), (self._read, answers) = os.pipe(), os.pipe()

        def wired():  # the browser reads commands from 3 and answers on 4
            ends = os.dup(theirs), os.dup(answers)
            os.dup2(ends[0], 3)
            os.dup2(ends[1], 4)

        self._process = subprocess.Popen(
            [CHROMIUM, "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--hide-scrollbars",
             "--disable-background-networking", "--disable-component-update", "--disable-sync", "--remote-debugging-pipe",
             f"--user-data-dir={self._folder.name}", "about:blank"],
            preexec_fn=wired, close_fds=False, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        os.close(theirs)
        os.close(answers)
        self._number, self._rest, self._session, self._loaded = 0, b"", None, False
        target = next(one for one in self.ask("Target.getTargets")["targetInfos"] if one["type"] == "page")
        self._session = self.ask("Target.attachToTarget", targetId=target["targetId"], flatten=True)["sessionId"]
        for domain in ("Page", "Runtime", "Log"):
            self.ask(f"{domain}.enable")
        self.ask("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=width < 500)
        self.ask("Emulation.setEmulatedMedia",
                 features=[{"name": "prefers-color-scheme", "value": "dark" if dark else "light"}])
        served = str(path).startswith("http://")
        self.ask("Page.navigate", url=(str(path) if served else Path(path).resolve().as_uri()) + address)
        while not self._loaded:
            self._hear(self._message())
        return self

    def __exit__(self, *_):
        self._process.kill()
        self._process.wait()
        os.close(self._read)
        os.close(self._write)
        self._folder.cleanup()

    def ask(self, method, **values):
        """What the browser answers to a command."""
        self._number += 1
        message = {"id": self._number, "method": method, "params": values}
        message |= {"sessionId": self._session} if self._session else {}
        os.write(self._write, json.dumps(message).encode() + b"\0")
        while (found := self._message()).get("id") != self._number:
            self._hear(found)
        assert "error" not in found, found
        return found["result"]

    def _message(self):
        while b"\0" not in self._rest:
            assert select.select([self._read], [], [], WAIT)[0], "the browser does not answer"
            more = os.read(self._read, 1 << 20)
            assert more, "the browser has ended"
            self._rest += more
        text, _, self._rest = self._rest.partition(b"\0")
        return json.loads(text)

    def _hear(self, message):
        name, values = message.get("method"), message.get("params", {})
        self._loaded = self._loaded or name == "Page.loadEventFired"
        if name in ("Runtime.exceptionThrown", "Log.entryAdded", "Runtime.consoleAPICalled"):
            self.said.append(json.dumps(values))

    def value(self, expression):
        """Of an expression in the page's script."""
        found = self.ask("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        assert "exceptionDetails" not in found, found
        return found["result"].get("value")

    def key(self, name, code):
        """A key, pressed and released; `code` is its number in Windows."""
        for kind in ("keyDown", "keyUp"):
            self.ask("Input.dispatchKeyEvent", type=kind, key=name, code=name, windowsVirtualKeyCode=code)

    def until(self, condition, seconds=WAIT):
        """Waits for a condition in the page's script."""
        last = time.monotonic() + seconds
        while not self.value(f"Boolean({condition})"):
            assert time.monotonic() < last, f"{condition}: not within {seconds} s; {self.said[:5]}"
            time.sleep(0.05)

    def wheel(self, x, y, turn):
        """The mouse's wheel, turned at a point; forward is below 0."""
        self.ask("Input.dispatchMouseEvent", type="mouseWheel", x=x, y=y, deltaX=0, deltaY=turn)

    def point(self, x, y):
        """The mouse, moved to a point."""
        self.ask("Input.dispatchMouseEvent", type="mouseMoved", x=x, y=y)

    def drag(self, begin, end):
        """The mouse, pressed at a point (x, y) and released at another."""
        for kind, (x, y) in (("mousePressed", begin), ("mouseMoved", end), ("mouseReleased", end)):
            self.ask("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", buttons=1, clickCount=1)

    def picture(self, path, whole=True):
        """A screenshot, PNG."""
        data = self.ask("Page.captureScreenshot", captureBeyondViewport=whole)["data"]
        Path(path).write_bytes(base64.b64decode(data))

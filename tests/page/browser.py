"""Headless Chromium, driven by its DevTools protocol over a pipe: the standard library suffices."""

import base64
import json
import os
import shutil
import subprocess
import tempfile
import time
from pathlib import Path
from typing import Any, Self

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
PATIENCE_S = 60.0
COMPLAINTS = ("Runtime.exceptionThrown", "Log.entryAdded")


class Browser:
    """A browser with one page; a context manager."""

    def __init__(self, width: int = 1280, height: int = 900, dark: bool = False) -> None:
        """A blank page of that size, in CSS pixels."""
        self._profile = tempfile.mkdtemp(prefix="midnet-bench-browser-")
        command_end, self._write = os.pipe()
        self._read, answer_end = os.pipe()
        flags = ["--headless", "--no-sandbox", "--disable-gpu", "--remote-debugging-pipe", "--no-first-run"]
        flags += [f"--user-data-dir={self._profile}", "about:blank"]
        self._process = subprocess.Popen(
            # the protocol goes over descriptors 3 and 4; not every sh knows numbers of two digits
            ["bash", "-c", f'exec "$0" "$@" 3<&{command_end} 4>&{answer_end}', CHROMIUM, *flags],
            pass_fds=(command_end, answer_end),
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        os.close(command_end)
        os.close(answer_end)
        self._number, self._rest, self._session = 0, b"", ""
        self.complaints: list[str] = []
        """what the page has thrown, and the errors in its console"""
        self.requests: list[str] = []
        """the addresses that were asked for"""
        page = next(one for one in self.send("Target.getTargets")["targetInfos"] if one["type"] == "page")
        attached = self.send("Target.attachToTarget", targetId=page["targetId"], flatten=True)
        self._session = attached["sessionId"]
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.send(f"{domain}.enable")
        self.send(
            "Emulation.setDeviceMetricsOverride",
            width=width,
            height=height,
            deviceScaleFactor=1,
            mobile=False,
        )
        scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        self.send("Emulation.setEmulatedMedia", features=[scheme])

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._process.terminate()
        self._process.wait(timeout=PATIENCE_S)
        os.close(self._write)
        os.close(self._read)
        shutil.rmtree(self._profile, ignore_errors=True)

    def send(self, method: str, **parameters: Any) -> Any:
        """What a method of the protocol answers."""
        self._number += 1
        message: dict[str, Any] = {"id": self._number, "method": method, "params": parameters}
        if self._session:
            message["sessionId"] = self._session
        os.write(self._write, json.dumps(message).encode() + b"\0")
        while True:
            answer = self._next()
            if answer.get("id") == self._number:
                assert "error" not in answer, answer
                return answer["result"]

    def _next(self) -> dict[str, Any]:
        while b"\0" not in self._rest:
            part = os.read(self._read, 1 << 20)
            assert part, "Chromium has ended"
            self._rest += part
        message, _, self._rest = self._rest.partition(b"\0")
        found: dict[str, Any] = json.loads(message)
        method, told = found.get("method", ""), found.get("params", {})
        is_error = method == "Runtime.consoleAPICalled" and told["type"] in ("error", "warning")
        if method in COMPLAINTS or is_error:
            self.complaints.append(json.dumps(told))
        if method == "Network.requestWillBeSent":
            self.requests.append(told["request"]["url"])
        return found

    def open(self, file: Path, fragment: str = "") -> None:
        """Go to a page, and wait until its player is ready."""
        self.send("Page.navigate", url=file.as_uri() + fragment)
        self.wait_for("document.querySelector('#player').dataset.ready === 'true'")

    def value(self, expression: str) -> Any:
        """What JavaScript gives on the page; None while it throws."""
        answer = self.send("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        return answer["result"].get("value") if "exceptionDetails" not in answer else None

    def wait_for(self, expression: str) -> None:
        """Until an expression is true; fails after a minute."""
        until_s = time.monotonic() + PATIENCE_S
        while self.value(expression) is not True:
            assert time.monotonic() < until_s, (expression, self.complaints)
            time.sleep(0.02)

    def press(self, key: str, code: str = "") -> None:
        """A key goes down and up again."""
        text = {"text": key} if len(key) == 1 else {}
        self.send("Input.dispatchKeyEvent", type="keyDown", key=key, code=code, **text)
        self.send("Input.dispatchKeyEvent", type="keyUp", key=key, code=code)

    def screenshot(self, file: Path, whole: bool = False) -> None:
        """What is seen, or the whole page, as a PNG file."""
        answer = self.send("Page.captureScreenshot", format="png", captureBeyondViewport=whole)
        file.write_bytes(base64.b64decode(answer["data"]))

"""Drives headless Chromium by its own protocol over a pipe: no driver, no network, no package."""

from __future__ import annotations

import fcntl
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

_FLAGS = (
    "--headless",
    "--remote-debugging-pipe",
    "--disable-gpu",
    "--disable-dev-shm-usage",
    "--disable-background-networking",
    "--disable-component-update",
    "--no-first-run",
    "--force-device-scale-factor=1",
)

# Chromium reads commands from descriptor 3 and writes answers to 4.
_JOIN = (
    "import os, sys; os.dup2(int(sys.argv[1]), 3); os.dup2(int(sys.argv[2]), 4); os.execv(sys.argv[3], sys.argv[3:])"
)


class Page:
    """One tab. Sends commands of the Chrome DevTools Protocol and keeps the events that come back."""

    def __init__(self, to_browser: int, from_browser: int) -> None:
        self._out, self._in = to_browser, from_browser
        self._buffer = b""
        self._count = 0
        self._session: str | None = None
        self.events: list[dict[str, Any]] = []
        target = self.send("Target.createTarget", url="about:blank")["targetId"]
        self._session = self.send("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        for domain in ("Page", "Runtime", "Network", "Log"):
            self.send(f"{domain}.enable")

    def send(self, method: str, **parameters: Any) -> Any:
        """The result of one command."""
        self._count += 1
        message: dict[str, Any] = {"id": self._count, "method": method, "params": parameters}
        if self._session is not None:
            message["sessionId"] = self._session
        os.write(self._out, json.dumps(message).encode() + b"\0")
        while True:
            answer = self._receive()
            if answer.get("id") == self._count:
                assert "error" not in answer, answer
                return answer["result"]
            self.events.append(answer)

    def open(self, file: Path, width: int, height: int, scheme: str = "light") -> None:
        """Load a file and wait until it is drawn."""
        self.send("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=False)
        self.send("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": scheme}])
        self.events.clear()
        self.send("Page.navigate", url=file.as_uri())
        while not any(e.get("method") == "Page.loadEventFired" for e in self.events):
            self.events.append(self._receive())
        self.run("new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))")

    def run(self, script: str) -> Any:
        """The value of an expression in the page."""
        answer = self.send("Runtime.evaluate", expression=script, returnByValue=True, awaitPromise=True)
        assert "exceptionDetails" not in answer, answer["exceptionDetails"]
        return answer["result"].get("value")

    def drag(self, start: tuple[float, float], end: tuple[float, float]) -> None:
        """Press the mouse, move it in steps, let go, and wait until what it set in motion is at rest."""

        def mouse(kind: str, at: tuple[float, float], buttons: int) -> None:
            button = "none" if kind == "mouseMoved" and not buttons else "left"
            self.send(
                "Input.dispatchMouseEvent", type=kind, x=at[0], y=at[1], button=button, buttons=buttons, clickCount=1
            )

        mouse("mouseMoved", start, 0)
        mouse("mousePressed", start, 1)
        for k in range(1, 6):
            mouse("mouseMoved", tuple(a + (b - a) * k / 5 for a, b in zip(start, end, strict=True)), 1)  # type: ignore[arg-type]
        mouse("mouseReleased", end, 0)
        self._come_to_rest()

    def _come_to_rest(self) -> None:
        """Wait for three pictures in a row that are the same: a busy machine keeps no time."""
        shown: list[str] = []
        while len(shown) < 3 or len(set(shown[-3:])) > 1:
            assert len(shown) < 1200, "the page never comes to rest"
            self.run("new Promise(done => setTimeout(done, 100))")
            shown.append(self.send("Page.captureScreenshot")["data"])

    def complaints(self) -> list[str]:
        """Errors of scripts, warnings of the browser, and requests that are neither the file nor inside it."""
        found = []
        for event in self.events:
            method, parameters = event.get("method"), event.get("params", {})
            if method == "Runtime.exceptionThrown" or (
                method == "Log.entryAdded" and parameters["entry"]["level"] in ("error", "warning")
            ):
                found.append(json.dumps(parameters))
            if method == "Network.requestWillBeSent" and not parameters["request"]["url"].startswith(
                ("file:", "data:")
            ):
                found.append(parameters["request"]["url"])
        return found

    def _receive(self) -> dict[str, Any]:
        deadline = time.monotonic() + 120
        while b"\0" not in self._buffer:
            assert time.monotonic() < deadline, "Chromium does not answer"
            part = os.read(self._in, 1 << 16)
            assert part, "Chromium ended"
            self._buffer += part
        message, _, self._buffer = self._buffer.partition(b"\0")
        answer = json.loads(message)
        assert isinstance(answer, dict)
        return answer


@contextmanager
def chromium(executable: str) -> Iterator[Page]:
    """A tab of a fresh headless Chromium, ended with the block."""
    read_commands, write_commands = (_high(fd) for fd in os.pipe())
    read_answers, write_answers = (_high(fd) for fd in os.pipe())
    # Chromium's helpers may write a last file into the profile while it is being removed
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        flags = [*_FLAGS, f"--user-data-dir={profile}", *(["--no-sandbox"] if os.geteuid() == 0 else [])]
        process = subprocess.Popen(
            [sys.executable, "-c", _JOIN, str(read_commands), str(write_answers), executable, *flags, "about:blank"],
            pass_fds=(read_commands, write_answers),
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        os.close(read_commands)
        os.close(write_answers)
        try:
            yield Page(write_commands, read_answers)
        finally:
            os.close(write_commands)
            os.close(read_answers)
            process.terminate()
            process.wait()


def _high(fd: int) -> int:
    """The descriptor moved above 3 and 4, which Chromium's pipe takes."""
    moved = fcntl.fcntl(fd, fcntl.F_DUPFD, 10)
    os.close(fd)
    return moved

"""Processes that work for the studio, heard line by line."""

from __future__ import annotations

import json
import subprocess
import sys
import threading
from collections.abc import Callable, Mapping
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from mirelight.apps.studio.worker import Ordered

_LONGEST = 1 << 20  # characters of a message
_GRACE = 5.0  # seconds


class Helper:
    """A process that carries out one order.

    Args:
        order: what is to be done.
        heard: called from a thread with each message, and with ``{"ended": True}`` after the last.
    """

    def __init__(self, order: Ordered, heard: Callable[[Mapping[str, Any]], None]) -> None:
        self._heard, self._ended_by_us = heard, False
        self._process = subprocess.Popen(
            [sys.executable, "-m", "mirelight.apps.studio.worker"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            encoding="utf-8",
            start_new_session=True,  # Ctrl-C is not its own
        )
        assert self._process.stdin is not None
        self._process.stdin.write(json.dumps(asdict(order)) + "\n")
        self._process.stdin.flush()
        self._thread = threading.Thread(target=self._listen, daemon=True)
        self._thread.start()

    def end(self) -> None:
        """End it now; what it has finished stays."""
        self._ended_by_us = True
        self._process.terminate()
        try:
            self._process.wait(_GRACE)
        except subprocess.TimeoutExpired:
            self._process.kill()
        self._thread.join(_GRACE)

    def _listen(self) -> None:
        assert self._process.stdout is not None
        failed = False
        while line := self._process.stdout.readline(_LONGEST):
            try:
                message = json.loads(line)
            except ValueError:
                continue
            failed = failed or "failed" in message
            self._heard(message)
        code = self._process.wait()
        if code and not failed and not self._ended_by_us:
            self._heard({"failed": f"its process ended without a word (code {code}); the machine may be out of memory"})
        self._heard({"ended": True})

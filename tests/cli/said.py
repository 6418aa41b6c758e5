"""What a process says while it runs, read with a limit: one that never says it fails the test, and does not hang it."""

from __future__ import annotations

import subprocess
import threading

LIMIT = 240  # seconds; a hung process is ended by then, however slow the machine is


def said_until(process: subprocess.Popen[str], text: str, limit: float = LIMIT) -> str:
    """The lines that `process` says on stderr, up to the first that holds `text`.

    Raises AssertionError with what was said where it ends without that, and where it has not said it after `limit`
    seconds: then it is killed.
    """
    assert process.stderr is not None
    late = threading.Event()

    def end() -> None:
        late.set()
        process.kill()

    timer = threading.Timer(limit, end)
    timer.start()
    lines = ""
    try:
        for line in process.stderr:
            lines += line
            if text in line:
                return lines
    finally:
        timer.cancel()
    why = f"was not said within {limit:g} s" if late.is_set() else "was never said"
    raise AssertionError(f"{text!r} {why}; stderr:\n{lines}")

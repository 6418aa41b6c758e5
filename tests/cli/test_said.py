"""What waits for a line of a process ends, whatever the process does."""

from __future__ import annotations

import subprocess
import sys

import pytest

from .said import said_until


@pytest.mark.parametrize(
    ("then", "why"),
    [("print('next', file=sys.stderr, flush=True); time.sleep(3600)", "not said within 1 s"), ("", "never said")],
    ids=["hangs", "ends"],
)
def test_what_is_never_said_ends_the_test(then: str, why: str) -> None:
    program = f"import sys, time; print('begun', file=sys.stderr, flush=True); {then}"
    with subprocess.Popen([sys.executable, "-c", program], stderr=subprocess.PIPE, text=True) as process:
        assert said_until(process, "begun") == "begun\n"
        with pytest.raises(AssertionError, match=f"'done' was {why}"):
            said_until(process, "done", limit=1)

"""What a program prints on different numbers of threads, each in a process of its own: Dr.Jit keeps its first."""

from __future__ import annotations

import os
import subprocess
import sys


def printed(program: str, *threads: str) -> set[str]:
    """What `program` prints when the number of threads is its only argument."""
    out = set()
    for count in threads:
        run = subprocess.run(
            [sys.executable, "-c", program, count],
            capture_output=True,
            text=True,
            check=False,
            env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
        )
        assert run.returncode == 0, run.stderr
        out.add(run.stdout.strip())
    return out

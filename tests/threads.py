"""Numbers of threads: the share of each process that runs tests, and what a program prints on different ones."""

from __future__ import annotations

import os
import subprocess
import sys
from types import ModuleType

import pytest

BESIDE = int(os.environ.get("PYTEST_XDIST_WORKER_COUNT", "1"))  # processes that run tests


def share_cores(patch: pytest.MonkeyPatch) -> None:
    """Let Dr.Jit begin with this process's share of the cores: with a thread for every core in each of several, all
    wait for one another, and burn a quarter more time. What a test asks for itself comes after."""
    from mirelight.base import backend
    from mirelight.batch.processes import threads_of

    load = backend._import_drjit
    begun: list[bool] = []

    def loaded() -> ModuleType:
        drjit = load()
        if not begun:
            begun.append(True)
            drjit.set_thread_count(threads_of(BESIDE))
        return drjit

    if BESIDE > 1:
        patch.setattr(backend, "_import_drjit", loaded)


def printed(program: str, *threads: str) -> set[str]:
    """What `program` prints when the number of threads is its only argument, each in a process of its own: Dr.Jit keeps
    its first."""
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

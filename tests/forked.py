"""Commands as processes of their own, forked from one that holds what they import.

Half of what a small command takes is the import of its modules, and the start of Dr.Jit and Mitsuba.
"""

from __future__ import annotations

import multiprocessing
import os
import subprocess
import sys
from functools import cache
from multiprocessing import forkserver
from multiprocessing.context import ForkServerContext
from pathlib import Path

import pytest

from mirelight.cli import main
from tests.threads import share_cores

ROOT = Path(__file__).resolve().parents[1]


def run(arguments: tuple[str, ...], folder: Path, aside: Path, timeout: float) -> subprocess.CompletedProcess[str]:
    """`mirelight` in `folder`, with this process's environment; what it prints is kept in `aside` meanwhile."""
    streams = aside / "stdout", aside / "stderr"
    process = server().Process(target=_main, args=(arguments, folder, dict(os.environ), *streams))
    process.start()
    process.join(timeout)
    if process.exitcode is None:
        process.kill()
        raise subprocess.TimeoutExpired(arguments, timeout)
    out, err = (x.read_text(encoding="utf-8") for x in streams)
    return subprocess.CompletedProcess(arguments, process.exitcode, out, err)


@cache
def server() -> ForkServerContext:
    """What forks processes; it has loaded `tests.forked_from` before the first."""
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(["tests.forked_from"])
    with pytest.MonkeyPatch.context() as patch:  # it is started wherever a test has gone
        patch.setenv("PYTHONPATH", str(ROOT), prepend=os.pathsep)
        patch.setenv("OPENBLAS_NUM_THREADS", "1")  # what forks has no thread that works
        forkserver.ensure_running()
    return context


def _main(arguments: tuple[str, ...], folder: Path, variables: dict[str, str], out: Path, err: Path) -> None:
    """The command in a process of its own, as `python -m mirelight` runs it."""
    os.chdir(folder)
    os.environ.clear()
    os.environ.update(variables)
    for number, path, flags in (
        (0, os.devnull, os.O_RDONLY),
        (1, out, os.O_CREAT | os.O_WRONLY | os.O_TRUNC),
        (2, err, os.O_CREAT | os.O_WRONLY | os.O_TRUNC),
    ):
        os.dup2(os.open(path, flags), number)
    sys.path.insert(0, str(folder))
    share_cores(pytest.MonkeyPatch())
    sys.exit(main(arguments))

"""What the commands of these tests are forked from."""

from __future__ import annotations

from multiprocessing import forkserver
from pathlib import Path

from .conftest import Run


def test_no_thread_works_where_commands_are_forked(run: Run) -> None:
    """A lock that another thread holds at a fork is never let go of in the child. Dr.Jit's one thread waits there."""
    assert run("--version").returncode == 0
    server = forkserver._forkserver._forkserver_pid  # type: ignore[attr-defined]
    assert sum(1 for _ in Path(f"/proc/{server}/task").iterdir()) == 2

"""How far one piece of work is, on a terminal."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager

from mirelight.base.progress import ShareProgress, quiet


@contextmanager
def bar(silent: bool) -> Iterator[ShareProgress]:
    """A live bar of one piece of work on a terminal; elsewhere nothing, as that takes seconds."""
    if silent or not sys.stderr.isatty():
        yield quiet
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    columns = TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn()
    with Progress(*columns, console=Console(stderr=True), transient=True) as shown:
        row = shown.add_task("reading", total=1.0)
        yield lambda what, done: shown.update(row, description=what, completed=done)

"""What the machine can give: memory, and a stretch of work that Ctrl-C waits for. Standard library alone."""

from __future__ import annotations

import gc
import os
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from types import FrameType

_GROUPS = Path("/sys/fs/cgroup")
# Files of a memory control group, version 2 and version 1: its limit, what it uses, and the line of `memory.stat` with
# the bytes of files that are only cached and give way.
_GROUP_FILES = (
    ("memory.max", "memory.current", "memory.stat", "inactive_file"),
    (
        "memory/memory.limit_in_bytes",
        "memory/memory.usage_in_bytes",
        "memory/memory.stat",
        "total_inactive_file",
    ),
)
_UNLIMITED = 1 << 60  # version 1 says so with a number near 2^63


def cores() -> int:
    """CPU cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@dataclass(frozen=True, slots=True)
class Memory:
    """Bytes, as the system tells."""

    total: int  # of the machine
    free: int  # that this process can take without swapping, within its control group
    limit: int | None  # of the control group, which is what a container has; None: no limit


def memory() -> Memory:
    """The machine's memory now. Where a system does not say what is free, all that it has counts as free."""
    total = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") if hasattr(os, "sysconf") else 1 << 62
    free, limit = total, None
    with suppress(OSError, KeyError, ValueError):
        lines = Path("/proc/meminfo").read_text(encoding="ascii").splitlines()
        free = int(dict(line.split(":", 1) for line in lines)["MemAvailable"].split()[0]) * 1024
    for names in _GROUP_FILES:
        with suppress(OSError, KeyError, ValueError):  # no such version, or no limit ("max")
            most, used = (int((_GROUPS / name).read_text(encoding="ascii")) for name in names[:2])
            if most >= _UNLIMITED:
                continue
            rows = dict(line.split() for line in (_GROUPS / names[2]).read_text(encoding="ascii").splitlines())
            free, limit = min(free, max(most - used + int(rows[names[3]]), 0)), most
            break
    return Memory(total, free, limit)


def free_memory() -> int:
    """Bytes that this process can still take without swapping: the least of what machine and control group allow."""
    return memory().free


@contextmanager
def collector_held() -> Iterator[None]:
    """Python's garbage collector waits until the block is done.

    For work in which no object may be freed that happens to be garbage just then.
    """
    ran = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if ran:
            gc.enable()


@contextmanager
def uninterrupted() -> Iterator[None]:
    """SIGINT and SIGTERM wait until the block is done, whatever would have handled them.

    For work that must be whole or not begun. Python runs signal handlers in the main thread alone, so in another thread
    there is nothing to hold back.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    waiting: list[int] = []

    def note(number: int, frame: FrameType | None) -> None:
        waiting.append(number)

    handlers = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    for of, handler in handlers.items():
        if handler is not None:  # None: not installed from Python, so nothing can be put back
            signal.signal(of, note)
    try:
        yield
    finally:
        for of, handler in handlers.items():
            if handler is not None:
                signal.signal(of, handler)
        for number in waiting:
            signal.raise_signal(number)

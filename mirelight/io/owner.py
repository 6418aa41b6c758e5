"""Which process a file in a shared folder belongs to, and whether that process still runs."""

from __future__ import annotations

import hashlib
import os
import platform
import re
from functools import cache
from pathlib import Path

_TOKEN = re.compile(r"([0-9a-f]{10})-([0-9]{1,9})")


@cache
def machine() -> str:
    """Ten hex digits of this machine since its last start; containers that number their processes apart differ."""
    parts = [platform.node()]
    for name in ("/proc/sys/kernel/random/boot_id", "/proc/self/ns/pid"):
        path = Path(name)
        try:
            parts.append(str(path.stat().st_ino) if path.is_symlink() else path.read_text(encoding="ascii"))
        except OSError:
            continue
    return hashlib.sha256("\0".join(parts).encode()).hexdigest()[:10]


def token() -> str:
    """This process: its machine and its number."""
    return f"{machine()}-{os.getpid()}"


def process_of(owner: str) -> int:
    """The process of a token; 0 for what is no token."""
    found = _TOKEN.fullmatch(owner)
    return int(found[2]) if found else 0


def runs(owner: str) -> bool | None:
    """Whether the process of a token still runs; None where that cannot be told from here (another machine's)."""
    found = _TOKEN.fullmatch(owner)
    if found is None or found[1] != machine():
        return None
    try:
        os.kill(int(found[2]), 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        return True
    return not _is_zombie(int(found[2]))


def _is_zombie(process: int) -> bool:
    """A killed process whose parent has not asked for its exit code does nothing any more."""
    try:
        status = Path(f"/proc/{process}/stat").read_text(encoding="ascii", errors="replace")
    except OSError:
        return False
    return status.rpartition(")")[2].split()[:1] == ["Z"]

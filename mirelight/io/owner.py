"""Which process a file in a shared folder belongs to, and whether that process still runs."""

from __future__ import annotations

import hashlib
import os
import platform
import re
import subprocess
import zlib
from functools import cache
from pathlib import Path

_TOKEN = re.compile(r"([0-9a-f]{10})-([0-9]{1,9})(?:-t([0-9]{1,20}))?")


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
    """This process: its machine, its number, and when it was started, where that can be told: numbers come again (in a
    container that is started anew, the first process is number 1 each time)."""
    process = os.getpid()
    start = _own_start(process)
    return f"{machine()}-{process}" + (f"-t{start}" if start else "")


def process_of(owner: str) -> int:
    """The process of a token; 0 for what is no token."""
    found = _TOKEN.fullmatch(owner)
    return int(found[2]) if found else 0


def runs(owner: str) -> bool | None:
    """Whether the process of a token still runs; None where that cannot be told from here (another machine's)."""
    found = _TOKEN.fullmatch(owner)
    if found is None or found[1] != machine():
        return None
    process = int(found[2])
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        pass  # somebody else's
    state, start = _state(process)
    if state == "Z":  # killed, and its parent has not asked for its exit code: it does nothing any more
        return False
    return not (found[3] and start) or found[3] == start


@cache
def _own_start(process: int) -> str:
    return _state(process)[1]


def _state(process: int) -> tuple[str, str]:
    """One letter, Z for a zombie, and digits that tell when a process was started; empty where that cannot be told."""
    try:
        text = Path(f"/proc/{process}/stat").read_text(encoding="ascii", errors="replace")
        fields = text.rpartition(")")[2].split()  # from the third on: the second may hold anything
        return fields[0], fields[19]
    except OSError:
        pass
    except IndexError:
        return "", ""
    if Path("/proc/self/stat").exists():
        return "", ""
    command = ["ps", "-o", "stat=", "-o", "lstart=", "-p", str(process)]
    plain = {**os.environ, "LC_ALL": "C", "TZ": "UTC"}
    try:
        told = subprocess.run(command, capture_output=True, text=True, timeout=10, check=True, env=plain).stdout
    except (OSError, ValueError, subprocess.SubprocessError):
        return "", ""
    state, _, start = told.strip().partition(" ")
    return state[:1], str(zlib.crc32(start.strip().encode())) if start.strip() else ""

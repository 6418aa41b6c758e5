"""Who works on what, among processes and machines that share a folder. No server and no file locks.

A claim is a file that only one process can make (`O_EXCL` is atomic, on NFS too). Its process touches it while it
works; a claim of a process that has ended, or that was not touched for long, is taken over by whoever renames it first.
Should two work at once all the same, they make the same files twice, and lose nothing.
"""

from __future__ import annotations

import hashlib
import json
import os
import platform
import re
import secrets
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from mirelight.io import owner
from mirelight.io.atomic import output_error
from mirelight.io.safety import NotAFileError, open_file

_TOUCH = 30.0  # seconds between two touches
_STALE = 600.0  # seconds without a touch after which another machine's process counts as gone
_LONGEST = 1 << 16  # bytes of a claim that are read
_UNSIGNED = 10.0  # seconds after which a claim without a name counts as that of a process killed while it made it


@dataclass(frozen=True, slots=True)
class Held:
    """A claim as it stands."""

    name: str  # of the work
    host: str  # name of the machine
    process: int
    age: float  # seconds since it was taken, by the folder's own clock
    silent: float  # seconds since the last sign of life
    alive: bool  # False: its process has ended, or was silent for too long; whoever comes next takes it over


class Claims:
    """The claims in a folder."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._held: set[Path] = set()
        self._toucher: threading.Thread | None = None
        self._ended = threading.Event()

    @contextmanager
    def claim(self, name: str, run: str = "") -> Iterator[bool]:
        """Whether the work of that name is this process's own until the block ends.

        Args:
            name: of the work.
            run: a word that processes share where somebody sees to it that no two do the same work at once, as a
                scheduler does: a claim of the same run is taken over, because its process has been given up.

        Raises:
            OutputError: the folder cannot be written.
        """
        path = self._path(name)
        mine = self._take(path, name, run)
        try:
            yield mine
        finally:
            if mine:
                self._held.discard(path)
                with suppress(OSError):
                    if _signed(path)[0] == owner.token():  # it may have been taken over meanwhile
                        path.unlink()

    def held(self) -> list[Held]:
        """All claims, the oldest first."""
        found: list[Held] = []
        now = self._now()
        with suppress(OSError):
            for path in self._folder.glob("[!.]*"):
                with suppress(OSError):
                    touched = path.lstat().st_mtime
                    holder, about = _signed(path)
                    running = owner.runs(holder)
                    found.append(
                        Held(
                            name=str(about.get("name", path.name)),
                            host=str(about.get("host", "an unknown machine")),
                            process=owner.process_of(holder),
                            age=max(0.0, now - _number(about.get("since"), touched)),
                            silent=max(0.0, now - touched),
                            alive=running if running is not None else now - touched <= _STALE,
                        )
                    )
        return sorted(found, key=lambda x: -x.age)

    def clear(self) -> None:
        """Take away the claims of processes that have ended: of work that was done, nobody comes for them."""
        with suppress(OSError):
            for path in self._folder.glob("[!.]*"):
                if self._abandoned(path, ""):
                    self._removed(path)

    def _path(self, name: str) -> Path:
        plain = re.sub(r"[^\w.-]+", "_", name)[:80]
        return self._folder / f"{plain}-{hashlib.sha256(name.encode()).hexdigest()[:8]}"

    def _take(self, path: Path, name: str, run: str) -> bool:
        for _ in range(2):
            try:
                handle = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o644)
            except FileExistsError:
                if not self._abandoned(path, run) or not self._removed(path):
                    return False
                continue
            except OSError as e:
                raise output_error(path, e) from None
            about = {"name": name, "host": platform.node(), "since": os.fstat(handle).st_mtime, "run": run}
            try:
                os.write(handle, f"{owner.token()}\n{json.dumps(about)}\n".encode())
            except OSError as e:
                path.unlink(missing_ok=True)
                raise output_error(path, e) from None
            finally:
                os.close(handle)
            self._hold(path)
            return True
        return False

    def _abandoned(self, path: Path, run: str) -> bool:
        try:
            holder, about = _signed(path)
            running = owner.runs(holder)
            if running is False or (run and about.get("run") == run and holder != owner.token()):
                return True
            if running:
                return False
            return self._now() - path.lstat().st_mtime > (_STALE if holder else _UNSIGNED)
        except OSError:
            return False  # it has just been given up

    def _now(self) -> float:
        """The folder's own clock: the machines' may differ."""
        probe = self._folder / f".clock~{owner.token()}-{secrets.token_hex(4)}"
        try:
            probe.touch()
            return probe.stat().st_mtime
        except OSError:
            return time.time()  # a folder that is only read
        finally:
            with suppress(OSError):
                probe.unlink()

    def _removed(self, path: Path) -> bool:
        """Takes an abandoned claim away; of several that try, one can."""
        taken = path.with_name(f".{path.name}~{owner.token()}-{secrets.token_hex(4)}")
        try:
            path.rename(taken)
        except OSError:
            return False
        with suppress(OSError):  # what is no file stays aside
            taken.unlink()
        return True

    def _hold(self, path: Path) -> None:
        self._held.add(path)
        if self._toucher is None:
            self._toucher = threading.Thread(target=self._touch, name="mirelight claims", daemon=True)
            self._toucher.start()

    def _touch(self) -> None:
        while not self._ended.wait(_TOUCH):
            for path in tuple(self._held):
                with suppress(OSError):
                    os.utime(path)

    def close(self) -> None:
        """Stop touching."""
        self._ended.set()


def _signed(path: Path) -> tuple[str, dict[str, object]]:
    """Whose a claim is, and what it says of itself; both empty where its process has not come to write that.

    Raises:
        OSError: it has been given up.
    """
    try:
        with open_file(path) as file:
            holder, _, rest = file.read(_LONGEST).decode("utf-8", "replace").partition("\n")
    except OSError as e:
        if not (isinstance(e, NotAFileError) or path.is_symlink()):
            raise
        return "", {}  # nobody's
    try:
        about = json.loads(rest)
    except (ValueError, RecursionError):
        about = {}
    return holder, about if isinstance(about, dict) else {}


def _number(value: object, otherwise: float) -> float:
    return float(value) if isinstance(value, int | float) and abs(value) < 1e15 else otherwise

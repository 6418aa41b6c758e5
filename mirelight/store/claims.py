"""Who works on what, among processes and machines that share a folder. No server and no file locks.

A claim is a file that only one process can make: a link to a file that is signed already, so that a process that is
killed leaves no claim without a name; where there are no links, a file that must be new (`O_EXCL`). Both are atomic, on
NFS too. Its process touches it while it works; a claim of a process that has ended, or that was not touched for long,
is taken over by whoever renames it first. Who has renamed one that is not what it had looked at (another was quicker,
and it is that one's now) puts it back. Should two work at once all the same, they make the same files twice, and lose
nothing.
"""

from __future__ import annotations

import hashlib
import json
import os
import platform
import re
import secrets
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from mirelight.io import owner
from mirelight.io.atomic import output_error
from mirelight.io.safety import NotAFileError, json_object, open_file
from mirelight.store.touching import Toucher

_STALE = 600.0  # seconds without a touch after which a process counts as gone, even where its number lives
_LONGEST = 1 << 16  # bytes of a claim that are read
_UNSIGNED = 10.0  # seconds after which a claim without a name counts as that of a process killed while it made it
_NEW = os.O_WRONLY | os.O_CREAT | os.O_EXCL  # a file that must not be there before
_OWN: set[str] = set()  # marks of the claims that this process holds


@dataclass(frozen=True, slots=True)
class Held:
    """A claim as it stands."""

    name: str  # of the work
    host: str  # name of the machine
    process: int
    age: float  # seconds since it was taken, by the folder's own clock
    silent: float  # seconds since the last sign of life
    alive: bool  # False: its process has ended, or was silent for too long; whoever comes next takes it over


@dataclass(frozen=True, slots=True)
class _Signed:
    """What a claim's file says."""

    holder: str  # token of its process; empty where that has not come to write it
    text: str  # all besides
    touched: float

    @property
    def about(self) -> dict[str, object]:
        """What it says of itself."""
        return json_object(self.text) or {}

    @property
    def runs(self) -> bool | None:
        """Whether its process is at it; None where that cannot be told from here."""
        if self.holder == owner.token():  # given up by us, or of an earlier process that cannot be told from this one
            return self.about.get("mark") in _OWN
        return owner.runs(self.holder)


class Claims:
    """The claims in a folder.

    Args:
        folder: its place.
        toucher: gives signs of life; None: one of its own.
    """

    def __init__(self, folder: Path, toucher: Toucher | None = None) -> None:
        self._folder = folder
        self._toucher = toucher or Toucher()

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
        path, mark = self._path(name), secrets.token_hex(8)
        mine = self._take(path, name, run, mark)
        try:
            yield mine
        finally:
            if mine:
                self._toucher.leave(path)
                with suppress(OSError):
                    now = _signed(path)
                    if now.holder == owner.token() and now.about.get("mark") == mark:  # else it was taken over
                        self._removed(path, now)
                _OWN.discard(mark)

    def held(self) -> list[Held]:
        """All claims, the oldest first."""
        found: list[Held] = []
        now = self._now()
        with suppress(OSError):
            for path in self._folder.glob("[!.]*"):
                with suppress(OSError):
                    claim = _signed(path)
                    about, running, silent = claim.about, claim.runs, max(0.0, now - claim.touched)
                    found.append(
                        Held(
                            name=str(about.get("name", path.name)),
                            host=str(about.get("host", "an unknown machine")),
                            process=owner.process_of(claim.holder),
                            age=max(0.0, now - _number(about.get("since"), claim.touched)),
                            silent=silent,
                            alive=running is not False and silent <= _STALE,
                        )
                    )
        return sorted(found, key=lambda x: -x.age)

    def clear(self) -> None:
        """Take away the claims of processes that have ended: of work that was done, nobody comes for them."""
        with suppress(OSError):
            for path in self._folder.glob("[!.]*"):
                if (found := self._abandoned(path, "")) is not None:
                    self._removed(path, found)

    def _path(self, name: str) -> Path:
        plain = re.sub(r"[^\w.-]+", "_", name)[:80]
        return self._folder / f"{plain}-{hashlib.sha256(name.encode()).hexdigest()[:8]}"

    def _take(self, path: Path, name: str, run: str, mark: str) -> bool:
        for _ in range(2):
            _OWN.add(mark)
            try:
                self._make(path, {"name": name, "host": platform.node(), "run": run, "mark": mark})
            except OSError as e:
                _OWN.discard(mark)
                if not isinstance(e, FileExistsError):
                    raise output_error(path, e) from None
                found = self._abandoned(path, run)
                if found is None or not self._removed(path, found):
                    return False
                continue
            self._toucher.hold(path)
            return True
        return False

    def _make(self, path: Path, about: dict[str, object]) -> None:
        """A claim of this process.

        Raises:
            FileExistsError: somebody holds it.
            OSError: the folder cannot be written.
        """
        ready = _beside(path)
        try:
            handle = os.open(ready, _NEW, 0o644)
            try:
                about["since"] = os.fstat(handle).st_mtime
                os.write(handle, f"{owner.token()}\n{json.dumps(about)}\n".encode())
            finally:
                os.close(handle)
            _placed(ready, path)
        finally:
            ready.unlink(missing_ok=True)

    def _abandoned(self, path: Path, run: str) -> _Signed | None:
        """The claim, where nobody is at its work any more."""
        try:
            found = _signed(path)
        except OSError:
            return None  # it has just been given up
        running = found.runs
        if running is False or (run and found.about.get("run") == run and found.holder != owner.token()):
            return found
        return found if self._now() - found.touched > (_STALE if found.holder else _UNSIGNED) else None

    def _now(self) -> float:
        """The folder's own clock: the machines' may differ."""
        probe = _beside(self._folder / "clock")
        try:
            probe.touch()
            return probe.stat().st_mtime
        except OSError:
            return time.time()  # a folder that is only read
        finally:
            with suppress(OSError):
                probe.unlink()

    def _removed(self, path: Path, seen: _Signed) -> bool:
        """Takes a claim away that was seen to be abandoned; of several that try, one can."""
        taken = _beside(path)
        try:
            path.rename(taken)
        except OSError:
            return False
        with suppress(OSError):
            if _signed(taken) != seen:  # taken over, or touched, between the look and the renaming
                _put_back(taken, path)
                return False
        with suppress(OSError):  # what is no file stays aside
            taken.unlink()
        return True

    def close(self) -> None:
        """Ends the thread that touches claims."""
        self._toucher.close()


def _beside(path: Path) -> Path:
    """A name for a temporary file of this process."""
    return path.with_name(f".{path.name}~{owner.token()}-{secrets.token_hex(4)}")


def _placed(ready: Path, path: Path) -> None:
    """Give a file a second name that nothing has.

    Raises:
        FileExistsError: something has it.
        OSError: it cannot be written.
    """
    try:
        os.link(ready, path, follow_symlinks=False)
    except FileExistsError:
        raise
    except (OSError, NotImplementedError):  # a file system without such links
        handle = os.open(path, _NEW, 0o644)
        try:
            os.write(handle, ready.read_bytes())
        except OSError:
            path.unlink(missing_ok=True)
            raise
        finally:
            os.close(handle)


def _put_back(taken: Path, path: Path) -> None:
    """Undo a renaming, unless somebody has claimed the work in between: then two are at it, and lose nothing."""
    try:
        os.link(taken, path, follow_symlinks=False)
    except FileExistsError:
        pass
    except (OSError, NotImplementedError):  # a folder, or a file system without such links
        if not path.exists():
            taken.rename(path)
            return
    taken.unlink()


def _signed(path: Path) -> _Signed:
    """Who made a claim, and when it was last touched.

    Raises:
        OSError: it has been given up.
    """
    touched = path.lstat().st_mtime
    try:
        with open_file(path) as file:
            holder, _, rest = file.read(_LONGEST).decode("utf-8", "replace").partition("\n")
    except OSError as e:
        if not (isinstance(e, NotAFileError) or path.is_symlink()):
            raise
        return _Signed("", "", touched)  # nobody's
    return _Signed(holder, rest, touched)


def _number(value: object, otherwise: float) -> float:
    return float(value) if isinstance(value, int | float) and abs(value) < 1e15 else otherwise

"""What a command writes, looked at before it begins: a name of the right kind, in a folder, of no file that is read."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from mirelight.base.errors import OutputError

if TYPE_CHECKING:
    from mirelight.model import Job


_HEAD = 1 << 16  # bytes of a file that are looked at


def named(out: str, what: str, *suffixes: str) -> Path:
    """The file to write. Raises OutputError where its name has none of the suffixes, or its folder is not there."""
    path = Path(out)
    if not path.suffix or not path.name.lower().endswith(suffixes):
        *some, last = suffixes
        kinds = f"{', '.join(some)} or {last}" if some else last
        raise OutputError(f"{path}: {what} written as {kinds}; nothing was written")
    in_a_folder(path)
    return path


def in_a_folder(*outs: Path) -> None:
    """Raises OutputError where a file to write has no folder to stand in, none that can be written, or is one."""
    import tempfile  # with what it loads, a tenth of what help takes

    from mirelight.io.atomic import output_error

    for out in outs:
        if not out.parent.is_dir():
            raise OutputError(f"{out}: cannot be written (the folder does not exist); nothing was written")
        if out.is_dir():
            raise OutputError(f"{out}: cannot be written (it is a folder); nothing was written")
        try:
            with tempfile.TemporaryFile(dir=out.parent):
                pass
        except OSError as error:
            raise output_error(out, error) from None


def files_of(work: Job) -> tuple[Path, ...]:
    """The job file, and all that it names."""
    return work.source, *(work.source.parent / name for name in work.inputs)


def own(out: Path, sign: str) -> None:
    """Raises OutputError where a file of that name is there and mirelight has not written it.

    Args:
        out: a file to write.
        sign: what such a file of mirelight's holds near its beginning.
    """
    if not out.is_file():  # a pipe would be waited for
        return
    try:
        with out.open("rb") as file:
            head = file.read(_HEAD)
    except OSError as error:
        from mirelight.io.atomic import output_error

        raise output_error(out, error) from None
    if head and sign.encode() not in head:
        raise OutputError(f"{out}: mirelight has not written it, and would write over it; give another name")


def spare(outs: Iterable[Path], read: Iterable[Path]) -> None:
    """Raises OutputError where a file to write is one that is read."""
    known = [path for path in read if path.exists()]
    for out in outs:
        if out.exists() and any(out.samefile(path) for path in known):
            raise OutputError(f"{out}: it is read here, and would be written over; give another name")

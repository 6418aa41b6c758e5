"""The command line. Only argparse is loaded before a command is known, so that help is instant."""

from __future__ import annotations

import argparse
import contextlib
import gc
import io
import os
import signal
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from types import FrameType
from typing import NoReturn

from mirelight.base.errors import MirelightError, RenderError, printable
from mirelight.cli.codes import BAD, INTERRUPTED, TERMINATED
from mirelight.cli.parser import make_parser

__all__ = ["main", "make_parser"]


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; the return value is the exit code, of `mirelight.cli.codes`."""
    _prepare_streams()
    parser = make_parser()
    args = parser.parse_args(arguments)
    if args.command is None:
        parser.print_help()
        return BAD
    try:
        with _in_order():
            code: int = args.call(args)
        return code if _flushed() else BAD
    except RenderError as e:  # raised where only arrays are known
        _say(f"{_subject(args)}: {e}")
        return BAD
    except MirelightError as e:
        for line in str(e).splitlines():
            _say(line)
        return BAD
    except KeyboardInterrupt:
        _say("interrupted")
        return INTERRUPTED
    except MemoryError:
        _say(f"{_subject(args)}: out of memory; use a smaller resolution or fewer splats, or a machine with more")
        return BAD
    except OSError as e:
        if e.filename is None:  # files are read and written by name; what has none is a stream
            _close_stdout(e)
        else:
            _say(f"{e.filename}: {e.strerror or e}")
        return BAD


def _prepare_streams() -> None:
    """Output that can always be written: characters that the stream's encoding lacks become escapes.

    A stream that the caller has closed is replaced by the null device, so that no file that is opened later gets its
    number, and with it what libraries print.
    """
    for number, mode in ((0, os.O_RDONLY), (1, os.O_WRONLY), (2, os.O_WRONLY)):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, mode)  # the lowest free number, this one
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:  # as Python starts where the stream is closed
            setattr(sys, name, Path(os.devnull).open("w", encoding="utf-8"))  # noqa: SIM115 (until the process ends)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")


def _flushed() -> bool:
    """Whether all that was printed has reached stdout; says so where it has not, and prints no more there."""
    try:
        sys.stdout.flush()
    except OSError as e:
        _close_stdout(e)
        return False
    return True


def _close_stdout(error: OSError) -> None:
    """Print no more there. The reader of a pipe may go when it likes, as `| head` does; all else is said."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    if not isinstance(error, BrokenPipeError):
        _say(f"stdout: cannot be written ({error.strerror or error})")


def _subject(args: argparse.Namespace) -> str:
    """The file that a command is about."""
    for name in ("job", "file", "capture", "folder", "paths"):
        found = getattr(args, name, None)
        if found:
            return str(found if isinstance(found, str) else found[0])
    return str(args.command)


def _say(line: str) -> None:
    with contextlib.suppress(OSError):
        print(f"mirelight: {printable(line)}", file=sys.stderr)


@contextlib.contextmanager
def _in_order() -> Iterator[None]:
    """SIGTERM ends the block in order, so that no temporary file is left; after it the process is as it was."""
    thresholds = gc.get_threshold()
    gc.set_threshold(100_000, 20, 100)  # plans of many frames hold a million objects and no cycles
    before = signal.signal(signal.SIGTERM, _terminate)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before or signal.SIG_DFL)
        gc.set_threshold(*thresholds)


def _terminate(number: int, frame: FrameType | None) -> NoReturn:
    raise SystemExit(TERMINATED)

"""Runs commands one after the other in one process, so that what is heavy is loaded once. Speaks lines of JSON."""

from __future__ import annotations

import io
import json
import os
import sys
import traceback
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest

_opened: list[str] | None = None  # what was opened while a case ran


def _watch(event: str, arguments: tuple[Any, ...]) -> None:
    if _opened is not None and event in ("open", "os.listdir", "os.scandir") and arguments:
        try:
            _opened.append(os.fspath(arguments[0]))
        except TypeError:
            return


def main() -> None:
    """Read a case a line (folder, arguments) from stdin; answer each on the descriptor that the command line names."""
    global _opened
    answers = os.fdopen(int(sys.argv[1]), "w", encoding="utf-8")
    _load()
    sys.addaudithook(_watch)
    print(json.dumps({"ready": os.getpid()}), file=answers, flush=True)
    for line in sys.stdin:
        task = json.loads(line)
        os.chdir(task["folder"])
        _opened = []
        code, raised = _run(task["arguments"], Path(task["said"]), task["streams"])
        opened, _opened = sorted({str(x) for x in _opened if isinstance(x, str)}), None
        print(json.dumps({"code": code, "raised": raised, "opened": opened}), file=answers, flush=True)


def _load() -> None:
    import DracoPy
    import OpenEXR
    import PIL.Image
    import trimesh

    import mirelight.apps.inspect.inspect
    import mirelight.apps.realtime
    import mirelight.compare
    import mirelight.compositor
    import mirelight.io.job
    import mirelight.lighting
    from tests.usd_readers import fork_readers

    fork_readers(pytest.MonkeyPatch())
    assert DracoPy and OpenEXR and PIL and trimesh and mirelight


def _run(arguments: list[str], said: Path, streams: str) -> tuple[int, str]:
    """The command with its output in files, or as `streams` says: exit code, and what it raised where it must not."""
    from mirelight import cli

    kept = os.dup(1), os.dup(2)
    with (said / "stdout").open("wb") as out, (said / "stderr").open("wb") as error:
        for number, file in ((1, out), (2, error)):
            _point(number, file.fileno(), streams)
    own = sys.stdout, sys.stderr
    sys.stdout, sys.stderr = (_stream(number, streams) for number in (1, 2))
    try:
        code, raised = cli.main(arguments), ""
    except SystemExit as e:
        code, raised = e.code if isinstance(e.code, int) else 2, ""
    except BaseException:
        code, raised = 1, traceback.format_exc()
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError, AttributeError):  # a full disk, or none at all
            stream.flush()
    sys.stdout, sys.stderr = own
    for number, saved in zip((1, 2), kept, strict=True):
        os.dup2(saved, number)
        os.close(saved)
    return code, raised


def _stream(number: int, streams: str) -> Any:
    """As Python makes it when it starts."""
    if streams == "closed":
        return None
    raw = io.BufferedWriter(io.FileIO(number, "wb", closefd=False))
    return io.TextIOWrapper(raw, encoding="ascii" if streams == "ascii" else "utf-8", line_buffering=number == 2)


def _point(number: int, file: int, streams: str) -> None:
    """What a command finds at a descriptor."""
    match streams:
        case "closed":
            os.close(number)
        case "full" if number == 1:
            _moved(os.open("/dev/full", os.O_WRONLY), number)
        case "unread" if number == 1:
            reader, writer = os.pipe()
            os.close(reader)
            _moved(writer, number)
        case _:
            os.dup2(file, number)


def _moved(file: int, number: int) -> None:
    os.dup2(file, number)
    os.close(file)


if __name__ == "__main__":
    main()

"""Runs commands one after the other in one process, so that what is heavy is loaded once. Speaks lines of JSON."""

from __future__ import annotations

import json
import os
import sys
import traceback
from pathlib import Path
from typing import Any

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
        code, raised = _run(task["arguments"], Path(task["said"]))
        opened, _opened = sorted({str(x) for x in _opened if isinstance(x, str)}), None
        print(json.dumps({"code": code, "raised": raised, "opened": opened}), file=answers, flush=True)


def _load() -> None:
    import DracoPy
    import OpenEXR
    import PIL.Image
    import trimesh

    import mirelight.compare
    import mirelight.compositor
    import mirelight.io.inspect
    import mirelight.io.job
    import mirelight.lighting
    import mirelight.realtime

    assert DracoPy and OpenEXR and PIL and trimesh and mirelight


def _run(arguments: list[str], said: Path) -> tuple[int, str]:
    """The command with its output in files; its exit code, and what it raised where it must not."""
    from mirelight import cli

    kept = os.dup(1), os.dup(2)
    with (said / "stdout").open("wb") as out, (said / "stderr").open("wb") as error:
        os.dup2(out.fileno(), 1)
        os.dup2(error.fileno(), 2)
    try:
        code, raised = cli.main(arguments), ""
    except SystemExit as e:
        code, raised = e.code if isinstance(e.code, int) else 2, ""
    except BaseException:
        code, raised = 1, traceback.format_exc()
    for stream, number, saved in ((sys.stdout, 1, kept[0]), (sys.stderr, 2, kept[1])):
        stream.flush()
        os.dup2(saved, number)
        os.close(saved)
    return code, raised


if __name__ == "__main__":
    main()

"""The process that opens a stage: ``python -m mirelight.io.usd.child REQUEST FOLDER BYTES``.

Before the library composes a stage, every file that it names is looked up: what lies outside its folder is said, and
has to be a layer or a picture, so that an untrusted stage opens nothing else of the machine.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from contextlib import suppress
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from mirelight.io.usd.rows import Answer, Failure, Request
from mirelight.io.usd.stage import RefusedError, Stage, open_stage


def main() -> None:
    """Read what is asked and write the answer."""
    request = Request(**json.loads(sys.argv[1]))
    folder = Path(sys.argv[2])
    _limit(int(sys.argv[3]))
    try:
        answer = _answer(request, folder)
    except RefusedError as e:
        answer = Answer(failure=Failure(found=e.found, remedy=e.remedy, prim=e.prim))
    except MemoryError:
        answer = Answer(failure=Failure(found="it takes more memory than is free", remedy="give a smaller stage"))
    except RecursionError:
        answer = Answer(failure=Failure(found="it is nested too deeply", remedy="the stage is damaged"))
    except Exception as e:
        found = f"the USD library cannot read it ({_reason(e)})"
        answer = Answer(failure=Failure(found=found, remedy="the stage is damaged"))
    (folder / "answer.json").write_text(json.dumps(asdict(answer)), encoding="utf-8")


def _answer(request: Request, folder: Path) -> Answer:
    from mirelight.io.usd import take_cameras, take_lights, take_meshes, take_splats

    stage = open_stage(Path(request.path), folder, request.time)
    parts: dict[str, Callable[[Stage, Request], Answer]] = {
        "splats": take_splats.splats,
        "head": take_splats.head,
        "mesh": take_meshes.mesh,
        "cameras": take_cameras.cameras,
        "lights": take_lights.lights,
        "times": take_lights.times,
        "files": _files,
    }
    answer = parts[request.part](stage, request)
    return replace(answer, notes=[*answer.notes, *stage.notes], rate=stage.rate)


def _files(stage: Stage, _: Request) -> Answer:
    from mirelight.io.usd import take_meshes

    with suppress(RefusedError):  # it may be used for something else
        take_meshes.remarks(stage)
    return Answer(files=sorted(str(x) for x in stage.files))


def _limit(most: int) -> None:
    """No more address space than the machine has memory: a stage may claim terabytes."""
    try:
        import resource
    except ImportError:  # Windows
        return
    resource.setrlimit(resource.RLIMIT_AS, (most, most))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def _reason(error: Any) -> str:
    try:
        text = str(error)
    except UnicodeDecodeError:  # the library quotes the stage's bytes
        return "it holds bytes that are no text"
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    named = [line for line in lines if "rror" in line]
    text = (named or lines or [type(error).__name__])[-1]
    return text.rpartition(" : ")[2].strip("'")[:200]


if __name__ == "__main__":
    main()

"""Reading a stage in a child process: the library ends its process on some damaged files."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import mirelight
from mirelight.base.errors import InputError, one_line
from mirelight.base.extras import require
from mirelight.base.machine import free_memory
from mirelight.io.safety import existing
from mirelight.io.usd.rows import Answer, Request, answer_from

ANSWER = "answer.json"
_TIMEOUT = 900  # s; text stages of a city take minutes


@dataclass(frozen=True, slots=True)
class Read:
    """An answer and the folder of its arrays and files, which lasts as long as the `with`."""

    path: Path
    answer: Answer
    folder: Path

    def array(self, name: str) -> NDArray[Any] | None:
        """An array of any shape by name, mapped from its file; None where the stage has none."""
        file = self.folder / f"{name}.npy"
        if not file.is_file():
            return None
        found: NDArray[Any] = np.load(file, mmap_mode="r", allow_pickle=False)
        return found


@contextmanager
def ask(path: str | Path, request: Request) -> Iterator[Read]:
    """Ask a child for a part of a stage.

    Raises:
        InputError: it cannot be used.
        BackendError: the library is not installed.
    """
    path = existing(path)
    if path.is_dir():
        raise InputError(path, "a folder", "name a stage (.usd, .usda, .usdc or .usdz)")
    require("usd")
    with tempfile.TemporaryDirectory(prefix="mirelight-usd-") as name:
        folder = Path(name)
        answer = _run(path, request, folder)
        if answer.failure is not None:
            one = answer.failure
            raise InputError(path, one.found, one.remedy, field=one.prim)
        yield Read(path, answer, folder)


def _run(path: Path, request: Request, folder: Path) -> Answer:
    home = str(Path(mirelight.__file__).parent.parent)
    paths = [home, *os.environ.get("PYTHONPATH", "").split(os.pathsep)]
    environment = dict(os.environ) | {"PYTHONPATH": os.pathsep.join(x for x in paths if x)}
    limit = str(max(free_memory(), 1 << 31) + (4 << 30))
    asked = json.dumps(asdict(replace(request, path=str(path.absolute()))))
    command = [sys.executable, "-m", "mirelight.io.usd.child", asked, str(folder), limit]
    try:
        done = subprocess.run(
            command,
            env=environment,
            cwd=path.absolute().parent,  # where the library looks for names without a folder
            stdin=subprocess.DEVNULL,
            capture_output=True,
            encoding="utf-8",
            errors="replace",
            timeout=_TIMEOUT,
            check=False,
        )
    except subprocess.TimeoutExpired:
        raise InputError(path, f"reading it took more than {_TIMEOUT} s", "give a smaller stage") from None
    except OSError as e:
        raise InputError(path, f"no process could be started to read it ({e.strerror})") from None
    said = folder / ANSWER
    if done.returncode or not said.is_file():
        how = f"signal {-done.returncode}" if done.returncode < 0 else f"status {done.returncode}"
        raise InputError(path, f"the USD library gave up on it ({how}{_last(done.stderr)})", "the stage is damaged")
    return answer_from(json.loads(said.read_bytes()))


def _last(text: str) -> str:
    lines = [line for line in text.splitlines() if line.strip()]
    return f": {one_line(lines[-1])[:160]}" if lines else ""

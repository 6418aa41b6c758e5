"""Children that read stages, forked from one process which has the USD library: most of what a small stage takes is to
load it. The commands of `tests/oracle/test_stage_whole.py` start them as users do."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import traceback
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from mirelight.io.usd import process

ROOT = Path(__file__).resolve().parents[1]


class Readers:
    """A process that forks a child for each request; it ends when this one does."""

    def __init__(self) -> None:
        # a fork has none of its parent's threads: the library is to start none
        env = {**os.environ, "PYTHONPATH": os.pathsep.join((str(ROOT), *sys.path)), "PXR_WORK_THREAD_LIMIT": "1"}
        env["TF_ENV_SETTING_ALERTS_ENABLED"] = "0"
        command = [sys.executable, "-m", "tests.usd_readers"]
        self._process = subprocess.Popen(command, env=env, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)

    def run(
        self, command: list[str], *, env: dict[str, str], cwd: Path, **_: object
    ) -> subprocess.CompletedProcess[str]:
        """As `subprocess.run` of ``python -m mirelight.io.usd.child REQUEST FOLDER BYTES``."""
        assert command[1:3] == ["-m", "mirelight.io.usd.child"]
        assert self._process.stdin is not None and self._process.stdout is not None
        said = Path(command[4], "stderr.txt")
        task = {"arguments": command[3:], "env": env, "cwd": str(cwd), "said": str(said)}
        self._process.stdin.write(json.dumps(task) + "\n")
        self._process.stdin.flush()
        code = int(self._process.stdout.readline())
        return subprocess.CompletedProcess(command, code, "", said.read_text(encoding="utf-8", errors="replace"))

    def close(self) -> None:
        """Ends the process."""
        self._process.kill()
        self._process.communicate()


def fork_readers(patch: pytest.MonkeyPatch) -> Readers:
    """Let stages be read by forked children in this process."""
    readers = Readers()
    calls = SimpleNamespace(run=readers.run, DEVNULL=subprocess.DEVNULL, TimeoutExpired=subprocess.TimeoutExpired)
    patch.setattr(process, "subprocess", calls)
    return readers


def main() -> None:
    """Read a request a line from stdin; write each child's return code."""
    from pxr import Ar, Sdf, Usd, UsdGeom, UsdLux, UsdShade, UsdUtils

    from mirelight.io.usd import (
        child,
        exact,
        piece,
        take_cameras,
        take_lights,
        take_materials,
        take_meshes,
        take_splats,
    )

    assert all((Ar, Sdf, UsdGeom, UsdLux, UsdShade, UsdUtils, exact, piece, take_cameras, take_lights))
    assert all((take_materials, take_meshes, take_splats))
    Usd.Stage.CreateInMemory()  # finds its plug-ins
    for line in sys.stdin:
        task = json.loads(line)
        number = os.fork()
        if not number:
            _read(child.main, task)
        _, status = os.waitpid(number, 0)
        print(os.waitstatus_to_exitcode(status), flush=True)


def _read(read: Any, task: dict[str, Any]) -> None:
    """The child: as Python runs a module, and no farther."""
    code = 1
    try:
        nothing = os.open(os.devnull, os.O_RDWR)
        said = os.open(task["said"], os.O_CREAT | os.O_WRONLY)
        for number, file in enumerate((nothing, nothing, said)):
            os.dup2(file, number)
        os.chdir(task["cwd"])
        os.environ.clear()
        os.environ.update(task["env"])
        sys.argv = ["child", *task["arguments"]]
        read()
        code = 0
    except BaseException:
        traceback.print_exc()
    finally:
        sys.stderr.flush()
        os._exit(code)


if __name__ == "__main__":
    main()

"""Output on streams that cannot take it: closed, full, ASCII alone."""

from __future__ import annotations

import json
import os
import subprocess
from pathlib import Path

import pytest

from .conftest import COMMAND

ASCII = {**os.environ, "LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0", "PYTHONIOENCODING": "ascii"}


def shell(line: str, folder: Path, **environment: str) -> subprocess.CompletedProcess[bytes]:
    command = f"{' '.join(COMMAND)} {line}"
    return subprocess.run(["sh", "-c", command], cwd=folder, capture_output=True, env={**os.environ, **environment})


@pytest.mark.parametrize("closed", [">&-", "2>&-", "<&-", ">&- 2>&- <&-"])
def test_closed_streams(folder: Path, closed: str) -> None:
    before = {x: x.read_bytes() for x in folder.iterdir()}
    done = shell(f"inspect splats.ply {closed}", folder)
    assert (done.returncode, done.stderr) == (0, b"")
    bad = shell(f"inspect missing.ply {closed}", folder)
    assert bad.returncode == 2 and b"Traceback" not in bad.stderr
    assert {x: x.read_bytes() for x in folder.iterdir()} == before


def test_a_full_device_is_named(folder: Path) -> None:
    done = shell("inspect splats.ply > /dev/full", folder)
    assert done.returncode == 2
    assert done.stderr == b"mirelight: stdout: cannot be written (No space left on device)\n"


def test_ascii_streams(folder: Path) -> None:
    (folder / "splätß.ply").write_bytes((folder / "splats.ply").read_bytes())
    schema = shell("schema", folder, **ASCII)
    assert schema.returncode == 0
    assert json.loads(schema.stdout.decode("ascii")) == json.loads(shell("schema", folder).stdout)
    for arguments in ("splätß.ply", "--json splätß.ply"):
        done = shell(f"inspect {arguments}", folder, **ASCII)
        assert (done.returncode, done.stderr) == (0, b"")
        assert done.stdout.isascii()


def test_names_of_files_do_not_act_on_the_terminal(folder: Path) -> None:
    name = b"a\x1b[2J\xff.ply"
    (folder / os.fsdecode(name)).write_bytes((folder / "splats.ply").read_bytes())
    for arguments in ([name], [b"--json", name], [b"x" + name]):
        command = [os.fsencode(x) for x in COMMAND]
        done = subprocess.run([*command, b"inspect", *arguments], cwd=folder, capture_output=True)
        shown = done.stdout + done.stderr
        assert b"\x1b" not in shown and b"\xff" not in shown and b"Traceback" not in shown
        if b"--json" in arguments:
            assert json.loads(done.stdout)["path"] == os.fsdecode(name)

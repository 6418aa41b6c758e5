"""Output on streams that cannot take it: closed, full, ASCII alone."""

from __future__ import annotations

import json
import os
import subprocess
from pathlib import Path

import pytest

from mirelight import cli
from mirelight.io import splats

from ..proxy.clouds import on_surface, square
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


def test_closed_streams_are_there_and_take_nothing(folder: Path) -> None:
    """Commands may ask them whether they are a terminal, and libraries may print."""
    script = "import os, sys; from mirelight import cli; cli.main(['schema']); "
    script += "os._exit(int(sys.stdout.isatty() or sys.stderr.isatty()) or 7)"
    done = subprocess.run(["sh", "-c", f'{COMMAND[0]} -c "{script}" >&- 2>&-'], cwd=folder)
    assert done.returncode == 7


@pytest.mark.parametrize(
    "arguments",
    [
        ["fly\x1b[2J"],
        ["render", "a", "\x1b[2J"],
        ["export", "a", "--layout", "\x1b[2J"],
        ["proxy", "a", "--triangles", "x"],
    ],
)
def test_wrong_arguments_are_one_line(folder: Path, arguments: list[str]) -> None:
    done = subprocess.run([*COMMAND, *arguments], cwd=folder, capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (2, "")
    (line,) = done.stderr.splitlines()
    assert line.startswith("mirelight: ") and line.endswith(" --help says more") and line.isprintable()


@pytest.mark.parametrize(
    "arguments",
    [["new", "floor.ply", "-o", "\x1b[2J.toml"], ["render", "job.toml", "-o", "\x1b[2J", "--camera", "front"]],
)
def test_names_of_output_do_not_act_on_the_terminal(folder: Path, arguments: list[str]) -> None:
    splats.write(on_surface(*square(4, 0.1, 1, 0), 0.1, thin=0.02), folder / "floor.ply")
    done = subprocess.run([*COMMAND, *arguments], cwd=folder, capture_output=True)
    assert done.returncode == 0
    assert b"\\x1b[2J" in done.stdout and b"\x1b" not in done.stdout + done.stderr


def test_commands_print_through_one_module() -> None:
    """`say` writes what is not printable as escapes; rich has a console, `watch` a line."""
    others = {"__init__.py", "progress.py", "watch.py"}
    folder = Path(cli.__file__).parent
    found = {path.name: path.read_text(encoding="utf-8").count("print(") for path in folder.glob("*.py")}
    assert {name for name, count in found.items() if count} == {"say.py", *others}
    assert found["__init__.py"] == 1

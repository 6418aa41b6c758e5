"""Files appear whole or not at all."""

from __future__ import annotations

import errno
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from mirelight.base.errors import OutputError
from mirelight.io.atomic import atomic_path
from mirelight.io.image import write
from mirelight.model import Frame

NOBODY = 65534


def test_the_file_appears_at_the_end(tmp_path: Path) -> None:
    target = tmp_path / "a.txt"
    with atomic_path(target) as temporary:
        temporary.write_text("new", encoding="utf-8")
        assert temporary.parent == tmp_path and temporary.suffix == ".txt"
        assert not target.exists()
    assert target.read_text(encoding="utf-8") == "new"
    assert list(tmp_path.iterdir()) == [target]


def test_a_failure_leaves_the_old_file_and_nothing_else(tmp_path: Path) -> None:
    target = tmp_path / "a.txt"
    target.write_text("old", encoding="utf-8")
    with pytest.raises(RuntimeError), atomic_path(target) as temporary:
        temporary.write_text("half", encoding="utf-8")
        raise RuntimeError("interrupted")
    with pytest.raises(KeyboardInterrupt), atomic_path(target) as temporary:
        raise KeyboardInterrupt
    assert target.read_text(encoding="utf-8") == "old"
    assert list(tmp_path.iterdir()) == [target]


def test_permissions_are_those_of_a_new_file(tmp_path: Path) -> None:
    plain = tmp_path / "plain"
    plain.touch()
    with atomic_path(tmp_path / "a") as temporary:
        temporary.write_bytes(b"x")
    assert (tmp_path / "a").stat().st_mode == plain.stat().st_mode


@pytest.mark.parametrize(
    ("code", "message"),
    [(errno.ENOSPC, "the disk is full"), (errno.EDQUOT, "quota"), (errno.EIO, "Input/output error")],
)
def test_what_the_system_says_while_writing(tmp_path: Path, code: int, message: str) -> None:
    with pytest.raises(OutputError, match=message) as error, atomic_path(tmp_path / "a.bin"):
        raise OSError(code, os.strerror(code))
    assert str(tmp_path / "a.bin") in str(error.value) and "\n" not in str(error.value)
    assert list(tmp_path.iterdir()) == []


def test_folders_that_cannot_take_it(tmp_path: Path, frame: Frame) -> None:
    (tmp_path / "file").touch()
    (tmp_path / "folder.exr").mkdir()
    for path, message in (
        (tmp_path / "absent" / "a.exr", "the folder does not exist"),
        (tmp_path / "file" / "a.exr", "its folder is not a folder"),
        (tmp_path / "folder.exr", "it is a folder"),
    ):
        with pytest.raises(OutputError, match=message):
            write(frame, path)
    assert len(list(tmp_path.iterdir())) == 2


@pytest.fixture
def read_only_folder() -> Iterator[Path]:
    """A folder that this process may not write to; root, who may write anywhere, becomes nobody for the while."""
    folder = Path(tempfile.mkdtemp())
    folder.chmod(0o555)
    root = os.geteuid() == 0
    try:
        if root:
            os.seteuid(NOBODY)
        yield folder
    finally:
        if root:
            os.seteuid(0)
        folder.chmod(0o755)
        folder.rmdir()


def test_a_read_only_folder(read_only_folder: Path, frame: Frame) -> None:
    for name in ("a.exr", "a.png"):
        with pytest.raises(OutputError, match="no permission to write there"):
            write(frame, read_only_folder / name)
    assert list(read_only_folder.iterdir()) == []


CHILD = """
import resource, signal, sys
from pathlib import Path
import numpy as np
from mirelight.base.errors import OutputError
from mirelight.io.environment import write_environment
from mirelight.io.gltf.write import write_glb
from mirelight.io.png import write_png
from mirelight.model import ProxyMesh

signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, 20_000))
folder, noise = Path(sys.argv[1]), np.random.default_rng(0)
picture = noise.random((200, 300, 3), dtype=np.float32)
mesh = ProxyMesh(vertices=noise.random((30_000, 3), dtype=np.float32), faces=np.array([[0, 1, 2]], dtype=np.int32))
writers = {
    "a.exr": lambda p: write_environment(p, picture),
    "a.hdr": lambda p: write_environment(p, picture),
    "a.png": lambda p: write_png(p, noise.integers(0, 256, (200, 300, 3), dtype=np.uint8), {}),
    "a.glb": lambda p: write_glb(p, mesh),
}
for name, put in writers.items():
    try:
        put(folder / name)
    except OutputError as e:
        assert "\\n" not in str(e) and name in str(e), e
    else:
        raise SystemExit(f"{name} was written")
write_environment(folder / "small.hdr", picture[:4])  # the limit stops only what is too large
print(sorted(x.name for x in folder.iterdir()))
"""


def test_no_writer_leaves_half_a_file_when_the_system_stops_it(tmp_path: Path) -> None:
    """A limit on file size stands in for a full disk: the same calls fail in the same places."""
    done = subprocess.run([sys.executable, "-c", CHILD, str(tmp_path)], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout.strip()) == (0, "['small.hdr']"), done.stderr

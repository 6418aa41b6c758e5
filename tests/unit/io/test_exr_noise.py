"""What the OpenEXR library prints about damaged files reaches nobody; all other output does."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pytest

from mirelight.base.errors import InputError
from mirelight.io.exr import read_exr, write_exr
from mirelight.io.exr_noise import silenced

READ_RAW = "import OpenEXR, sys; OpenEXR.File(sys.argv[1], separate_channels=True)"
COMMAND = [sys.executable, "-m", "mirelight"]


@pytest.fixture
def damaged(tmp_path: Path) -> Path:
    """A file whose header is sound and whose pixels end early."""
    path = tmp_path / "damaged.exr"
    write_exr(path, {"": np.random.default_rng(0).random((64, 64, 3)).astype(np.float32)})
    path.write_bytes(path.read_bytes()[:20_000])
    return path


def test_the_library_is_loud_and_the_command_is_not(damaged: Path) -> None:
    raw = subprocess.run([sys.executable, "-c", READ_RAW, damaged], capture_output=True)
    assert b"EXR_ERR_" in raw.stderr and b"Warning: Exception raised" in raw.stdout  # else this test says nothing
    for command in (["inspect"], ["compare", str(damaged)]):
        done = subprocess.run([*COMMAND, *command, str(damaged)], capture_output=True, text=True)
        assert (done.returncode, done.stdout) == (2, ""), command
        text = "an EXR image that cannot be read (IndexError); the file is damaged"
        assert done.stderr == f"mirelight: {damaged}: {text}\n"


def test_other_output_is_passed_on(capfd: pytest.CaptureFixture[str]) -> None:
    print("before")
    with silenced(), silenced():
        print("of the package")
        other = threading.Thread(target=print, args=("inside",))
        other.start()
        other.join()
        os.write(2, b"/a b.exr: (EXR_ERR_CORRUPT_CHUNK) bad\nkept\n/a.exr: (EXR_ERR_CORRUPT_CHUNK) bad\nhalf")
    print("after")
    assert capfd.readouterr() == ("before\ninside\nafter\n", "kept\nhalf")


def open_files() -> int:
    folder = Path("/proc/self/fd")
    return len(list(folder.iterdir())) if folder.is_dir() else 0


def test_streams_are_restored_after_errors_and_threads(damaged: Path, capfd: pytest.CaptureFixture[str]) -> None:
    before = [os.fstat(number).st_ino for number in (1, 2)]
    stdout, count = sys.stdout, open_files()

    def read() -> None:
        for _ in range(20):
            with pytest.raises(InputError, match="the file is damaged"):
                read_exr(damaged)

    threads = [threading.Thread(target=read) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert [os.fstat(number).st_ino for number in (1, 2)] == before
    assert sys.stdout is stdout
    assert open_files() <= count  # fewer where what an earlier test left was collected
    assert capfd.readouterr() == ("", "")


def test_no_room_for_a_temporary_file(damaged: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(**_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("tempfile.TemporaryFile", full)
    with pytest.raises(InputError, match="the file is damaged"):
        read_exr(damaged)

"""Which libLLVM is chosen, that an unsound one is never loaded, and that every failure is one line."""

from __future__ import annotations

import ctypes
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from mirelight.base import backend
from mirelight.base.backend import LlvmLibrary
from mirelight.base.errors import BackendError
from mirelight.cli import main

# What a stand-in library answers, by its file name: the finding and choosing is tested on files that are no libraries.
VERSIONS: dict[str, tuple[int, int, int] | None] = {
    "libLLVM-14.so.1": (0, 0, 0),
    "libLLVM-15.so.1": (0, 0, 0),
    "libLLVM-16.so.1": (16, 0, 6),
    "libLLVM-17.so.1": (17, 0, 6),
    "libLLVM-18.so.1": (18, 1, 3),
    "libLLVM.so.19.1": (19, 1, 7),
    "libLLVM.so.22.1": None,
    "libLLVM.so": (20, 1, 0),
}


@pytest.fixture(autouse=True)
def fresh() -> Iterator[None]:
    """Each test chooses anew, and what it chose does not outlive it."""
    before = os.environ.pop("DRJIT_LIBLLVM_PATH", None)
    backend.choose.cache_clear()
    yield
    backend.choose.cache_clear()
    os.environ.pop("DRJIT_LIBLLVM_PATH", None)
    if before is not None:
        os.environ["DRJIT_LIBLLVM_PATH"] = before


@pytest.fixture
def machine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty folder that is the only place where libraries are looked for; asking goes by VERSIONS."""
    monkeypatch.setattr(backend, "_loader_paths", lambda: iter(()))
    monkeypatch.setattr(backend, "_folders", lambda: iter([(tmp_path, "test")]))
    monkeypatch.setattr(backend, "ask", lambda path, where="": LlvmLibrary(path, VERSIONS[Path(path).name], where))
    return tmp_path


def put(folder: Path, *names: str) -> None:
    for name in names:
        (folder / name).touch()


@pytest.mark.parametrize(
    ("present", "chosen"),
    [
        ("libLLVM-14.so.1 libLLVM.so.19.1 libLLVM-15.so.1", "libLLVM.so.19.1"),
        ("libLLVM-17.so.1 libLLVM-18.so.1", "libLLVM-18.so.1"),
        ("libLLVM-18.so.1 libLLVM.so", "libLLVM.so"),  # no version in the name: asked, and newer
        ("libLLVM.so libLLVM.so.22.1", "libLLVM.so"),  # the newest cannot be loaded
        ("libLLVM-14.so.1 libLLVM-15.so.1 libLLVM-16.so.1", None),
        ("", None),
    ],
)
def test_newest_sound_library_wins(machine: Path, present: str, chosen: str | None) -> None:
    put(machine, *present.split())
    library = backend.choose()
    assert (library and Path(library.path).name) == chosen


def test_symbolic_links_are_one_library(machine: Path) -> None:
    put(machine, "libLLVM.so.19.1")
    (machine / "libLLVM-19.so").symlink_to("libLLVM.so.19.1")
    (machine / "libLLVM.so").symlink_to("libLLVM-19.so")
    assert len(backend._found()) == 1


def test_the_users_sound_choice_is_honoured(machine: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    put(machine, "libLLVM.so.19.1", "libLLVM-17.so.1")
    monkeypatch.setenv("DRJIT_LIBLLVM_PATH", str(machine / "libLLVM-17.so.1"))
    library = backend.choose()
    assert library is not None
    assert library.version == (17, 0, 6)


@pytest.mark.parametrize("named", ["libLLVM-15.so.1", "libLLVM-16.so.1", "libLLVM.so.22.1"])
def test_the_users_unsound_choice_gives_one_line(
    machine: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture, named: str
) -> None:
    put(machine, *VERSIONS)
    monkeypatch.setenv("DRJIT_LIBLLVM_PATH", str(machine / named))
    backend.prepare()
    backend.prepare()
    assert os.environ["DRJIT_LIBLLVM_PATH"] == str(machine / "libLLVM.so")
    (record,) = caplog.records
    assert named in record.getMessage()


def test_none_names_the_command_that_installs_one(machine: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    put(machine, "libLLVM-16.so.1")
    for manager, command in (
        ("apt-get", "apt-get install libllvm19"),
        ("dnf", "dnf install llvm-libs"),
        ("brew", "brew install llvm"),
    ):
        monkeypatch.setattr(shutil, "which", lambda name, manager=manager: name if name == manager else None)
        with pytest.raises(BackendError) as raised:
            backend.prepare()
        assert command in str(raised.value)
        assert "16.0.6" in str(raised.value)
        assert "\n" not in str(raised.value)


def test_cuda_needs_no_library_and_leaves_none_to_be_found(machine: Path) -> None:
    put(machine, "libLLVM-15.so.1")
    backend.prepare("cuda_ad_rgb")
    assert os.environ["DRJIT_LIBLLVM_PATH"] == os.devnull


def test_real_libraries_tell_their_version() -> None:
    chosen = backend.choose()
    assert chosen is not None
    assert chosen.sound
    for library in backend.libraries():
        number = backend._named_version(library.path)
        if library.version and library.version[0] and number != 999:
            assert library.version[0] == number


@pytest.mark.parametrize("content", [b"", b"not a library", b"\x7fELF" + bytes(60)])
def test_a_broken_file_is_no_library(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "libLLVM.so"
    path.write_bytes(content)
    assert backend.ask(str(path)).version is None


def run(code: str, **environment: str) -> subprocess.CompletedProcess[str]:
    """A fresh process: what Dr.Jit loads is decided once per process."""
    env = {k: v for k, v in os.environ.items() if k != "DRJIT_LIBLLVM_PATH"} | environment
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=env, check=False)


def test_drjit_reports_the_chosen_version() -> None:
    told = run(
        "from mirelight.base import backend\n"
        "dr, types = backend.drjit()\n"
        "print(dr.detail.llvm_version() == backend.choose().version, dr.sum(types.Float(1, 2, 3))[0])"
    )
    assert told.stdout.split() == ["True", "6.0"], told.stderr


def test_an_unsound_choice_does_not_reach_drjit(tmp_path: Path) -> None:
    bad = tmp_path / "libLLVM-15.so.1"
    bad.write_bytes(b"nothing")
    told = run("from mirelight.base import backend; print(backend.mitsuba().variant())", DRJIT_LIBLLVM_PATH=str(bad))
    assert told.stdout.strip() == "llvm_ad_rgb"
    assert len(told.stderr.splitlines()) == 1


def test_variants_switch_in_one_process() -> None:
    told = run(
        "from mirelight.base import backend; from mirelight.apps import doctor\n"
        "for _ in range(2):\n"
        "    doctor.small_render('llvm_ad_rgb')\n"
        "    mi = backend.mitsuba()\n"
        "    print(mi.variant())\n"
        "    mi.set_variant('scalar_rgb')\n"
    )
    assert told.stdout.split() == ["llvm_ad_rgb"] * 2, told.stderr


def test_threads_are_set_and_left_alone() -> None:
    told = run(
        "from mirelight.base import backend\n"
        "dr, _ = backend.drjit(threads=3)\n"
        "backend.mitsuba()\n"
        "print(dr.thread_count())\n"
        "backend.mitsuba(threads=1)\n"
        "print(dr.thread_count())\n"
        "try: backend.drjit(threads=0)\n"
        "except backend.BackendError as error: print(error)\n"
    )
    assert told.stdout.splitlines() == ["3", "1", "0 threads asked for; give 1 or more"], told.stderr


def test_absent_cuda_is_one_line() -> None:
    told = run(
        "from mirelight.base import backend\n"
        "dr, _ = backend.drjit()\n"
        "has = dr.has_backend(dr.JitBackend.CUDA)\n"
        "try: print(has, backend.mitsuba('cuda_ad_rgb').variant())\n"
        "except backend.BackendError as error: print(has, error)\n"
    )
    has, said = told.stdout.strip().split(" ", 1)
    assert (has in ("True", "1")) == (said == "cuda_ad_rgb"), told.stderr
    assert "\n" not in said


def test_missing_libatomic_is_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    def absent(name: str) -> None:
        raise OSError(f"{name}: cannot open shared object file")

    monkeypatch.setattr(ctypes, "CDLL", absent)
    monkeypatch.setattr(sys, "platform", "linux")
    said = backend._import_problem(NameError("name 'ImportError_msg' is not defined"))
    assert "libatomic.so.1 is missing" in said
    assert "install" in said


def test_doctor_passes_here_and_says_what_it_uses(capsys: pytest.CaptureFixture[str]) -> None:
    chosen = backend.choose()
    assert main(["doctor"]) == 0
    said = capsys.readouterr().out
    assert chosen is not None
    assert f"used {chosen.path}" in said
    assert "llvm_ad_rgb  renders" in said


def test_doctor_survives_a_child_that_aborts(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    aborting = tmp_path / "python"
    aborting.write_text("#!/bin/sh\nkill -ABRT $$\n")
    aborting.chmod(0o755)
    backend.choose()
    monkeypatch.setattr(sys, "executable", str(aborting))
    assert main(["doctor"]) == 2
    assert "llvm_ad_rgb  FAILED: the process was ended by SIGABRT" in capsys.readouterr().out


@pytest.mark.parametrize("home", [None, "/dev/null/nobody"])
def test_without_a_home_kernels_go_elsewhere_without_a_word(tmp_path: Path, home: str | None) -> None:
    code = "from mirelight.base import backend; dr, t = backend.drjit(); dr.eval(t.Float(dr.arange(t.UInt32, 9)) * 2.5)"
    env = {k: v for k, v in os.environ.items() if k not in ("HOME", "DRJIT_CACHE_DIR")} | {"TMPDIR": str(tmp_path)}
    env |= {} if home is None else {"HOME": home}
    ran = subprocess.run([sys.executable, "-c", code], env=env, capture_output=True, text=True, check=True)
    assert ran.stdout == ran.stderr == ""
    (folder,) = tmp_path.glob("mirelight-kernels-*")
    assert list(folder.iterdir()) and folder.stat().st_mode & 0o777 == 0o700

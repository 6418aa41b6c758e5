"""Finds a sound libLLVM before Dr.Jit is imported, and is the only caller of `mi.set_variant`.

Dr.Jit takes the library named by DRJIT_LIBLLVM_PATH, else whichever it meets first. With LLVM 15 and 16 the first
kernel aborts the whole process ("Cannot select … fminimum") and 14 is refused with a misleading message, so every
candidate is asked for its version in a child process and the choice is handed over in that variable.
"""

from __future__ import annotations

import ctypes
import logging
import os
import re
import shutil
import stat
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Literal, TypeAlias

from mirelight.base.errors import BackendError

Variant: TypeAlias = Literal["llvm_ad_rgb", "cuda_ad_rgb"]

OLDEST_SOUND_LLVM = 17  # 15 and 16 abort on the first kernel, Dr.Jit refuses 14 and older
_VARIABLE = "DRJIT_LIBLLVM_PATH"
_CACHE = "DRJIT_CACHE_DIR"

# LLVMGetVersion came with LLVM 16; a library that loads without it is older. Loaded in a child: two LLVMs in one
# process may end it, and a foreign or broken file can crash the loader.
_ASK = """
import ctypes, sys
library = ctypes.CDLL(sys.argv[1])
version = [ctypes.c_uint() for _ in range(3)]
if hasattr(library, "LLVMGetVersion"):
    library.LLVMGetVersion(*map(ctypes.byref, version))
print(*(v.value for v in version))
"""

_INSTALL = {
    "apt-get": "apt-get install libllvm19 (as root or with sudo; any version from 17 on will do)",
    "dnf": "dnf install llvm-libs (as root or with sudo)",
    "zypper": "zypper install libLLVM19 (as root or with sudo)",
    "pacman": "pacman -S llvm-libs (as root or with sudo)",
    "brew": "brew install llvm",
}


@dataclass(frozen=True, slots=True)
class LlvmLibrary:
    """A libLLVM on this machine and what it said of itself."""

    path: str  # as it was found
    version: tuple[int, int, int] | None  # None: it cannot be loaded; (0, 0, 0): older than 16
    where: str  # what led to it, for a person

    @property
    def sound(self) -> bool:
        """True where Dr.Jit's kernels are known to compile with it."""
        return self.version is not None and self.version[0] >= OLDEST_SOUND_LLVM

    @property
    def verdict(self) -> str:
        """One phrase: the version and whether it can be used."""
        if self.version is None:
            return "cannot be loaded"
        if self.version == (0, 0, 0):
            return "older than 16, would abort or be refused"
        number = ".".join(map(str, self.version))
        return number if self.sound else f"{number}, would abort the process"


# --- finding libLLVM -------------------------------------------------------------------------------------------------


def _loader_paths() -> Iterator[str]:
    """Files that the dynamic loader's cache knows."""
    ldconfig = shutil.which("ldconfig") or shutil.which("/sbin/ldconfig")
    if ldconfig is None:
        return
    listed = subprocess.run([ldconfig, "-p"], capture_output=True, text=True, check=False).stdout
    yield from (m.group(1) for m in re.finditer(r"^\s*libLLVM[-.].*=> (/.+)$", listed, re.MULTILINE))


def _folders() -> Iterator[tuple[Path, str]]:
    """Folders that may hold a libLLVM, with what they are."""
    for name in ("LD_LIBRARY_PATH", "DYLD_LIBRARY_PATH"):
        yield from ((Path(f), name) for f in os.environ.get(name, "").split(os.pathsep) if f)
    prefixes = [p for p in (os.environ.get("CONDA_PREFIX"), sys.prefix) if p]
    yield from ((Path(p) / "lib", "environment prefix") for p in prefixes)
    for pattern in (
        "usr/lib/*-linux-gnu*",
        "usr/lib/llvm-*/lib",
        "usr/lib/llvm/*/lib*",
        "usr/lib64",
        "usr/lib64/llvm*/lib*",
        "usr/lib",
    ):
        yield from ((f, "distribution") for f in sorted(Path("/").glob(pattern)))
    for home in ("opt/homebrew/opt", "usr/local/opt", "home/linuxbrew/.linuxbrew/opt"):
        yield from ((f, "Homebrew") for f in sorted(Path("/").glob(f"{home}/llvm*/lib")))


def _found() -> list[tuple[str, str]]:
    """Every libLLVM on this machine as (path, where), each real file once, DRJIT_LIBLLVM_PATH left aside."""
    pairs = [(path, "loader") for path in _loader_paths()]
    for folder, where in _folders():
        for pattern in ("libLLVM.so*", "libLLVM-[0-9]*.so*", "libLLVM.dylib", "libLLVM-[0-9]*.dylib"):
            pairs += [(str(path), where) for path in sorted(folder.glob(pattern))]
    unique: dict[str, tuple[str, str]] = {}
    for path, where in pairs:
        unique.setdefault(os.path.realpath(path), (path, where))
    return list(unique.values())


def _named_version(path: str) -> int:
    """The major version in a library's file name; a large number where the name tells none, so that it is asked."""
    match = re.search(r"(\d+)", Path(os.path.realpath(path)).name)
    return int(match.group(1)) if match else 999


@cache
def ask(path: str, where: str = "") -> LlvmLibrary:
    """Load `path` in a child process and ask its version."""
    command = [sys.executable, "-I", "-S", "-c", _ASK, path]
    try:
        child = subprocess.run(command, capture_output=True, text=True, check=False, timeout=60)
        major, minor, patch = map(int, child.stdout.split())
    except (subprocess.TimeoutExpired, ValueError):
        return LlvmLibrary(path, None, where)
    return LlvmLibrary(path, (major, minor, patch), where)


def libraries() -> list[LlvmLibrary]:
    """Every libLLVM of this machine, DRJIT_LIBLLVM_PATH first, then newest first. Asks each one: slow, for doctor."""
    named = os.environ.get(_VARIABLE)
    others = [x for x in _found() if not named or os.path.realpath(x[0]) != os.path.realpath(named)]
    asked = sorted((ask(*pair) for pair in others), key=lambda x: x.version or (-1, 0, 0), reverse=True)
    return ([ask(named, _VARIABLE)] if named else []) + asked


def _newest_sound() -> LlvmLibrary | None:
    """The newest sound library, asking no more of them than it takes."""
    best: LlvmLibrary | None = None
    for path, where in sorted(_found(), key=lambda pair: _named_version(pair[0]), reverse=True):
        if _named_version(path) < OLDEST_SOUND_LLVM or (
            best and best.version and _named_version(path) <= best.version[0]
        ):
            break
        library = ask(path, where)
        if library.sound and (best is None or (library.version or ()) > (best.version or ())):
            best = library
    return best


def install_command() -> str:
    """The command that installs a sound libLLVM with this machine's package manager."""
    for manager, command in _INSTALL.items():
        if shutil.which(manager):
            return command
    return "install LLVM 17 or newer (its shared library libLLVM) and name it in " + _VARIABLE


@cache
def choose() -> LlvmLibrary | None:
    """The libLLVM that Dr.Jit is to load: DRJIT_LIBLLVM_PATH where sound, else the newest sound one, else None.

    An unsound DRJIT_LIBLLVM_PATH is reported in one warning line. Decided once per process.
    """
    named = os.environ.get(_VARIABLE)
    if named:
        library = ask(named, _VARIABLE)
        if library.sound:
            return library
        log = logging.getLogger("mirelight")
        log.warning("%s=%s is not used: %s (17 or newer is needed)", _VARIABLE, named, library.verdict)
    return _newest_sound()


def prepare(variant: Variant = "llvm_ad_rgb") -> None:
    """Hand the chosen libLLVM to Dr.Jit; must run before Dr.Jit compiles anything. Cheap when called again.

    Raises:
        BackendError: `variant` needs libLLVM and this machine has no sound one.
    """
    library = choose()
    if library is None and variant == "llvm_ad_rgb":
        unsound = [f"{x.path} ({x.verdict})" for x in libraries()]
        seen = f"found only {', '.join(unsound)}" if unsound else "none was found"
        raise BackendError(f"libLLVM 17 or newer is needed and {seen}; to install it: {install_command()}")
    # With no sound library Dr.Jit must not find an unsound one by itself; it cannot load a device file.
    os.environ[_VARIABLE] = library.path if library else os.devnull
    _place_kernels()


# --- kernels ---------------------------------------------------------------------------------------------------------


def _place_kernels() -> None:
    """Name a folder for Dr.Jit's kernels where the one that it would take cannot be written: it prints a line of its
    own then, and compiles everything anew in every process."""
    home = os.environ.get("HOME")
    named = os.environ.get(_CACHE) or (str(Path(home) / ".drjit") if home else "")
    if named and _is_writable(Path(named)):
        return
    try:
        folder = Path(tempfile.gettempdir()) / f"mirelight-kernels-{os.getuid() if hasattr(os, 'getuid') else 0}"
        if not (_is_writable(folder) and _is_own(folder)):  # kernels are code: only one's own are loaded
            folder = Path(tempfile.mkdtemp(prefix="mirelight-kernels-"))
    except OSError:  # nowhere at all
        return
    os.environ[_CACHE] = str(folder)


def _is_writable(folder: Path) -> bool:
    """Whether files can be made in a folder, which is made where only itself is missing."""
    try:
        folder.mkdir(mode=0o700, exist_ok=True)
    except OSError:
        return False
    return os.access(folder, os.W_OK | os.X_OK)


def _is_own(folder: Path) -> bool:
    found = folder.lstat()
    return not hasattr(os, "getuid") or (
        stat.S_ISDIR(found.st_mode) and found.st_uid == os.getuid() and not found.st_mode & 0o022
    )


# --- the modules -----------------------------------------------------------------------------------------------------


def _import_drjit() -> ModuleType:
    try:
        import drjit as dr
    except (ImportError, NameError) as error:  # without libatomic Dr.Jit's own import handler ends in a NameError
        raise BackendError(_import_problem(error)) from error
    return dr


def _import_problem(error: Exception) -> str:
    if sys.platform == "linux":
        try:
            ctypes.CDLL("libatomic.so.1")
        except OSError:
            package = "dnf install libatomic" if shutil.which("dnf") else "apt-get install libatomic1"
            return f"Dr.Jit cannot be imported because libatomic.so.1 is missing; to install it: {package}"
    return f"Dr.Jit cannot be imported: {error}"


def _ready(variant: Variant, threads: int | None) -> ModuleType:
    """Dr.Jit, with the backend of `variant` known to work and its thread count set."""
    prepare(variant)
    dr = _import_drjit()
    if variant == "cuda_ad_rgb" and not dr.has_backend(dr.JitBackend.CUDA):
        raise BackendError(
            "cuda_ad_rgb needs an NVIDIA GPU and its driver (libcuda), and none was found; use llvm_ad_rgb"
        )
    if variant == "llvm_ad_rgb" and dr.detail.llvm_version()[0] < OLDEST_SOUND_LLVM:
        raise BackendError(
            f"Dr.Jit was imported before mirelight chose its libLLVM; import mirelight first or set {_VARIABLE}"
        )
    if threads is not None:
        if threads < 1:
            raise BackendError(f"{threads} threads asked for; give 1 or more")
        if dr.thread_count() != threads:
            dr.set_thread_count(threads)
    return dr


def give_back() -> None:
    """Give the memory back that Dr.Jit keeps for arrays to come, after work whose arrays are unlike those that follow:
    of three million splats it is two gigabytes."""
    if "drjit" in sys.modules:
        _import_drjit().flush_malloc_cache()


def mitsuba(variant: Variant = "llvm_ad_rgb", threads: int | None = None) -> ModuleType:
    """The `mitsuba` module with `variant` active.

    The variant belongs to the whole process. Asking for another one switches it; Mitsuba objects made before stay those
    of their own variant and must not be rendered any more, so hold none across calls.

    Args:
        variant: Mitsuba's name for it.
        threads: worker threads from now on; None leaves them as they are (at first: every core).

    Raises:
        BackendError: the variant cannot run here; says what to install.
    """
    _ready(variant, threads)
    import mitsuba as mi

    if mi.variant() != variant:
        try:
            mi.set_variant(variant)
        except ImportError as error:
            raise BackendError(f"{variant} cannot be used: {error}") from error
    return mi


def drjit(variant: Variant = "llvm_ad_rgb", threads: int | None = None) -> tuple[ModuleType, ModuleType]:
    """The `drjit` module and its array types without derivatives: `drjit.cuda` where asked, else `drjit.llvm`.

    Args and errors as for :func:`mitsuba`.
    """
    dr = _ready("cuda_ad_rgb" if variant == "cuda_ad_rgb" else "llvm_ad_rgb", threads)
    return dr, import_module("drjit.cuda" if variant == "cuda_ad_rgb" else "drjit.llvm")

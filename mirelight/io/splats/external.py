"""Formats that are read by PlayCanvas' command-line tool splat-transform, where it is installed (LCC)."""

from __future__ import annotations

import shutil
import subprocess
import tempfile
from pathlib import Path

from mirelight.base.errors import InputError
from mirelight.io.splats import ply
from mirelight.io.splats.info import SplatFileInfo
from mirelight.model import SplatCloud

_TIMEOUT = 900  # seconds; a city-sized LCC takes minutes


def summary(path: Path, lod: int | None) -> SplatFileInfo:
    """The head of a converted file: the whole conversion, because only the tool knows the format. Raises InputError."""
    with tempfile.TemporaryDirectory(prefix="mirelight-") as folder:
        converted = ply.summary(_convert(path, Path(folder), lod))
    return SplatFileInfo(
        path=path,
        format=f"{path.suffix.lower()} through splat-transform",
        count=converted.count,
        sh_degree=converted.sh_degree,
        antialiased=converted.antialiased,
        notes=converted.notes,
    )


def read(path: Path, lod: int | None) -> SplatCloud:
    """The splats as splat-transform converts them, in PLY's axes. Raises InputError."""
    with tempfile.TemporaryDirectory(prefix="mirelight-") as folder:
        return ply.read(_convert(path, Path(folder), lod))


def _convert(path: Path, folder: Path, lod: int | None) -> Path:
    tool = shutil.which("splat-transform")
    if tool is None:
        remedy = "install it (npm install -g @playcanvas/splat-transform) or convert the file to .ply"
        raise InputError(
            path, f"{path.suffix.lower()} files are read through splat-transform, which is not here", remedy
        )
    target = folder / "converted.ply"
    command = [tool, "--quiet", "--lod-select", str(lod or 0), str(path.resolve()), str(target)]
    try:
        done = subprocess.run(
            command, cwd=folder, capture_output=True, encoding="utf-8", errors="replace", timeout=_TIMEOUT, check=False
        )
    except subprocess.TimeoutExpired:
        raise InputError(path, f"splat-transform took more than {_TIMEOUT} s", "convert it to .ply by hand") from None
    except OSError as e:
        raise InputError(path, f"splat-transform could not be started ({e.strerror})") from None
    if done.returncode or not target.is_file():
        raise InputError(path, f"splat-transform could not convert it: {_reason(done)}", "is the file whole?")
    return target


def _reason(done: subprocess.CompletedProcess[str]) -> str:
    """The line in which the tool names an error, without the stack trace around it; else its last line."""
    lines = [line.strip("✗ \t") for line in (done.stderr + done.stdout).splitlines() if line.strip()]
    named = [line for line in lines if "rror:" in line]
    return (named or lines[-1:] or ["no message"])[0][:200]

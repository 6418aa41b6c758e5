"""Files that are dropped on the page: kept beside the job, which names them."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import count
from pathlib import Path

import numpy as np

from mirelight.apps.first_job import beside
from mirelight.base.errors import InputError
from mirelight.io import splats
from mirelight.io.atomic import write_file
from mirelight.io.mesh import read_mesh
from mirelight.io.safety import read_bytes
from mirelight.io.suffixes import SPLATS

MOST_BYTES = 256 * 2**20
MOST_OF_CAPTURES = 2**30
_SUFFIXES = (".hdr", ".exr")
_MESHES = (".glb", ".obj", ".stl")  # whole in one file, and no capture


def capture(folder: Path, name: str, body: bytes) -> Path:
    """Keep a capture; its path.

    Raises:
        InputError: it is no splat file.
        OutputError: it cannot be written.
    """
    with _kept(folder, name, SPLATS, body) as path:
        splats.summary(path)
    return path


def kept(folder: Path, name: str, body: bytes) -> tuple[str, float]:
    """Keep a panorama.

    Returns:
        Its file's name, and the intensity that brings its mean to 1 cd/m².

    Raises:
        InputError: it is no panorama.
        OutputError: it cannot be written.
    """
    with _kept(folder, name, _SUFFIXES, body) as path:
        found = beside.of_file(path, np.zeros(3))
        if found is None:
            raise InputError(path, "a panorama without light", beside.NO_LIGHT)
    return path.name, found.intensity


def thing(folder: Path, name: str, body: bytes) -> tuple[str, list[list[float]]]:
    """Keep a mesh that is put into the capture.

    Returns:
        Its file's name, and its bounds: lowest and highest x, y, z.

    Raises:
        InputError: it is no mesh.
        OutputError: it cannot be written.
    """
    with _kept(folder, name, _MESHES, body) as path:
        found = read_mesh(path, finish=True)
        if not len(found.faces):
            raise InputError(path, "no triangles", "drop a mesh")
    return path.name, [x.tolist() for x in found.bounds]


@contextmanager
def _kept(folder: Path, name: str, suffixes: tuple[str, ...], body: bytes) -> Iterator[Path]:
    """A file that was written; one of no use goes again, unless it was there before, and is named as on the page."""
    path, fresh = _written(folder, name, suffixes, body)
    try:
        yield path
    except InputError as error:
        if fresh:
            path.unlink()
        raise InputError(path.name, error.found, error.remedy) from None


def _written(folder: Path, name: str, suffixes: tuple[str, ...], body: bytes) -> tuple[Path, bool]:
    """Write a file under its own name, and whether it was not there; no other one is written over."""
    plain = re.sub(r"[^\w.-]+", "-", Path(name).name).strip(".-")[-100:]
    suffix = next((x for x in suffixes if plain.lower().endswith(x)), None)
    if suffix is None or plain.lower() == suffix:
        raise InputError(plain or "the file", "not of a kind that is taken", f"drop one of {', '.join(suffixes)}")
    path = _place(folder, plain[: -len(suffix)], suffix, body)
    fresh = not path.exists()
    if fresh:
        write_file(path, body)
    return path, fresh


def _place(folder: Path, stem: str, suffix: str, body: bytes) -> Path:
    """Where there is nothing yet, or the same."""
    for number in count(1):
        path = folder / (f"{stem}{suffix}" if number == 1 else f"{stem}-{number}{suffix}")
        same = path.is_file() and path.stat().st_size == len(body) and read_bytes(path, MOST_OF_CAPTURES) == body
        if same or not path.exists():
            return path
    raise AssertionError

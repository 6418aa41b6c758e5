"""Files that are dropped on the page: kept beside the job, which names them."""

from __future__ import annotations

import re
from itertools import count
from pathlib import Path

import numpy as np

from mirelight.apps.first_job import beside
from mirelight.base.errors import InputError
from mirelight.io.atomic import atomic_path
from mirelight.io.safety import read_bytes
from mirelight.io.suffixes import SPLATS

MOST_BYTES = 256 * 2**20
MOST_OF_CAPTURES = 2**30
_SUFFIXES = (".hdr", ".exr")


def capture(folder: Path, name: str, body: bytes) -> Path:
    """Keep a capture; its path.

    Raises:
        InputError: its name is not one of a splat file.
        OutputError: it cannot be written.
    """
    return _written(folder, name, SPLATS, body)


def kept(folder: Path, name: str, body: bytes) -> tuple[str, float]:
    """Keep a panorama.

    Returns:
        Its file's name, and the intensity that brings its mean to 1 cd/m².

    Raises:
        InputError: it is no panorama.
        OutputError: it cannot be written.
    """
    path = _written(folder, name, _SUFFIXES, body)
    try:
        found = beside.of_file(path, np.zeros(3))
        if found is None:
            raise InputError(path, "a panorama without light", beside.NO_LIGHT)
    except InputError as error:
        path.unlink()
        raise InputError(path.name, error.found, error.remedy) from None
    return path.name, found.intensity


def _written(folder: Path, name: str, suffixes: tuple[str, ...], body: bytes) -> Path:
    """Write a file under its own name; the same is kept once, and no other one is written over."""
    plain = re.sub(r"[^\w.-]+", "-", Path(name).name).strip(".-")[-100:]
    suffix = next((x for x in suffixes if plain.lower().endswith(x)), None)
    if suffix is None or plain.lower() == suffix:
        raise InputError(plain or "the file", "not of a kind that is taken", f"drop one of {', '.join(suffixes)}")
    path = _place(folder, plain[: -len(suffix)], suffix, body)
    if not path.exists():
        with atomic_path(path) as temporary:
            temporary.write_bytes(body)
    return path


def _place(folder: Path, stem: str, suffix: str, body: bytes) -> Path:
    """Where there is nothing yet, or the same."""
    for number in count(1):
        path = folder / (f"{stem}{suffix}" if number == 1 else f"{stem}-{number}{suffix}")
        same = path.is_file() and path.stat().st_size == len(body) and read_bytes(path, MOST_OF_CAPTURES) == body
        if same or not path.exists():
            return path
    raise AssertionError

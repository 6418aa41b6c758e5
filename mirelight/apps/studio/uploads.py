"""Panoramas that are dropped on the page: kept beside the job, which names them."""

from __future__ import annotations

import re
from itertools import count
from pathlib import Path

import numpy as np

from mirelight.apps.first_job import beside
from mirelight.base.errors import InputError
from mirelight.io.atomic import atomic_path
from mirelight.io.safety import read_bytes

MOST_BYTES = 256 * 2**20
_SUFFIXES = (".hdr", ".exr")


def kept(folder: Path, name: str, body: bytes) -> tuple[str, float]:
    """Keep a panorama. The same file is kept once, and no other one is written over.

    Returns:
        Its file's name, and the intensity that brings its mean to 1 cd/m².

    Raises:
        InputError: it is no panorama.
        OutputError: it cannot be written.
    """
    plain = re.sub(r"[^\w.-]+", "-", Path(name).name).strip(".-") or "panorama"
    stem, suffix = Path(plain).stem[:60], Path(plain).suffix.lower()
    if suffix not in _SUFFIXES:
        raise InputError(plain, "no panorama", f"drop one of {', '.join(_SUFFIXES)}")
    path = _place(folder, stem, suffix, body)
    if not path.exists():
        with atomic_path(path) as temporary:
            temporary.write_bytes(body)
    try:
        found = beside.of_file(path, np.zeros(3))
        if found is None:
            raise InputError(path, "a panorama without light", beside.NO_LIGHT)
    except InputError as error:
        path.unlink()
        raise InputError(plain, error.found, error.remedy) from None
    return path.name, found.intensity


def _place(folder: Path, stem: str, suffix: str, body: bytes) -> Path:
    """Where there is nothing yet, or the same."""
    for number in count(1):
        path = folder / (f"{stem}{suffix}" if number == 1 else f"{stem}-{number}{suffix}")
        same = path.is_file() and path.stat().st_size == len(body) and read_bytes(path, MOST_BYTES) == body
        if same or not path.exists():
            return path
    raise AssertionError

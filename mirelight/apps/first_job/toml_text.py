"""Paths, places and vectors as a first job has them."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from mirelight.apps.first_job import view
from mirelight.base.errors import InputError
from mirelight.model import F64

_DIGITS = 4


class Names:
    """Paths as a job in a folder has them.

    Raises:
        InputError: a path that TOML, which is UTF-8, cannot hold.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder.resolve()

    def __call__(self, path: Path) -> str:
        return quoted(Path(os.path.relpath(path.resolve(), self._folder)))


def quoted(path: Path) -> str:
    """A path as a job has it.

    Raises:
        InputError: one that TOML, which is UTF-8, cannot hold.
    """
    name = path.as_posix()
    try:
        name.encode()
    except UnicodeEncodeError:
        raise InputError(path, "a name that is not UTF-8, which no job can hold", "rename it") from None
    return json.dumps(name, ensure_ascii=False)


def position(values: F64, seen: view.FirstView) -> str:
    """A place (3,), to a hundred-thousandth of what the camera is away, be it in millimetres or in kilometres."""
    away = float(np.linalg.norm(seen.target - seen.camera.position))
    return vector(values, max(_DIGITS - math.floor(math.log10(away)), 0))


def vector(values: Sequence[float] | F64, digits: int = _DIGITS) -> str:
    """Numbers (N,), each to so many digits after the point."""
    return "[" + ", ".join(f"{round(float(v), digits) + 0.0:.12g}" for v in values) + "]"

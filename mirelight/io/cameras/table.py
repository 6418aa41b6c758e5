"""Cameras as a table of comma-separated values: a header with the columns' names, a line for each camera.

Columns: `x y z`, the position; `qw qx qy qz`, the rotation of world from camera, or `target_x target_y target_z`, a
point looked at, with `up_x up_y up_z` (default +Y); `fx` in pixels (and `fy cx cy`) with `width height`, or `yfov` in
degrees (default 45); and `name`. Order is free, other columns are ignored.
"""

from __future__ import annotations

import csv
import io
import math
from functools import partial
from pathlib import Path

import numpy as np

from mirelight.base import conventions
from mirelight.base.conventions import Matrix
from mirelight.base.errors import InputError
from mirelight.io.cameras import reading
from mirelight.io.cameras.placed import Angle, FileCamera, Intrinsics
from mirelight.io.cameras.transforms import Axes
from mirelight.io.safety import read_bytes

_LARGEST = 1 << 27  # bytes
_LARGEST_NUMBER = 1e9  # of units and pixels, as everywhere in a job
_YFOV = 45.0  # degrees
_POSITION = ("x", "y", "z")
_QUATERNION = ("qw", "qx", "qy", "qz")
_TARGET = ("target_x", "target_y", "target_z")
_UP = ("up_x", "up_y", "up_z")


def read(path: Path, axes: Axes) -> tuple[FileCamera, ...]:
    """The cameras in the order of the lines. Raises InputError.

    Args:
        path: the file.
        axes: of the cameras whose rotation is a quaternion.
    """
    try:
        text = read_bytes(path, _LARGEST).decode("utf-8-sig")
        table = list(csv.reader(io.StringIO(text, newline=""), strict=True))
    except (UnicodeDecodeError, csv.Error) as e:
        reason = "not UTF-8 text" if isinstance(e, UnicodeDecodeError) else str(e)[:80]
        raise InputError(path, f"not a table of comma-separated values ({reason})") from None
    header = [name.strip().lower() for name in table[0]] if table else []
    for name in _POSITION:
        if name not in header:
            raise InputError(
                path, f"no column {name}", f"columns are {', '.join(_POSITION + _QUATERNION)} and more", field="line 1"
            )
    lines = [(number, row) for number, row in enumerate(table[1:], start=2) if any(cell.strip() for cell in row)]
    reading.limited(path, len(lines))
    for number, row in lines:
        if len(row) != len(header):
            found = f"{len(row)} values, and the header has {len(header)} names"
            raise InputError(path, found, "leave a cell empty, not out", field=f"line {number}")
    rows = [_Row(path, number, dict(zip(header, (c.strip() for c in row), strict=False))) for number, row in lines]
    names = reading.picture_names(row.cells.get("name") or f"{i:04d}" for i, row in enumerate(rows, start=1))
    return tuple(
        FileCamera(name=name, world_from_camera=_pose(row, axes), lens=_lens(row))
        for row, name in zip(rows, names, strict=True)
    )


class _Row:
    """One line, by the names of its columns."""

    def __init__(self, path: Path, number: int, cells: dict[str, str]) -> None:
        self.cells = cells
        self.fail = partial(InputError, path, field=f"line {number}")

    def has(self, *names: str) -> bool:
        return any(self.cells.get(name) for name in names)

    def number(self, name: str, default: float | None = None) -> float:
        cell = self.cells.get(name)
        if not cell:
            if default is None:
                raise self.fail(f"no {name}", "give a number")
            return default
        try:
            value = float(cell)
        except ValueError:
            value = math.nan
        if not abs(value) <= _LARGEST_NUMBER:
            raise self.fail(f"{cell[:40]!r} as {name}", f"give a number of at most {_LARGEST_NUMBER:g}")
        return value

    def vector(self, names: tuple[str, ...]) -> Matrix:
        return np.array([self.number(name) for name in names])

    def side(self, name: str) -> int:
        value = self.number(name)
        if not (value == int(value) and 1 <= value <= reading.LARGEST_SIDE):
            raise self.fail(f"{value:g} as {name}", "give pixels")
        return int(value)


def _pose(row: _Row, axes: Axes) -> Matrix:
    position = row.vector(_POSITION)
    if row.has(*_QUATERNION):
        if row.has(*_TARGET):
            raise row.fail("both a quaternion and a target", "keep one of them")
        rotation = reading.rotation_of(row.vector(_QUATERNION), row.fail)
        pose = reading.rigid(conventions.compose(position, rotation), row.fail)
        return pose @ reading.FLIP if axes == "opencv" else pose
    target = row.vector(_TARGET)
    up = row.vector(_UP) if row.has(*_UP) else np.array([0.0, 1.0, 0.0])
    if not np.linalg.norm(target - position) > 1e-9 or not np.linalg.norm(up) > 1e-9:
        raise row.fail("a direction of length zero", "give another target or up")
    return reading.rigid(conventions.look_at(position, target, up), row.fail)


def _lens(row: _Row) -> Intrinsics | Angle:
    size = (row.side("width"), row.side("height")) if row.has("width", "height") else None
    if not row.has("fx"):
        degrees = reading.field_of_view(row.number("yfov", _YFOV), row.fail)
        return Angle(degrees=degrees, side="vertical", size=size)
    if row.has("yfov"):
        raise row.fail("both fx and yfov", "keep one of them")
    if size is None:
        raise row.fail("fx without width and height", "give them in pixels")
    fx = row.number("fx")
    values = (fx, row.number("fy", fx), row.number("cx", size[0] / 2), row.number("cy", size[1] / 2))
    return reading.intrinsics(values, size, row.fail)

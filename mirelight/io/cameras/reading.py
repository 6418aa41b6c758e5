"""What the readers of camera files share: JSON, numbers, poses and names."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from mirelight.base import conventions
from mirelight.base.conventions import Matrix
from mirelight.base.errors import InputError
from mirelight.base.names import FreeNames
from mirelight.io.cameras.placed import Intrinsics
from mirelight.io.gltf.fields import Fields
from mirelight.io.safety import json_value, read_bytes
from mirelight.model import F64

MOST_CAMERAS = 100_000  # in one file
LARGEST_SIDE = 65536  # px of a picture
LARGEST_JSON = 1 << 27  # bytes
_LARGEST_POSITION = 1e9  # units; as everywhere in a job
_LARGEST_FOCAL = 1e9  # px
_LEAST_FOCAL = 1e-3  # px
_SKEW = 1e-3  # how far a rotation's columns may be from right angles and from one length
_LONGEST_NAME = 100

FLIP = np.diag([1.0, -1.0, -1.0, 1.0])  # OpenCV's camera axes (+Z ahead, +Y down) to glTF's and back


def load_json(path: Path, data: bytes | None = None) -> Any:
    """The JSON value of a file. Raises InputError: too large, no JSON, too deep."""
    return json_value(path, read_bytes(path, LARGEST_JSON) if data is None else data)


def objects(path: Path, where: str, values: object) -> list[Fields]:
    """The objects of an array, each knowing where it stands. Raises InputError: no array, too long, not objects."""
    if not isinstance(values, list):
        raise InputError(path, "not an array of cameras", field=where)
    limited(path, len(values), where)
    out = []
    for i, value in enumerate(values):
        if not isinstance(value, dict):
            raise InputError(path, "not an object", field=f"{where}[{i}]")
        out.append(Fields(path, f"{where}[{i}]", value))
    return out


def limited(path: Path, count: int, where: str = "") -> None:
    """Raises InputError: no camera, or more than anybody renders."""
    if count < 1:
        raise InputError(path, "no camera in it", field=where)
    if count > MOST_CAMERAS:
        raise InputError(path, f"{count:,} cameras", f"at most {MOST_CAMERAS:,} are read", field=where)


def rows(fields: Fields, name: str) -> F64:
    """A matrix (4, 4) written as rows of 4 numbers; a last row 0 0 0 1 may be left out. Raises InputError."""
    value = fields.values.get(name)
    if not isinstance(value, list) or len(value) not in (3, 4):
        found = "missing" if name not in fields.values else "not a matrix"
        raise fields.fail(name, found, "4 rows of 4 numbers are expected")
    out = np.eye(4)
    for i, row in enumerate(value):
        label = f"{name}[{i}]"
        out[i] = Fields(fields.file, fields.where, {label: row}).vector(label, 4)
    if not np.allclose(out[3], (0, 0, 0, 1), atol=1e-6):
        raise fields.fail(f"{name}[3]", "not 0 0 0 1", "the matrix goes row by row, the position in its last column")
    return out


def rigid(matrix: ArrayLike, fail: Callable[[str, str], InputError]) -> Matrix:
    """The pose (4, 4) with its scale taken out and its rotation made exact.

    Args:
        matrix: (4, 4) rotation times one scale, and a position.
        fail: makes the error from what was found and what to do.

    Raises:
        InputError: mirrored, sheared, flattened, or farther out than any scene.
    """
    m = np.asarray(matrix, dtype=np.float64)
    if not np.all(np.abs(m[:3, 3]) <= _LARGEST_POSITION):
        raise fail("a position beyond all scenes", "the file is damaged")
    r = m[:3, :3]
    with np.errstate(over="ignore"):
        size = float(np.linalg.norm(r)) / math.sqrt(3)
    if not 1e-9 < size < 1e9:
        raise fail("a rotation without size", "the file is damaged")
    r = r / size
    if np.abs(r.T @ r - np.eye(3)).max() > _SKEW:
        raise fail("a matrix with shear or unequal scale", "a camera has a rotation and a position")
    if np.linalg.det(r) < 0:
        raise fail("a mirrored matrix", "a camera has a rotation and a position; two of its axes may be exchanged")
    u, _, v = np.linalg.svd(r)
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = u @ v, m[:3, 3]
    return out


def rotation_of(wxyz: ArrayLike, fail: Callable[[str, str], InputError]) -> Matrix:
    """The rotation (3, 3) of a quaternion of any length but zero. Raises InputError."""
    q = np.asarray(wxyz, dtype=np.float64)
    with np.errstate(over="ignore"):
        length = float(np.linalg.norm(q))
    if not 1e-9 < length < 1e9:
        raise fail("a quaternion of length zero", "the file is damaged")
    return conventions.rotation_from_quaternion(q / length)


def inverse(pose: Matrix) -> Matrix:
    """The inverse (4, 4) of a rigid matrix."""
    r, t = pose[:3, :3], pose[:3, 3]
    return conventions.compose(-r.T @ t, r.T)


def side(fields: Fields, name: str) -> int:
    """A picture's width or height in pixels. Raises InputError."""
    return fields.integer(name, low=1, high=LARGEST_SIDE)


def intrinsics(values: Sequence[float], size: tuple[int, int], fail: Callable[[str, str], InputError]) -> Intrinsics:
    """The lens of fx, fy, cx, cy in pixels. Raises InputError: out of every camera's range."""
    fx, fy, cx, cy = values
    if not all(_LEAST_FOCAL <= f <= _LARGEST_FOCAL for f in (fx, fy)):
        raise fail(f"a focal length of {fx:g} by {fy:g} pixels", "it must be positive")
    if not all(abs(c) <= _LARGEST_FOCAL for c in (cx, cy)):
        raise fail(f"a principal point at {cx:g}, {cy:g}", "it is given in pixels")
    return Intrinsics(width=size[0], height=size[1], fx=fx, fy=fy, cx=cx, cy=cy)


def field_of_view(degrees: float, fail: Callable[[str, str], InputError]) -> float:
    """The angle in degrees. Raises InputError: not above 0 and below 180."""
    if not 0.01 <= degrees <= 179:
        raise fail(f"a field of view of {degrees:g} degrees", "it lies between 0 and 179")
    return degrees


def picture_names(raw: Iterable[str]) -> list[str]:
    """Names for cameras from those of their pictures, all different and fit for file names.

    The suffix and the folders that all share are left out; other folders are joined by "_".
    """
    parts = [[p for p in re.split(r"[/\\]+", name) if p not in ("", ".", "..")] or ["camera"] for name in raw]
    shared = 0
    folders = [p[:-1] for p in parts]
    while folders and all(len(f) > shared and f[shared] == folders[0][shared] for f in folders):
        shared += 1
    free, names = FreeNames(), list[str]()
    for p in parts:
        last = re.sub(r"(?<=.)\.(?=\w*[A-Za-z])\w{1,5}$", "", p[-1])
        names.append(free.take(_tidy("_".join([*p[shared:-1], last]))))
    return names


def _tidy(name: str) -> str:
    clean = "".join("_" if c in '/\\:*?"<>|[]' or not c.isprintable() else c for c in name).strip().lstrip(".")
    return clean[-_LONGEST_NAME:].lstrip(". ") or "camera"

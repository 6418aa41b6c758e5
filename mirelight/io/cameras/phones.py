"""Poses that phones write while they capture: Polycam's folder of cameras, Record3D's metadata.

Polycam: one JSON file for each picture, `t_00` to `t_23` the first three rows of world from camera, `fx fy cx cy width
height` in pixels. Record3D: `poses`, a row [qx qy qz qw x y z] for each picture, and `K`, the lens as a 3 x 3 matrix
column by column. Both in ARKit's axes: metres, Y up, the camera looks along its -Z.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from mirelight.base import conventions
from mirelight.base.errors import InputError
from mirelight.io.cameras import reading
from mirelight.io.cameras.placed import FileCamera
from mirelight.io.gltf.fields import Fields

_POLYCAM_FOLDERS = ("keyframes/corrected_cameras", "keyframes/cameras", "corrected_cameras", "cameras", ".")
_ROW = ("0", "1", "2", "3")


def find_polycam(folder: Path) -> Path | None:
    """The folder of Polycam's camera files in an export; those that it has corrected come first."""
    for name in _POLYCAM_FOLDERS:
        inside = folder / name
        if inside.is_dir() and any(is_polycam(_peek(file)) for file in sorted(inside.glob("*.json"))[:1]):
            return inside
    return None


def is_polycam(data: Any) -> bool:
    """True for the content of one of Polycam's camera files."""
    return isinstance(data, dict) and "t_00" in data and "t_23" in data


def _peek(file: Path) -> Any:
    try:
        return reading.load_json(file)
    except InputError:
        return None


def read_polycam(files: Sequence[Path]) -> tuple[FileCamera, ...]:
    """The cameras of some files, sorted by name. Raises InputError."""
    ordered = sorted(files, key=lambda file: file.name)
    if ordered:
        reading.limited(ordered[0].parent, len(ordered))
    names = reading.picture_names(file.name for file in ordered)
    return tuple(_polycam(file, name) for file, name in zip(ordered, names, strict=True))


def _polycam(file: Path, name: str) -> FileCamera:
    data = reading.load_json(file)
    if not is_polycam(data):
        raise InputError(file, "not a camera of Polycam", "take other files out of the folder")
    fields = Fields(file, "", data)
    matrix = np.eye(4)
    matrix[:3] = [[fields.number(f"t_{row}{column}") for column in _ROW] for row in _ROW[:3]]
    size = reading.side(fields, "width"), reading.side(fields, "height")
    lens = tuple(fields.number(key) for key in ("fx", "fy", "cx", "cy"))
    return FileCamera(
        name=name,
        world_from_camera=reading.rigid(matrix, partial(fields.fail, "t_00")),
        lens=reading.intrinsics(lens, size, partial(fields.fail, "fx")),
        picture=file.stem,
    )


def is_record3d(data: Any) -> bool:
    """True for the content of Record3D's metadata."""
    return isinstance(data, dict) and "poses" in data and "K" in data


def read_record3d(path: Path, data: dict[str, Any]) -> tuple[FileCamera, ...]:
    """The cameras in order; each has the name of its picture, its number from 0. Raises InputError."""
    top = Fields(path, "", data)
    size = reading.side(top, "w"), reading.side(top, "h")
    k = top.vector("K", 9)
    lens = reading.intrinsics((k[0], k[4], k[6], k[7]), size, partial(top.fail, "K"))
    poses = data["poses"]
    if not isinstance(poses, list):
        raise top.fail("poses", "not an array of cameras")
    reading.limited(path, len(poses), "poses")
    out = []
    for i, value in enumerate(poses):
        key = f"poses[{i}]"
        row = Fields(path, "", {key: value}).vector(key, 7)
        fail = partial(top.fail, key)
        rotation = reading.rotation_of(row[[3, 0, 1, 2]], fail)
        pose = reading.rigid(conventions.compose(row[4:], rotation), fail)
        out.append(FileCamera(name=str(i), world_from_camera=pose, lens=lens))
    return tuple(out)

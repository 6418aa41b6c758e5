"""The camera that a PLY file of splats holds: SHARP (Mescheder and others 2025) makes splats of one picture.

Beside the splats such a file has the elements `extrinsic` (16 numbers, camera from world, row by row, OpenCV's axes),
`intrinsic` (9, in pixels, row by row) and `image_size` (2: width, height), each of one property of the same name.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np

from mirelight.base.errors import InputError
from mirelight.io.cameras import reading
from mirelight.io.cameras.placed import FileCamera
from mirelight.io.safety import open_binary
from mirelight.io.splats.ply_header import PlyHeader, blocks, read_ply_header
from mirelight.model import F64

_COUNTS = {"extrinsic": 16, "intrinsic": 9, "image_size": 2}


def is_of(path: Path) -> bool:
    """Whether a file of splats says from where its picture was taken. Raises InputError: a damaged PLY file."""
    if not path.is_file():
        return False
    with open_binary(path) as file:
        return file.read(3) == b"ply" and _holds(read_ply_header(path))


def _holds(header: PlyHeader) -> bool:
    there = (header.elements.get(name) for name in _COUNTS)
    return all(x is not None and x.name in x.names and x.count == _COUNTS[x.name] for x in there)


def read(path: Path) -> tuple[FileCamera, ...]:
    """The one camera. Raises InputError: none in the file, or none that a pinhole stands for."""
    header = read_ply_header(path)
    if not _holds(header):
        raise InputError(path, "splats without a camera in their file", "give the file of the capture's cameras")
    pose, lens, size = (_numbers(header, name) for name in _COUNTS)
    width, height = (int(x) for x in size)
    if not 1 <= min(width, height) <= max(width, height) <= reading.LARGEST_SIDE:
        raise InputError(path, f"{width} x {height} pixels", "the file is damaged", field="image_size")
    fx, fy, cx, cy = lens[[0, 4, 2, 5]].tolist()
    world = reading.inverse(reading.rigid(pose.reshape(4, 4), partial(_fail, path, "extrinsic")))
    return (
        FileCamera(
            name="picture",
            world_from_camera=world @ reading.FLIP,
            lens=reading.intrinsics((fx, fy, cx, cy), (width, height), partial(_fail, path, "intrinsic")),
        ),
    )


def _numbers(header: PlyHeader, name: str) -> F64:
    (rows,) = blocks(header.path, header.elements[name], _COUNTS[name])
    return np.asarray(rows[name], np.float64)


def _fail(path: Path, field: str, found: str, remedy: str) -> InputError:
    return InputError(path, found, remedy, field=field)

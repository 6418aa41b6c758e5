"""Writes COLMAP's sparse models, text and binary: pinhole cameras, images and points without tracks.

Both come out, since some loaders read one and some the other, and the text reader of INRIA's trainer is slow. Ids count
from 1. Format: see :mod:`mirelight.io.cameras.colmap`.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from mirelight.base.errors import InputError
from mirelight.io.atomic import write_file
from mirelight.io.cameras import colmap
from mirelight.model import Camera
from mirelight.model.arrays import freeze

_PINHOLE = 1  # the model's number


@dataclass(frozen=True, slots=True, eq=False)
class Points:
    """Points of a sparse model, M of them."""

    positions: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))  # (M, 3) world units
    colors: np.ndarray = field(default_factory=lambda: np.zeros((0, 3), dtype=np.uint8))  # (M, 3) display-encoded

    def __post_init__(self) -> None:
        freeze(self, "positions", (len(self.positions), 3), np.float64)
        freeze(self, "colors", (len(self.positions), 3), np.uint8)


def write(folder: Path, cameras: Sequence[Camera], pictures: Sequence[str], points: Points | None = None) -> None:
    """Write cameras, images and points3D as .txt and .bin into a folder that exists.

    Args:
        folder: usually sparse/0.
        cameras: in the world that the model shall have; equal lenses share a camera of the model.
        pictures: the file name of each camera's picture.
        points: what a trainer starts from.

    Raises:
        InputError: an orthographic camera, which a model cannot hold.
        OutputError: as for :func:`mirelight.io.atomic.atomic_path`.
    """
    for name, data in model(folder, cameras, pictures, points):
        write_file(folder / name, data)


def model(
    folder: Path, cameras: Sequence[Camera], pictures: Sequence[str], points: Points | None = None
) -> Iterator[tuple[str, bytes]]:
    """The files of :func:`write`, each with its name. Raises InputError, as it does."""
    for camera in cameras:
        if camera.projection != "perspective":
            raise InputError(folder, f"camera {camera.name!r} is orthographic", "a COLMAP model holds pinholes alone")
    points = points or Points()
    lenses, which = _lenses(cameras)
    poses = [colmap.pose(camera.world_from_camera) for camera in cameras]
    images = [
        (i, q, t, w, name) for i, ((q, t), w, name) in enumerate(zip(poses, which, pictures, strict=True), start=1)
    ]
    for name, head, rows in (
        ("cameras", "CAMERA_ID MODEL WIDTH HEIGHT fx fy cx cy", _cameras(lenses)),
        ("images", "IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME, then a line of points", _images(images)),
        ("points3D", "POINT3D_ID X Y Z R G B ERROR TRACK", _points(points)),
    ):
        both = list(rows)
        yield f"{name}.txt", "".join([f"# {head}\n", *(text for text, _ in both)]).encode()
        yield f"{name}.bin", b"".join([struct.pack("<Q", len(both)), *(binary for _, binary in both)])


_Row = tuple[str, bytes]  # in text and in binary
_Lens = tuple[int, int, float, float, float, float]
_Image = tuple[int, np.ndarray, np.ndarray, int, str]


def _lenses(cameras: Sequence[Camera]) -> tuple[list[_Lens], list[int]]:
    ids: dict[_Lens, int] = {}
    which = []
    for c in cameras:
        lens = (c.width, c.height, float(c.fx), float(c.fy), float(c.cx), float(c.cy))
        which.append(ids.setdefault(lens, len(ids) + 1))
    return list(ids), which


def _numbers(values: Sequence[float] | np.ndarray) -> str:
    return " ".join(repr(float(x)) for x in values)


def _cameras(lenses: list[_Lens]) -> Iterator[_Row]:
    for i, lens in enumerate(lenses, start=1):
        width, height, *values = lens
        yield f"{i} PINHOLE {width} {height} {_numbers(values)}\n", struct.pack("<iiQQ4d", i, _PINHOLE, *lens)


def _images(images: list[_Image]) -> Iterator[_Row]:
    for i, q, t, camera, name in images:
        binary = struct.pack("<i7di", i, *q, *t, camera) + name.encode() + b"\0" + struct.pack("<Q", 0)
        yield f"{i} {_numbers(q)} {_numbers(t)} {camera} {name}\n\n", binary


def _points(points: Points) -> Iterator[_Row]:
    for i, (position, color) in enumerate(zip(points.positions, points.colors.tolist(), strict=True), start=1):
        text = f"{i} {_numbers(position)} {' '.join(map(str, color))} 0\n"
        yield text, struct.pack("<Q3d3BdQ", i, *position, *color, 0.0, 0)

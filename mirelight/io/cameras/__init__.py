"""Files of cameras: one module per format, all giving :class:`FileCamera` in the capture's axes.

glTF, whose cameras have a world of their own, is read by :mod:`mirelight.io.gltf`. ``docs/guides/cameras.md`` says what
each format keeps, and its conventions.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal, TypeAlias

import numpy as np

from mirelight.base import conventions
from mirelight.base.conventions import Matrix
from mirelight.base.errors import InputError
from mirelight.io.cameras import (
    camera_path,
    colmap,
    inria,
    one_picture,
    phones,
    reading,
    supersplat,
    table,
    transforms,
    worlds,
)
from mirelight.io.cameras.placed import STRAIGHT, Angle, Distortion, FileCamera, Intrinsics, Panorama
from mirelight.io.cameras.transforms import Axes
from mirelight.io.safety import existing, open_binary
from mirelight.model import F64, SplatWorld

__all__ = [
    "STRAIGHT",
    "Angle",
    "Axes",
    "CameraFile",
    "Distortion",
    "FileCamera",
    "Intrinsics",
    "Kind",
    "Panorama",
    "open_file",
]

Kind = Literal[
    "COLMAP",
    "cameras.json",
    "transforms.json",
    "SuperSplat",
    "camera_path.json",
    "Polycam",
    "Record3D",
    "CSV",
    "SHARP",
]

DATAPARSER = "dataparser_transforms.json"  # nerfstudio's, of a training

_READABLE = (
    "read are glTF, COLMAP, cameras.json, transforms.json, .ssproj, camera_path.json, Polycam, Record3D, CSV "
    "and the PLY of SHARP"
)


_FEWEST_POINTS = 50  # that tell where splats lie
_ON = (
    0.1  # of how far points spread, that they lie from splats at most: 0.018 in the right world, 0.3 and more in others
)

Centres: TypeAlias = Callable[[], F64]  # (N, 3) of splats, in their own axes


@dataclass(frozen=True, slots=True)
class CameraFile:
    """A recognised file or folder; :meth:`read` gives its cameras."""

    path: Path
    kind: Kind
    files: tuple[Path, ...]  # what may be read
    dataparser: Path | None = None  # nerfstudio's transforms of a training, beside it
    data: Any = None  # parsed JSON

    def read(
        self,
        *,
        axes: Axes | None = None,
        world: SplatWorld = "capture",
        centres: Centres | None = None,
        fps: float | None = None,
        frames: int | None = None,
    ) -> tuple[FileCamera, ...]:
        """The cameras of the file.

        Args:
            axes: transforms.json and CSV: the cameras' own axes; None: OpenGL's.
            world: COLMAP, transforms.json and camera_path.json: that of a trainer, which its splats are in; capture:
                that of the pictures' poses. Others are in one world.
            centres: gives the splats' (N, 3), which gsplat's world needs.
            fps: SuperSplat: pictures in a second of its film, instead of its keys.
            frames: SuperSplat: pictures over its whole film.

        Raises:
            InputError: damaged, without cameras, or of a lens that no pinhole stands for.
        """
        match self.kind:
            case "COLMAP":
                return self._trained(colmap.read(*self.files[:2]), world, centres)
            case "cameras.json":
                return inria.read(self.path, self.data)
            case "transforms.json":
                return self._trained(transforms.read(self.path, self.data, axes), world, centres)
            case "SuperSplat":
                return supersplat.read(self.path, fps, frames)
            case "camera_path.json":
                return camera_path.read(self.path, self.data, None if world == "nerfstudio" else self.dataparser)
            case "Polycam":
                return phones.read_polycam(self.files)
            case "Record3D":
                return phones.read_record3d(self.path, self.data)
            case "CSV":
                return table.read(self.path, axes or "opengl")
            case "SHARP":
                return one_picture.read(self.path)

    def worlds(self) -> tuple[SplatWorld, ...]:
        """The worlds that its cameras can be brought to."""
        if self.kind == "COLMAP":
            return ("capture", "nerfstudio", "gsplat")
        return ("capture", "nerfstudio") if self.kind in ("transforms.json", "camera_path.json") else ("capture",)

    def world_of(self, cameras: Sequence[FileCamera], centres: F64) -> SplatWorld | None:
        """The world in which what the pictures showed lies on splats; None where no points tell it.

        Args:
            cameras: all of the file, in the capture's axes.
            centres: (N, 3) of the splats.

        Raises:
            InputError: the points are damaged.
        """
        points = self.points()
        if points is None or not len(centres):
            return None
        known = self.worlds()
        apart = worlds.apart(points, [self.to_world(cameras, x, lambda: centres, points) for x in known], centres)
        best = int(np.argmin(apart))
        return known[best] if apart[best] < _ON else None

    def points_file(self) -> Path | None:
        """COLMAP's file of points, by which gsplat moved its world; None where none lies beside the cameras'."""
        return colmap.points_beside(self.files[1]) if self.kind == "COLMAP" else None

    def points(self) -> F64 | None:
        """(M, 3) what its pictures showed, in the capture's axes; None where nothing says. Raises InputError."""
        if self.kind == "COLMAP":
            path = self.points_file()
            found = None if path is None else colmap.read_points(path).positions
        elif self.kind == "transforms.json":
            found = transforms.points_beside(self.path, self.data)
        else:
            return None
        return found if found is not None and len(found) >= _FEWEST_POINTS else None

    def to_world(
        self, cameras: Sequence[FileCamera], world: SplatWorld, centres: Centres | None, points: F64 | None = None
    ) -> Matrix:
        """The matrix (4, 4) from the capture's axes to a world.

        Args:
            cameras: all of the file, in the capture's axes.
            world: one of :meth:`worlds`.
            centres: see :meth:`read`.
            points: (M, 3) :meth:`points`, where they were read already.

        Raises:
            InputError: what leads there is not there.
        """
        if world == "gsplat":
            points = self.points() if points is None else points
            if points is None or centres is None:
                found, remedy = "no points3D beside it, by which gsplat moved its world", "copy it from the same model"
                raise InputError(self.path, found, remedy)
            return worlds.of_gsplat(cameras, points, centres())
        if world == "nerfstudio" and self.dataparser is not None:
            return worlds.said_by_nerfstudio(self.dataparser)
        if world == "nerfstudio":
            if self.kind == "COLMAP":
                return worlds.of_nerfstudio(cameras, worlds.COLMAP_TO_NERFSTUDIO)
            return worlds.of_nerfstudio(cameras, transforms.file_from_capture(self.path, self.data))
        return np.eye(4)

    def _trained(
        self, cameras: tuple[FileCamera, ...], world: SplatWorld, centres: Centres | None
    ) -> tuple[FileCamera, ...]:
        if world == "capture":
            return cameras
        m = self.to_world(cameras, world, centres)
        return tuple(replace(x, world_from_camera=conventions.rigid_part(m @ x.world_from_camera)) for x in cameras)


def open_file(path: str | Path) -> CameraFile:
    """Recognise a file or folder of cameras by its content.

    Args:
        path: a file, or a folder that holds a COLMAP model (also as sparse/0), a transforms.json, a cameras.json, or
            what Polycam or Record3D export.

    Raises:
        InputError: missing, or of no known format.
    """
    path = existing(path)
    if path.is_dir():
        return _folder(path)
    with open_binary(path) as file:
        head = file.read(4096)
    if head.startswith(b"ply"):
        return CameraFile(path, "SHARP", (path,))
    if head.startswith(b"PK"):
        return CameraFile(path, "SuperSplat", (path,))
    if path.stem.lower() in ("cameras", "images", "points3d") and path.suffix.lower() in (".bin", ".txt"):
        pair = path.with_stem("cameras"), path.with_stem("images")
        if not all(file.is_file() for file in pair):
            raise InputError(path, "half a COLMAP model", f"{pair[0].name} and {pair[1].name} stand side by side")
        return _colmap(path, pair)
    if head.lstrip(b"\xef\xbb\xbf \t\r\n")[:1] in (b"{", b"["):
        return _json(path)
    if path.suffix.lower() == ".csv" or b"," in head.split(b"\n", 1)[0]:
        return CameraFile(path, "CSV", (path,))
    raise InputError(path, "not a file of cameras", _READABLE)


def _folder(path: Path) -> CameraFile:
    model = colmap.find(path)
    if model is not None:
        return _colmap(path, model)
    for name in ("transforms.json", "cameras.json", "metadata", "metadata.json"):
        if (path / name).is_file():
            return _json(path / name)
    polycam = phones.find_polycam(path)
    if polycam is not None:
        return CameraFile(path, "Polycam", tuple(sorted(polycam.glob("*.json"))))
    raise InputError(path, "a folder without cameras", _READABLE)


def _colmap(path: Path, model: tuple[Path, Path]) -> CameraFile:
    near = (path if path.is_dir() else path.parent) / DATAPARSER
    dataparser = near if near.is_file() else None
    return CameraFile(path, "COLMAP", model if dataparser is None else (*model, dataparser), dataparser)


def _json(path: Path) -> CameraFile:
    data = reading.load_json(path)
    beside = path.with_name(DATAPARSER)
    dataparser = beside if beside.is_file() else None
    read = (path,) if dataparser is None else (path, dataparser)
    if isinstance(data, list):
        return CameraFile(path, "cameras.json", (path,), None, data)
    if isinstance(data, dict) and "frames" in data:
        return CameraFile(path, "transforms.json", read, dataparser, data)
    if isinstance(data, dict) and "camera_path" in data:
        return CameraFile(path, "camera_path.json", read, dataparser, data)
    if phones.is_polycam(data):
        return CameraFile(path, "Polycam", (path,))
    if phones.is_record3d(data):
        return CameraFile(path, "Record3D", (path,), None, data)
    raise InputError(path, "JSON, but no cameras in it that are known", _READABLE)

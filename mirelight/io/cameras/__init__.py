"""Files of cameras: one module per format, all giving :class:`FileCamera` in the capture's axes.

glTF, whose cameras have a world of their own, is read by :mod:`mirelight.io.gltf`. ``docs/guides/cameras.md`` says what
each format keeps, and its conventions.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from mirelight.base.errors import InputError
from mirelight.io.cameras import camera_path, colmap, inria, one_picture, phones, reading, supersplat, table, transforms
from mirelight.io.cameras.placed import STRAIGHT, Angle, Distortion, FileCamera, Intrinsics
from mirelight.io.cameras.transforms import DATAPARSER, Axes
from mirelight.io.safety import existing, open_binary

__all__ = [
    "STRAIGHT",
    "Angle",
    "Axes",
    "CameraFile",
    "Distortion",
    "FileCamera",
    "Intrinsics",
    "Kind",
    "World",
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
World = Literal["capture", "nerfstudio"]

_READABLE = (
    "read are glTF, COLMAP, cameras.json, transforms.json, .ssproj, camera_path.json, Polycam, Record3D, CSV "
    "and the PLY of SHARP"
)


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
        world: World = "capture",
        fps: float | None = None,
        frames: int | None = None,
    ) -> tuple[FileCamera, ...]:
        """The cameras of the file.

        Args:
            axes: transforms.json and CSV: the cameras' own axes; None: OpenGL's.
            world: transforms.json and camera_path.json: nerfstudio: the world of a training, which its exported splats
                are in; capture: that of the pictures' poses.
            fps: SuperSplat: pictures in a second of its film, instead of its keys.
            frames: SuperSplat: pictures over its whole film.

        Raises:
            InputError: damaged, without cameras, or of a lens that no pinhole stands for.
        """
        match self.kind:
            case "COLMAP":
                return colmap.read(*self.files)
            case "cameras.json":
                return inria.read(self.path, self.data)
            case "transforms.json":
                trained = world == "nerfstudio"
                if trained and self.dataparser is None:
                    remedy = "copy it from the training's folder to beside this file"
                    raise InputError(self.path, f"no {DATAPARSER} beside it, which leads to nerfstudio's world", remedy)
                return transforms.read(self.path, self.data, axes, self.dataparser if trained else None)
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
        return CameraFile(path, "COLMAP", pair)
    if head.lstrip(b"\xef\xbb\xbf \t\r\n")[:1] in (b"{", b"["):
        return _json(path)
    if path.suffix.lower() == ".csv" or b"," in head.split(b"\n", 1)[0]:
        return CameraFile(path, "CSV", (path,))
    raise InputError(path, "not a file of cameras", _READABLE)


def _folder(path: Path) -> CameraFile:
    model = colmap.find(path)
    if model is not None:
        return CameraFile(path, "COLMAP", model)
    for name in ("transforms.json", "cameras.json", "metadata", "metadata.json"):
        if (path / name).is_file():
            return _json(path / name)
    polycam = phones.find_polycam(path)
    if polycam is not None:
        return CameraFile(path, "Polycam", tuple(sorted(polycam.glob("*.json"))))
    raise InputError(path, "a folder without cameras", _READABLE)


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

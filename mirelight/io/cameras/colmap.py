"""COLMAP's sparse models, text and binary: cameras, images and points.

Format: colmap.github.io/format.html. An image's pose is camera from world, quaternion wxyz and translation, in OpenCV's
camera axes (+Z ahead, +Y down); pixel centres lie at +0.5. Binary files are little-endian.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from io import BufferedReader
from pathlib import Path

import numpy as np

from mirelight.base import conventions
from mirelight.base.errors import InputError
from mirelight.io.cameras import reading
from mirelight.io.cameras.placed import ALL_AROUND, Distortion, FileCamera, Intrinsics, Panorama, pinholes
from mirelight.io.safety import open_binary
from mirelight.model import F64

LONGEST_NAME = 4096  # bytes
_LONGEST_LINE = 1 << 26  # bytes; the line of an image's points is long


@dataclass(frozen=True, slots=True)
class Model:
    """One of COLMAP's camera models, and where its parameters stand."""

    name: str
    count: int  # parameters
    focals: int = 0  # 1: f; 2: fx, fy; 0: no pinhole with a polynomial distortion
    radial: tuple[int, ...] = ()  # indices of k1, k2, …
    divisor: tuple[int, ...] = ()
    tangential: tuple[int, int] | None = None
    prism: tuple[int, int] | None = None
    fisheye: bool = False


# In the order of their numbers (colmap/src/colmap/sensor/models.h).
MODELS = (
    Model("SIMPLE_PINHOLE", 3, 1),
    Model("PINHOLE", 4, 2),
    Model("SIMPLE_RADIAL", 4, 1, (3,)),
    Model("RADIAL", 5, 1, (3, 4)),
    Model("OPENCV", 8, 2, (4, 5), (), (6, 7)),
    Model("OPENCV_FISHEYE", 8, 2, (4, 5, 6, 7), fisheye=True),
    Model("FULL_OPENCV", 12, 2, (4, 5, 8), (9, 10, 11), (6, 7)),
    Model("FOV", 5),
    Model("SIMPLE_RADIAL_FISHEYE", 4, 1, (3,), fisheye=True),
    Model("RADIAL_FISHEYE", 5, 1, (3, 4), fisheye=True),
    Model("THIN_PRISM_FISHEYE", 12, 2, (4, 5, 8, 9), (), (6, 7), (10, 11), fisheye=True),
    Model("RAD_TAN_THIN_PRISM_FISHEYE", 16),
    Model("SIMPLE_DIVISION", 4),
    Model("DIVISION", 5),
    Model("SIMPLE_FISHEYE", 3, 1, fisheye=True),
    Model("FISHEYE", 4, 2, fisheye=True),
    Model("EUCM", 6),
    Model(ALL_AROUND, 2),  # its width and height
)
_BY_NAME = {model.name: model for model in MODELS}


@dataclass(frozen=True, slots=True)
class Lens:
    """A camera of the model: how pictures were taken, not from where."""

    intrinsics: Intrinsics
    distortion: Distortion | Panorama | None


@dataclass(frozen=True, slots=True)
class _Image:
    name: str
    camera: int
    pose: tuple[float, ...]  # qw qx qy qz tx ty tz
    where: str


def find(folder: Path) -> tuple[Path, Path] | None:
    """The files of cameras and images of a model in the folder, its 0, sparse/0, sparse or colmap/sparse/0."""
    for inside in (".", "0", "sparse/0", "sparse", "colmap/sparse/0"):
        for suffix in (".bin", ".txt"):
            pair = folder / inside / f"cameras{suffix}", folder / inside / f"images{suffix}"
            if all(file.is_file() for file in pair):
                return pair
    return None


def read(cameras: Path, images: Path) -> tuple[FileCamera, ...]:
    """The cameras that took a model's images, sorted by the images' names; each panorama in six.

    Raises:
        InputError: what is wrong, with its line or its place.
    """
    binary = cameras.suffix.lower() == ".bin"
    lenses = dict((_binary_lenses if binary else _text_lenses)(cameras))
    found = sorted((_binary_images if binary else _text_images)(images), key=lambda image: image.name)
    reading.limited(images, len(found))
    names = reading.picture_names(image.name for image in found)
    return pinholes(_placed(images, image, name, lenses) for image, name in zip(found, names, strict=True))


def points_beside(images: Path) -> Path | None:
    """The model's file of points; None where there is none."""
    path = images.with_stem("points3D")
    return path if path.is_file() else None


@dataclass(frozen=True, slots=True, eq=False)
class Points:
    """Points of a model, M of them in the order of its file, as its pictures showed them."""

    positions: F64  # (M, 3)
    errors: F64  # (M,) px
    pictures: F64  # (M,) how many show each


def read_points(path: Path) -> Points:
    """The points of a model. Raises InputError."""
    found = list((_binary_points if path.suffix.lower() == ".bin" else _text_points)(path))
    rows = np.array(found, np.float64).reshape(-1, 5)
    if not np.isfinite(rows[:, :3]).all():
        raise InputError(path, "a point that is not finite", "the file is damaged")
    return Points(rows[:, :3], rows[:, 3], rows[:, 4])


def _placed(file: Path, image: _Image, name: str, lenses: dict[int, Lens]) -> FileCamera:
    fail = partial(InputError, file, field=image.where)
    lens = lenses.get(image.camera)
    if lens is None:
        raise fail(f"camera {image.camera}, which the model does not have", "the model is incomplete")
    if not all(math.isfinite(x) for x in image.pose):
        raise fail("a pose that is not finite", "the file is damaged")
    matrix = conventions.compose(image.pose[4:], reading.rotation_of(image.pose[:4], fail))
    return FileCamera(
        name=name,
        world_from_camera=reading.inverse(reading.rigid(matrix, fail)) @ reading.FLIP,
        lens=lens.intrinsics,
        distortion=lens.distortion,
        picture=image.name,
    )


def _lens(model: Model, width: int, height: int, values: tuple[float, ...], file: Path, where: str) -> Lens:
    fail = partial(InputError, file, field=where)
    if not all(math.isfinite(x) for x in values):
        raise fail("a parameter that is not finite", "the file is damaged")
    if not (1 <= width <= reading.LARGEST_SIDE and 1 <= height <= reading.LARGEST_SIDE):
        raise fail(f"a picture of {width} x {height} pixels", "the file is damaged")
    if model.name == ALL_AROUND:
        if width != 2 * height:
            raise fail(f"a panorama of {width} by {height} pixels", "one of all directions is twice as wide as high")
        side = Panorama(side="front", width=width)
        return Lens(side.lens(), side)
    if not model.focals:
        raise fail(f"the camera model {model.name}, which no pinhole stands for", "undistort the model in COLMAP")
    focals = (values[0], values[0]) if model.focals == 1 else (values[0], values[1])
    center = values[model.focals], values[model.focals + 1]
    lens = reading.intrinsics((*focals, *center), (width, height), fail)
    return Lens(lens, _distortion(model, values) if model.radial or model.fisheye else None)


def _distortion(model: Model, values: tuple[float, ...]) -> Distortion:
    pairs = [(values[of[0]], values[of[1]]) if of else (0.0, 0.0) for of in (model.tangential, model.prism)]
    return Distortion(
        model=model.name,
        radial=tuple(values[i] for i in model.radial),
        divisor=tuple(values[i] for i in model.divisor),
        tangential=pairs[0],
        prism=pairs[1],
        fisheye=model.fisheye,
    )


# --- text ------------------------------------------------------------------------------------------------------------


def _lines(file: Path) -> Iterator[tuple[int, str]]:
    """Lines with their numbers, from 1. Raises InputError: not UTF-8, or lines without end."""
    number = 0
    with open_binary(file) as stream:
        while True:
            try:
                raw = stream.readline(_LONGEST_LINE + 1)
            except OSError as e:
                raise InputError(file, f"cannot be read ({e.strerror})") from None
            if not raw:
                return
            number += 1
            if len(raw) > _LONGEST_LINE:
                raise InputError(file, "a line without end", "the file is damaged", field=f"line {number}")
            try:
                yield number, raw.decode("utf-8").strip()
            except UnicodeDecodeError:
                raise InputError(file, "not UTF-8 text", "the file is damaged", field=f"line {number}") from None


def _text_lenses(file: Path) -> Iterator[tuple[int, Lens]]:
    for number, line in _lines(file):
        if not line or line.startswith("#"):
            continue
        where, words = f"line {number}", line.split()
        fail = partial(InputError, file, field=where)
        if len(words) < 4:
            raise fail(f"{len(words)} words", "a camera is CAMERA_ID MODEL WIDTH HEIGHT PARAMETERS")
        model = _BY_NAME.get(words[1])
        if model is None:
            raise fail(f"the camera model {words[1][:40]!r}, which is not known", "undistort the model in COLMAP")
        if len(words) != 4 + model.count:
            raise fail(f"{len(words) - 4} parameters of a {model.name}", f"it has {model.count}")
        identity, width, height = (_whole(words[i], fail) for i in (0, 2, 3))
        values = tuple(_real(word, fail) for word in words[4:])
        yield identity, _lens(model, width, height, values, file, where)


def _text_images(file: Path) -> Iterator[_Image]:
    lines = _lines(file)
    count = 0
    for number, line in lines:
        if not line or line.startswith("#"):
            continue
        where, words = f"line {number}", line.split(maxsplit=9)
        fail = partial(InputError, file, field=where)
        if len(words) < 10:
            raise fail(f"{len(words)} words", "an image is IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME")
        if len(words[9]) > LONGEST_NAME:
            raise fail("a name without end", "the file is damaged")
        count += 1
        if count > reading.MOST_CAMERAS:
            reading.limited(file, count)
        pose = tuple(_real(word, fail) for word in words[1:8])
        yield _Image(words[9], _whole(words[8], fail), pose, f"{where} (image {words[9][:60]!r})")
        next(lines, None)  # the image's points


def _text_points(file: Path) -> Iterator[tuple[float, ...]]:
    for number, line in _lines(file):
        if line and not line.startswith("#"):
            words, fail = line.split(), partial(InputError, file, field=f"line {number}")
            if len(words) < 8:
                raise fail(f"{len(words)} words", "a point is POINT3D_ID X Y Z R G B ERROR TRACK")
            yield *(_real(word, fail) for word in (*words[1:4], words[7])), (len(words) - 8) // 2


def _real(word: str, fail: partial[InputError]) -> float:
    try:
        return float(word)
    except ValueError:
        raise fail(f"{word[:40]!r}, expected a number", "the file is damaged") from None


def _whole(word: str, fail: partial[InputError]) -> int:
    if not (word.isascii() and word.isdigit() and len(word) < 20):
        raise fail(f"{word[:40]!r}, expected a whole number", "the file is damaged")
    return int(word)


# --- binary ----------------------------------------------------------------------------------------------------------


class _Stream:
    """Little-endian values of a file, each checked to be there."""

    def __init__(self, file: Path, stream: BufferedReader) -> None:
        self._file, self._stream = file, stream
        self.size = stream.seek(0, 2)
        stream.seek(0)

    def take(self, layout: str) -> tuple[int | float, ...]:
        wanted = struct.calcsize(layout)
        data = self._stream.read(wanted)
        if len(data) < wanted:
            raise self.fail()
        return struct.unpack(layout, data)

    def text(self) -> str:
        """Bytes up to a zero."""
        out = bytearray()
        while (byte := self._stream.read(1)) != b"\0":
            if not byte:
                raise self.fail()
            if len(out) >= LONGEST_NAME:
                raise InputError(self._file, "a name without end", "the file is damaged")
            out += byte
        return out.decode("utf-8", errors="replace")

    def skip(self, count: int) -> None:
        if count > self.size - self._stream.tell():
            raise self.fail()
        self._stream.seek(count, 1)

    def fail(self) -> InputError:
        return InputError(self._file, f"ends after {self.size:,} bytes", "the file is truncated or damaged")


def _binary_lenses(file: Path) -> Iterator[tuple[int, Lens]]:
    with open_binary(file) as raw:
        stream = _Stream(file, raw)
        (count,) = stream.take("<Q")
        for i in range(int(count)):
            identity, number, width, height = (int(x) for x in stream.take("<iiQQ"))
            where = f"cameras[{i}]"
            if not 0 <= number < len(MODELS):
                raise InputError(
                    file,
                    f"camera model number {number}, which is not known",
                    "undistort the model in COLMAP",
                    field=where,
                )
            model = MODELS[number]
            values = stream.take(f"<{model.count}d")
            yield identity, _lens(model, width, height, values, file, where)


def _binary_images(file: Path) -> Iterator[_Image]:
    with open_binary(file) as raw:
        stream = _Stream(file, raw)
        count = int(stream.take("<Q")[0])
        if count > stream.size // 73:  # bytes of an image with the shortest name and no points
            raise stream.fail()
        if count > reading.MOST_CAMERAS:
            reading.limited(file, count)
        for i in range(count):
            values = stream.take("<i7di")
            name = stream.text()
            (points,) = stream.take("<Q")
            stream.skip(24 * int(points))
            yield _Image(name, int(values[8]), values[1:8], f"images[{i}] ({name[:60]!r})")


def _binary_points(file: Path) -> Iterator[tuple[float, ...]]:
    with open_binary(file) as raw:
        stream = _Stream(file, raw)
        for _ in range(int(stream.take("<Q")[0])):
            values = stream.take("<Q3d3BdQ")
            stream.skip(8 * int(values[-1]))
            yield *values[1:4], *values[7:]


def pose(world_from_camera: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """COLMAP's quaternion (4,) wxyz and translation (3,) of a pose (4, 4) in glTF's camera axes."""
    inverse = reading.inverse(np.asarray(world_from_camera, dtype=np.float64) @ reading.FLIP)
    return conventions.quaternion_from_rotation(inverse[:3, :3]), inverse[:3, 3]

"""The files of a SOG capture: in a folder, or in one ZIP file (.sog), read without unpacking anything."""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from mirelight.base.errors import InputError
from mirelight.io.gltf.fields import Fields
from mirelight.io.safety import json_value, neighbour, read_bytes


class Files(Protocol):
    """Where the files that a meta.json names are found."""

    path: Path  # what error messages name

    def load(self, name: str, limit: int, field: str) -> bytes:
        """The whole of one file, at most `limit` bytes. Raises InputError."""


class FolderFiles:
    """Files of a SOG capture that lie beside its meta.json."""

    def __init__(self, meta: Path) -> None:
        """`meta` is the meta.json itself."""
        self.path = meta

    def load(self, name: str, limit: int, field: str) -> bytes:
        """The whole of one file. Raises InputError: missing, too large, or outside the folder."""
        return read_bytes(neighbour(name, self.path, field), limit)


class ZipFiles:
    """Members of a ZIP file."""

    def __init__(self, path: Path) -> None:
        """Read the directory of the archive. Raises InputError."""
        self.path = path
        try:
            self._archive = zipfile.ZipFile(path)
        except Exception as e:  # a damaged directory makes zipfile raise errors of a dozen types
            raise InputError(path, f"not a readable ZIP file ({e})", "the file is truncated or damaged") from None

    def load(self, name: str, limit: int, field: str) -> bytes:
        """The whole of one member. Raises InputError: missing, damaged, or larger than `limit` once unpacked."""
        try:
            member = self._archive.getinfo(name)
        except KeyError:
            raise InputError(self.path, f"no member {name[:60]!r}", "the capture is incomplete", field=field) from None
        try:
            with self._archive.open(member) as file:
                data = file.read(limit + 1)
        except Exception as e:  # as above: zlib.error, BadZipFile, NotImplementedError, RuntimeError, EOFError …
            found = f"member {name[:60]!r} cannot be unpacked ({e or type(e).__name__})"
            raise InputError(self.path, found, "the file is damaged", field=field) from None
        if len(data) > limit:
            found = f"member {name[:60]!r} unpacks to more than {limit:,} bytes"
            raise InputError(self.path, found, "that is more than its splats need", field=field)
        return data


def parse_json(path: Path, data: bytes) -> Fields:
    """A JSON object whose getters name file and field in their errors. Raises InputError."""
    value = json_value(path, data)
    if not isinstance(value, dict):
        raise InputError(path, "the JSON is not an object")
    return Fields(path, "", value)


def read_pixels(files: Files, name: str, field: str, least: int, most: int) -> tuple[NDArray[np.uint8], int]:
    """The pixels of a lossless 8-bit image, row by row from the top, and its width.

    Args:
        files: where it is.
        name: its name there.
        field: the field of the meta.json that names it.
        least: pixels that it must have.
        most: pixels that it may have; larger ones are not decoded.

    Returns:
        (width x height, 4) RGBA.

    Raises:
        InputError: missing, not WebP or PNG, lossy, too small or too large, damaged.
    """
    from io import BytesIO

    from PIL import Image

    data = files.load(name, 4 * most + 65536, field)
    if data[8:16] == b"WEBPVP8 ":
        raise InputError(files.path, f"{name[:60]!r} is lossy WebP", "splats need lossless images", field=field)
    try:
        with Image.open(BytesIO(data), formats=("WEBP", "PNG")) as image:
            width, height = image.size
            if not least <= width * height <= most:
                found = f"{name[:60]!r} has {width} x {height} pixels for {least:,} values"
                raise InputError(files.path, found, "the file is damaged", field=field)
            pixels = np.asarray(image.convert("RGBA")).reshape(-1, 4)
    except InputError:
        raise
    except Exception as e:  # Pillow's decoders raise errors of many types on damaged data
        found = f"{name[:60]!r} is not a readable image ({str(e)[:80] or type(e).__name__})"
        raise InputError(files.path, found, "the file is damaged", field=field) from None
    return pixels, width

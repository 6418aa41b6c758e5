"""OpenEXR files as named channels: the only place that touches the OpenEXR package.

Files are written as one part with many layers ("layer.channel"), because that is what every reader shows alike; any
scanline or tiled, single- or multi-part file is read.
"""

from __future__ import annotations

import os
import struct
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from mirelight.errors import InputError, OutputError
from mirelight.io.atomic import atomic_path
from mirelight.io.safety import existing, require_memory

MAGIC = b"\x76\x2f\x31\x01"
_REC709 = (0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3127, 0.3290)  # chromaticities of R, G, B and D65 (ITU-R BT.709-6)
_MAX_HALF = 65504.0  # brighter half floats would become infinite
_ROWS_PER_CHUNK = 16  # of ZIP compression
_ORDER = {name: i for i, name in enumerate("RGBAXYZ")}

Metadata = Mapping[str, str | int | float | tuple[float, float] | NDArray[np.float32]]


@dataclass(frozen=True, slots=True, eq=False)
class ExrImage:
    """An OpenEXR file in memory."""

    channels: Mapping[str, NDArray[Any]]  # full name, e.g. "unlit.R" -> (h, w) float16, float32 or uint32
    metadata: Mapping[str, Any]  # the first part's attributes

    @property
    def layers(self) -> tuple[str, ...]:
        """Layer names in file order; "" holds the channels without a layer."""
        return tuple(dict.fromkeys(name.rpartition(".")[0] for name in self.channels))

    def layer(self, name: str = "") -> NDArray[np.float32]:
        """(h, w, n) float32 of one layer, its channels in the order R G B A or X Y Z; KeyError where it is absent."""
        found = [x for x in self.channels if x.rpartition(".")[0] == name]
        if not found:
            raise KeyError(f"no layer {name!r}; the file has {', '.join(self.layers)}")
        found.sort(key=lambda x: _ORDER.get(x.rpartition(".")[2], len(_ORDER)))
        return np.stack([self.channels[x].astype(np.float32) for x in found], axis=-1)


def write_exr(
    path: str | Path,
    images: Mapping[str, NDArray[Any]],
    metadata: Metadata | None = None,
    half: Collection[str] = (),
) -> None:
    """Write one part with all images, ZIP compressed. C-contiguous float32 arrays are not copied.

    Args:
        path: the file to write.
        images: by the name of a layer ("" for none) its colour (h, w, 3) RGB or (h, w, 4) RGBA; by the full name of a
            channel, e.g. "depth.Z", that channel (h, w). All of one size.
        metadata: header attributes besides the necessary ones.
        half: names of images to store as 16-bit floats, clamped to 65504; the others are 32-bit.

    Raises:
        OutputError: the file cannot be written; nothing half-written is left.
    """
    import OpenEXR

    header = {
        "compression": OpenEXR.ZIP_COMPRESSION,
        "type": OpenEXR.scanlineimage,
        "chromaticities": _REC709,
        **(metadata or {}),
    }
    planes = {name or "RGBA"[: values.shape[2]]: _plane(values, name in half) for name, values in images.items()}
    with atomic_path(path) as temporary:
        try:
            with OpenEXR.File(header, planes) as file:
                file.write(str(temporary))
        except RuntimeError as e:  # what the package raises when the system refuses to write
            raise _write_error(path, temporary, e) from None


def read_exr(path: str | Path) -> ExrImage:
    """Read every channel of every part; a part's name goes before its channels' names unless it is there already.

    No colour conversion is made, whatever chromaticities the file names.

    Raises:
        InputError: not an OpenEXR image, damaged, deep, subsampled, or larger than memory.
    """
    import OpenEXR

    path = existing(path)
    _check_size(path, read_header(path))
    try:
        with OpenEXR.File(str(path), separate_channels=True) as file:
            parts = [(part.name(), part.header, part.channels) for part in file.parts]
            metadata = dict(parts[0][1])
            channels: dict[str, NDArray[Any]] = {}
            for name, _, found in parts:
                for key, channel in found.items():
                    prefix = f"{name}." if len(parts) > 1 and name and not key.startswith(f"{name}.") else ""
                    channels[prefix + key] = np.asarray(channel.pixels)
    except Exception as e:  # the package raises bare RuntimeError, ValueError and TypeError for damaged files
        raise InputError(
            path, f"an EXR image that cannot be read ({type(e).__name__})", "the file is damaged"
        ) from None
    return ExrImage(channels, metadata)


def read_header(path: str | Path) -> list[dict[str, Any]]:
    """The header of each part, without pixels.

    Raises:
        InputError: missing, or not an OpenEXR image.
    """
    import OpenEXR

    path = existing(path)
    try:
        with path.open("rb") as stream:
            if stream.read(4) != MAGIC:
                raise InputError(path, "not an OpenEXR image", "check the file")
        with OpenEXR.File(str(path), header_only=True) as file:
            return [dict(part.header) for part in file.parts]
    except InputError:
        raise
    except Exception as e:
        raise InputError(
            path, f"an EXR header that cannot be read ({type(e).__name__})", "the file is damaged"
        ) from None


def _plane(values: NDArray[Any], half: bool) -> NDArray[Any]:
    """The array in the stored type, C-contiguous: the package writes any other layout wrong without an error."""
    if half:
        return np.ascontiguousarray(np.clip(values, -_MAX_HALF, _MAX_HALF), dtype=np.float16)
    return np.ascontiguousarray(values, dtype=np.float32)


def _check_size(path: Path, headers: list[dict[str, Any]]) -> None:
    total = 0
    for header in headers:
        low, high = (np.asarray(corner, dtype=np.int64) for corner in header["dataWindow"])
        width, height = (int(x) for x in high - low + 1)
        channels = header.get("channels", [])
        if width < 1 or height < 1 or any(c.xSampling != 1 or c.ySampling != 1 for c in channels):
            found = f"a part of {width} x {height} pixels with subsampled channels or none"
            raise InputError(path, found, "save it as plain RGB")
        total += width * height * len(channels)
    require_memory(path, total * 4, f"{total} channel values")


def _write_error(path: str | Path, temporary: Path, error: RuntimeError) -> OutputError:
    try:
        full = os.statvfs(temporary).f_bavail == 0
    except OSError:
        full = False
    reason = "the disk is full" if full else " ".join(str(error).replace(str(temporary), "it").split())
    return OutputError(f"{path}: cannot be written ({reason}); nothing half-written was left")


def is_whole(path: str | Path) -> bool:
    """Whether the last row of a file written by :func:`write_exr` is there, without reading pixels.

    Reads the header's attributes and the offset table behind them ("OpenEXR File Layout"); a file cut off anywhere ends
    before its last chunk does.
    """
    try:
        with Path(path).open("rb") as stream:
            size = stream.seek(0, 2)
            stream.seek(4)
            flags = struct.unpack("<I", stream.read(4))[0]
            if flags & ~0x4FF:  # long names (0x400) apart, only plain single-part scanline files
                return False
            rows = _rows(stream)
            chunks = -(-rows // _ROWS_PER_CHUNK)
            stream.seek(8 * (chunks - 1), 1)
            last = struct.unpack("<Q", stream.read(8))[0]
            stream.seek(last + 4)
            length = struct.unpack("<I", stream.read(4))[0]
            return bool(last + 8 + length <= size)
    except (OSError, struct.error, ValueError):
        return False


def _rows(stream: BinaryIO) -> int:
    """Rows of the data window; leaves the stream behind the header."""
    rows = 0
    while name := _name(stream):
        _name(stream)  # the attribute's type
        value = stream.read(struct.unpack("<i", stream.read(4))[0])
        if name == b"dataWindow":
            _, top, _, bottom = struct.unpack("<4i", value)
            rows = bottom - top + 1
    if rows < 1:
        raise ValueError("no rows")
    return rows


def _name(stream: BinaryIO) -> bytes:
    """A zero-terminated string of at most 255 bytes."""
    out = b""
    while (byte := stream.read(1)) != b"\0":
        if not byte or len(out) == 255:
            raise ValueError("not a name")
        out += byte
    return out

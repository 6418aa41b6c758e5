"""OpenEXR files as named channels: the only place that touches the OpenEXR package.

Files are written as one part with many layers ("layer.channel"), because that is what every reader shows alike; any
scanline or tiled, single- or multi-part file is read.
"""

from __future__ import annotations

import math
import os
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from mirelight.base import primaries
from mirelight.base.errors import InputError, OutputError
from mirelight.base.primaries import Chromaticities
from mirelight.io.atomic import atomic_path
from mirelight.io.exr_bytes import DIGEST, NO_DIGEST, is_whole, seal
from mirelight.io.exr_noise import silenced
from mirelight.io.safety import existing, open_binary, require_memory
from mirelight.model import Compression, shown

MAGIC = b"\x76\x2f\x31\x01"
CHROMATICITIES, INTEROP_ID = "chromaticities", "colorInteropID"  # standard attributes: eight numbers, and a name
_MAX_HALF = 65504.0  # brighter half floats would become infinite
_COMPRESSIONS: Mapping[Compression, str] = {
    "zip": "ZIP_COMPRESSION",
    "dwaa": "DWAA_COMPRESSION",
    "none": "NO_COMPRESSION",
}
_ORDER = {name: i for i, name in enumerate("RGBAXYZ")}

Metadata = Mapping[str, str | int | float | tuple[float, ...] | NDArray[np.float32]]


@dataclass(frozen=True, slots=True, eq=False)
class ExrImage:
    """An OpenEXR file in memory."""

    channels: Mapping[str, NDArray[Any]]  # full name, e.g. "unlit.R" -> (h, w) float16, float32 or uint32
    metadata: Mapping[str, Any]  # the first part's attributes

    def __repr__(self) -> str:
        if not self.channels:
            return "ExrImage(no channels)"
        height, width = next(iter(self.channels.values())).shape
        values = shown.names([name or "(picture)" for name in self.layers])
        return f"ExrImage({width} x {height}, {len(self.channels)} channels in {len(self.layers)} layers: {values})"

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
    compression: Compression = "zip",
    crop: bool = True,
) -> None:
    """Write one part with all images. C-contiguous float32 arrays are not copied.

    Where half of the picture or more is zero in every image, the file's data window is the rest ("The OpenEXR File
    Format": what lies outside it is zero), and the display window stays the whole picture. The header's
    `mirelight/digest` seals the file, see :func:`mirelight.io.exr_bytes.is_intact`.

    Args:
        path: the file to write.
        images: by the name of a layer ("" for none) its colour (h, w, 3) RGB or (h, w, 4) RGBA; by the full name of a
            channel, e.g. "depth.Z", that channel (h, w). All of one size.
        metadata: header attributes besides the necessary ones.
        half: names of images to store as 16-bit floats, clamped to 65504; the others are 32-bit.
        compression: "zip" (lossless), "none", or "dwaa" (lossy: channels R, G, B and Y of any layer are rounded to 16
            bits and then to what an eye would not see; others stay).
        crop: False: the data window is the whole picture, for readers that know no other.

    Raises:
        OutputError: the file cannot be written; nothing half-written is left.
    """
    import OpenEXR

    planes = {name or "RGBA"[: values.shape[2]]: _plane(values, name in half) for name, values in images.items()}
    height, width = next(iter(planes.values())).shape[:2]
    rows, columns = _window(list(planes.values())) if crop else (range(height), range(width))
    header = {
        "compression": getattr(OpenEXR, _COMPRESSIONS[compression]),
        "type": OpenEXR.scanlineimage,
        CHROMATICITIES: primaries.REC709,
        "displayWindow": _box(range(height), range(width)),
        "dataWindow": _box(rows, columns),
        DIGEST: NO_DIGEST,
        **(metadata or {}),
    }
    if (len(rows), len(columns)) != (height, width):
        inside = np.s_[rows.start : rows.stop, columns.start : columns.stop]
        planes = {name: np.ascontiguousarray(plane[inside]) for name, plane in planes.items()}
    if not _has_utf8_name(path):
        raise OutputError(f"{path}: cannot be written (OpenEXR takes names in UTF-8); nothing half-written was left")
    with atomic_path(path) as temporary:
        try:
            with silenced(), OpenEXR.File(header, planes) as file:
                file.write(str(temporary))
        except RuntimeError as e:  # what the package raises when the system refuses to write
            raise _write_error(path, temporary, e) from None
        if not is_whole(temporary):  # the last bytes leave as the package closes the file, and fail in silence
            raise _write_error(path, temporary, RuntimeError("fewer bytes arrived than were written"))
        seal(temporary)


def read_exr(path: str | Path) -> ExrImage:
    """Read every channel of every part; a part's name goes before its channels' names unless it is there already.

    Channels have the size of the display window: zero where the data window leaves it out, cut where that is larger. No
    colour conversion is made, whatever chromaticities the file names: see :func:`to_rec709`.

    Raises:
        InputError: not an OpenEXR image, damaged, deep, subsampled, or larger than memory.
    """
    import OpenEXR

    path = existing(path)
    headers = read_header(path)
    _check_size(path, headers)
    try:
        with silenced(), OpenEXR.File(str(path), separate_channels=True) as file:
            parts = [(part.name(), part.header, part.channels) for part in file.parts]
            metadata = dict(parts[0][1])
            channels: dict[str, NDArray[Any]] = {}
            for name, header, found in parts:
                for key, channel in found.items():
                    prefix = f"{name}." if len(parts) > 1 and name and not key.startswith(f"{name}.") else ""
                    channels[prefix + key] = _on_display(np.asarray(channel.pixels), header)
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
        with open_binary(path) as stream:
            if stream.read(4) != MAGIC:
                raise InputError(path, "not an OpenEXR image", "check the file")
        if not _has_utf8_name(path):
            raise InputError(path, "a name that is not UTF-8, which OpenEXR does not take", "rename file and folders")
        with silenced(), OpenEXR.File(str(path), header_only=True) as file:
            return [dict(part.header) for part in file.parts]
    except InputError:
        raise
    except Exception as e:
        raise InputError(
            path, f"an EXR header that cannot be read ({type(e).__name__})", "the file is damaged"
        ) from None


def chromaticities_of(path: str | Path, header: Mapping[str, Any]) -> Chromaticities | None:
    """The primaries and the white that a part's colours are in; None where it does not say ("Rec.709" then, by
    OpenEXR's rule).

    Raises:
        InputError: numbers that no colours can be in.
    """
    found = header.get(CHROMATICITIES)
    if found is None:
        named = (space for space, known in primaries.INTEROP_IDS.items() if known == header.get(INTEROP_ID))
        return next((primaries.PRIMARIES[space] for space in named), None)
    numbers = tuple(float(x) for x in np.asarray(found, np.float64).ravel())
    if not primaries.are_usable(numbers):
        shown_numbers = ", ".join(f"{x:g}" for x in numbers[:8])
        remedy = "save it with those of its colour space, or without the attribute if it is Rec.709"
        raise InputError(path, f"primaries that span no colours ({shown_numbers})", remedy, field=CHROMATICITIES)
    space = primaries.known(numbers)
    return primaries.PRIMARIES[space] if space is not None else cast(Chromaticities, numbers)


def to_rec709(path: str | Path, header: Mapping[str, Any], rgb: NDArray[np.float32]) -> NDArray[np.float32]:
    """Colours (..., 3) of a part, linear, premultiplied or not, in Rec.709: the given array where they are in it.

    Raises:
        InputError: chromaticities that no colours can be in.
    """
    found = chromaticities_of(path, header)
    return rgb if found is None else primaries.converted(rgb, found, primaries.REC709)


def _has_utf8_name(path: str | Path) -> bool:
    try:
        str(path).encode()
    except UnicodeEncodeError:
        return False
    return True


def _plane(values: NDArray[Any], half: bool) -> NDArray[Any]:
    """The array in the stored type, C-contiguous: the package writes any other layout wrong without an error."""
    if half:
        return np.ascontiguousarray(np.clip(values, -_MAX_HALF, _MAX_HALF), dtype=np.float16)
    return np.ascontiguousarray(values, dtype=np.float32)


def _window(planes: list[NDArray[Any]]) -> tuple[range, range]:
    """Rows and columns outside of which every bit of every plane is 0; all where that is most of the picture."""
    height, width = planes[0].shape[:2]
    top, left, bottom, right = height, width, 0, 0
    for plane in planes:
        bits = plane.view(f"u{plane.itemsize}").reshape(height, width, -1)
        rows = np.flatnonzero(bits.any(axis=(1, 2)))
        if len(rows):
            columns = np.flatnonzero(bits[rows[0] : rows[-1] + 1].any(axis=0).any(axis=-1))
            top, bottom = min(top, int(rows[0])), max(bottom, int(rows[-1]) + 1)
            left, right = min(left, int(columns[0])), max(right, int(columns[-1]) + 1)
        if 2 * (bottom - top) * (right - left) > height * width and bottom > top:
            return range(height), range(width)
    if bottom <= top:  # all black: a window cannot be empty
        return range(1), range(1)
    return range(top, bottom), range(left, right)


def _box(rows: range, columns: range) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """OpenEXR's box2i: (x, y) of the first and of the last pixel."""
    corners = (columns[0], rows[0]), (columns[-1], rows[-1])
    return np.array(corners[0], np.int32), np.array(corners[1], np.int32)


def _corners(header: Mapping[str, Any]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """(2, 2) of the data and of the display window: row and column of the first pixel, and those behind the last."""
    data, display = (
        np.array([np.asarray(corner, np.int64)[::-1] + k for k, corner in enumerate(header[name])])
        for name in ("dataWindow", "displayWindow")
    )
    return data, display


def _on_display(pixels: NDArray[Any], header: Mapping[str, Any]) -> NDArray[Any]:
    """A channel of the data window on the display window."""
    data, display = _corners(header)
    if np.array_equal(data, display):
        return pixels
    out = np.zeros(tuple(display[1] - display[0]), pixels.dtype)
    low, high = np.maximum(data[0], display[0]), np.minimum(data[1], display[1])
    source, target = (tuple(slice(a, b) for a, b in zip(low - x[0], high - x[0], strict=True)) for x in (data, display))
    out[target] = pixels[source]
    return out


def _check_size(path: Path, headers: list[dict[str, Any]]) -> None:
    total = 0
    for header in headers:
        data, display = _corners(header)
        channels = header.get("channels", [])
        height, width = (int(x) for x in data[1] - data[0])
        if height < 1 or width < 1 or any(c.xSampling != 1 or c.ySampling != 1 for c in channels):
            found = f"a part of {width} x {height} pixels with subsampled channels or none"
            raise InputError(path, found, "save it as plain RGB")
        if not np.all(np.maximum(data[0], display[0]) < np.minimum(data[1], display[1])):
            raise InputError(path, "pixels that lie outside its display window", "save it with the pixels inside")
        size = height * width
        if not np.array_equal(data, display):
            size += math.prod(int(x) for x in display[1] - display[0])
        total += size * len(channels)
    require_memory(path, total * 4, f"{total} channel values")


def _write_error(path: str | Path, temporary: Path, error: RuntimeError) -> OutputError:
    try:
        full = os.statvfs(temporary).f_bavail == 0
    except OSError:
        full = False
    reason = "the disk is full" if full else " ".join(str(error).replace(str(temporary), "it").split())
    return OutputError(f"{path}: cannot be written ({reason}); nothing half-written was left")

"""SOG (PlayCanvas, "spatially ordered Gaussians"), versions 1 and 2: attributes as pixels of lossless images.

A folder with a meta.json, or all of it in one ZIP file (.sog). Positions are 16 bits of sign(x) ln(1 + |x|); rotations
the three smallest components in 8 bits; scales and colours bytes into a codebook (2) or between bounds (1); SH above
degree 0 a palette with up to 65536 entries. Format: developer.playcanvas.com, "The SOG Format"; splat-transform.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mirelight.base.errors import InputError
from mirelight.base.sh import COEFFICIENTS, degree_of
from mirelight.io.gltf.fields import Fields
from mirelight.io.safety import read_bytes, require_memory
from mirelight.io.splats import values
from mirelight.io.splats.archive import Files, FolderFiles, ZipFiles, parse_json, read_pixels
from mirelight.io.splats.builder import ROWS, CloudBuilder, Slot, cloud_bytes
from mirelight.io.splats.info import SplatFileInfo
from mirelight.model import F32, SplatCloud

_LARGEST_META = 1 << 22  # bytes
_PALETTE_ROW = 64  # palette entries side by side in the centroids image
_LARGEST_PALETTE = 1 << 16
_QUAT_TAG = 252  # alpha of a rotation pixel: 252 + index of the largest component, wxyz

Pixels = NDArray[np.uint8]


@dataclass(frozen=True, slots=True)
class SogHead:
    """A parsed meta.json; nothing else is read yet."""

    files: Files
    meta: Fields
    version: int
    count: int
    antialiased: bool

    @property
    def bands(self) -> int | None:
        """SH degree where the meta.json says it (version 2)."""
        if "shN" not in self.meta:
            return 0
        return self.meta.child("shN").integer("bands", low=1, high=3) if self.version == 2 else None


def open_folder(meta: Path) -> SogHead:
    """The head of an unbundled SOG by its meta.json. Raises InputError."""
    return _parse(FolderFiles(meta), read_bytes(meta, _LARGEST_META))


def open_bundle(path: Path) -> SogHead:
    """The head of a bundled .sog. Raises InputError."""
    files = ZipFiles(path)
    return _parse(files, files.load("meta.json", _LARGEST_META, ""))


def summary_of(head: SogHead, path: Path) -> SplatFileInfo:
    """What the head says. Version 1 keeps the SH degree in an image, which is opened for it. Raises InputError."""
    degree = head.bands if head.bands is not None else degree_of(1 + _read_palette(head).shape[1])
    return SplatFileInfo(
        path=path,
        format=f"SOG v{head.version}",
        count=head.count,
        sh_degree=degree,
        antialiased=head.antialiased,
    )


def read_head(head: SogHead, path: Path) -> SplatCloud:
    """The splats of an open SOG, in PLY's axes. Raises InputError."""
    require_memory(path, 24 * head.count + cloud_bytes(head.count, 1), f"{head.count:,} splats")
    images = SogImages(head)
    builder = CloudBuilder(path, head.count, images.coefficients)
    images.emit(builder, 0, head.count)
    return builder.cloud(antialiased=head.antialiased)


class SogImages:
    """The decoded images of one SOG, ready to give any range of its splats."""

    def __init__(self, head: SogHead) -> None:
        """Read and check every image. Raises InputError."""
        self._head, meta = head, head.meta
        self._means = (self._image("means", 0), self._image("means", 1))
        means = meta.child("means")
        with np.errstate(over="ignore"):  # what becomes infinite is dropped splat by splat
            self._low = means.vector("mins", 3).astype(np.float32)
            self._high = means.vector("maxs", 3).astype(np.float32)
        self._quats, self._scales, self._sh0 = (self._image(name, 0) for name in ("quats", "scales", "sh0"))
        self._scale_table = _byte_values(meta.child("scales"), head.version, 3)
        self._colour_table = _byte_values(meta.child("sh0"), head.version, 4)
        self._palette: F32 | None = None
        if "shN" in meta:
            self._palette = _read_palette(head)
            self._labels = self._image("shN", 1)

    @property
    def coefficients(self) -> int:
        """K: SH coefficients of each splat, degree 0 included."""
        return 1 + (0 if self._palette is None else self._palette.shape[1])

    def emit(self, builder: CloudBuilder, start: int, stop: int) -> None:
        """Append the splats start … stop − 1 to a cloud whose K is at least `coefficients`."""
        for first in range(start, stop, ROWS):
            rows = slice(first, min(first + ROWS, stop))
            slot = builder.slot(rows.stop - first)
            self._decode(rows, slot)
            builder.commit(slot)

    def _decode(self, rows: slice, slot: Slot) -> None:
        low, high = (image[rows, :3].astype(np.float32) for image in self._means)
        with np.errstate(over="ignore", invalid="ignore"):
            t = (low + 256 * high) / 65535
            logs = self._low + (self._high - self._low) * t
            slot.means[:] = np.copysign(np.expm1(np.abs(logs)), logs)
        _decode_quats(self._quats[rows], slot.quats)
        channel = np.arange(3)
        values.exponential(self._scale_table[channel, self._scales[rows, :3]], out=slot.scales)
        slot.sh[:, 0] = self._colour_table[channel, self._sh0[rows, :3]]
        alpha = self._sh0[rows, 3]
        if self._head.version == 1:
            values.sigmoid(self._colour_table[3, alpha], out=slot.opacities)
        else:
            slot.opacities[:] = alpha / np.float32(255)
        slot.sh[:, 1:] = 0
        if self._palette is not None:
            labels = self._labels[rows, 0] + self._labels[rows, 1].astype(np.intp) * 256
            known = labels < len(self._palette)  # others keep their plain colour, as splat-transform reads them
            slot.sh[known, 1 : self.coefficients] = self._palette[labels[known]]

    def _image(self, attribute: str, index: int) -> Pixels:
        """The pixels of one per-splat image, cut to the count."""
        count = self._head.count
        # Writers pad to multiples of 4 or to powers of two; more than that is not a picture of these splats.
        pixels, _ = _named_image(self._head, attribute, index, count, 4 * count + (1 << 16))
        return pixels[:count]


def _parse(files: Files, data: bytes) -> SogHead:
    meta = parse_json(files.path, data)
    version = meta.integer("version", 1)
    if version not in (1, 2):
        raise meta.fail("version", f"{version}", "SOG versions 1 and 2 are read")
    if version == 2:
        count = meta.integer("count", high=2**31)
    else:
        shape = meta.child("means").integers("shape", high=2**31)
        count = shape[0] if shape else 0
    if count < 1:
        raise InputError(files.path, "no splats in it, or not a SOG file", "give a capture")
    antialiased = meta.values.get("antialias") is True or meta.values.get("model") == "antialiased"
    return SogHead(files, meta, version, count, antialiased)


def _named_image(head: SogHead, attribute: str, index: int, least: int, most: int) -> tuple[Pixels, int]:
    entry = head.meta.child(attribute)
    names = entry.texts("files")
    if len(names) <= index:
        raise entry.fail("files", f"{len(names)} files, expected {index + 1}")
    return read_pixels(head.files, names[index], entry.at(f"files[{index}]"), least, most)


def _byte_values(entry: Fields, version: int, channels: int) -> F32:
    """(channels, 256) what each byte of each channel stands for."""
    if version == 2:
        table = entry.vector("codebook", 256)
        with np.errstate(over="ignore"):  # what becomes infinite is dropped splat by splat
            return np.broadcast_to(table.astype(np.float32), (channels, 256))
    low, high = entry.vector("mins", channels), entry.vector("maxs", channels)
    with np.errstate(over="ignore", invalid="ignore"):
        return (low[:, None] + (high - low)[:, None] * np.arange(256) / 255).astype(np.float32)


def _read_palette(head: SogHead) -> F32:
    """(entries, coefficients, 3) SH above degree 0. Version 1 tells the degree by the image's width alone."""
    entry = head.meta.child("shN")
    most = _LARGEST_PALETTE * (COEFFICIENTS[3] - 1)
    pixels, width = _named_image(head, "shN", 0, 1, most)
    rest = width // _PALETTE_ROW
    wanted = (3, 8, 15) if head.bands is None else (COEFFICIENTS[head.bands] - 1,)
    if width % _PALETTE_ROW or rest not in wanted:
        raise entry.fail("files[0]", f"an image {width} pixels wide is no SH palette", "the file is damaged")
    if head.version == 2:
        table = entry.vector("codebook", 256).astype(np.float32)
        count = entry.integer("count", low=1, high=_LARGEST_PALETTE)
    else:
        low, high = entry.number("mins"), entry.number("maxs")
        table = (low + (high - low) * np.arange(256) / 255).astype(np.float32)
        count = _LARGEST_PALETTE
    entries = pixels.reshape(-1, rest, 4)[:count, :, :3]
    return np.asarray(table[entries], dtype=np.float32)


def _decode_quats(pixels: Pixels, out: F32) -> None:
    """Three smallest components in RGB, which one is left out in alpha; a wrong alpha means the identity."""
    three = (pixels[:, :3] / np.float32(255) * 2 - 1) / np.float32(values.SQRT2)
    values.complete_quaternions(three, np.maximum(pixels[:, 3], _QUAT_TAG) - _QUAT_TAG, out=out)
    out[pixels[:, 3] < _QUAT_TAG] = (1, 0, 0, 0)


def check_range(head: SogHead, start: int, count: int, file: Path, field: str) -> None:
    """Raises InputError where splats start … start + count − 1 are not all in this SOG."""
    if start + count > head.count:
        found = f"splats {start:,} to {start + count:,} of {head.count:,} in {head.files.path.parent.name}"
        raise InputError(file, found, "the capture is incomplete or damaged", field=field)

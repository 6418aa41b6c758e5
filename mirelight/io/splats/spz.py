"""SPZ (Niantic), versions 1 to 4: 8-bit attributes and fixed-point positions, gzip (1–3) or one zstd stream each (4).

The specification stores axes right-up-back; PLY's are right-down-front. Files are read into PLY's axes, so that one
capture is the same cloud through either format, as splat-transform and Niantic's own spz_to_ply do. Adobe's extension
that names other axes is honoured. Facts from the format's README and reference code (github.com/nianticlabs/spz).
"""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass
from io import BufferedReader
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mirelight.errors import InputError
from mirelight.io.atomic import atomic_path
from mirelight.io.safety import open_binary, require_memory
from mirelight.io.splats import values
from mirelight.io.splats.builder import ROWS, CloudBuilder, Slot, cloud_bytes
from mirelight.io.splats.info import SplatFileInfo
from mirelight.model import SplatCloud
from mirelight.sh import COEFFICIENTS

_MAGIC = b"NGSP"
_ANTIALIASED, _EXTENDED = 1, 2  # header flags
_COORDINATE_SYSTEM = 0xADBE0003  # SPZ_ADOBE_coordinate_system
_LONGEST_EXTENSIONS = 1 << 20  # bytes
_GZIP_MOST = 1032  # deflate cannot shrink further than this
_ZSTD_MOST = 1024 / 9  # splats a byte; zstd knows no bound, this is the reference reader's
_WINDOW_MOST = 1 << 27  # bytes of zstd window that a file may ask for

_COLOR_SCALE = 0.15  # of the stored degree-0 coefficient
_REST = {0: 0, 1: 3, 2: 8, 3: 15, 4: 24}  # degree -> coefficients above degree 0

# Axis signs that turn stored values into PLY's right-down-front, by the extension's number of the stored system.
_RIGHT_UP_BACK = 4
_TO_PLY = {
    1: (-1, 1, -1),  # left down back
    2: (1, 1, -1),  # right down back
    3: (-1, -1, -1),  # left up back
    4: (1, -1, -1),  # right up back, the default
    5: (-1, 1, 1),  # left down front
    6: (1, 1, 1),  # right down front
    7: (-1, -1, 1),  # left up front
    8: (1, -1, 1),  # right up front
}


@dataclass(frozen=True, slots=True)
class _Head:
    version: int
    count: int
    degree: int  # as stored, up to 4
    fraction_bits: int
    flags: int

    @property
    def kept(self) -> int:
        """SH coefficients above degree 0 that are read."""
        return min(_REST[self.degree], COEFFICIENTS[3] - 1)

    @property
    def sizes(self) -> dict[str, int]:
        """Bytes of each attribute, in file order."""
        n = self.count
        per_splat = {
            "positions": 6 if self.version == 1 else 9,
            "alphas": 1,
            "colors": 3,
            "scales": 3,
            "rotations": 4 if self.version >= 3 else 3,
            "sh": 3 * _REST[self.degree],
        }
        return {name: n * size for name, size in per_splat.items() if size}


def summary(path: Path) -> SplatFileInfo:
    """The head of an SPZ file. Raises InputError."""
    with open_binary(path) as file:
        head = _Stream(path, file).head
    return SplatFileInfo(
        path=path,
        format=f"SPZ v{head.version}",
        count=head.count,
        sh_degree=min(head.degree, 3),
        antialiased=bool(head.flags & _ANTIALIASED),
        notes=("SH of degree 4 is left out",) if head.degree > 3 else (),
    )


def read(path: Path) -> SplatCloud:
    """The splats of an SPZ file, turned into PLY's axes. Raises InputError."""
    with open_binary(path) as file:
        stream = _Stream(path, file)
        head = stream.head
        need = sum(head.sizes.values()) + cloud_bytes(head.count, 1 + head.kept)
        require_memory(path, need, f"{head.count:,} splats")
        stored, system = stream.attributes()
    if system not in _TO_PLY:
        found = f"axes of kind {system} (SPZ_ADOBE_coordinate_system)"
        raise InputError(path, found, "save it again in right-up-back axes")
    builder = CloudBuilder(path, head.count, 1 + head.kept)
    for first in range(0, head.count, ROWS):
        count = min(ROWS, head.count - first)
        slot = builder.slot(count)
        rows = {name: _rows(data, head.count)[first : first + count] for name, data in stored.items()}
        _decode(head, rows, slot)
        values.flip_axes(_TO_PLY[system], slot.means, slot.quats, slot.sh)
        builder.commit(slot)
    return builder.cloud(antialiased=bool(head.flags & _ANTIALIASED))


def write(cloud: SplatCloud, path: Path) -> None:
    """Write SPZ version 3 (gzip), which every SPZ reader since 2025 knows.

    Positions keep 2^-12 of a unit, fewer bits where the cloud is wider than ±2048 units; SH keeps 5 bits in degree 1
    and 4 above, as the reference encoder's defaults.

    Raises:
        OutputError: it cannot be written.
        ValueError: positions that 24 bits cannot hold (beyond ±8 million units).
    """
    reach = float(np.abs(cloud.means).max())
    bits = min(12, 22 - int(np.floor(np.log2(max(reach, 1)))))
    if bits < 0:
        raise ValueError(f"positions reach {reach:.3g}; SPZ holds ±8 million units")
    means, quats, sh = cloud.means.copy(), cloud.quats.copy(), cloud.sh.copy()
    values.flip_axes(_TO_PLY[_RIGHT_UP_BACK], means, quats, sh)
    three, largest = values.three_smallest(np.roll(quats, -1, axis=1))  # xyzw
    magnitude = np.floor(np.abs(three) * (511 * values.SQRT2) + 0.5).astype(np.uint32)
    fields = magnitude | (three < 0).astype(np.uint32) << 9
    rotation = (largest.astype(np.uint32) << 30) | fields[:, 0] << 20 | fields[:, 1] << 10 | fields[:, 2]
    rest = np.full((1, sh.shape[1] - 1, 1), 16)
    rest[:, :3] = 8  # bucket widths of 4 and 5 bits
    codes = np.round(sh[:, 1:] * 128) + 128
    codes = (codes + rest // 2) // rest * rest
    fixed = np.clip(np.round(means.astype(np.float64) * 2**bits), 1 - 2**23, 2**23 - 1).astype("<i4")
    header = struct.pack(
        "<4sIIBBBB", _MAGIC, 3, len(cloud), cloud.sh_degree, bits, _ANTIALIASED if cloud.antialiased else 0, 0
    )
    pieces = (
        header,
        fixed[..., None].view(np.uint8)[..., :3].tobytes(),
        _byte(cloud.opacities * 255),
        _byte(sh[:, 0] * (_COLOR_SCALE * 255) + 127.5),
        _byte((values.log_scale(cloud.scales) + 10) * 16),
        rotation.astype("<u4").tobytes(),
        _byte(codes),
    )
    packer = zlib.compressobj(wbits=31)  # no name, no time: the same cloud gives the same bytes
    with atomic_path(path) as temporary, temporary.open("wb") as file:
        for piece in pieces:
            file.write(packer.compress(piece))
        file.write(packer.flush())


class _Stream:
    """An open SPZ file: its head, then its attributes."""

    def __init__(self, path: Path, file: BufferedReader) -> None:
        """Read and check the head. Raises InputError."""
        self._path, self._file = path, file
        self._size = file.seek(0, 2)
        file.seek(0)
        self._zstd = file.read(4) == _MAGIC
        file.seek(0)
        self._inflater = zlib.decompressobj(wbits=31)
        raw = bytearray(file.read(32)) if self._zstd else bytearray(16)
        if not self._zstd:
            self._inflate(memoryview(raw))
        self.head, self._streams, self._toc = self._parse(bytes(raw))

    def attributes(self) -> tuple[dict[str, NDArray[np.uint8]], int]:
        """Every attribute's bytes, and the number of the stored coordinate system. Raises InputError."""
        places = self._zstd_places() if self._zstd else []
        stored = {name: np.empty(size, dtype=np.uint8) for name, size in self.head.sizes.items()}
        if self._zstd:
            self._file.seek(32)
            extensions = self._file.read(min(self._toc - 32, _LONGEST_EXTENSIONS))
            for (name, data), (start, length) in zip(stored.items(), places, strict=True):
                self._unzstd(name, data, start, length)
        else:
            for data in stored.values():
                self._inflate(data.data)
            extensions = self._inflate_rest()
        return stored, _coordinate_system(extensions) if self.head.flags & _EXTENDED else _RIGHT_UP_BACK

    def _parse(self, raw: bytes) -> tuple[_Head, int, int]:
        length = 32 if self._zstd else 16
        if len(raw) < length or raw[:4] != _MAGIC:
            raise InputError(self._path, "not an SPZ file", "the file is truncated or damaged")
        version, count, degree, fraction_bits, flags, streams = struct.unpack_from("<IIBBBB", raw, 4)
        toc = struct.unpack_from("<I", raw, 16)[0] if self._zstd else 0
        versions = (4,) if self._zstd else (1, 2, 3)
        if version not in versions:
            raise InputError(self._path, f"SPZ version {version}", "versions 1 to 4 are read")
        if degree not in _REST:
            raise InputError(self._path, f"SH degree {degree}", "expected 0 to 4; the file is damaged")
        if fraction_bits > 24:
            raise InputError(self._path, f"{fraction_bits} fractional bits of 24", "the file is damaged")
        head = _Head(version, count, degree, fraction_bits, flags)
        most = self._size * (_ZSTD_MOST if self._zstd else _GZIP_MOST * count / max(sum(head.sizes.values()), 1))
        if not 0 < count <= most:
            found = f"{count:,} splats promised in a file of {self._size:,} bytes"
            raise InputError(self._path, found, "the file is damaged or hostile")
        if self._zstd and (streams != len(head.sizes) or not 32 <= toc <= self._size - 16 * streams):
            raise InputError(self._path, f"{streams} streams, table at byte {toc}", "the file is damaged")
        return head, streams, toc

    def _inflate(self, out: memoryview) -> None:
        """Fill `out` from the gzip stream, never inflating more than fits."""
        done, data = 0, b""
        try:
            while done < len(out):
                data = self._inflater.unconsumed_tail or self._file.read(1 << 20)
                piece = self._inflater.decompress(data, len(out) - done)
                if not piece and (self._inflater.eof or not data):
                    raise InputError(self._path, "ends early", "the file is truncated")
                out[done : done + len(piece)] = piece
                done += len(piece)
        except zlib.error as e:
            raise InputError(self._path, f"not an SPZ file (gzip: {e})", "the file is damaged") from None

    def _inflate_rest(self) -> bytes:
        """What follows the attributes: extension records, bounded; at the end gzip's check sum is verified."""
        out = b""
        while len(out) < _LONGEST_EXTENSIONS and not self._inflater.eof:
            data = self._inflater.unconsumed_tail or self._file.read(1 << 16)
            if not data:
                raise InputError(self._path, "ends early", "the file is truncated")
            try:
                out += self._inflater.decompress(data, _LONGEST_EXTENSIONS - len(out))
            except zlib.error as e:
                raise InputError(self._path, f"damaged after the splats (gzip: {e})") from None
        return out

    def _zstd_places(self) -> list[tuple[int, int]]:
        """Where version 4's streams lie (start, length), their sizes checked against the count."""
        self._file.seek(self._toc)
        table = np.frombuffer(self._file.read(16 * self._streams), dtype="<u8").reshape(-1, 2)
        at = self._toc + 16 * self._streams
        places = []
        for (name, wanted), (packed, unpacked) in zip(self.head.sizes.items(), table.tolist(), strict=True):
            if unpacked != wanted or packed > self._size - at:
                found = f"stream {name!r} of {packed:,} bytes for {unpacked:,}, expected {wanted:,}"
                raise InputError(self._path, found, "the file is truncated or damaged")
            places.append((at, packed))
            at += packed
        return places

    def _unzstd(self, name: str, out: NDArray[np.uint8], start: int, length: int) -> None:
        """Fill `out` from one zstd stream, never decompressing more than fits."""
        import zstandard

        self._file.seek(start)
        source = self._file.read(length)
        decompressor = zstandard.ZstdDecompressor(max_window_size=_WINDOW_MOST)
        done = 0
        try:
            with decompressor.stream_reader(source) as reader:
                while done < len(out) and (got := reader.readinto(out[done:].data)):
                    done += got
        except zstandard.ZstdError as e:
            raise InputError(self._path, f"stream {name!r} (zstd: {e})", "the file is damaged") from None
        if done < len(out):
            raise InputError(self._path, f"stream {name!r} ends early", "the file is truncated")


def _coordinate_system(extensions: bytes) -> int:
    """The stored coordinate system: that of Adobe's extension, else right-up-back. Unknown records are skipped."""
    at = 0
    while at + 8 <= len(extensions):
        kind, length = struct.unpack_from("<II", extensions, at)
        if kind == _COORDINATE_SYSTEM and length == 4 and at + 12 <= len(extensions):
            number: int = struct.unpack_from("<I", extensions, at + 8)[0]
            return number or _RIGHT_UP_BACK  # 0 is "unspecified"
        at += 8 + length
    return _RIGHT_UP_BACK


def _rows(data: NDArray[np.uint8], count: int) -> NDArray[np.uint8]:
    return data.reshape(count, -1)


def _decode(head: _Head, rows: dict[str, NDArray[np.uint8]], slot: Slot) -> None:
    n = len(slot.means)
    slot.means[:] = _positions(head, rows["positions"])
    slot.opacities[:] = rows["alphas"][:, 0] / np.float32(255)
    slot.sh[:, 0] = (rows["colors"] / np.float32(255) - 0.5) / _COLOR_SCALE
    values.exponential(rows["scales"] / np.float32(16) - 10, out=slot.scales)
    xyzw = np.empty((n, 4), dtype=np.float32)
    if head.version >= 3:
        word = np.ascontiguousarray(rows["rotations"]).view("<u4")[:, 0]
        fields = np.stack([word >> s & 1023 for s in (20, 10, 0)], axis=1)
        magnitude = (fields & 511).astype(np.float32) / (511 * values.SQRT2)
        values.complete_quaternions(np.where(fields & 512, -magnitude, magnitude), word >> 30, out=xyzw)
    else:
        three = rows["rotations"] / np.float32(127.5) - 1
        values.complete_quaternions(three, np.full(n, 3), out=xyzw)
    slot.quats[:] = np.roll(xyzw, 1, axis=1)
    if head.kept:
        coefficients = rows["sh"].reshape(n, -1, 3)[:, : head.kept]
        slot.sh[:, 1:] = coefficients / np.float32(128) - 1


def _positions(head: _Head, raw: NDArray[np.uint8]) -> NDArray[np.float32]:
    """(n, 3): half floats in version 1, signed 24-bit fixed point after."""
    if head.version == 1:
        return np.ascontiguousarray(raw).view("<f2").astype(np.float32)
    padded = np.zeros((len(raw), 3, 4), dtype=np.uint8)
    padded[:, :, 1:] = raw.reshape(-1, 3, 3)  # in the upper bytes, so that the sign is the word's
    fixed = padded.view("<i4")[:, :, 0] >> 8
    return (fixed * 2.0**-head.fraction_bits).astype(np.float32)


def _byte(x: NDArray[np.floating]) -> bytes:
    """Rounded to nearest and clamped to 0..255."""
    return np.clip(np.round(x), 0, 255).astype(np.uint8).tobytes()

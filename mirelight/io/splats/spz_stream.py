"""The container of SPZ files: a header, then every attribute's bytes, in one gzip stream (versions 1 to 3) or one zstd
stream each (version 4). Facts from the format's README and reference code (github.com/nianticlabs/spz)."""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass
from io import BufferedReader
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mirelight.base.errors import InputError
from mirelight.base.sh import COEFFICIENTS

MAGIC = b"NGSP"
ANTIALIASED, EXTENDED = 1, 2  # header flags
RIGHT_UP_BACK = 4  # the coordinate system of files that name none

_COORDINATE_SYSTEM = 0xADBE0003  # SPZ_ADOBE_coordinate_system
_LONGEST_EXTENSIONS = 1 << 20  # bytes
_GZIP_MOST = 1032  # deflate cannot shrink further than this
_ZSTD_MOST = 1024 / 9  # splats a byte; zstd knows no bound, this is the reference reader's
_WINDOW_MOST = 1 << 27  # bytes of zstd window that a file may ask for
_REST = {0: 0, 1: 3, 2: 8, 3: 15, 4: 24}  # SH degree -> coefficients above degree 0


@dataclass(frozen=True, slots=True)
class SpzHead:
    """The header of either container."""

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


class SpzStream:
    """An open SPZ file: its head, then its attributes."""

    def __init__(self, path: Path, file: BufferedReader) -> None:
        """Read and check the head. Raises InputError."""
        self._path, self._file = path, file
        self._size = file.seek(0, 2)
        file.seek(0)
        self._zstd = file.read(4) == MAGIC
        file.seek(0)
        self._inflater = zlib.decompressobj(wbits=31)
        raw = bytearray(file.read(32)) if self._zstd else bytearray(16)
        if not self._zstd:
            self._inflate(memoryview(raw))
        self.head, self._streams, self._toc = self._parse(bytes(raw))

    def attributes(self) -> tuple[dict[str, NDArray[np.uint8]], int]:
        """Every attribute's bytes (N,), and the number of the stored coordinate system. Raises InputError."""
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
        return stored, _coordinate_system(extensions) if self.head.flags & EXTENDED else RIGHT_UP_BACK

    def _parse(self, raw: bytes) -> tuple[SpzHead, int, int]:
        length = 32 if self._zstd else 16
        if len(raw) < length or raw[:4] != MAGIC:
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
        head = SpzHead(version, count, degree, fraction_bits, flags)
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
            return number or RIGHT_UP_BACK  # 0 is "unspecified"
        at += 8 + length
    return RIGHT_UP_BACK

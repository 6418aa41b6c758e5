"""What can be said of an EXR file without decoding its pixels: whether it is all there, and whether a bit has changed.

Layout: "OpenEXR File Layout" of the OpenEXR documentation.
"""

from __future__ import annotations

import hashlib
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

from mirelight.io.safety import open_file

DIGEST = "mirelight/digest"  # header attribute, a string: SHA-256 of the file with this value's digits taken as "0"
NO_DIGEST = "0" * 64
_LONG_NAMES = 0x400
_ROWS_PER_CHUNK = {0: 1, 1: 1, 2: 1, 3: 16, 4: 32, 5: 16, 6: 32, 7: 32, 8: 32, 9: 256}  # by the code of compression


@dataclass(frozen=True, slots=True)
class _Header:
    """Where things lie in a plain scanline file."""

    chunks: tuple[int, ...]  # first row of each
    table: int  # offset of the table of the chunks' offsets
    digest: int | None  # offset of the digest's digits


def is_whole(path: str | Path) -> bool:
    """Whether a scanline file is all there: cheap, as it reads the header and eight bytes of every chunk.

    True where the chunks follow each other from the offset table to the end of the file without a gap, each with the
    row number and the length that it must have. Finds a file that was cut off anywhere or has bytes too many, and most
    damage of whole disk blocks; bits that changed inside a chunk's data it does not see, :func:`is_intact` does.
    """
    try:
        with open_file(Path(path)) as stream:
            return _chunks_fit(stream)
    except (OSError, struct.error, ValueError, OverflowError):
        return False


def is_intact(path: str | Path) -> bool:
    """Whether a file is, to the bit, what :func:`mirelight.io.exr.write_exr` wrote: reads all of it, decodes nothing.

    False for a whole file without a digest, too: nothing is known of it.
    """
    try:
        with open_file(Path(path)) as stream:
            if not _chunks_fit(stream):
                return False
            at = _header(stream).digest
            if at is None:
                return False
            stream.seek(at)
            return _digest(stream, at) == stream.read(len(NO_DIGEST)).decode("ascii", "replace")
    except (OSError, struct.error, ValueError, OverflowError):
        return False


def seal(path: Path) -> None:
    """Put the digest of a file into it, in place of the zeros that its header holds."""
    with path.open("r+b") as stream:
        at = _header(stream).digest
        if at is None:
            raise ValueError("no digest in the header")
        digest = _digest(stream, at)
        stream.seek(at)
        stream.write(digest.encode())


def _digest(stream: BinaryIO, at: int) -> str:
    """SHA-256 of the stream with the digits at `at` as zeros; leaves the stream there."""
    sha = hashlib.sha256()
    stream.seek(0)
    sha.update(stream.read(at))
    sha.update(NO_DIGEST.encode())
    stream.seek(at + len(NO_DIGEST))
    while block := stream.read(1 << 20):
        sha.update(block)
    stream.seek(at)
    return sha.hexdigest()


def _chunks_fit(stream: BinaryIO) -> bool:
    header = _header(stream)
    size = stream.seek(0, 2)
    stream.seek(header.table)
    table = stream.read(8 * len(header.chunks))
    expected = header.table + len(table)
    offsets = struct.unpack(f"<{len(header.chunks)}Q", table)
    for offset, row in sorted(zip(offsets, header.chunks, strict=True)):
        if offset != expected:
            return False
        stream.seek(offset)
        y, length = struct.unpack("<iI", stream.read(8))
        if y != row:
            return False
        expected = offset + 8 + length
    return expected == size


def _header(stream: BinaryIO) -> _Header:
    """Raises ValueError or struct.error for anything but one plain scanline part."""
    stream.seek(4)
    flags = struct.unpack("<I", stream.read(4))[0]
    if flags & ~0xFF & ~_LONG_NAMES:
        raise ValueError("not a plain scanline file")
    low = high = rows = digest = None
    while name := _name(stream):
        kind = _name(stream)
        length = struct.unpack("<i", stream.read(4))[0]
        at = stream.tell()
        value = stream.read(length)
        if len(value) != length:
            raise ValueError("cut off")
        if name == b"dataWindow":
            _, low, _, high = struct.unpack("<4i", value)
        elif name == b"compression":
            rows = _ROWS_PER_CHUNK.get(value[0])
        elif name == DIGEST.encode() and kind == b"string" and length == len(NO_DIGEST):
            digest = at
    if low is None or high is None or rows is None or not low <= high < low + 2**24:
        raise ValueError("no rows")
    return _Header(tuple(range(low, high + 1, rows)), stream.tell(), digest)


def _name(stream: BinaryIO) -> bytes:
    """A zero-terminated string of at most 255 bytes."""
    out = b""
    while (byte := stream.read(1)) != b"\0":
        if not byte or len(out) == 255:
            raise ValueError("not a name")
        out += byte
    return out

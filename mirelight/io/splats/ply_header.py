"""The header of a PLY file, and its elements as NumPy structured types (Turk's PLY 1.0, as splat tools write it)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mirelight.base.errors import InputError, printable
from mirelight.io.safety import open_binary

NO_SPLATS = "a mesh or point cloud has no splats; give a Gaussian-splat PLY"
_LONGEST_HEADER = 1 << 18  # bytes
_TYPES = {
    "char": "i1",
    "uchar": "u1",
    "short": "i2",
    "ushort": "u2",
    "int": "i4",
    "uint": "u4",
    "float": "f4",
    "double": "f8",
    "int8": "i1",
    "uint8": "u1",
    "int16": "i2",
    "uint16": "u2",
    "int32": "i4",
    "uint32": "u4",
    "float32": "f4",
    "float64": "f8",
}
_BYTE_ORDERS = {"binary_little_endian": "<", "binary_big_endian": ">"}


@dataclass(frozen=True, slots=True)
class Element:
    """One table of a PLY file."""

    name: str
    count: int
    dtype: np.dtype[Any]  # structured, packed, in the file's byte order
    offset: int  # of its first byte in the file

    @property
    def names(self) -> tuple[str, ...]:
        """Property names in file order."""
        return self.dtype.names or ()


@dataclass(frozen=True, slots=True)
class PlyHeader:
    """Every element that can be read, in file order, and the comments."""

    path: Path
    elements: dict[str, Element]
    comments: tuple[str, ...]

    @property
    def antialiased(self) -> bool:
        """Trained with opacity compensation, as Brush ("SplatRenderMode: mip") and Postshot ("antialiased 1") say."""
        last = False
        for comment in self.comments:
            name, _, value = comment.lower().replace(":", " ", 1).partition(" ")
            if name == "splatrendermode":
                last = value.strip() == "mip"
            elif name == "antialiased":
                last = value.strip() == "1"
        return last

    def fail(self, found: str, remedy: str = "") -> InputError:
        """The error to raise about this file's header."""
        return InputError(self.path, found, remedy, field="PLY header")


def read_ply_header(path: Path) -> PlyHeader:
    """Parse the header and check that the file holds what it promises.

    Elements from the first one with a list property on are left out: their place depends on their content, and splats
    have no lists. Text (ascii) files are refused.

    Raises:
        InputError: not a PLY file, a header out of form, or fewer bytes than its counts need.
    """
    with open_binary(path) as file:
        head = file.read(_LONGEST_HEADER)
        size = file.seek(0, 2)
    lines, start = _header_lines(path, head)
    order, tables, comments = _parse(PlyHeader(path, {}, ()), lines)
    header = PlyHeader(path, {}, tuple(comments))
    for name, count, fields in tables:
        if fields is None:
            break
        try:
            dtype = np.dtype([(field, order + kind) for field, kind in fields])
        except ValueError:
            raise header.fail(f"element {name!r} names a property twice") from None
        if count * dtype.itemsize > size - start:
            found = f"{count:,} rows of {name!r} need {count * dtype.itemsize:,} bytes, {size - start:,} are left"
            raise header.fail(found, "the file is truncated")
        header.elements[name] = Element(name, count, dtype, start)
        start += count * dtype.itemsize
    return header


def blocks(path: Path, element: Element, rows: int) -> Iterator[NDArray[Any]]:
    """The element's rows (N,), `rows` at a time, in one buffer that is used again for each block.

    Reading beats mapping here: it needs no address space, and a file that shrinks meanwhile is an error, not a crash.

    Raises:
        InputError: the file ends early.
    """
    buffer = np.empty(min(rows, element.count), dtype=element.dtype)
    raw = buffer.view(np.uint8)
    with open_binary(path) as file:
        file.seek(element.offset)
        for first in range(0, element.count, rows):
            count = min(rows, element.count - first)
            wanted = count * element.dtype.itemsize
            try:
                got = file.readinto(raw[:wanted].data)
            except OSError as e:
                raise InputError(path, f"cannot be read ({e.strerror})") from None
            if got != wanted:
                raise InputError(path, f"ends in row {first:,} of {element.name!r}", "the file is truncated")
            yield buffer[:count]


def _header_lines(path: Path, head: bytes) -> tuple[list[str], int]:
    """The header's lines and the offset of the first byte after it."""
    if head[:3] != b"ply" or head[3:4] not in (b"\n", b"\r"):
        raise InputError(path, "not a PLY file")
    at = head.find(b"\nend_header")
    newline = head.find(b"\n", at + 1)
    if at < 0 or newline < 0 or head[at + 11 : newline].strip():
        raise InputError(path, "a PLY header without end_header", "the file is truncated or damaged")
    return head[:at].decode("latin-1").splitlines(), newline + 1


def _parse(
    header: PlyHeader, lines: list[str]
) -> tuple[str, list[tuple[str, int, list[tuple[str, str]] | None]], list[str]]:
    """Byte order, tables (name, rows, properties; None where it has lists) and comments."""
    order = ""
    tables: list[tuple[str, int, list[tuple[str, str]] | None]] = []
    comments: list[str] = []
    for line in lines[1:]:
        match line.split():
            case ["comment" | "obj_info", *_]:
                comments.append(line.strip().partition(" ")[2].strip())
            case ["format", kind, _]:
                if kind not in _BYTE_ORDERS:
                    if not any("f_dc_0" in x or "packed_position" in x for x in lines):
                        raise header.fail("no property 'f_dc_0'", NO_SPLATS)
                    raise header.fail(f"format {kind[:30]}", "save the file as binary_little_endian")
                order = _BYTE_ORDERS[kind]
            case ["element", name, count] if count.isascii() and count.isdigit() and len(count) < 16:
                if any(name == table[0] for table in tables):
                    raise header.fail(f"two elements named {name[:30]!r}")
                tables.append((name, int(count), []))
            case ["property", "list", _, _, _] if tables:
                tables[-1] = (*tables[-1][:2], None)
            case ["property", kind, name] if tables and kind in _TYPES:
                fields = tables[-1][2]
                if fields is not None:
                    fields.append((name, _TYPES[kind]))
            case []:
                pass
            case _:
                raise header.fail(f"the line {line[:60]!r} is not understood")
    if not order:
        raise header.fail("no format line", "the file is damaged")
    return order, tables, comments


def comment_lines(comments: Sequence[str]) -> list[str]:
    """Header lines of comments; what is not printable ASCII becomes an escape."""
    clean = (" ".join(x.split()).encode("ascii", "backslashreplace").decode("ascii") for x in comments)
    return [f"comment {printable(x)}" for x in clean]

"""Whether PLY and STL meshes hold as many rows as their headers say: looked at before anything is read by them.

A reader that believes a count allocates for it, or fails somewhere in the middle. What is told here is the least that
the rows can take, so a file that passes may still be damaged.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

from mirelight.base.errors import InputError
from mirelight.io.safety import open_binary

_MAX_HEADER = 1 << 16  # bytes of a PLY header that are looked at
_SIZES = {"char": 1, "short": 2, "int": 4, "float": 4, "double": 8}  # bytes; those with a "u" before have the same
_TEXT_VALUE = 2  # bytes of a value in text: a digit, and what parts it from the next
_STL_HEADER, _STL_TRIANGLE = 84, 50  # bytes
_STL_TEXT = re.compile(rb"\s*solid\b[^\0]*?\bfacet\b", re.IGNORECASE)


def check_counts(path: Path, suffix: str) -> None:
    """Of a PLY or STL file; one that has no such header is left to its reader.

    Raises:
        InputError: a count that is none, or rows that the rest of the file is too short for.
    """
    with open_binary(path) as file:
        head = file.read(_MAX_HEADER)
        size = file.seek(0, 2)
    if suffix == ".stl":
        _check_stl(path, head, size)
    elif head[:3] == b"ply" and (end := re.search(rb"[\r\n]end_header[ \t]*\r?\n?", head)):
        _check_ply(path, head[: end.start()].decode("latin-1").splitlines(), size - end.end())


def _check_stl(path: Path, head: bytes, size: int) -> None:
    if _STL_TEXT.match(head) or b"\0" not in head:  # text
        return
    field = "number of triangles (byte 80)"
    if size < _STL_HEADER:
        raise InputError(path, f"{size} bytes, less than the header's {_STL_HEADER}", "the file is truncated")
    count, left = int.from_bytes(head[80:84], "little"), size - _STL_HEADER
    if count * _STL_TRIANGLE != left:
        found = f"{count:,} triangles take {count * _STL_TRIANGLE:,} bytes, {left:,} are left"
        raise InputError(path, found, "the file is truncated or damaged; write it again", field=field)


def _check_ply(path: Path, lines: list[str], left: int) -> None:
    is_text = any(x.split()[:2] == ["format", "ascii"] for x in lines)
    for name, text, row in _elements(lines, is_text):
        field = f"element {name[:30]}"
        if not (text.isascii() and text.isdigit()):
            raise InputError(path, f"a count of {text[:30]!r}", "the file is damaged; write it again", field=field)
        count = int(text[:30])
        if count * row - (1 if is_text else 0) > left:  # text need not end with a line feed
            found = f"{count:,} rows take {count * row:,} bytes at least, {left:,} are left"
            raise InputError(path, found, "the file is truncated or damaged; write it again", field=field)
        left -= count * row


def _elements(lines: list[str], is_text: bool) -> Iterator[tuple[str, str, int]]:
    """(name, count as written, least bytes of a row) of a header's elements."""
    found: list[tuple[str, str, int]] = []
    for line in lines:
        match line.split():
            case ["element", name, count, *_]:
                found.append((name, count, 0))
            case ["property", "list", kind, *_] | ["property", kind, *_] if found:  # of a list the count alone is sure
                name, count, row = found[-1]
                found[-1] = (name, count, row + (_TEXT_VALUE if is_text else _size(kind)))
    yield from found


def _size(kind: str) -> int:
    """Bytes of a value of a type as headers name it, 1 where it is unknown."""
    bits = re.fullmatch(r"(?:u?int|float)(8|16|32|64)", kind)
    return int(bits[1]) // 8 if bits else _SIZES.get(kind.removeprefix("u"), 1)

"""Pictures that are too large get a line that says so, before a pixel of them is decoded."""

from __future__ import annotations

import io
import struct
import zlib

import pytest

from mirelight.base.errors import InputError
from mirelight.io.decoding import opened


def png_header(width: int, height: int) -> io.BytesIO:
    """A PNG file that says it has that size, and holds no pixel."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    head = chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0))
    return io.BytesIO(b"\x89PNG\r\n\x1a\n" + head + chunk(b"IDAT", zlib.compress(b"\0")) + chunk(b"IEND", b""))


@pytest.mark.parametrize(
    ("width", "said"), [(5_000, "an image of 5000 x 5000 pixels"), (60_000, "an image of more than 170 million pixels")]
)
def test_a_picture_that_is_too_large_is_told_to_be_scaled_down(width: int, said: str) -> None:
    with (
        pytest.raises(InputError, match=f"{said}; scale it down to at most 16 million pixels"),
        opened(png_header(width, width), "wall.png", 16 << 20, 4),
    ):
        pass

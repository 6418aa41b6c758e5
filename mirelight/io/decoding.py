"""Pillow's decoders over untrusted files: size before memory, and one line for all that they raise."""

from __future__ import annotations

import io
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, TYPE_CHECKING

from mirelight.base.errors import InputError
from mirelight.io.safety import require_memory

if TYPE_CHECKING:
    from PIL.Image import Image as Picture

_FORMATS = ("PNG", "JPEG", "WEBP")
_MOST_JPEG = 1 << 26  # bytes
_FILLING = tuple(byte * (1 << 17) for byte in (b"\0", b"\xff"))  # Pillow searches such for a marker, byte by byte


@contextmanager
def opened(stream: IO[bytes], file: str | Path, most: int, each: int, field: str = "") -> Iterator[Picture]:
    """A PNG, JPEG or WebP picture, to be decoded within the block.

    Args:
        stream: the encoded picture.
        file: whom to name in an error.
        most: pixels that it may have.
        each: bytes that decoding takes for each pixel; no more is begun than is free.
        field: where in that file.

    Raises:
        InputError: not such a picture, damaged, or too large; also for whatever a decoder raises in the block.
    """
    from PIL import Image

    smaller = f"scale it down to at most {most >> 20} million pixels"
    data = _encoded(stream, file, most, field)
    try:
        with warnings.catch_warnings(action="ignore"), Image.open(io.BytesIO(data), formats=_FORMATS) as image:
            width, height = image.size
            if width * height > most:
                raise InputError(file, f"an image of {width} x {height} pixels", smaller, field=field)
            require_memory(Path(file), width * height * each, f"{width} x {height} pixels")
            yield image
    except (InputError, MemoryError):
        raise
    except Image.DecompressionBombError:  # before its size can be asked
        most_read = 2 * (Image.MAX_IMAGE_PIXELS or 0) >> 20
        raise InputError(file, f"an image of more than {most_read} million pixels", smaller, field=field) from None
    except Exception as e:  # errors of a dozen types, zlib.error and IndexError for a broken colour profile
        found = f"an image that cannot be decoded ({type(e).__name__})"
        raise InputError(file, found, "give a sound PNG, JPEG or WebP image", field=field) from None


def _encoded(stream: IO[bytes], file: str | Path, most: int, field: str) -> bytes:
    head, size = stream.read(2), stream.seek(0, 2)
    allowed = _MOST_JPEG if head == b"\xff\xd8" else 8 * most  # 16-bit RGBA; a sparse file may claim terabytes
    if size > allowed:
        raise InputError(file, f"an image of {size:,} bytes", f"at most {allowed:,} are read", field=field)
    stream.seek(0)
    data = stream.read()
    if head == b"\xff\xd8" and any(x in data for x in _FILLING):
        raise InputError(file, "a JPEG image with long runs of nothing", "the file is damaged", field=field)
    return data

"""8- and 16-bit pictures (PNG, JPEG, WebP) as linear light."""

from __future__ import annotations

import io
import warnings
from pathlib import Path
from typing import IO

import numpy as np

from mirelight import colour
from mirelight.errors import InputError
from mirelight.model import F32

_FORMATS = ("PNG", "JPEG", "WEBP")
_MAX_PIXELS = 1 << 26  # 8192 x 8192
_MAX_BYTES = 1 << 29  # of the encoded picture, 16-bit RGB of that size; a sparse file may claim terabytes
_MAX_JPEG = 1 << 26
_FILLING = tuple(byte * (1 << 17) for byte in (b"\0", b"\xff"))  # Pillow searches such for a marker, byte by byte


def decode_srgb_image(stream: IO[bytes], file: str | Path, field: str = "") -> F32:
    """A picture's colours in linear light; its alpha and any embedded colour profile are ignored.

    Args:
        stream: the encoded picture.
        file: whom to name in an error.
        field: where in that file.

    Returns:
        (h, w, 3) float32, row 0 the top, sRGB decoded.

    Raises:
        InputError: not a PNG, JPEG or WebP picture, damaged, or larger than 67 million pixels.
    """
    from PIL import Image

    head, size = stream.read(2), stream.seek(0, 2)
    most = _MAX_JPEG if head == b"\xff\xd8" else _MAX_BYTES
    if size > most:
        raise InputError(file, f"an image of {size:,} bytes", f"at most {most:,} are read", field=field)
    stream.seek(0)
    data = stream.read()
    if head == b"\xff\xd8" and any(x in data for x in _FILLING):
        raise InputError(file, "a JPEG image with long runs of nothing", "the file is damaged", field=field)
    try:
        with warnings.catch_warnings(action="ignore"), Image.open(io.BytesIO(data), formats=_FORMATS) as image:
            if image.width * image.height > _MAX_PIXELS:
                found = f"an image of {image.width} x {image.height} pixels"
                raise InputError(file, found, "scale it down to at most 8192 x 8192", field=field)
            return _linear(image)
    except (InputError, MemoryError):
        raise
    except Exception as e:  # Pillow's decoders raise errors of a dozen types, zlib.error for a broken colour profile
        found = f"an image that cannot be decoded ({type(e).__name__})"
        raise InputError(file, found, "give a sound PNG, JPEG or WebP image", field=field) from None


def _linear(image: object) -> F32:
    from PIL import Image

    assert isinstance(image, Image.Image)
    if image.mode.startswith("I"):  # 16-bit gray, which Pillow would clip to 8 bits
        gray = np.asarray(image, dtype=np.float32) / np.float32(65535)
        return np.repeat(colour.srgb_decode(gray)[:, :, None], 3, axis=2)
    table = colour.srgb_decode(np.arange(256, dtype=np.float32) / np.float32(255))
    return np.asarray(table[np.asarray(image.convert("RGB"))])

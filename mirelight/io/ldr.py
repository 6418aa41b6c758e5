"""8- and 16-bit pictures (PNG, JPEG, WebP) as linear light."""

from __future__ import annotations

from pathlib import Path
from typing import IO, TYPE_CHECKING

import numpy as np

from mirelight.base import colour
from mirelight.io.decoding import opened
from mirelight.model import F32

if TYPE_CHECKING:
    from PIL.Image import Image as Picture

_MOST_PIXELS = 1 << 26  # 8192 x 8192
_EACH = 12 + 4 + 4  # bytes a pixel: the result, the decoded picture, and the same as RGB
_ROWS = 1 << 18  # pixels that are turned into light at once


def decode_with_alpha(stream: IO[bytes], file: str | Path) -> tuple[F32, F32 | None]:
    """A picture's colours as :func:`decode_srgb_image` gives them, and its alpha (h, w), 0..1; None where it has none.

    Raises:
        InputError: as there.
    """
    with opened(stream, file, _MOST_PIXELS, _EACH + 4) as image:
        gray = image.mode.startswith("I")
        clear = not gray and ("A" in image.mode or "transparency" in image.info)
        whole = image.convert("RGBA") if clear else image
        alpha = np.asarray(whole.getchannel("A"), np.float32) / np.float32(255) if clear else None
        return _linear(image if gray or image.mode == "RGB" else whole.convert("RGB"), 65536 if gray else 256), alpha


def decode_srgb_image(stream: IO[bytes], file: str | Path, field: str = "") -> F32:
    """A picture's colours in linear light; its alpha and any embedded colour profile are ignored.

    Args:
        stream: the encoded picture.
        file: whom to name in an error.
        field: where in that file.

    Returns:
        (h, w, 3) float32, row 0 the top, sRGB decoded.

    Raises:
        InputError: not a PNG, JPEG or WebP picture, damaged, larger than 67 million pixels, or than memory.
    """
    with opened(stream, file, _MOST_PIXELS, _EACH, field) as image:
        gray = image.mode.startswith("I")  # 16 bits, which Pillow would clip to 8
        return _linear(image if gray or image.mode == "RGB" else image.convert("RGB"), 65536 if gray else 256)


def _linear(image: Picture, levels: int) -> F32:
    """Some rows at a time: NumPy's index into the table takes 24 bytes a pixel."""
    table = colour.srgb_decode(np.arange(levels, dtype=np.float32) / np.float32(levels - 1))
    image.load()
    out = np.empty((image.height, image.width, 3), np.float32)
    step = max(_ROWS // image.width, 1)
    for top in range(0, image.height, step):
        rows = np.asarray(image.crop((0, top, image.width, min(top + step, image.height))))
        values = table[np.clip(rows, 0, levels - 1)]
        out[top : top + step] = values[..., None] if values.ndim == 2 else values
    return out

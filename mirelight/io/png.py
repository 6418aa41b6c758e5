"""PNG for display: linear light through exposure, tone curve and transfer curve to 8 bits, with text chunks."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mirelight import colour
from mirelight.errors import InputError
from mirelight.io.atomic import atomic_path
from mirelight.model import F32, DisplaySettings, Profile

_END = b"\x00\x00\x00\x00IEND\xae\x42\x60\x82"  # the last chunk of every whole PNG file


def encode_display(rgba: F32, display: DisplaySettings, profile: Profile = "physical") -> NDArray[np.uint8]:
    """A premultiplied linear picture as display values over the display's background.

    See :func:`mirelight.colour.shown`.

    Args:
        rgba: (H, W, 4) linear, premultiplied.
        display: exposure in stops, tone curve, background.
        profile: whose transfer curve: sRGB for physical, a 2.2 power for playcanvas.

    Returns:
        (H, W, 3) uint8, rounded half to even.
    """
    shown = colour.shown(
        rgba[..., :3],
        rgba[..., 3],
        profile,
        gain=2.0**display.exposure,
        tone=display.tone,
        background=display.background,
    )
    shown *= np.float32(255)
    return np.rint(shown, out=shown).astype(np.uint8)


def write_png(path: str | Path, pixels: NDArray[np.uint8], texts: Mapping[str, str]) -> None:
    """Write an 8-bit RGB picture with text chunks.

    Args:
        path: the file to write.
        pixels: (H, W, 3) uint8.
        texts: keyword -> ASCII text, stored before the pixels.

    Raises:
        OutputError: the file cannot be written; nothing half-written is left.
    """
    from PIL import Image, PngImagePlugin

    info = PngImagePlugin.PngInfo()
    for key, text in texts.items():
        info.add_text(key, text)
    with atomic_path(path) as temporary:
        Image.fromarray(np.ascontiguousarray(pixels)).save(temporary, "PNG", pnginfo=info)


def read_png_text(path: str | Path) -> dict[str, str]:
    """The text chunks of a PNG file, without decoding its pixels.

    Raises:
        InputError: not a PNG file, or cut off.
    """
    from PIL import Image

    try:
        with Path(path).open("rb") as stream:
            stream.seek(-len(_END), 2)
            if stream.read() != _END:
                raise InputError(path, "a PNG file without its end", "the file is truncated")
            stream.seek(0)
            with Image.open(stream, formats=("PNG",)) as image:
                return {k: v for k, v in image.info.items() if isinstance(k, str) and isinstance(v, str)}
    except (OSError, SyntaxError, ValueError, Image.DecompressionBombError) as e:
        raise InputError(path, f"not a PNG file that can be read ({type(e).__name__})", "check the file") from None

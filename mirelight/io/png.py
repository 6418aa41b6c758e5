"""PNG for display: linear light through exposure, tone curve and transfer curve to 8 bits, with text chunks."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from mirelight.base import colour
from mirelight.base.errors import InputError
from mirelight.base.png import END, SIGNATURE, png_bytes
from mirelight.io.atomic import write_file
from mirelight.io.safety import open_file
from mirelight.io.views import curve_of
from mirelight.model import F32, DisplaySettings, Profile, rules_of


def encode_display(
    rgba: F32,
    display: DisplaySettings,
    profile: Profile = "physical",
    *,
    whole: bool = False,
    behind: F32 | None = None,
) -> NDArray[np.uint8]:
    """A premultiplied linear picture as display values over the display's background.

    See :func:`mirelight.base.colour.shown`.

    Args:
        rgba: (H, W, 4) linear, premultiplied.
        display: exposure in stops, tone curve or view, background.
        profile: whose transfer curve, without a view: sRGB for physical, a 2.2 power for playcanvas.
        whole: the splats were blended in linear light.
        behind: (H, W, 3) linear light in place of the background.

    Returns:
        (H, W, 3) uint8, rounded half to even.

    Raises:
        BackendError, InputError: see :func:`mirelight.io.views.curve_of`.
    """
    transfer = rules_of(profile).transfer
    if whole and behind is None:
        behind = colour.decode(display.background, transfer)
    shown = colour.shown(
        rgba[..., :3],
        rgba[..., 3],
        transfer,
        gain=2.0**display.exposure,
        tone=display.tone,
        background=display.background,
        view=curve_of(display),
        behind=behind,
    )
    shown *= np.float32(255)
    return np.rint(shown, out=shown).astype(np.uint8)


def encode_straight(rgba: F32, display: DisplaySettings, profile: Profile = "physical") -> NDArray[np.uint8]:
    """A premultiplied linear picture as display values with straight alpha.

    Laid over a background by a program, rgb a + background (1 - a), it is what :func:`encode_display` gives over that
    background, except where a colour is brighter than white before it is multiplied by alpha, which 8 bits cannot hold.

    Args:
        rgba: (H, W, 4) linear, premultiplied.
        display: exposure in stops, tone curve or view; its background has no part in it.
        profile: whose transfer curve, without a view.

    Returns:
        (H, W, 4) uint8, rounded half to even; black where alpha is 0.
    """
    own = colour.straight(rgba[..., :3], rgba[..., 3]) * np.float32(2.0**display.exposure)
    shown = colour.displayed(own, rules_of(profile).transfer, display.tone, curve_of(display))
    values = np.concatenate([shown, rgba[..., 3:]], axis=-1)
    clean = np.clip(np.nan_to_num(values, nan=0.0, posinf=1.0, neginf=0.0), 0.0, 1.0)
    return np.asarray(np.rint(clean * np.float32(255)), dtype=np.uint8)


def write_png(path: str | Path, pixels: NDArray[np.uint8], texts: Mapping[str, str]) -> None:
    """Write an 8-bit picture with text chunks.

    Args:
        path: the file to write.
        pixels: (H, W, 3) RGB or (H, W, 4) RGBA uint8.
        texts: keyword -> ASCII text, stored before the pixels.

    Raises:
        OutputError: the file cannot be written; nothing half-written is left.
    """
    write_file(path, png_bytes(pixels, texts))


def read_png_text(path: str | Path) -> dict[str, str]:
    """The text chunks (tEXt) of a PNG file before its pixels, and whether it ends well, without decoding anything.

    Raises:
        InputError: not a PNG file, or cut off.
    """
    found: dict[str, str] = {}
    try:
        with open_file(Path(path)) as stream:
            for kind, data in _chunks(stream, until=b"IDAT"):
                if kind == b"tEXt":
                    key, _, text = data.partition(b"\0")
                    found[key.decode("latin-1")] = text.decode("latin-1")
            stream.seek(-len(END), 2)
            if stream.read() != END:
                raise InputError(path, "a PNG file without its end", "the file is truncated")
    except (OSError, ValueError, struct.error) as e:
        raise InputError(path, f"not a PNG file that can be read ({type(e).__name__})", "check the file") from None
    return found


def png_is_intact(path: str | Path) -> bool:
    """Whether every chunk of a PNG file has the CRC-32 that it must have, and nothing follows its end."""
    try:
        with open_file(Path(path)) as stream:
            kinds = [kind for kind, _ in _chunks(stream)]
            return kinds[:1] == [b"IHDR"] and b"IDAT" in kinds and kinds[-1] == b"IEND" and not stream.read(1)
    except (OSError, ValueError, struct.error):
        return False


def _chunks(stream: BinaryIO, until: bytes = b"") -> Iterator[tuple[bytes, bytes]]:
    """Kind and data of each chunk with the right CRC, up to IEND or before the first one of the kind `until`.

    Raises:
        ValueError, struct.error: another kind of file, a wrong CRC, or an end too early.
    """
    if stream.read(len(SIGNATURE)) != SIGNATURE:
        raise ValueError("no signature")
    kind = b""
    while kind != b"IEND":
        length, kind = struct.unpack(">I4s", stream.read(8))
        if kind == until:
            return
        data = stream.read(length)
        if struct.unpack(">I", stream.read(4))[0] != zlib.crc32(kind + data):
            raise ValueError("a wrong CRC")
        yield kind, data

"""Pictures of any kind as a display shows them: 8-bit values of a PNG, JPEG or WebP, or of a linear EXR."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mirelight.base.errors import InputError
from mirelight.io import records
from mirelight.io.decoding import opened
from mirelight.io.exr import read_exr, to_rec709
from mirelight.io.frame_texts import PROVENANCE, profile_of
from mirelight.io.png import encode_display
from mirelight.io.safety import existing, open_binary
from mirelight.io.views import located
from mirelight.model import F32, DisplaySettings

SUFFIXES = (".png", ".jpg", ".jpeg", ".webp", ".exr")  # of files that can be shown, what is cheapest first

_MOST_PIXELS = 1 << 27
_EACH = 4 * 4 + 4 + 3  # bytes a pixel: the picture, black and both together as RGBA, that as RGB, and the result


def read_display(path: str | Path) -> NDArray[np.uint8]:
    """A picture file as display values.

    A frame's EXR is shown by its job's display settings, which the file holds; another program's as linear light in
    the primaries that it names, premultiplied, at exposure 0. What is transparent lies over black.

    Returns:
        (H, W, 3) uint8.

    Raises:
        InputError: not such a picture, damaged, or larger than 134 million pixels.
    """
    path = existing(path)
    suffix = path.suffix.lower()
    if suffix == ".exr":
        return _exr(path)
    if suffix in SUFFIXES:
        return _eight_bit(path)
    raise InputError(path, f"a file of type {suffix or 'unknown'}", "give PNG, JPEG, WebP or EXR files, or a folder")


def _exr(path: Path) -> NDArray[np.uint8]:
    image = read_exr(path)
    try:
        values = image.layer()
    except (KeyError, ValueError):
        found = f"an EXR without a picture (layers {', '.join(image.layers[:5])})"
        raise InputError(path, found, "give one with R, G and B") from None
    rgba = _rgba(values)
    rgba[..., :3] = to_rec709(path, image.metadata, rgba[..., :3])
    profile, linear = profile_of(path, image.metadata)
    behind = None
    if PROVENANCE in image.metadata and {f"background.{x}" for x in "RGB"} <= set(image.channels):
        behind = to_rec709(path, image.metadata, image.layer("background"))
    settings = _display_of(image.metadata)
    if settings.view is not None:
        settings = replace(settings, view=located(settings.view, path))
    return encode_display(rgba, settings, profile, whole=linear, behind=behind)


def _rgba(values: F32) -> F32:
    if values.shape[2] == 4:
        return values
    rgb = {1: (0, 0, 0), 2: (0, 0, 0), 3: (0, 1, 2)}[min(values.shape[2], 3)]
    out = np.ones((*values.shape[:2], 4), np.float32)
    out[..., :3] = values[..., rgb]
    return out


def _display_of(texts: Mapping[str, Any]) -> DisplaySettings:
    """The settings that the frame's own PNG would be made with; the defaults where the file does not say."""
    try:
        return records.made(DisplaySettings, json.loads(texts[PROVENANCE])["settings"]["display"])
    except (AttributeError, KeyError, TypeError, ValueError, RecursionError):
        return DisplaySettings()


def _eight_bit(path: Path) -> NDArray[np.uint8]:
    from PIL import Image

    with open_binary(path) as stream, opened(stream, path, _MOST_PIXELS, _EACH) as image:
        if image.mode.startswith("I"):  # 16-bit gray, which Pillow would clip to 8 bits
            gray = (np.asarray(image, dtype=np.uint32) >> 8).astype(np.uint8)
            return np.repeat(gray[..., None], 3, axis=2)
        if not image.has_transparency_data:
            return np.asarray(image.convert("RGB"))
        black = Image.new("RGBA", image.size, (0, 0, 0, 255))
        return np.asarray(Image.alpha_composite(black, image.convert("RGBA")).convert("RGB"))

"""Reading pictures: linear EXR, and 8-bit PNG, JPEG or WebP."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from mirelight.base.errors import InputError
from mirelight.compare.types import Bool, Picture
from mirelight.io.decoding import opened
from mirelight.io.exr import read_exr, to_rec709
from mirelight.io.frame_texts import PROVENANCE
from mirelight.io.safety import json_object, open_binary, read_file
from mirelight.model import PROFILES

LINEAR = (".exr",)
DISPLAY = (".png", ".jpg", ".jpeg", ".webp")
ENGINE_PICTURES = ("frame.png", "unlit.png")  # of `mirelight realtime`, in a folder for each frame
_MOST_PIXELS = 1 << 27
_EACH = 4 + 4 + 2 * 16  # bytes a pixel: the picture, the same as RGBA, that as numbers, and these as shares
_MAX_META = 1 << 20  # bytes of a meta.json that is read
_BRIGHTEST = 1e9  # stands for infinite light


def read_picture(path: Path, *, premultiplied: bool = False) -> Picture:
    """A picture with what its file says about it.

    Args:
        path: EXR (linear light, premultiplied) or PNG, JPEG, WebP (display values).
        premultiplied: an 8-bit file's colour is already multiplied by its alpha; what `mirelight realtime` wrote is
            known to be, and needs no word.

    Raises:
        InputError: not such a picture, damaged, or larger than 134 million pixels.
    """
    suffix = path.suffix.lower()
    if suffix in LINEAR:
        return _read_exr(existing(path))
    if suffix in DISPLAY:
        return _read_display(existing(path), premultiplied)
    raise InputError(path, f"a file of type {suffix or 'unknown'}", "give EXR, PNG, JPEG or WebP")


def existing(path: Path) -> Path:
    """The path, if there is a file; else an InputError.

    Raises:
        InputError: there is no such file.
    """
    if not path.is_file():
        raise InputError(path, "no such file", "check the path")
    return path


def read_mask(path: Path, size: tuple[int, int]) -> Bool:
    """(H, W) True where the picture is brighter than mid-gray.

    Raises:
        InputError: unreadable, or of another size.
    """
    picture = read_picture(path)
    if picture.size != size:
        found = f"a mask of {picture.size[1]} x {picture.size[0]} pixels for a picture of {size[1]} x {size[0]}"
        raise InputError(path, found, "give one of the same size")
    return np.asarray(picture.rgb.mean(axis=-1) > 0.5)


def _read_display(path: Path, premultiplied: bool) -> Picture:
    with open_binary(path) as stream, opened(stream, path, _MOST_PIXELS, _EACH) as image:
        texts = {str(k): v for k, v in image.info.items() if isinstance(v, str)}
        pixels = np.asarray(image.convert("RGBA"), dtype=np.float32) / np.float32(255)
    settings = _provenance(texts) or _beside(path)
    rgb, alpha = pixels[..., :3], pixels[..., 3]
    if not (premultiplied or _is_back_buffer(path, settings)):
        rgb = rgb * alpha[..., None]
    return Picture(file=path, rgb=rgb, linear=False, alpha=alpha, settings=settings)


def _read_exr(path: Path) -> Picture:
    image = read_exr(path)
    layers = {name: image.layer(name) for name in ("", "lighting", "depth", "noise") if name in image.layers}
    main = layers.get("")
    if main is None or not {"R", "G", "B"} <= set(image.channels):
        raise InputError(path, "an EXR without channels R, G and B", "give a picture")
    rgb = to_rec709(path, image.metadata, np.ascontiguousarray(main[..., :3]))
    alpha = main[..., 3] if "A" in image.channels else np.ones(rgb.shape[:2], dtype=np.float32)
    lighting = layers.get("lighting")
    return Picture(
        file=path,
        rgb=np.nan_to_num(rgb, nan=0.0, posinf=_BRIGHTEST, neginf=0.0),
        linear=True,
        alpha=alpha,
        coverage=lighting[..., 3] if lighting is not None and "lighting.A" in image.channels else None,
        depth=layers["depth"][..., 0] if "depth" in layers else None,
        noise=layers.get("noise"),
        settings=_provenance({k: v for k, v in image.metadata.items() if isinstance(v, str)}),
    )


# --- what a file says about itself -----------------------------------------------------------------------------------


def _provenance(texts: Mapping[str, str]) -> dict[str, Any]:
    """The provenance that mirelight writes into EXR and PNG; empty for other files."""
    return json_object(texts.get(PROVENANCE)) or {}


def _beside(path: Path) -> dict[str, Any]:
    """The settings of a real-time frame: a `meta.json` in its folder that names the engine."""
    meta = path.with_name("meta.json")
    with suppress(OSError, ValueError):
        if meta.is_file() and meta.stat().st_size <= _MAX_META:
            found = json_object(read_file(meta)) or {}
            return found if "engine" in found else {}
    return {}


def _is_back_buffer(path: Path, settings: Mapping[str, Any]) -> bool:
    """True for the engine's own pictures: with `meta.json` beside them, which names the engine."""
    return path.name in ENGINE_PICTURES and "engine" in settings


def blended_in_light(settings: Mapping[str, Any]) -> bool:
    """True where the settings say that splats were blended in linear light, by the engine or as trained."""
    if "engine" in settings:
        return settings.get("pipeline") == "linear"
    compositor = settings.get("settings", {}).get("compositor", {})
    if not isinstance(compositor, dict):
        return False
    if compositor.get("profile") == "physical":
        return compositor.get("color_space") in ("lin_rec709_display", "ACEScct")
    return compositor.get("linear") is True


def shows_engine_colours(picture: Picture) -> bool:
    """True where the picture says that it follows the real-time engine, whose display curve is a 2.2 power."""
    settings = picture.settings
    compositor = settings.get("settings", {}).get("compositor", {})
    profile = compositor.get("profile") if isinstance(compositor, dict) else None
    return "engine" in settings or any(profile == x.name and x.transfer == "power" for x in PROFILES.values())

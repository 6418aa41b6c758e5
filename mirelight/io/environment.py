"""Environment maps as linear radiance: OpenEXR, Radiance HDR, and 8-bit pictures."""

from __future__ import annotations

from pathlib import Path
from typing import NoReturn

import numpy as np

from mirelight.base.errors import InputError, OutputError
from mirelight.io import exr, hdr
from mirelight.io.ldr import decode_srgb_image
from mirelight.io.safety import BRIGHTEST, existing, open_binary
from mirelight.model import F32

_LDR_MAGICS = (b"\x89PNG", b"\xff\xd8\xff", b"RIFF")


def read_environment(path: str | Path) -> F32:
    """An equirectangular map, told apart by content.

    Colours come in linear Rec.709: an EXR file's chromaticities and a Radiance file's PRIMARIES are converted, what has
    none is taken as Rec.709. EXPOSURE lines of Radiance files are not applied, and PNG, JPEG and WebP pictures are sRGB
    decoded. Negative values, of colours that Rec.709 does not hold or left by resampling, become 0. Any aspect is
    taken; 2:1 is the full sphere without distortion.

    Args:
        path: the file.

    Returns:
        (h, w, 3) float32, row 0 the top (+Y).

    Raises:
        InputError: unreadable, of an unknown kind, or with pixels that are NaN, infinite or above 1e12 (their number
            is named).
    """
    path = existing(path)
    with open_binary(path) as stream:
        magic = stream.read(4)
    if magic == exr.MAGIC:
        radiance = _read_exr_rgb(path)
    elif magic.startswith(hdr.MAGIC):
        radiance = hdr.read_hdr(path)
    elif magic.startswith(_LDR_MAGICS):
        with open_binary(path) as stream:
            radiance = decode_srgb_image(stream, path)
    else:
        raise InputError(path, "neither OpenEXR, Radiance HDR, PNG, JPEG nor WebP", "convert it to one of these")
    return _clean(path, radiance)


def write_environment(path: str | Path, radiance: F32) -> None:
    """Write a map as .exr (32-bit float) or .hdr (RGBE), by the suffix.

    Args:
        path: the file to write.
        radiance: (h, w, 3) linear, finite, not negative.

    Raises:
        OutputError: another suffix, or the file cannot be written.
    """
    suffix = Path(path).suffix.lower()
    if suffix == ".exr":
        exr.write_exr(path, {"": radiance}, crop=False)
    elif suffix == ".hdr":
        hdr.write_hdr(path, radiance)
    else:
        raise OutputError(f"{path}: an environment is written as .exr or .hdr")


def _read_exr_rgb(path: Path) -> F32:
    """The picture's own R, G, B; else those of its only colour layer; else its luminance as gray."""
    header = exr.read_header(path)[0]
    if "envmap" in header and "latlong" not in str(header["envmap"]).lower():
        raise InputError(path, "a cube map", "convert it to latitude-longitude", field="envmap")
    if not all(np.array_equal(a, b) for a, b in zip(header["dataWindow"], header["displayWindow"], strict=True)):
        raise InputError(path, "a data window that differs from the display window", "save it uncropped")
    image = exr.read_exr(path)
    coloured = [layer for layer in image.layers if all(_name(layer, c) in image.channels for c in "RGB")]
    if coloured and (coloured[0] == "" or len(coloured) == 1):
        names = [_name(coloured[0], c) for c in "RGB"]
    elif "" in image.layers and "Y" in image.channels and not coloured:
        names = ["Y", "Y", "Y"]
    else:
        found = ", ".join(image.channels)[:200]
        raise InputError(path, f"no R, G and B channels of one picture (it has {found})", "save one RGB layer")
    rgb = np.stack([image.channels[name].astype(np.float32) for name in names], axis=-1)
    return exr.to_rec709(path, image.metadata, rgb)


def _name(layer: str, channel: str) -> str:
    return f"{layer}.{channel}" if layer else channel


def _clean(path: Path, radiance: F32) -> F32:
    if not (radiance.max(initial=0) <= BRIGHTEST and radiance.min(initial=0) > -np.inf):  # false where one is NaN
        _refuse(path, radiance)
    return np.maximum(radiance, np.float32(0), out=radiance)  # of this reader alone; a second one may not fit


def _refuse(path: Path, radiance: F32) -> NoReturn:
    too_bright = np.count_nonzero(radiance > BRIGHTEST) - np.count_nonzero(np.isposinf(radiance))
    if too_bright:
        raise InputError(path, f"{too_bright} values above {BRIGHTEST:g}", "repair the map, e.g. scale or clamp it")
    bad = ~np.isfinite(radiance).all(axis=-1)
    row, column = (int(x[0]) for x in np.nonzero(bad))
    found = f"{np.count_nonzero(bad)} pixels are NaN or infinite, the first in row {row}, column {column}"
    raise InputError(path, found, "repair the map, e.g. clamp it to its largest finite value")

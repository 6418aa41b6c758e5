"""Radiance pictures (.hdr, RGBE), after Ward's "Real Pixels" (Graphics Gems II, 1991) and Radiance's filefmts page.

Old and new run lengths are read, new ones written. Only the orientation "-Y height +X width" is read. EXPOSURE lines
are not applied, as Mitsuba and Blender do not apply them.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import cast

import numpy as np
from numpy.typing import NDArray

from mirelight.base import primaries
from mirelight.base.errors import InputError
from mirelight.base.primaries import Chromaticities
from mirelight.io.atomic import write_file
from mirelight.io.safety import existing, open_binary, read_whole, require_memory
from mirelight.model import F32

Rgbe = NDArray[np.uint8]

MAGIC = b"#?"
_MAX_HEADER = 1 << 16
_MAX_SIDE = 1 << 16  # pixels
_SHORTEST, _LONGEST = 8, 0x7FFF  # scanlines outside are never stored with new run lengths
_EXPONENT_BIAS = 128 + 8  # value = mantissa byte * 2^(exponent byte - 136)


def read_hdr(path: str | Path) -> F32:
    """A Radiance picture as linear RGB in Rec.709; without a PRIMARIES line its colours are taken as that.

    Returns:
        (h, w, 3) float32, row 0 the top.

    Raises:
        InputError: not such a picture, damaged, in XYZ, or of another orientation.
    """
    path = existing(path)
    data = read_whole(path, "its bytes")
    width, height, start, space = _read_header(path, data)
    require_memory(path, width * height * 16, f"{width} x {height} pixels")
    rgb = _decoded(_read_pixels(path, data, start, width, height))
    return rgb if space is None else primaries.converted(rgb, space, primaries.REC709)


def read_hdr_primaries(path: str | Path) -> Chromaticities | None:
    """What the PRIMARIES line says; None where there is none. Raises InputError."""
    path = existing(path)
    with open_binary(path) as stream:
        return _read_header(path, stream.read(_MAX_HEADER))[3]


def write_hdr(path: str | Path, radiance: F32) -> None:
    """Write linear RGB as a Radiance picture: 8 bits of the brightest channel's precision, rounded to nearest.

    Args:
        path: the file to write.
        radiance: (h, w, 3) not negative, finite.

    Raises:
        OutputError: the file cannot be written.
    """
    height, width = radiance.shape[:2]
    rgbe = _encoded(radiance)
    head = f"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y {height} +X {width}\n".encode("ascii")
    if _SHORTEST <= width <= _LONGEST:
        body = b"".join(_compressed(row) for row in rgbe)
    else:
        body = rgbe.tobytes()
    write_file(path, head + body)


def _read_header(path: Path, data: bytes) -> tuple[int, int, int, Chromaticities | None]:
    """Width, height, where the pixels start, and the primaries that are named."""
    end = data.find(b"\n\n", 0, _MAX_HEADER)
    if not data.startswith(MAGIC) or end < 0:
        raise InputError(path, "not a Radiance picture", "check the file")
    lines = data[:end].decode("latin-1").splitlines()
    formats = [line.partition("=")[2].strip() for line in lines if line.startswith("FORMAT=")]
    if formats and formats[-1] != "32-bit_rle_rgbe":
        raise InputError(path, f"pixels in {formats[-1][:40]!r}", "save it as RGB", field="FORMAT")
    stop = data.find(b"\n", end + 2, end + 2 + 256)
    size = data[end + 2 : max(stop, 0)].decode("latin-1")
    match = re.fullmatch(r"-Y (\d{1,9}) \+X (\d{1,9})\s*", size)
    if match is None:
        remedy = "save it upright, rows from top to bottom"
        raise InputError(path, f"a resolution line {size[:40]!r} instead of '-Y height +X width'", remedy)
    height, width = int(match[1]), int(match[2])
    if not (1 <= width <= _MAX_SIDE and 1 <= height <= _MAX_SIDE):
        raise InputError(path, f"{width} x {height} pixels", f"at most {_MAX_SIDE} along each side are read")
    return width, height, stop + 1, _primaries(path, lines)


def _primaries(path: Path, lines: list[str]) -> Chromaticities | None:
    named = [line.partition("=")[2] for line in lines if line.startswith("PRIMARIES=")]
    if not named:
        return None
    try:
        numbers = tuple(float(x) for x in named[-1].split())
    except ValueError:
        numbers = ()
    if not primaries.are_usable(numbers):
        remedy = "give x and y of red, green, blue and white, or leave the line out if it is Rec.709"
        raise InputError(path, f"primaries {named[-1].strip()[:60]!r}", remedy, field="PRIMARIES")
    space = primaries.known(numbers)
    return primaries.PRIMARIES[space] if space is not None else cast(Chromaticities, numbers)


def _read_pixels(path: Path, data: bytes, at: int, width: int, height: int) -> Rgbe:
    """The picture's bytes (h, w, 4), run lengths undone."""
    flat = data[at : at + width * height * 4]
    if len(data) - at == width * height * 4 and not _has_runs(flat, width):
        return np.frombuffer(flat, dtype=np.uint8).reshape(height, width, 4)
    if len(data) - at < height * 4:
        raise InputError(path, f"{len(data) - at} bytes for {height} rows", "the file is truncated")
    rows = []
    for row in range(height):
        try:
            head = data[at : at + 4]
            if _SHORTEST <= width <= _LONGEST and head[:2] == b"\2\2" and head[2] < 128:
                if (head[2] << 8 | head[3]) != width:
                    raise ValueError("a row of another width")
                pixels, at = _new_row(data, at + 4, width)
            else:
                pixels, at = _old_row(data, at, width)
        except (IndexError, ValueError):
            raise InputError(path, f"row {row} of {height} cannot be decoded", "the file is damaged") from None
        rows.append(pixels)
    return np.stack(rows)


def _has_runs(flat: bytes, width: int) -> bool:
    """Whether a block as long as plain pixels holds run lengths after all."""
    pixels = np.frombuffer(flat, dtype=np.uint8).reshape(-1, 4)
    old = bool(np.any(np.all(pixels[:, :3] == 1, axis=1)))
    first = pixels[0]
    return old or (_SHORTEST <= width <= _LONGEST and first[0] == 2 and first[1] == 2 and first[2] < 128)


def _new_row(data: bytes, at: int, width: int) -> tuple[Rgbe, int]:
    """One scanline of four run-length coded components: counts above 128 repeat one byte, others copy bytes."""
    out = bytearray()
    for component in range(4):
        end = (component + 1) * width
        while len(out) < end:
            count = data[at]
            if count > 128:
                out += data[at + 1 : at + 2] * (count - 128)
                at += 2
            elif count:
                out += data[at + 1 : at + 1 + count]
                at += 1 + count
            else:
                raise ValueError("an empty run")
            if at > len(data):
                raise ValueError("past the end")
        if len(out) != end:
            raise ValueError("a run past the end of the row")
    return np.frombuffer(bytes(out), dtype=np.uint8).reshape(4, width).T, at


def _old_row(data: bytes, at: int, width: int) -> tuple[Rgbe, int]:
    """One scanline of pixels, where (1, 1, 1, n) repeats the last pixel; consecutive counts are digits to base 256."""
    out = bytearray()
    shift = 0
    while len(out) < width * 4:
        pixel = data[at : at + 4]
        if len(pixel) < 4:
            raise ValueError("past the end")
        if pixel[:3] == b"\1\1\1":
            count = pixel[3] << shift
            if not out or len(out) // 4 + count > width:
                raise ValueError("a run past the end of the row")
            out += out[-4:] * count
            shift += 8
        else:
            out += pixel
            shift = 0
        at += 4
    return np.frombuffer(bytes(out), dtype=np.uint8).reshape(width, 4), at


def _decoded(rgbe: Rgbe) -> F32:
    scale = np.ldexp(np.float32(1), rgbe[..., 3].astype(np.int32) - _EXPONENT_BIAS)
    scale[rgbe[..., 3] == 0] = 0
    return np.asarray(rgbe[..., :3].astype(np.float32) * scale[..., None], dtype=np.float32)


def _encoded(radiance: F32) -> Rgbe:
    """(h, w, 4) bytes; a mantissa that would round up to 256 takes the next exponent."""
    values = np.asarray(radiance, dtype=np.float64)
    brightest = values.max(axis=-1)
    _, exponent = np.frexp(brightest)
    exponent += np.rint(np.ldexp(brightest, 8 - exponent)) > 255
    mantissa = np.rint(np.ldexp(values, (8 - exponent)[..., None]))
    out = np.concatenate([mantissa, (exponent + 128)[..., None]], axis=-1)
    out[(brightest <= 0) | (exponent + 128 < 1)] = 0
    return np.asarray(np.clip(out, 0, 255), dtype=np.uint8)


def _compressed(row: Rgbe) -> bytes:
    """One scanline with new run lengths; runs of four bytes and more are worth coding."""
    width = len(row)
    out = bytearray((2, 2, width >> 8, width & 255))
    for component in row.T:
        edges = np.flatnonzero(np.diff(component)) + 1
        starts, stops = np.concatenate([[0], edges]), np.concatenate([edges, [width]])
        plain = 0  # where bytes not yet written begin
        for start, stop in zip(starts.tolist(), stops.tolist(), strict=True):
            if stop - start >= 4:
                _put_plain(out, component[plain:start].tobytes())
                for at in range(start, stop, 127):
                    out += bytes((128 + min(127, stop - at), int(component[start])))
                plain = stop
        _put_plain(out, component[plain:].tobytes())
    return bytes(out)


def _put_plain(out: bytearray, data: bytes) -> None:
    for at in range(0, len(data), 128):
        part = data[at : at + 128]
        out += bytes((len(part),)) + part

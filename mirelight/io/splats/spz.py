"""SPZ (Niantic), versions 1 to 4: 8-bit attributes and fixed-point positions.

The specification stores axes right-up-back; PLY's are right-down-front. Files are read into PLY's axes, so that one
capture is the same cloud through either format, as splat-transform and Niantic's own spz_to_ply do. Adobe's extension
that names other axes is honoured. Facts from the format's README and reference code (github.com/nianticlabs/spz).
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mirelight.base.errors import InputError
from mirelight.io.atomic import atomic_path
from mirelight.io.safety import open_binary, require_memory
from mirelight.io.splats import values
from mirelight.io.splats.builder import ROWS, CloudBuilder, Slot, cloud_bytes
from mirelight.io.splats.info import SplatFileInfo
from mirelight.io.splats.spz_stream import ANTIALIASED, MAGIC, RIGHT_UP_BACK, SpzHead, SpzStream
from mirelight.model import F32, SplatCloud

_COLOR_SCALE = 0.15  # of the stored degree-0 coefficient

# Axis signs that turn stored values into PLY's right-down-front, by the extension's number of the stored system.
_TO_PLY = {
    1: (-1, 1, -1),  # left down back
    2: (1, 1, -1),  # right down back
    3: (-1, -1, -1),  # left up back
    4: (1, -1, -1),  # right up back, the default
    5: (-1, 1, 1),  # left down front
    6: (1, 1, 1),  # right down front
    7: (-1, -1, 1),  # left up front
    8: (1, -1, 1),  # right up front
}


def summary(path: Path) -> SplatFileInfo:
    """The head of an SPZ file. Raises InputError."""
    with open_binary(path) as file:
        head = SpzStream(path, file).head
    return SplatFileInfo(
        path=path,
        format=f"SPZ v{head.version}",
        count=head.count,
        sh_degree=min(head.degree, 3),
        antialiased=bool(head.flags & ANTIALIASED),
        notes=("SH of degree 4 is left out",) if head.degree > 3 else (),
    )


def read(path: Path) -> SplatCloud:
    """The splats of an SPZ file, turned into PLY's axes. Raises InputError."""
    with open_binary(path) as file:
        stream = SpzStream(path, file)
        head = stream.head
        need = sum(head.sizes.values()) + cloud_bytes(head.count, 1 + head.kept)
        require_memory(path, need, f"{head.count:,} splats")
        stored, system = stream.attributes()
    if system not in _TO_PLY:
        found = f"axes of kind {system} (SPZ_ADOBE_coordinate_system)"
        raise InputError(path, found, "save it again in right-up-back axes")
    builder = CloudBuilder(path, head.count, 1 + head.kept)
    flips = values.axis_flips(_TO_PLY[system], min(head.degree, 3))
    for first in range(0, head.count, ROWS):
        count = min(ROWS, head.count - first)
        slot = builder.slot(count)
        rows = {name: data.reshape(head.count, -1)[first : first + count] for name, data in stored.items()}
        _decode(head, rows, slot)
        for array, flip in zip((slot.means, slot.quats, slot.sh), flips, strict=True):
            array *= flip
        builder.commit(slot)
    return builder.cloud(antialiased=bool(head.flags & ANTIALIASED))


def write(cloud: SplatCloud, path: Path) -> None:
    """Write SPZ version 3 (gzip), which every SPZ reader since 2025 knows.

    Positions keep 2^-12 of a unit, fewer bits where the cloud is wider than ±2048 units; SH keeps 5 bits in degree 1
    and 4 above, as the reference encoder's defaults.

    Raises:
        OutputError: it cannot be written.
        ValueError: positions that 24 bits cannot hold (beyond ±8 million units).
    """
    reach = float(np.abs(cloud.means).max())
    bits = min(12, 22 - int(np.floor(np.log2(max(reach, 1)))))
    if bits < 0:
        raise ValueError(f"positions reach {reach:.3g}; SPZ holds ±8 million units")
    flips = values.axis_flips(_TO_PLY[RIGHT_UP_BACK], cloud.sh_degree)
    flags = ANTIALIASED if cloud.antialiased else 0
    blocks = [slice(first, first + ROWS) for first in range(0, len(cloud), ROWS)]
    encoders: tuple[Callable[[slice], bytes], ...] = (
        lambda rows: _encode_positions(cloud.means[rows] * flips.means, bits),
        lambda rows: _byte(cloud.opacities[rows] * 255),
        lambda rows: _byte(cloud.sh[rows, 0] * (_COLOR_SCALE * 255) + 127.5),
        lambda rows: _byte((values.log_scale(cloud.scales[rows]) + 10) * 16),
        lambda rows: _encode_rotations(cloud.quats[rows] * flips.quats),
        lambda rows: _encode_sh(cloud.sh[rows, 1:] * flips.sh[1:]),
    )
    packer = zlib.compressobj(wbits=31)  # no name, no time: the same cloud gives the same bytes
    with atomic_path(path) as temporary, temporary.open("wb") as file:
        head = struct.pack("<4sIIBBBB", MAGIC, 3, len(cloud), cloud.sh_degree, bits, flags, 0)
        file.write(packer.compress(head))
        for encode in encoders:
            for rows in blocks:
                file.write(packer.compress(encode(rows)))
        file.write(packer.flush())


def _decode(head: SpzHead, rows: dict[str, NDArray[np.uint8]], slot: Slot) -> None:
    n = len(slot.means)
    slot.means[:] = _positions(head, rows["positions"])
    slot.opacities[:] = rows["alphas"][:, 0] / np.float32(255)
    slot.sh[:, 0] = (rows["colors"] / np.float32(255) - 0.5) / _COLOR_SCALE
    values.exponential(rows["scales"] / np.float32(16) - 10, out=slot.scales)
    xyzw = np.empty((n, 4), dtype=np.float32)
    if head.version >= 3:
        word = np.ascontiguousarray(rows["rotations"]).view("<u4")[:, 0]
        fields = np.stack([word >> s & 1023 for s in (20, 10, 0)], axis=1)
        magnitude = (fields & 511).astype(np.float32) / (511 * values.SQRT2)
        values.complete_quaternions(np.where(fields & 512, -magnitude, magnitude), word >> 30, out=xyzw)
    else:
        three = rows["rotations"] / np.float32(127.5) - 1
        values.complete_quaternions(three, np.full(n, 3), out=xyzw)
    slot.quats[:] = np.roll(xyzw, 1, axis=1)
    if head.kept:
        coefficients = rows["sh"].reshape(n, -1, 3)[:, : head.kept]
        slot.sh[:, 1:] = coefficients / np.float32(128) - 1


def _positions(head: SpzHead, raw: NDArray[np.uint8]) -> NDArray[np.float32]:
    """(n, 3): half floats in version 1, signed 24-bit fixed point after."""
    if head.version == 1:
        return np.ascontiguousarray(raw).view("<f2").astype(np.float32)
    padded = np.zeros((len(raw), 3, 4), dtype=np.uint8)
    padded[:, :, 1:] = raw.reshape(-1, 3, 3)  # in the upper bytes, so that the sign is the word's
    fixed = padded.view("<i4")[:, :, 0] >> 8
    return (fixed * 2.0**-head.fraction_bits).astype(np.float32)


def _byte(x: NDArray[np.floating]) -> bytes:
    """Rounded to nearest and clamped to 0..255."""
    return np.clip(np.round(x), 0, 255).astype(np.uint8).tobytes()


def _encode_positions(means: F32, bits: int) -> bytes:
    """Positions as signed numbers of 24 bits with a fixed point."""
    fixed = np.clip(np.round(means.astype(np.float64) * 2**bits), 1 - 2**23, 2**23 - 1).astype("<i4")
    return bytes(fixed[..., None].view(np.uint8)[..., :3].tobytes())


def _encode_rotations(quats: F32) -> bytes:
    """2 bits for the largest component of xyzw, a sign and 9 bits for each other."""
    three, largest = values.three_smallest(np.roll(quats, -1, axis=1))
    magnitude = np.floor(np.abs(three) * (511 * values.SQRT2) + 0.5).astype(np.uint32)
    fields = magnitude | (three < 0).astype(np.uint32) << 9
    words = largest.astype(np.uint32) << 30 | fields[:, 0] << 20 | fields[:, 1] << 10 | fields[:, 2]
    return words.astype("<u4").tobytes()


def _encode_sh(rest: F32) -> bytes:
    """Steps of 1/128 around 128, rounded to the middle of wider buckets so that the file packs better."""
    width = np.full((1, rest.shape[1], 1), 1 << (8 - 4))
    width[:, :3] = 1 << (8 - 5)
    return _byte((np.round(rest * 128) + 128 + width // 2) // width * width)

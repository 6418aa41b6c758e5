"""PlayCanvas' compressed PLY: 16 bytes a splat, quantised inside the bounds of each chunk of 256, SH in 8 bits.

Bit layout as splat-transform writes it: position and scale 11-10-11 bits, colour and opacity 4 x 8, rotation 2 bits for
the largest component (wxyz) and 10 for each other. Scales are logarithmic inside the bounds; opacity is not a logit.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mirelight.base.sh import degree_of
from mirelight.io.atomic import atomic_path
from mirelight.io.splats import values
from mirelight.io.splats.builder import ROWS, CloudBuilder, Slot
from mirelight.io.splats.info import SplatFileInfo
from mirelight.io.splats.ply_header import Element, PlyHeader, blocks, comment_lines, read_ply_header
from mirelight.model import F32, SplatCloud

CHUNK = 256  # splats that share bounds

_BOUNDS = [f"{side}_{axis}" for side in ("min", "max") for axis in "xyz"]
_SCALE_BOUNDS = [f"{side}_scale_{axis}" for side in ("min", "max") for axis in "xyz"]
_COLOR_BOUNDS = [f"{side}_{channel}" for side in ("min", "max") for channel in "rgb"]
_PACKED = ["packed_position", "packed_rotation", "packed_scale", "packed_color"]

# SH bytes are buckets of 1/256 over -4..4, taken at their centres; the end buckets reach the ends.
_SH_VALUES = ((np.concatenate([[0], np.arange(1, 255) + 0.5, [256]]) / 256 - 0.5) * 8).astype(np.float32)


def is_compressed(header: PlyHeader) -> bool:
    """True where the PLY has PlayCanvas' chunks."""
    vertex = header.elements.get("vertex")
    return "chunk" in header.elements and vertex is not None and "packed_position" in vertex.names


def summary(path: Path) -> SplatFileInfo:
    """The head of a compressed PLY file. Raises InputError."""
    header = read_ply_header(path)
    vertex = _checked(header)
    return SplatFileInfo(
        path=path,
        format="compressed PLY",
        count=vertex.count,
        sh_degree=degree_of(1 + _rest_per_channel(header)),
        antialiased=header.antialiased,
    )


def read(path: Path) -> SplatCloud:
    """The splats of a compressed PLY file, in the file's own axes. Raises InputError."""
    header = read_ply_header(path)
    vertex = _checked(header)
    rest = _rest_per_channel(header)
    builder = CloudBuilder(path, vertex.count, 1 + rest)
    chunks = header.elements["chunk"]
    sh_blocks = blocks(path, header.elements["sh"], ROWS) if rest else None
    for bounds, packed in zip(
        blocks(path, chunks, ROWS // CHUNK), blocks(path, vertex, ROWS), strict=True
    ):  # both end together: there is a chunk for every 256 splats
        slot = builder.slot(len(packed))
        _unpack(packed, bounds, slot)
        if sh_blocks is not None:
            codes = next(sh_blocks)
            bytes_ = np.stack([codes[f"f_rest_{i}"] for i in range(3 * rest)], axis=1).reshape(-1, 3, rest)
            slot.sh[:, 1:] = _SH_VALUES[bytes_].transpose(0, 2, 1)
        builder.commit(slot)
    return builder.cloud(antialiased=header.antialiased)


def chunk_bounds(path: Path) -> tuple[F32, F32, F32]:
    """Of each chunk, (C, 3) each: lowest corner, highest corner, largest logarithmic scales. Raises InputError."""
    header = read_ply_header(path)
    _checked(header)
    chunks = header.elements["chunk"]
    found = [
        np.stack([table[name] for name in (*_BOUNDS, *_SCALE_BOUNDS[3:])], axis=1).astype(np.float32)
        for table in blocks(path, chunks, ROWS // CHUNK)
    ]
    low, high, scale = np.split(np.concatenate(found), 3, axis=1)
    return low, high, scale


def write(cloud: SplatCloud, path: Path, comments: Sequence[str] = ()) -> None:
    """Write a compressed PLY file; splats come out in Morton order, so that a chunk is a small box.

    Raises:
        OutputError: it cannot be written.
    """
    k = cloud.sh.shape[1]
    order = morton_order(cloud.means)
    count, chunks = len(order), -(-len(order) // CHUNK)
    order = np.concatenate([order, np.full(chunks * CHUNK - count, order[-1])])
    comment = ["comment SplatRenderMode: mip"] if cloud.antialiased else []
    comment += comment_lines(comments)
    lines = ["ply", "format binary_little_endian 1.0", *comment, f"element chunk {chunks}"]
    lines += [f"property float {name}" for name in _BOUNDS + _SCALE_BOUNDS + _COLOR_BOUNDS]
    lines += [f"element vertex {count}"] + [f"property uint {name}" for name in _PACKED]
    if k > 1:
        lines += [f"element sh {count}"] + [f"property uchar f_rest_{i}" for i in range(3 * (k - 1))]
    with atomic_path(path) as temporary, temporary.open("wb") as file:
        file.write("\n".join([*lines, "end_header", ""]).encode("ascii"))
        packed = [_pack(cloud, rows) for rows in np.split(order, range(ROWS, len(order), ROWS))]
        file.write(np.concatenate([bounds for bounds, _ in packed]).astype("<f4").tobytes())
        file.write(np.concatenate([words for _, words in packed])[:count].astype("<u4").tobytes())
        if k > 1:
            for rows in np.split(order[:count], range(ROWS, count, ROWS)):
                codes = np.clip(np.floor((cloud.sh[rows, 1:] / 8 + 0.5) * 256), 0, 255).astype(np.uint8)
                file.write(codes.transpose(0, 2, 1).tobytes())


def morton_order(means: F32) -> NDArray[np.intp]:
    """(N,) indices that put positions (N, 3) along a Z-order curve of 2^21 cells an axis."""
    low = means.min(axis=0).astype(np.float64)
    extent = np.maximum(means.max(axis=0) - low, 1e-30)
    code = np.zeros(len(means), dtype=np.uint64)
    for axis in range(3):
        cell = ((means[:, axis] - low[axis]) / extent[axis] * (2**21 - 1)).astype(np.uint64)
        code |= _spread(cell) << np.uint64(axis)
    return np.argsort(code, kind="stable")


def _spread(x: NDArray[np.uint64]) -> NDArray[np.uint64]:
    """Two zero bits between the low 21 bits of each number."""
    for shift, mask in (
        (32, 0x1F00000000FFFF),
        (16, 0x1F0000FF0000FF),
        (8, 0x100F00F00F00F00F),
        (4, 0x10C30C30C30C30C3),
        (2, 0x1249249249249249),
    ):
        x = (x | (x << np.uint64(shift))) & np.uint64(mask)
    return x


def _checked(header: PlyHeader) -> Element:
    vertex, chunk = header.elements["vertex"], header.elements["chunk"]
    plain = np.dtype("<f4"), np.dtype("<u4")
    for element, names, kind in ((chunk, _BOUNDS + _SCALE_BOUNDS, plain[0]), (vertex, _PACKED, plain[1])):
        for name in names:
            if name not in element.names or element.dtype[name] != kind:
                raise header.fail(f"no property {name!r} of type {kind} in {element.name!r}", "the file is damaged")
    colours = [name in chunk.names and chunk.dtype[name] == plain[0] for name in _COLOR_BOUNDS]
    if any(colours) != all(colours):
        raise header.fail("colour bounds are incomplete", "the file is damaged")
    if chunk.count != -(-vertex.count // CHUNK):
        raise header.fail(f"{chunk.count:,} chunks for {vertex.count:,} splats", "the file is damaged")
    return vertex


def _rest_per_channel(header: PlyHeader) -> int:
    """SH coefficients above degree 0 for each channel."""
    sh = header.elements.get("sh")
    if sh is None:
        return 0
    count = len(sh.names)
    named = all(f"f_rest_{i}" in sh.names and sh.dtype[f"f_rest_{i}"] == np.uint8 for i in range(count))
    if count not in (9, 24, 45) or not named or sh.count != header.elements["vertex"].count:
        raise header.fail(f"element 'sh' with {count} properties, {sh.count:,} rows", "the file is damaged")
    return count // 3


def _unpack(packed: NDArray[Any], bounds: NDArray[Any], slot: Slot) -> None:
    """Decode one block of splats and the bounds of its chunks."""
    n = len(packed)

    def within(names: list[str], t: F32) -> F32:
        """Interpolate t in 0..1 between the chunk's lower and upper bounds."""
        if names[0] not in (bounds.dtype.names or ()):
            return t
        table = np.stack([bounds[name] for name in names], axis=1).repeat(CHUNK, axis=0)[:n]
        with np.errstate(over="ignore", invalid="ignore"):
            return np.asarray(table[:, :3] * (1 - t) + table[:, 3:] * t, dtype=np.float32)

    slot.means[:] = within(_BOUNDS, _unpack_11_10_11(packed["packed_position"]))
    values.exponential(within(_SCALE_BOUNDS, _unpack_11_10_11(packed["packed_scale"])), out=slot.scales)
    bytes_ = np.stack([packed["packed_color"] >> s & 255 for s in (24, 16, 8, 0)], axis=1)
    rgba = bytes_.astype(np.float32) / np.float32(255)
    slot.sh[:, 0] = values.dc_from_rgb(within(_COLOR_BOUNDS, rgba[:, :3]))
    slot.opacities[:] = rgba[:, 3]
    rotation = packed["packed_rotation"]
    three = np.stack([rotation >> s & 1023 for s in (20, 10, 0)], axis=1).astype(np.float32) / 1023 - 0.5
    values.complete_quaternions(three * values.SQRT2, rotation >> 30, out=slot.quats)


def _unpack_11_10_11(words: NDArray[np.uint32]) -> F32:
    parts = [(words >> 21) / 2047, (words >> 11 & 1023) / 1023, (words & 2047) / 2047]
    return np.stack(parts, axis=1).astype(np.float32)


def _pack(cloud: SplatCloud, rows: NDArray[np.intp]) -> tuple[F32, NDArray[np.uint32]]:
    """Bounds (chunks, 18) and words (n, 4) of some splats, a whole number of chunks."""
    # Bounds on log scales keep a flat axis from stretching its whole chunk (splat-transform uses the same ±20).
    log_scales = np.clip(values.log_scale(cloud.scales[rows]), -20, 20)
    rgb = values.rgb_from_dc(cloud.sh[rows, 0])
    bounds, codes = [], []
    for value in (cloud.means[rows], log_scales, rgb):
        blocks_ = value.reshape(-1, CHUNK, 3)
        low, high = blocks_.min(axis=1), blocks_.max(axis=1)
        span = np.where(high > low, high - low, 1)
        bounds += [low, high]
        codes.append(((blocks_ - low[:, None]) / span[:, None]).reshape(-1, 3))
    three, largest = values.three_smallest(cloud.quats[rows])
    rotation = largest.astype(np.uint32) << 30
    for i, shift in enumerate((20, 10, 0)):
        rotation |= _unorm(three[:, i] / values.SQRT2 + 0.5, 10) << shift
    position, scale = (_pack_11_10_11(code) for code in codes[:2])
    colour = _unorm(cloud.opacities[rows], 8)
    for i, shift in enumerate((24, 16, 8)):
        colour |= _unorm(codes[2][:, i], 8) << shift
    words = np.stack([position, rotation, scale, colour], axis=1)
    return np.concatenate(bounds, axis=1).astype(np.float32), words


def _pack_11_10_11(t: NDArray[Any]) -> NDArray[np.uint32]:
    x, y, z = (_unorm(t[:, i], bits) for i, bits in enumerate((11, 10, 11)))
    return np.asarray(x << 21 | y << 11 | z, dtype=np.uint32)


def _unorm(t: NDArray[Any], bits: int) -> NDArray[np.uint32]:
    """0..1 as an unsigned integer of so many bits, rounded."""
    top = (1 << bits) - 1
    return np.clip(np.floor(t * top + 0.5), 0, top).astype(np.uint32)

"""Writes SOG version 2: attributes quantised into lossless images, all in one ZIP file (.sog).

Every splat has 8 bits in a codebook of 256 for each of its scales and colours, found so that squared errors are small
(Lloyd 1982, on sorted values), and an entry of a palette for its SH above degree 0: the means of cells that come from
halving the splats at the median of the coefficient that differs most, again and again (Heckbert 1982, "Color image
quantization for frame buffer display", in up to 45 dimensions). Format: developer.playcanvas.com, "The SOG Format".
"""

from __future__ import annotations

import json
import zipfile
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mirelight.base.errors import OutputError
from mirelight.base.version import __version__
from mirelight.io.atomic import atomic_path
from mirelight.io.splats import values
from mirelight.io.splats.compressed_ply import morton_order
from mirelight.model import F32, F64, SplatCloud

MOST = 16383**2  # pixels of a WebP image
_LEVELS = 16  # halvings: 65536 entries, the most that a palette may have
_ROW = 64  # palette entries side by side
_ROUNDS = 30  # of Lloyd's algorithm
_LONG_AGO = (1980, 1, 1, 0, 0, 0)  # no time: the same cloud gives the same bytes

Bytes = NDArray[np.uint8]


def write(cloud: SplatCloud, path: Path) -> None:
    """Write a bundled SOG, in Morton order.

    Raises:
        OutputError: it cannot be written.
        ValueError: no splats, which the format cannot hold.
    """
    if not len(cloud):
        raise ValueError("no splats; SOG holds at least one")
    if len(cloud) > MOST:
        raise OutputError(f"{path}: {len(cloud):,} splats; SOG holds {MOST:,}; nothing was written")
    order = morton_order(cloud.means)
    meta: dict[str, Any] = {
        "version": 2,
        "asset": {"generator": f"mirelight {__version__}"},
        "count": len(cloud),
        "antialias": cloud.antialiased,
    }
    images: dict[str, Bytes] = {}  # (h, w, 4)
    meta["means"] = _means(cloud.means[order], images)
    book, codes = _coded(values.log_scale(cloud.scales[order]))
    images["scales.webp"] = _square(codes, 255)
    meta["scales"] = {"codebook": book, "files": ["scales.webp"]}
    images["quats.webp"] = _quats(cloud.quats[order])
    meta["quats"] = {"files": ["quats.webp"]}
    book, codes = _coded(cloud.sh[order, 0])
    opacity = np.round(np.clip(cloud.opacities[order], 0, 1) * 255).astype(np.uint8)
    images["sh0.webp"] = _square(codes, opacity)
    meta["sh0"] = {"codebook": book, "files": ["sh0.webp"]}
    if cloud.sh_degree:
        meta["shN"] = _rest(cloud.sh[order, 1:], cloud.sh_degree, images)
    with (
        atomic_path(path) as temporary,
        temporary.open("wb") as stream,
        zipfile.ZipFile(stream, "w", zipfile.ZIP_STORED) as archive,
    ):
        archive.writestr(zipfile.ZipInfo("meta.json", _LONG_AGO), json.dumps(meta, allow_nan=False))
        for name, image in images.items():
            archive.writestr(zipfile.ZipInfo(name, _LONG_AGO), _webp(image))


def _means(means: F32, images: dict[str, Bytes]) -> dict[str, Any]:
    """16 bits of sign(x) ln(1 + |x|) between bounds, in two images."""
    logs = np.copysign(np.log1p(np.abs(means.astype(np.float64))), means)
    low, high = logs.min(axis=0), logs.max(axis=0)
    share = (logs - low) / np.where(high > low, high - low, 1)
    steps = np.round(share * 65535).astype(np.uint16)
    images["means_l.webp"] = _square((steps & 255).astype(np.uint8), 255)
    images["means_u.webp"] = _square((steps >> 8).astype(np.uint8), 255)
    return {"mins": low.tolist(), "maxs": high.tolist(), "files": ["means_l.webp", "means_u.webp"]}


def _quats(quats: F32) -> Bytes:
    """The three smaller components in 8 bits each, and which one is left out."""
    three, largest = values.three_smallest(quats)
    steps = np.clip(np.round((three * values.SQRT2 + 1) / 2 * 255), 0, 255)
    return _square(steps.astype(np.uint8), (252 + largest).astype(np.uint8))


def _rest(sh: F32, degree: int, images: dict[str, Bytes]) -> dict[str, Any]:
    """SH above degree 0 (N, K, 3) as a palette of up to 65536 entries."""
    count, coefficients = sh.shape[:2]
    label, entries = _palette(sh.reshape(count, -1))
    book, codes = _coded(entries)
    rows = -(-len(entries) // _ROW)
    padded = np.zeros((rows * _ROW, coefficients, 3), np.uint8)
    padded[: len(entries)] = codes.reshape(-1, coefficients, 3)
    image = np.full((rows, _ROW * coefficients, 4), 255, np.uint8)
    image[..., :3] = padded.reshape(rows, _ROW * coefficients, 3)
    images["shN_centroids.webp"] = image
    pairs = np.stack([label & 255, label >> 8, np.zeros_like(label)], axis=1).astype(np.uint8)
    images["shN_labels.webp"] = _square(pairs, 255)
    files = ["shN_centroids.webp", "shN_labels.webp"]
    return {"count": len(entries), "bands": degree, "codebook": book, "files": files}


# --- quantising ------------------------------------------------------------------------------------------------------


def _coded(numbers: F32 | F64) -> tuple[list[float], Bytes]:
    """A codebook of 256 numbers, and for each number the nearest of them."""
    book = codebook(numbers)
    between = (book[1:] + book[:-1]) / 2
    return book.tolist(), np.searchsorted(between, numbers).astype(np.uint8)


def codebook(numbers: F32 | F64) -> F64:
    """(256,) ascending, near the least sum of squared errors for these numbers."""
    ordered = np.sort(numbers.astype(np.float64), axis=None)
    sums = np.concatenate([[0.0], np.cumsum(ordered)])
    # half of it where numbers are many, half evenly, so that the few far out are not left behind
    many = ordered[(np.arange(128) * 2 + 1) * len(ordered) // 256]
    book = np.sort(np.concatenate([many, np.linspace(ordered[0], ordered[-1], 128)]))
    for _ in range(_ROUNDS):
        ends = np.concatenate([[0], np.searchsorted(ordered, (book[1:] + book[:-1]) / 2), [len(ordered)]])
        count = np.diff(ends)
        book = np.where(count > 0, np.diff(sums[ends]) / np.maximum(count, 1), book)
        book = np.maximum.accumulate(book)
    return book


def _palette(rows: F32) -> tuple[NDArray[np.int64], F64]:
    """(N,) labels and (P, C) entries for rows (N, C): P = 65536, or N where there are fewer."""
    count = len(rows)
    levels = min(_LEVELS, int(np.ceil(np.log2(count)))) if count > 1 else 0
    order = np.arange(count)
    for level in range(levels):
        first = _firsts(count, level)
        node = np.repeat(np.arange(len(first)), np.diff([*first, count]))
        most, axis = np.full(len(first), -1.0), np.zeros(len(first), np.int64)
        size = np.maximum(np.diff([*first, count]), 1)
        for column in range(rows.shape[1]):  # a column at a time, for the memory of large clouds
            x = rows[order, column].astype(np.float64)
            mean = np.add.reduceat(x, first) / size
            spread = np.add.reduceat((x - mean[node]) ** 2, first)
            axis[spread > most] = column
            most = np.maximum(most, spread)
        order = order[np.lexsort((rows[order, axis[node]], node))]
    first = _firsts(count, levels)
    size = np.diff([*first, count])
    label = np.empty(count, np.int64)
    label[order] = np.repeat(np.arange(len(first)), size)
    entries = np.stack([np.add.reduceat(rows[order, c].astype(np.float64), first) / size for c in range(rows.shape[1])])
    return label, entries.T


def _firsts(count: int, level: int) -> NDArray[np.int64]:
    """Where the parts begin after so many halvings; none is empty."""
    return np.unique(count * np.arange(1 << level, dtype=np.int64) >> level)


# --- images ----------------------------------------------------------------------------------------------------------


def _square(rgb: Bytes, alpha: Bytes | int) -> Bytes:
    """(h, w, 4) of N pixels, as square as multiples of four allow; zeros behind the last."""
    count = len(rgb)
    width = -(-int(np.ceil(np.sqrt(count))) // 4) * 4
    height = -(-count // width // 4) * 4 if count > width * 4 else 4
    height = max(height, -(-count // width))
    height = -(-height // 4) * 4
    image = np.zeros((height * width, 4), np.uint8)
    image[:count, :3], image[:count, 3] = rgb, alpha
    return image.reshape(height, width, 4)


def _webp(image: Bytes) -> bytes:
    """Lossless, colours of transparent pixels included."""
    from PIL import Image

    stream = BytesIO()
    Image.fromarray(image, "RGBA").save(stream, "WEBP", lossless=True, exact=True, quality=75, method=4)
    return stream.getvalue()

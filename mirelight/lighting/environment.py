"""How an environment map is importance sampled. NumPy only.

Light samples are drawn in proportion to the radiance above its mean over the sphere: what lies below is left to the
reflected ray, and multiple importance sampling joins both (Karlík et al., "MIS Compensation", SIGGRAPH Asia 2019).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from mirelight.model import F32

SLOTS = 1 << 19  # a draw picks one of so many equal shares of the light; a cell's probability is a whole number of them
MAX_CELLS = 1 << 20  # larger maps share a cell between pixels


@dataclass(frozen=True, slots=True, eq=False)
class Distribution:
    """Where light samples of a map go: a grid of cells over it.

    Slots follow a Hilbert curve, so that numbers near each other choose directions near each other, and stratified
    numbers choose stratified directions.
    """

    slots: NDArray[np.uint32]  # (SLOTS,) row << 16 | column of a cell; (2,) zeros where nothing is to be sampled
    density: F32  # (rows, columns) probability of a cell times the number of cells: density over the unit square


def pixels_per_cell(height: int, width: int) -> int:
    """Pixels along a cell's side for a map of that size."""
    block = 1
    while -(-height // block) * -(-width // block) > MAX_CELLS or max(height, width) // block > 65535:
        block += 1
    return block


def distribution(brightness: F32) -> Distribution:
    """The distribution for cells of that mean brightness, (rows, columns). An even map is left to reflection alone."""
    rows, columns = brightness.shape
    blurred, share = _blur(brightness), _solid_angles(rows)
    everywhere = float(np.sum(blurred * share, dtype=np.float64))
    above = np.maximum(blurred - np.float32(everywhere / columns), np.float32(0)) * share
    order = _hilbert_order(rows, columns)
    ends = np.cumsum(above.ravel()[order], dtype=np.float64)
    if not ends[-1] > 1e-6 * everywhere:
        return Distribution(np.zeros(2, np.uint32), np.zeros((2, 2), np.float32))
    ends *= SLOTS / ends[-1]
    whole = np.rint(ends).astype(np.int32)
    counts = np.append(whole[:1], whole[1:] - whole[:-1])
    density = np.empty(rows * columns, np.float32)
    density[order] = counts * np.float32(rows * columns / SLOTS)
    chosen = np.flatnonzero(counts)
    cells = order[chosen]
    codes = (cells // columns << 16 | cells % columns).astype(np.uint32)
    return Distribution(np.repeat(codes, counts[chosen]), density.reshape(rows, columns))


def _blur(weights: F32) -> F32:
    """Mean of the bilinear interpolation over each pixel: [1 6 1] / 8 along both axes, columns wrap, rows do not."""
    rows = np.pad(weights, ((1, 1), (0, 0)), mode="edge")
    out: F32 = np.float32(6) * rows[1:-1]
    out += rows[:-2]
    out += rows[2:]
    columns = np.pad(out, ((0, 0), (1, 1)), mode="wrap")
    out *= np.float32(6)
    out += columns[:, :-2]
    out += columns[:, 2:]
    out /= np.float32(64)
    return out


def _solid_angles(rows: int) -> F32:
    """Share of the sphere of each row of cells, (rows, 1), adding to 1."""
    edges = np.cos(np.pi * np.arange(rows + 1) / rows)
    return ((edges[:-1] - edges[1:])[:, None] / 2).astype(np.float32)


@lru_cache(maxsize=4)
def _hilbert_order(rows: int, columns: int) -> NDArray[np.int32]:
    """(rows * columns,) flat cells along Hilbert curves through squares side by side, what lies outside left out."""
    side = 1 << max(rows - 1, 0).bit_length()
    x, y = np.zeros(1, np.int32), np.zeros(1, np.int32)
    while (n := 1 << (len(x).bit_length() // 2)) < side:  # four copies, the outer two mirrored at a diagonal
        x, y = np.concatenate([y, x, x + n, 2 * n - 1 - y]), np.concatenate([x, y + n, y + n, n - 1 - x])
    squares = -(-columns // side)
    across = (np.arange(squares, dtype=np.int32)[:, None] * side + x).ravel()
    down = np.tile(y, squares)
    inside = (across < columns) & (down < rows)
    return down[inside] * np.int32(columns) + across[inside]

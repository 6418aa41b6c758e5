"""Which splats meet which tile: exact ellipse ranges, one item per splat and tile row, then one stable sort."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mirelight.compositor.device import Array, Device
from mirelight.compositor.order import counting_permutation
from mirelight.compositor.record import HALF_HEIGHT, REACH, RECORD, S11, S12, S22, SLACK, TURN, VALUE_ROW, X, Y
from mirelight.model import F32

ITEM_BYTES = 24  # per splat and tile row while binning
PAIR_BYTES = 32  # per splat and tile while sorting
MOST_TILES = 1 << 18  # of a band: the sort's histogram has one counter a tile and should stay in the cache
MOST_ELEMENTS = 1 << 30  # indices have 32 bits


@dataclass(frozen=True, slots=True, eq=False)
class Band:
    """Rows of tiles that are blended together. All scalars are opaque."""

    columns: int  # tiles across the image
    rows: int  # tile rows in the band
    first_row: int  # of the band, in tiles

    @property
    def tiles(self) -> int:
        """Their number."""
        return self.columns * self.rows


@dataclass(frozen=True, slots=True, eq=False)
class TileLists:
    """Per tile, the depth-sorted ranks of its splats: ranks[start[t]:end[t]]."""

    ranks: Array  # (P,) uint32 into the sorted records
    start: Array  # (tiles,) uint32
    end: Array  # (tiles,) uint32
    filled: Array  # (tiles,) bool, whether there are any
    pairs: int


@dataclass(frozen=True, slots=True)
class TooLarge:
    """A band whose lists would take more than they may."""

    needed: int  # bytes; at least


def split(band: Band) -> tuple[Band, Band]:
    """Upper and lower half."""
    upper = band.rows // 2
    return (
        Band(band.columns, upper, band.first_row),
        Band(band.columns, band.rows - upper, band.first_row + upper),
    )


def sorted_records(device: Device, records: Array, order: Array) -> Array:
    """Records copied into depth order, so that everything after reads near memory."""
    dr, types = device.dr, device.types
    n = len(order)
    out = dr.empty(types.Float, n * RECORD)
    row = dr.gather(types.ArrayXf, records, order, shape=(RECORD, n))
    dr.scatter(out, row, dr.arange(types.UInt32, n))
    dr.eval(out)
    return out


def sorted_values(device: Device, values: F32, order: Array) -> Array:
    """Rows of other per-splat values (N, C) in depth order, padded to VALUE_ROW floats."""
    dr, types = device.dr, device.types
    padded = np.zeros((len(values), VALUE_ROW), dtype=np.float32)
    padded[:, : values.shape[1]] = values
    rows = dr.gather(types.ArrayXf, device.floats(padded), order, shape=(VALUE_ROW, len(order)))
    out = dr.empty(types.Float, len(order) * VALUE_ROW)
    dr.scatter(out, rows, dr.arange(types.UInt32, len(order)))
    dr.eval(out)
    return out


def _range(device: Device, low: Array, high: Array, cells: Array, size: int) -> tuple[Array, Array]:
    """First cell and number of cells that hold a pixel centre in [low, high] (px); cells of `size` px."""
    dr, types = device.dr, device.types
    edge = types.Float(cells * size)
    first = dr.ceil(low - (0.5 + SLACK))
    last = dr.floor(high - (0.5 - SLACK))
    first = dr.select(first > 0, first, 0)
    last = dr.select(last < edge, last, edge - 1)
    empty = ~(first <= last)
    begin = types.UInt32(dr.select(empty, 0, first)) // size
    until = types.UInt32(dr.select(empty, 0, last)) // size
    return begin, dr.select(empty, 0, until - begin + 1)


def _total(device: Device, counts: Array) -> int:
    """Their sum, which may not fit into 32 bits."""
    return int(device.dr.sum(device.types.UInt64(counts))[0])


def _expand(device: Device, counts: Array, total: int) -> tuple[Array, Array]:
    """First element of each owner, and owner of each element, where owners have `counts` elements, `total` in all."""
    dr, UInt32 = device.dr, device.types.UInt32
    offsets = dr.prefix_sum(counts)
    owners = dr.zeros(UInt32, total)
    dr.scatter(owners, dr.arange(UInt32, len(counts)), offsets, counts > 0)
    return offsets, dr.prefix_reduce(dr.ReduceOp.Max, owners, exclusive=False)


def tile_lists(device: Device, records: Array, band: Band, memory: int) -> TileLists | TooLarge:
    """Bin depth-sorted records into the tiles of a band, or say that `memory` bytes do not suffice."""
    dr, types = device.dr, device.types
    Float, UInt32, ArrayXf = types.Float, types.UInt32, types.ArrayXf
    n = len(records) // RECORD
    tiles = band.tiles
    columns, rows = dr.opaque(UInt32, band.columns), dr.opaque(UInt32, band.rows)
    top = dr.opaque(Float, band.first_row * device.tile_height)

    splat = dr.gather(ArrayXf, records, dr.arange(UInt32, n), shape=(RECORD, n))
    y = splat[Y] - top
    first, count = _range(device, y - splat[HALF_HEIGHT], y + splat[HALF_HEIGHT], rows, device.tile_height)
    dr.eval(first, count)
    items = _total(device, count)
    if items == 0:
        return _no_lists(device, tiles)
    if items * ITEM_BYTES > memory or items > MOST_ELEMENTS:
        return TooLarge(items * ITEM_BYTES)
    offsets, rank = _expand(device, count, items)

    # The ellipse's widest points within a strip of pixel centres: at its extreme rows, or at the strip's border
    splat = dr.gather(ArrayXf, records, rank, shape=(RECORD, items))
    row = dr.gather(UInt32, first, rank) + dr.arange(UInt32, items) - dr.gather(UInt32, offsets, rank)
    strip = Float(row * device.tile_height) + (top + 0.5) - splat[Y]
    strip_end = strip + (device.tile_height - 1)

    def edge(sign: float) -> Array:
        dy = sign * splat[TURN]
        dy = dr.select(dy < strip, strip, dr.select(dy > strip_end, strip_end, dy))
        v = splat[S22] * dy
        room = dr.fma(-v, v, splat[REACH])
        u = dr.sqrt(dr.select(room > 0, room, 0))
        return splat[X] + (sign * u - splat[S12] * dy) / splat[S11]

    column, width = _range(device, edge(-1), edge(+1), columns, device.tile_width)
    tile = row * columns + column
    dr.eval(tile, width)
    pairs = _total(device, width)
    if pairs == 0:
        return _no_lists(device, tiles)
    needed = items * ITEM_BYTES + pairs * PAIR_BYTES
    if needed > memory or pairs > MOST_ELEMENTS:
        return TooLarge(needed)
    offsets, item = _expand(device, width, pairs)
    tile = dr.gather(UInt32, tile - offsets, item) + dr.arange(UInt32, pairs)
    rank = dr.gather(UInt32, rank, item)
    dr.eval(tile, rank)
    del offsets, item, width

    permutation = counting_permutation(device, tile, max(1, (tiles - 1).bit_length()))
    ranks, sorted_tile = dr.gather(UInt32, rank, permutation), dr.gather(UInt32, tile, permutation)
    dr.eval(ranks, sorted_tile)
    bound = _lower_bounds(device, sorted_tile, tiles + 1)
    wanted = dr.arange(UInt32, tiles)
    start, end = dr.gather(UInt32, bound, wanted), dr.gather(UInt32, bound, wanted + 1)
    filled = start < end
    dr.eval(start, end, filled)
    return TileLists(ranks, start, end, filled, pairs)


def _no_lists(device: Device, tiles: int) -> TileLists:
    """Lists of a band that no splat meets."""
    dr, types = device.dr, device.types
    none = dr.zeros(types.UInt32, tiles)
    return TileLists(dr.zeros(types.UInt32, 1), none, none, dr.zeros(types.Bool, tiles), 0)


def _lower_bounds(device: Device, ascending: Array, count: int) -> Array:
    """For each value 0..count-1, the first position in `ascending` that is not below it."""
    dr, UInt32 = device.dr, device.types.UInt32
    wanted = dr.arange(UInt32, count)
    end = dr.opaque(UInt32, len(ascending))

    def halve(low: Array, high: Array) -> tuple[Array, Array]:
        middle = (low + high) >> 1
        below = dr.gather(UInt32, ascending, middle) < wanted
        return dr.select(below, middle + 1, low), dr.select(below, high, middle)

    low, _ = dr.while_loop(
        (dr.zeros(UInt32, count), end + dr.zeros(UInt32, count)), lambda low, high: low < high, halve
    )
    dr.eval(low)
    return low

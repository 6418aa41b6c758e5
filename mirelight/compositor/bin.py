"""Which splats meet which tile: exact ellipse ranges, one item per splat and tile row, then one stable sort."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mirelight.compositor.device import Array, Device
from mirelight.compositor.order import counting_permutation
from mirelight.compositor.record import HALF_HEIGHT, REACH, RECORD, S11, S12, S22, SLACK, TURN, VALUE_ROW, X, Y
from mirelight.model import F32

ITEM_BYTES = 24  # per splat and tile row while binning
PAIR_BYTES = 28  # per splat and tile while sorting
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
        """The number of tiles in the band."""
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
    """The band cut into its upper and lower half."""
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
    rows = np.zeros((len(order), VALUE_ROW), dtype=np.float32)
    rows[:, : values.shape[1]] = values[order.numpy()]
    return device.floats(rows)


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


def _places(device: Device, counts: Array, most: int) -> tuple[Array, int]:
    """Where each owner's elements begin if they lie one after another, and how many there are in all.

    Args:
        counts: elements of each owner, at most `most`.
    """
    dr = device.dr
    if len(counts) * most < 1 << 32:
        until = dr.cumsum(counts)
        dr.eval(until)
        return until - counts, int(until[len(counts) - 1])
    return dr.prefix_sum(counts), int(dr.sum(device.types.UInt64(counts))[0])  # the sum may not fit into 32 bits


def _spread(
    device: Device, counts: Array, places: Array, total: int, first: Array, owner: Array
) -> tuple[Array, Array]:
    """For each owner `counts` elements from its place on: first, first + 1, … beside the owner itself; `total` in all.

    One loop that scatters costs less than marking the first elements and a prefix maximum over all of them.
    """
    dr, UInt32 = device.dr, device.types.UInt32
    ascending, owners = dr.empty(UInt32, total), dr.empty(UInt32, total)

    def put(left: Array, place: Array, value: Array) -> tuple[Array, Array, Array]:
        dr.scatter(ascending, value, place)
        dr.scatter(owners, owner, place)
        return left - 1, place + 1, value + 1

    dr.while_loop((counts, places, first), lambda left, *_: left > 0, put)
    dr.eval(ascending, owners)
    return ascending, owners


def tile_lists(device: Device, records: Array, band: Band, memory: int) -> TileLists | TooLarge:
    """Bin depth-sorted records into the tiles of a band, or say that `memory` bytes do not suffice."""
    ranks = device.dr.arange(device.types.UInt32, len(records) // RECORD)
    first, count = _rows(device, records, ranks, band)
    places, items = _places(device, count, band.rows)
    if items == 0:
        return _no_lists(device, band.tiles)
    if items * ITEM_BYTES > memory or items > MOST_ELEMENTS:
        return TooLarge(items * ITEM_BYTES)
    row, rank = _spread(device, count, places, items, first, ranks)

    first, count = _tiles_of_row(device, records, rank, row, band)
    places, pairs = _places(device, count, band.columns)
    if pairs == 0:
        return _no_lists(device, band.tiles)
    needed = items * ITEM_BYTES + pairs * PAIR_BYTES
    if needed > memory or pairs > MOST_ELEMENTS:
        return TooLarge(needed)
    tile, rank = _spread(device, count, places, pairs, first, rank)
    return _lists_of(device, tile, rank, band.tiles)


def _rows(device: Device, records: Array, rank: Array, band: Band) -> tuple[Array, Array]:
    """First row of tiles of each splat within the band, and the number of them."""
    dr, types = device.dr, device.types
    splat = dr.gather(types.ArrayXf, records, rank, shape=(RECORD, len(rank)))
    y = splat[Y] - dr.opaque(types.Float, band.first_row * device.tile_height)
    rows = dr.opaque(types.UInt32, band.rows)
    first, count = _range(device, y - splat[HALF_HEIGHT], y + splat[HALF_HEIGHT], rows, device.tile_height)
    dr.eval(first, count)
    return first, count


def _tiles_of_row(device: Device, records: Array, rank: Array, row: Array, band: Band) -> tuple[Array, Array]:
    """First tile of each splat within a row of tiles, and the number of them.

    The ellipse's widest points within the row's strip of pixel centres lie at its extremes, or at the strip's border.
    """
    dr, types = device.dr, device.types
    splat = dr.gather(types.ArrayXf, records, rank, shape=(RECORD, len(rank)))
    top = dr.opaque(types.Float, band.first_row * device.tile_height + 0.5)
    strip = types.Float(row * device.tile_height) + top - splat[Y]
    strip_end = strip + (device.tile_height - 1)

    def edge(sign: float) -> Array:
        dy = sign * splat[TURN]
        dy = dr.select(dy < strip, strip, dr.select(dy > strip_end, strip_end, dy))
        v = splat[S22] * dy
        room = dr.fma(-v, v, splat[REACH])
        u = dr.sqrt(dr.select(room > 0, room, 0))
        return splat[X] + (sign * u - splat[S12] * dy) / splat[S11]

    columns = dr.opaque(types.UInt32, band.columns)
    column, count = _range(device, edge(-1), edge(+1), columns, device.tile_width)
    first = row * columns + column
    dr.eval(first, count)
    return first, count


def _lists_of(device: Device, tile: Array, rank: Array, tiles: int) -> TileLists:
    """Pairs of tile and splat, which come in depth order, sorted by tile."""
    dr, UInt32 = device.dr, device.types.UInt32
    bits = max(1, (tiles - 1).bit_length())
    length = dr.zeros(UInt32, 1 << bits)  # this size is compiled in: a power of two
    dr.scatter_reduce(dr.ReduceOp.Add, length, UInt32(1), tile, mode=dr.ReduceMode.Expand)
    dr.eval(length)
    start = dr.prefix_sum(length)
    ranks = dr.gather(UInt32, rank, counting_permutation(device, tile, bits))
    wanted = dr.arange(UInt32, tiles)
    start, length = dr.gather(UInt32, start, wanted), dr.gather(UInt32, length, wanted)
    end, filled = start + length, length > 0
    dr.eval(ranks, start, end, filled)
    return TileLists(ranks, start, end, filled, len(rank))


def _no_lists(device: Device, tiles: int) -> TileLists:
    """Lists of a band that no splat meets."""
    dr, types = device.dr, device.types
    none = dr.zeros(types.UInt32, tiles)
    return TileLists(dr.zeros(types.UInt32, 1), none, none, dr.zeros(types.Bool, tiles), 0)

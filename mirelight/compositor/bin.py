"""Which splats meet which tile: exact ellipse ranges, one item per splat and tile row, then one stable sort."""

from __future__ import annotations

from dataclasses import dataclass

from mirelight.compositor.device import Array, Device
from mirelight.compositor.order import counting_permutation
from mirelight.compositor.project import HALF_HEIGHT, REACH, RECORD, S11, S12, S22, SLACK, TURN, X, Y


@dataclass(frozen=True, slots=True, eq=False)
class Band:
    """Rows of tiles that are blended together. All scalars are opaque."""

    columns: int  # tiles across the image
    rows: int  # tile rows in the band
    first_row: int  # of the band, in tiles


@dataclass(frozen=True, slots=True, eq=False)
class TileLists:
    """Per tile, the depth-sorted ranks of its splats: ranks[start[t]:end[t]]."""

    ranks: Array  # (P,) uint32 into the sorted records
    start: Array  # (tiles,) uint32
    end: Array  # (tiles,) uint32
    pairs: int


def sorted_records(device: Device, records: Array, order: Array) -> Array:
    """Records copied into depth order, so that everything after reads near memory."""
    dr, types = device.dr, device.types
    n = len(order)
    out = dr.empty(types.Float, n * RECORD)
    row = dr.gather(types.ArrayXf, records, order, shape=(RECORD, n))
    dr.scatter(out, row, dr.arange(types.UInt32, n))
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


def _expand(device: Device, counts: Array) -> tuple[Array, Array, int]:
    """(offsets, owner of each element, their number) for owners that have `counts` elements each."""
    dr, UInt32 = device.dr, device.types.UInt32
    offsets = dr.prefix_sum(counts)
    dr.eval(offsets)
    total = int(offsets[len(counts) - 1]) + int(counts[len(counts) - 1])
    if total == 0:
        return offsets, dr.zeros(UInt32, 0), 0
    owners = dr.zeros(UInt32, total)
    dr.scatter(owners, dr.arange(UInt32, len(counts)), offsets, counts > 0)
    return offsets, dr.prefix_reduce(dr.ReduceOp.Max, owners, exclusive=False), total


def tile_lists(device: Device, records: Array, band: Band) -> TileLists:
    """Bin depth-sorted records into the tiles of a band."""
    dr, types = device.dr, device.types
    Float, UInt32, ArrayXf = types.Float, types.UInt32, types.ArrayXf
    n = len(records) // RECORD
    tiles = band.columns * band.rows
    columns, rows = dr.opaque(UInt32, band.columns), dr.opaque(UInt32, band.rows)
    top = dr.opaque(Float, band.first_row * device.tile_height)

    splat = dr.gather(ArrayXf, records, dr.arange(UInt32, n), shape=(RECORD, n))
    y = splat[Y] - top
    first, count = _range(device, y - splat[HALF_HEIGHT], y + splat[HALF_HEIGHT], rows, device.tile_height)
    dr.eval(first, count)
    offsets, rank, items = _expand(device, count)
    if items == 0:
        none = dr.zeros(UInt32, tiles)
        return TileLists(dr.zeros(UInt32, 1), none, dr.zeros(UInt32, tiles), 0)

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
    offsets, item, pairs = _expand(device, width)
    if pairs == 0:
        none = dr.zeros(UInt32, tiles)
        return TileLists(dr.zeros(UInt32, 1), none, dr.zeros(UInt32, tiles), 0)
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
    dr.eval(start, end)
    return TileLists(ranks, start, end, pairs)


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

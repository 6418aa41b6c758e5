"""Tiles on a queue: persistent lanes, one tile each, that fetch the next one when theirs is finished."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from mirelight.compositor.bin import Band, TileLists
from mirelight.compositor.device import Array, Device

UNROLL = 2  # splats an iteration, so that a pixel's state is loaded and stored half as often
NO_TILE = 0xFFFFFFFF

Pixels = list[list[Array]]


class PixelProgram(Protocol):
    """What happens in one pixel. Its state is a list of floats."""

    def fresh(self) -> list[float]:
        """The state of a pixel that nothing was blended into."""
        ...

    def running(self, pixel: list[Array]) -> Array:
        """Whether more fragments can change the pixel."""
        ...

    def fragment(self, splat: Array, exponent: Array, pixel: list[Array]) -> list[Array]:
        """The state after one more splat."""
        ...


def tile_order(band: Band) -> NDArray[np.uint32]:
    """Tiles of a band along a Morton curve: what is blended at the same time shares splats, hence cache lines."""
    row, column = np.divmod(np.arange(band.rows * band.columns, dtype=np.uint64), np.uint64(band.columns))
    code = np.zeros(len(row), dtype=np.uint64)
    for bit in range(16):
        for axis, cell in enumerate((column, row)):
            code |= ((cell >> np.uint64(bit)) & np.uint64(1)) << np.uint64(2 * bit + axis)
    return np.argsort(code).astype(np.uint32)


def for_each_tile(
    device: Device,
    lists: TileLists,
    band: Band,
    load: Callable[[Array, Array], Array],
    exponents: Callable[[Array, Array, Array], list[Array]],
    program: PixelProgram,
    write: Callable[[Array, Array, Pixels, Array], None],
) -> None:
    """Run `program` over every tile's list of splats.

    One symbolic loop holds the state of whole tiles. Which lane gets which tile depends on timing, what it computes
    there does not: the result is the same bits for any number of threads.

    Args:
        load: (ranks, mask) -> the lanes' splats.
        exponents: (splat, x, y) -> exponent of each pixel of the tile whose first pixel centre is (x, y).
        write: (tile column, tile row, pixels, mask) of finished tiles.
    """
    dr, types = device.dr, device.types
    Float, UInt32, Bool = types.Float, types.UInt32, types.Bool
    pixels = device.tile_width * device.tile_height
    lanes = device.persistent_lanes
    order = UInt32(tile_order(band))
    queue = dr.zeros(UInt32, 1)
    tiles, columns = dr.opaque(UInt32, band.tiles), dr.opaque(UInt32, band.columns)
    first_row = dr.opaque(UInt32, band.first_row)
    ranks, starts, ends = lists.ranks, lists.start, lists.end
    fresh = [[Float(v) for v in program.fresh()] for _ in range(pixels)]

    def place(tile: Array) -> tuple[Array, Array]:
        row = tile // columns
        return tile - row * columns, row + first_row

    def switch(tile: Array, position: Array, end: Array, state: Pixels) -> tuple[Array, Array, Array, Pixels]:
        column, row = place(tile)
        write(column, row, state, tile != NO_TILE)
        ticket = dr.scatter_inc(queue, UInt32(0), Bool(True))
        more = ticket < tiles
        tile = dr.gather(UInt32, order, ticket, more)
        position, end = dr.gather(UInt32, starts, tile, more), dr.gather(UInt32, ends, tile, more)
        return dr.select(more, tile, NO_TILE), position, end, fresh

    def step(
        running: Array, tile: Array, position: Array, end: Array, state: Pixels
    ) -> tuple[Array, Array, Array, Array, Pixels]:
        open_pixels = program.running(state[0])
        for pixel in state[1:]:
            open_pixels |= program.running(pixel)
        tile, position, end, state = dr.if_stmt(
            (tile, position, end, state), ~open_pixels | (position >= end), switch, lambda *same: same
        )
        column, row = place(tile)
        x, y = Float(column * device.tile_width) + 0.5, Float(row * device.tile_height) + 0.5
        for i in range(UNROLL):
            ok = position + i < end
            splat = load(dr.gather(UInt32, ranks, position + i, ok), ok)
            state = [program.fragment(splat, e, p) for e, p in zip(exponents(splat, x, y), state, strict=True)]
        return tile != NO_TILE, tile, position + UNROLL, end, state

    nothing = dr.zeros(UInt32, lanes)
    dr.while_loop(
        (
            dr.full(Bool, True, lanes),
            dr.full(UInt32, NO_TILE, lanes),
            nothing,
            nothing,
            [[dr.full(Float, v, lanes) for v in program.fresh()] for _ in range(pixels)],
        ),
        lambda running, *_: running,
        step,
    )

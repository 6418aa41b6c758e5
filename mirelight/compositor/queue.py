"""Tiles on a queue: persistent lanes, one tile each, that fetch the next one when theirs is finished."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterator
from functools import lru_cache, partial
from typing import Any, Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from mirelight.compositor.bin import Band, TileLists
from mirelight.compositor.device import Array, Device

UNROLL = 4  # splats an iteration, so that a pixel's state is loaded and stored a fourth as often
NO_TILE = 0xFFFFFFFF

PACKET = 16  # floats written at a time

Pixels: TypeAlias = list[list[Array]]
Splat: TypeAlias = list[Array]


class SplatSource(Hashable, Protocol):
    """Where splats come from. A splat is a list of arrays, one splat a lane. Hashable: equal ones are compiled once."""

    @property
    def slots(self) -> int:
        """How many numbers a splat has in the queue."""
        ...

    def load(self, data: list[Array], rank: Array, ok: Array) -> Splat:
        """The splats at `rank`; where not `ok`, one that nothing is seen of."""
        ...

    def hidden(self, splat: Splat, where: Array) -> Splat:
        """The splat with nothing to be seen of it in some lanes."""
        ...

    def exponents(self, splat: Splat, x0: Array, y0: Array) -> Iterator[Array]:
        """The exponent at each pixel of the tile whose first pixel centre is (x0, y0), row by row."""
        ...


class PixelProgram(Hashable, Protocol):
    """What happens in one pixel. Its state is a list of floats."""

    @property
    def results(self) -> int:
        """Floats at the front of a pixel's state that are kept when its tile is finished."""
        ...

    def fresh(self) -> list[float]:
        """The state of a pixel that nothing was blended into; each number is 0 or 1."""
        ...

    def begun(self, data: list[Array], x: Array, y: Array, fresh: Pixels) -> Pixels:
        """The states of the tile whose first pixel centre is (x, y), from fresh ones; `data` is the source's."""
        ...

    def finished(self, tile: Pixels) -> Array:
        """Whether no further fragment can change any of the pixels."""
        ...

    def fragment(self, splat: Splat, exponent: Array, pixel: list[Array]) -> list[Array]:
        """The state after one more splat."""
        ...


@lru_cache(maxsize=16)
def tile_order(columns: int, rows: int) -> NDArray[np.uint32]:
    """(N,) tiles along a Morton curve: what is blended at the same time shares splats, hence cache lines."""
    row, column = np.divmod(np.arange(columns * rows, dtype=np.uint64), np.uint64(columns))
    code = np.zeros(len(row), dtype=np.uint64)
    for bit in range(16):
        for axis, cell in enumerate((column, row)):
            code |= ((cell >> np.uint64(bit)) & np.uint64(1)) << np.uint64(2 * bit + axis)
    return np.argsort(code).astype(np.uint32)


def row_of(device: Device, tile: Array, columns: Array) -> Array:
    """tile // columns. By floats, exact below four million tiles: LLVM divides integers one lane at a time."""
    types = device.types
    return types.UInt32((types.Float(tile) + 0.5) / types.Float(columns))


def for_each_tile(
    device: Device, lists: TileLists, band: Band, source: SplatSource, data: list[Array], program: PixelProgram
) -> Array:
    """Run `program` over every tile's list of splats, which `source` finds in `data`.

    One symbolic loop holds the state of whole tiles and the next splats, which are loaded while those before them are
    blended. Which lane gets which tile depends on timing, what it computes there does not: the result is the same bits
    for any number of threads.

    Returns:
        the final states, (tiles * pixels of a tile * results of a state,); undefined where a tile's list is empty.
    """
    dr, types = device.dr, device.types
    UInt32 = types.UInt32
    room = 1 << (band.tiles - 1).bit_length()  # tiles; a power of two, so that few sizes are traced
    if lists.pairs == 0:
        return dr.empty(types.Float, room * device.tile_width * device.tile_height * program.results)
    order = UInt32(tile_order(band.columns, band.rows))
    order = dr.gather(UInt32, order, dr.compress(dr.gather(types.Bool, lists.filled, order)))
    scalars = [dr.opaque(UInt32, v) for v in (len(order), band.columns, band.first_row)]
    lanes = dr.zeros(UInt32, device.persistent_lanes)
    return _loop(device, source, program, room)(lanes, [order, lists.ranks, lists.start, lists.end, *scalars], data)


@lru_cache(maxsize=64)
def _loop(device: Device, source: SplatSource, program: PixelProgram, room: int) -> Callable[..., Array]:
    """The loop of `for_each_tile`, ready to run."""
    return device.frozen(_Loop(device, source, program, room).run)


class _Loop:
    """Blends tiles: each lane fetches one when the one before is finished."""

    def __init__(self, device: Device, source: SplatSource, program: PixelProgram, room: int) -> None:
        self.device, self.source, self.program, self.room = device, source, program, room
        self.pixels = device.tile_width * device.tile_height
        self.packets = self.pixels * program.results // PACKET  # one large packet costs far less than several small

    def run(self, zeros: Array, lists: list[Array], data: list[Array]) -> Array:
        """One lane for each of `zeros` fetches tiles until they are used up.

        Args:
            zeros: as many as lanes.
            lists: the tiles' order, splats' ranks, starts and ends of tiles' lists; tiles, columns, first row.
            data: of the source.
        """
        dr, types = self.device.dr, self.device.types
        out = dr.empty(types.Float, self.room * self.packets * PACKET)
        queue = dr.zeros(types.UInt32, 1)
        columns = lists[5]
        zero = _on_aligned_stack(self.device, types.Float(zeros), columns)
        one = zero + 1
        start = (
            zeros == 0,
            zeros + NO_TILE,
            zeros + UNROLL,  # position and end of a list that is done
            zeros,
            zero,
            zero,
            [[zero] * self.source.slots for _ in range(UNROLL)],
            [[one if v else zero for v in self.program.fresh()] for _ in range(self.pixels)],
        )
        step = partial(self._step, partial(self._next_tile, out, queue, lists, data), lists[1], data)
        dr.while_loop(start, lambda running, *_: running, step)
        dr.eval(out)
        return out

    def _next_tile(self, out: Array, queue: Array, lists: list[Array], data: list[Array], *at: Any) -> tuple[Any, ...]:
        """Write a tile's pixels, and go to the next in the queue: (tile, position, end, x, y, state), then and now."""
        dr, types, (tile, *_, state) = self.device.dr, self.device.types, at
        order, _, starts, ends, tiles, columns, first_row = lists
        flat = [slot for pixel in state for slot in pixel[: self.program.results]]
        for i in range(self.packets):
            packet = types.ArrayXf(flat[i * PACKET : (i + 1) * PACKET])
            dr.scatter(out, packet, tile * self.packets + i, tile != NO_TILE)
        ticket = dr.scatter_inc(queue, types.UInt32(0), types.Bool(True))
        more = ticket < tiles
        tile = dr.gather(types.UInt32, order, ticket, more)
        position, end = dr.gather(types.UInt32, starts, tile, more), dr.gather(types.UInt32, ends, tile, more)
        row = row_of(self.device, tile, columns)
        x = types.Float((tile - row * columns) * self.device.tile_width) + 0.5
        y = types.Float((row + first_row) * self.device.tile_height) + 0.5
        fresh = [[types.Float(v) for v in self.program.fresh()] for _ in range(self.pixels)]
        return dr.select(more, tile, NO_TILE), position, end, x, y, self.program.begun(list(data), x, y, fresh)

    def _step(
        self, next_tile: Callable[..., tuple[Any, ...]], ranks: Array, data: list[Array], *at: Any
    ) -> tuple[Any, ...]:
        """Blend the splats that are held, and load the next: (running, tile, position, end, x, y, held, state)."""
        dr, program = self.device.dr, self.program
        _, tile, position, end, x, y, held, state = at
        done = program.finished(state) | (position >= end + UNROLL)  # `held` lies before `position`
        here = (tile, position, end, x, y, state)
        tile, position, end, x, y, state = dr.if_stmt(here, done, next_tile, lambda *same: same)
        coming = []
        for i in range(UNROLL):
            ok = position + i < end
            coming.append(
                self.source.load(list(data), dr.gather(self.device.types.UInt32, ranks, position + i, ok), ok)
            )
        self.device.later()  # else Dr.Jit would emit the loads after the blend
        shown = [self.source.hidden(splat, done) for splat in held]  # those of the tile before are not for this one
        exponents = [self.source.exponents(splat, x, y) for splat in shown]
        blended = []
        for pixel in state:  # pixel by pixel, so that its state stays in registers from splat to splat
            for splat, of_pixel in zip(shown, exponents, strict=True):
                pixel = program.fragment(splat, next(of_pixel), pixel)
            blended.append(pixel)
        return tile != NO_TILE, tile, position + UNROLL, end, x, y, coming, blended


def _on_aligned_stack(device: Device, values: Array, place: Array) -> Array:
    """The same values, by way of local memory, which LLVM cannot see through as it does not know the `place`.

    Dr.Jit's kernels keep what does not fit into registers on a stack of the caller's alignment, where each access
    straddles two cache lines. Local memory makes LLVM align it: the blend takes a seventh less.
    """
    local = device.dr.alloc_local(device.types.Float, 2, values)
    local.write(values, place & 1)
    return local.read((place >> 1) & 1)

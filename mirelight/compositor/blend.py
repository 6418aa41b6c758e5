"""The blend: front to back over tiles, with colour, depths and any other per-splat values in one pass."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from mirelight.compositor.bin import Band, TileLists
from mirelight.compositor.device import Array, Device
from mirelight.compositor.kernel import SplatKernel
from mirelight.compositor.queue import Pixels, for_each_tile
from mirelight.compositor.record import BLUE, DEPTH, OFFSET, REACH, RECORD, RED, S11, S12, S22, SCALE, VALUE_ROW, X, Y
from mirelight.compositor.resolve import Frame, untile

NEARLY_OPAQUE = 2.0**-20  # profiles without a stop of their own end a pixel here: what lies behind adds less than 1e-6
VALUES = 8  # first of a splat's arrays that is accumulated
SIGN = 0x80000000
_ROUNDER = 1.5 * 2**23  # adding it leaves a float's nearest integer in its low bits


def _exp2_coefficients(degree: int) -> list[float]:
    """Of the near-minimax polynomial of 2^f on [-½, ½], lowest power first, by interpolation at Chebyshev nodes."""
    nodes = np.cos(np.pi * (np.arange(degree + 1) + 0.5) / (degree + 1)) / 2
    return [float(c) for c in np.linalg.solve(np.vander(nodes, increasing=True), np.exp2(nodes))]


EXP2 = _exp2_coefficients(5)  # relative error 2e-7 (degree 4: 4e-6)


def _exp2(device: Device, x: Array, scale: float) -> Array:
    """scale 2^x, x >= 0."""
    dr, types = device.dr, device.types
    shifted = x + _ROUNDER
    whole = dr.reinterpret_array(types.Int32, shifted) << 23
    part = x - (shifted - _ROUNDER)
    total = types.Float(scale * EXP2[-1])
    for c in reversed(EXP2[:-1]):
        total = dr.fma(total, part, scale * c)
    return dr.reinterpret_array(types.Float, dr.reinterpret_array(types.Int32, total) + whole)


@dataclass(frozen=True, slots=True, eq=False)
class Source:
    """Depth-sorted splats, and how one becomes alphas over a tile.

    A splat is a list of arrays, one splat a lane: x, y, s11, s12, s22, reach, scale, offset, and what is accumulated:
    colour, other values, depth.
    """

    device: Device
    kernel: SplatKernel
    records: Array  # (n * RECORD,)
    values: Array | None  # (n * VALUE_ROW,) other values
    channels: int
    depth: bool  # whether depths are blended

    @property
    def slots(self) -> int:
        """Arrays of a splat."""
        return VALUES + 3 + self.channels + self.depth

    def load(self, rank: Array, ok: Array) -> list[Array]:
        """Splats by their place in the depth order; lanes that are not `ok` read zeros, whose alpha is 0."""
        dr, types, lanes = self.device.dr, self.device.types, self.device.persistent_lanes
        row = dr.gather(types.ArrayXf, self.records, rank, ok, shape=(RECORD, lanes))
        splat = [row[s] for s in (X, Y, S11, S12, S22, REACH, SCALE, OFFSET, *range(RED, BLUE + 1))]
        if self.values is not None:
            more = dr.gather(types.ArrayXf, self.values, rank, ok, shape=(VALUE_ROW, lanes))
            splat += [more[i] for i in range(self.channels)]
        if self.depth:
            splat.append(row[DEPTH])
        return splat

    def hidden(self, splat: list[Array], where: Array) -> list[Array]:
        """The splat with alpha 0 in some lanes."""
        x, y, s11, s12, s22, reach, *rest = splat
        return [x, y, s11, s12, s22, self.device.dr.select(where, 0, reach), *rest]

    def exponents(self, splat: list[Array], x0: Array, y0: Array) -> Iterator[Array]:
        """e of every pixel of the tile whose first pixel centre is (x0, y0), row by row."""
        dr = self.device.dr
        x, y, s11, s12, s22, reach, *_ = splat
        along = [s11 * (x0 - x + float(i)) for i in range(self.device.tile_width)]
        for j in range(self.device.tile_height):
            dy = y0 - y + float(j)
            v, skew = s22 * dy, s12 * dy
            room = dr.fma(-v, v, reach)
            for a in along:
                u = a + skew
                yield dr.fma(-u, u, room)

    def alpha(self, splat: list[Array], exponent: Array) -> Array:
        """Alpha where the exponent is positive."""
        dr = self.device.dr
        positive = dr.select(exponent > 0, exponent, 0)  # numbers that underflow cost a hundred cycles each
        if self.kernel.truncated:
            return dr.fma(_exp2(self.device, positive, 1.0), splat[VALUES - 2], -splat[VALUES - 1])
        alpha = _exp2(self.device, positive, self.kernel.alpha_clip)
        return dr.select(alpha > self.kernel.alpha_max, self.kernel.alpha_max, alpha)


@dataclass(frozen=True, slots=True, eq=False)
class _Over:
    """Front-to-back compositing of one pixel: transmittance, sums of weight times value, median depth."""

    source: Source

    def fresh(self) -> list[float]:
        return [1.0] + [0.0] * (3 + self.source.channels + 2 * self.source.depth)

    def finished(self, tile: Pixels) -> Array:
        """Pixels that have stopped have a negative transmittance, or 0 where the profile has no stop of its own."""
        dr, Int32 = self.source.device.dr, self.source.device.types.Int32
        bits, *more = (dr.reinterpret_array(Int32, pixel[0]) for pixel in tile)
        for word in more:
            bits = bits & word if self.source.kernel.stop is not None else bits | word
        return bits < 0 if self.source.kernel.stop is not None else bits == 0

    def fragment(self, splat: list[Array], exponent: Array, pixel: list[Array]) -> list[Array]:
        dr, types, stop = self.source.device.dr, self.source.device.types, self.source.kernel.stop
        before, hit = pixel[0], exponent > 0
        alpha = self.source.alpha(splat, exponent)
        left = dr.fma(-alpha, before, before)
        if stop is None:
            kept, after = hit, dr.select(hit, left, before)
            after = dr.select(after < NEARLY_OPAQUE, 0, after)
        else:  # the fragment that would cross the limit is not blended; of stopped pixels `left` is negative
            kept = hit & (left >= stop)
            stopped = dr.reinterpret_array(types.Float, dr.reinterpret_array(types.UInt32, before) | SIGN)
            after = dr.select(kept, left, dr.select(hit, stopped, before))
        weight = dr.select(kept, alpha * before, 0)
        out = [after]
        out += [dr.fma(weight, v, p) for v, p in zip(splat[VALUES:], pixel[1:], strict=False)]
        if self.source.depth:
            out.append(dr.select(kept & (before > 0.5) & (left <= 0.5), splat[-1], pixel[-1]))
        return out


@dataclass(frozen=True, slots=True, eq=False)
class _EightBit:
    """Back-to-front compositing of one pixel of an RGBA8 target, which clamps and rounds after every splat."""

    source: Source

    def fresh(self) -> list[float]:
        return [0.0] * 3

    def finished(self, tile: Pixels) -> Array:
        """Never: what lies in front comes last."""
        return tile[0][0] < 0

    def fragment(self, splat: list[Array], exponent: Array, pixel: list[Array]) -> list[Array]:
        dr = self.source.device.dr
        alpha = self.source.alpha(splat, exponent)
        out = []
        for value, below in zip(splat[VALUES:], pixel, strict=False):
            added = alpha * value
            over = dr.fma(-alpha, below, dr.select(added < 1, added, 1) + below)
            level = dr.floor(dr.fma(dr.select(over < 1, over, 1), 255, 0.5)) * (1 / 255)
            out.append(dr.select(exponent > 0, level, below))
        return out


def blend(source: Source, lists: TileLists, band: Band, frame: Frame) -> None:
    """Blend a band's tiles into `frame`, front to back."""
    over = _Over(source)
    states = for_each_tile(source.device, lists, band, source, over)
    values = 4 + source.channels  # slots: transmittance, colour, other values, depth, median
    images = {"transmittance": range(1), "color": range(1, 4)}
    if source.channels:
        images["values"] = range(4, values)
    if source.depth:
        images |= {"depth": range(values, values + 1), "median": range(values + 1, values + 2)}
    untile(source.device, states, over.fresh(), lists, band, frame, images)


def blend_eight_bit(source: Source, lists: TileLists, band: Band, frame: Frame) -> None:
    """Blend a band's colours as the engine's RGBA8 target does. The records run back to front."""
    program = _EightBit(source)
    states = for_each_tile(source.device, lists, band, source, program)
    untile(source.device, states, program.fresh(), lists, band, frame, {"color": range(3)})

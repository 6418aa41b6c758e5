"""The blend: front to back over tiles, with colour, depths and any other per-splat values in one pass."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mirelight.compositor.bin import Band, TileLists
from mirelight.compositor.device import Array, Device
from mirelight.compositor.kernel import SplatKernel
from mirelight.compositor.project import BLUE, DEPTH, OFFSET, REACH, RECORD, RED, S11, S12, S22, SCALE, VALUE_ROW, X, Y
from mirelight.compositor.queue import for_each_tile
from mirelight.compositor.resolve import Frame, untile

NEARLY_OPAQUE = 2.0**-20  # profiles without a stop of their own end a pixel here: what lies behind adds less than 1e-6
_ROUNDER = 1.5 * 2**23  # adding it leaves a float's nearest integer in its low bits


def _exp2_coefficients(degree: int) -> list[float]:
    """Of the near-minimax polynomial of 2^f on [-½, ½], lowest power first, by interpolation at Chebyshev nodes."""
    nodes = np.cos(np.pi * (np.arange(degree + 1) + 0.5) / (degree + 1)) / 2
    return [float(c) for c in np.linalg.solve(np.vander(nodes, increasing=True), np.exp2(nodes))]


EXP2 = _exp2_coefficients(5)  # relative error 2e-7 (degree 4: 4e-6)


def _exp2(device: Device, x: Array) -> Array:
    """2^x for x > -126; anything below, which the caller masks."""
    dr, types = device.dr, device.types
    shifted = x + _ROUNDER
    whole = dr.reinterpret_array(types.Int32, shifted) << 23
    part = x - (shifted - _ROUNDER)
    total = types.Float(EXP2[-1])
    for c in reversed(EXP2[:-1]):
        total = dr.fma(total, part, c)
    return dr.reinterpret_array(types.Float, dr.reinterpret_array(types.Int32, total) + whole)


@dataclass(frozen=True, slots=True, eq=False)
class Splat:
    """One splat per lane, as the blend reads it."""

    shape: list[Array]  # x, y, s11, s12, s22, reach
    scale: Array  # used where the kernel is truncated
    offset: Array
    values: list[Array]  # what is accumulated: colour, other values, depth
    depth: Array | None


@dataclass(frozen=True, slots=True, eq=False)
class Source:
    """Depth-sorted splats, and how one becomes alphas over a tile."""

    device: Device
    kernel: SplatKernel
    records: Array  # (n * RECORD,)
    values: Array | None  # (n * VALUE_ROW,) other values
    channels: int
    depth: bool  # whether depths are blended

    def load(self, rank: Array, ok: Array) -> Splat:
        """Splats by their place in the depth order; lanes that are not `ok` read zeros, whose alpha is 0."""
        dr, types, lanes = self.device.dr, self.device.types, self.device.persistent_lanes
        row = dr.gather(types.ArrayXf, self.records, rank, ok, shape=(RECORD, lanes))
        values = [row[s] for s in range(RED, BLUE + 1)]
        if self.values is not None:
            more = dr.gather(types.ArrayXf, self.values, rank, ok, shape=(VALUE_ROW, lanes))
            values += [more[i] for i in range(self.channels)]
        if self.depth:
            values.append(row[DEPTH])
        return Splat(
            shape=[row[s] for s in (X, Y, S11, S12, S22, REACH)],
            scale=row[SCALE],
            offset=row[OFFSET],
            values=values,
            depth=row[DEPTH] if self.depth else None,
        )

    def exponents(self, splat: Splat, x0: Array, y0: Array) -> list[Array]:
        """e of every pixel of the tile whose first pixel centre is (x0, y0), row by row."""
        dr = self.device.dr
        x, y, s11, s12, s22, reach = splat.shape
        along = [s11 * (x0 - x + float(i)) for i in range(self.device.tile_width)]
        out = []
        for j in range(self.device.tile_height):
            dy = y0 - y + float(j)
            v, skew = s22 * dy, s12 * dy
            room = dr.fma(-v, v, reach)
            for a in along:
                u = a + skew
                out.append(dr.fma(-u, u, room))
        return out

    def alpha(self, splat: Splat, exponent: Array) -> Array:
        """Alpha where the exponent is positive."""
        dr = self.device.dr
        power = _exp2(self.device, dr.select(exponent > 0, exponent, 0))  # what underflows costs a hundred cycles
        if self.kernel.truncated:
            return dr.fma(power, splat.scale, -splat.offset)
        alpha = power * self.kernel.alpha_clip
        return dr.select(alpha > self.kernel.alpha_max, self.kernel.alpha_max, alpha)


@dataclass(frozen=True, slots=True, eq=False)
class _Over:
    """Front-to-back compositing of one pixel: transmittance, sums of weight times value, median depth.

    A pixel that has stopped keeps its transmittance with the sign flipped.
    """

    source: Source

    @property
    def sums(self) -> int:
        return 3 + self.source.channels + self.source.depth

    def fresh(self) -> list[float]:
        return [1.0] + [0.0] * (self.sums + self.source.depth)

    def running(self, pixel: list[Array]) -> Array:
        return pixel[0] > 0

    def fragment(self, splat: Splat, exponent: Array, pixel: list[Array]) -> list[Array]:
        dr, stop = self.source.device.dr, self.source.kernel.stop
        before = pixel[0]
        alpha = self.source.alpha(splat, exponent)
        live = (exponent > 0) & (before > 0)
        left = dr.fma(-alpha, before, before)
        if stop is None:
            kept, after = live, dr.select(left < NEARLY_OPAQUE, -left, left)
        else:  # the fragment that would cross the limit is not blended
            ends = left < stop
            kept, after = live & ~ends, dr.select(ends, -before, left)
        weight = dr.select(kept, alpha * before, 0)
        out = [dr.select(live, after, before)]
        out += [dr.fma(weight, v, p) for v, p in zip(splat.values, pixel[1:], strict=False)]
        if splat.depth is not None:
            out.append(dr.select(kept & (before > 0.5) & (left <= 0.5), splat.depth, pixel[-1]))
        return out


@dataclass(frozen=True, slots=True, eq=False)
class _EightBit:
    """Back-to-front compositing of one pixel of an RGBA8 target, which clamps and rounds after every splat."""

    source: Source

    def fresh(self) -> list[float]:
        return [0.0] * 3

    def running(self, pixel: list[Array]) -> Array:
        return pixel[0] >= 0

    def fragment(self, splat: Splat, exponent: Array, pixel: list[Array]) -> list[Array]:
        dr = self.source.device.dr
        alpha = self.source.alpha(splat, exponent)
        out = []
        for value, below in zip(splat.values, pixel, strict=False):
            added = alpha * value
            over = dr.fma(-alpha, below, dr.select(added < 1, added, 1) + below)
            level = dr.floor(dr.fma(dr.select(over < 1, over, 1), 255, 0.5)) * (1 / 255)
            out.append(dr.select(exponent > 0, level, below))
        return out


def blend(source: Source, lists: TileLists, band: Band, frame: Frame) -> None:
    """Blend a band's tiles into `frame`, front to back."""
    over = _Over(source)
    states = for_each_tile(source.device, lists, band, source.load, source.exponents, over)
    values = 4 + source.channels  # slots: transmittance, colour, other values, depth, median
    images = {"transmittance": range(1), "color": range(1, 4)}
    if source.channels:
        images["values"] = range(4, values)
    if source.depth:
        images |= {"depth": range(values, values + 1), "median": range(values + 1, values + 2)}
    untile(source.device, states, len(over.fresh()), band, frame, images)


def blend_eight_bit(source: Source, lists: TileLists, band: Band, frame: Frame) -> None:
    """Blend a band's colours as the engine's RGBA8 target does. The records run back to front."""
    program = _EightBit(source)
    states = for_each_tile(source.device, lists, band, source.load, source.exponents, program)
    untile(source.device, states, len(program.fresh()), band, frame, {"color": range(3)})

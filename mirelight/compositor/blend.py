"""The blend: front to back over tiles, with colour, depths and any other per-splat values in one pass."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from mirelight.compositor.bin import Band, TileLists
from mirelight.compositor.device import Array, Device
from mirelight.compositor.engine import edge_function
from mirelight.compositor.kernel import FragmentRule
from mirelight.compositor.queue import Pixels, for_each_tile
from mirelight.compositor.record import (
    BLUE,
    DEPTH,
    EDGE_X,
    EDGE_Y,
    HALF_LOG2E,
    OCTAVE,
    OFFSET,
    REACH,
    RECORD,
    RED,
    S11,
    S12,
    S22,
    SCALE,
    VALUE_ROW,
    X,
    Y,
)
from mirelight.compositor.resolve import Blended, untile

NEARLY_OPAQUE = 2.0**-20  # profiles without a stop of their own end a pixel here: what lies behind adds less than 1e-6
SCALE_AT, OFFSET_AT = 6, 7  # places in a splat's list of arrays
_MANTISSA, _ONE = 0x7FFFFF, 0x3F800000  # bits of a float: its fraction, and the number 1


def _exp2_coefficients(degree: int) -> list[float]:
    """Of the polynomial that `_exp2` evaluates on [1, 2), lowest power first: interpolated at Chebyshev nodes.

    2^f - f lies in (0.91, 1] for f in [0, 1), so (1 + 2^f - f) / 2 keeps one exponent; f added to its bits: 2^f / 2.
    """
    nodes = 1.5 + np.cos(np.pi * (np.arange(degree + 1) + 0.5) / (degree + 1)) / 2
    wanted = (2 + np.exp2(nodes - 1) - nodes) / 2
    return [float(c) for c in np.linalg.solve(np.vander(nodes, increasing=True), wanted)]


EXP2 = _exp2_coefficients(5)  # relative error 2e-7 (degree 4: 4e-6)


def _exp2(device: Device, steps: Array, octaves: int) -> Array:
    """2^(steps / OCTAVE - octaves), without meaning where that underflows.

    The steps are added to a float's bits, as in Schraudolph's exponential (Neural Computation 11, 1999); the polynomial
    of their fraction makes up for the bits' being linear between powers of two.
    """
    dr, types = device.dr, device.types
    bits = types.Int32(steps)
    part = dr.reinterpret_array(types.Float, (bits & _MANTISSA) | _ONE)
    scale = 2.0**-octaves
    total = types.Float(scale * EXP2[-1])
    for c in reversed(EXP2[:-1]):
        total = dr.fma(total, part, scale * c)
    return dr.reinterpret_array(types.Float, dr.reinterpret_array(types.Int32, total) + bits)


@dataclass(frozen=True, slots=True)
class Source:
    """How a splat is read, and how it becomes alphas over a tile.

    A splat is a list of arrays, one splat a lane: x, y, s11, s12, s22, reach, scale, offset, and what is accumulated:
    the edge of a half quad, colour, other values, depth.
    """

    device: Device
    rule: FragmentRule
    channels: int  # other values beside the colour
    depth: bool  # whether depths are blended
    halves: bool = False  # records are halves of quads, each with an edge

    @property
    def values(self) -> int:
        """First of a splat's arrays that is accumulated."""
        return OFFSET_AT + 1 + 2 * self.halves

    @property
    def slots(self) -> int:
        """How many numbers a splat has in the queue."""
        return self.values + 3 + self.channels + self.depth

    def load(self, data: list[Array], rank: Array, ok: Array) -> list[Array]:
        """Splats by their place in the depth order, from records and rows of other values if there are any.

        Lanes that are not `ok` read zeros, whose alpha is below the clip.
        """
        dr, types, lanes = self.device.dr, self.device.types, self.device.persistent_lanes
        row = dr.gather(types.ArrayXf, data[0], rank, ok, shape=(RECORD, lanes))
        edge = (EDGE_X, EDGE_Y) if self.halves else ()
        splat = [row[s] for s in (X, Y, S11, S12, S22, REACH, SCALE, OFFSET, *edge, *range(RED, BLUE + 1))]
        if self.channels:
            more = dr.gather(types.ArrayXf, data[1], rank, ok, shape=(VALUE_ROW, lanes))
            splat += [more[i] for i in range(self.channels)]
        if self.depth:
            splat.append(row[DEPTH])
        return splat

    def hidden(self, splat: list[Array], where: Array) -> list[Array]:
        """The splat with alpha 0 in some lanes."""
        x, y, s11, s12, s22, reach, *rest = splat
        return [x, y, s11, s12, s22, self.device.dr.select(where, 0, reach), *rest]

    @property
    def octaves(self) -> int:
        """Of exponents above those of alpha: a record of zeros has alpha 2^-octaves, which is below the clip."""
        return 0 if self.rule.truncated else int(np.ceil(-np.log2(self.rule.alpha_clip)))

    @property
    def least(self) -> float:
        """The exponent at the clip."""
        return 0 if self.rule.truncated else OCTAVE * float(np.log2(self.rule.alpha_clip) + self.octaves)

    def exponents(self, splat: list[Array], x0: Array, y0: Array) -> Iterator[Array]:
        """Exponents at every pixel of the tile whose first pixel centre is (x0, y0), row by row."""
        dr = self.device.dr
        x, y, s11, s12, s22, reach, *_ = splat
        peak = reach + self.least
        dx, dy = x0 - x, y0 - y
        edge = tuple(splat[OFFSET_AT + 1 : self.values])
        across = edge_function(self.device, edge, dx, dy) if self.halves else None
        cutoff = self.rule.cutoff
        last = None if cutoff is None else dr.maximum(peak - (HALF_LOG2E * OCTAVE) * cutoff**2, self.least)
        first = dr.fma(s11, dx, s12 * dy)
        along = [dr.fma(s11, float(i), first) if i else first for i in range(self.device.tile_width)]
        for j in range(self.device.tile_height):
            v = s22 * (dy + float(j))
            room = dr.fma(-v, v, peak)
            for i, a in enumerate(along):
                u = dr.fma(s12, float(j), a) if j else a
                exponent = dr.fma(-u, u, room)
                if across is not None:
                    inside = dr.fma(edge[0], float(i), dr.fma(edge[1], float(j), across)) > 0
                    exponent = dr.select(inside, exponent, 0)
                if last is not None:
                    exponent = dr.select(exponent > last, exponent, 0)
                yield exponent

    def hit(self, exponent: Array) -> Array:
        """Whether alpha reaches the clip."""
        return exponent > self.least

    def alpha(self, splat: list[Array], exponent: Array) -> Array:
        """Alpha where it reaches the clip."""
        dr = self.device.dr
        alpha = _exp2(self.device, exponent, self.octaves)
        if self.rule.truncated:
            return dr.fma(alpha, splat[SCALE_AT], -splat[OFFSET_AT])
        return dr.select(alpha > self.rule.alpha_max, self.rule.alpha_max, alpha)


@dataclass(frozen=True, slots=True)
class _Over:
    """Front-to-back compositing of one pixel: transmittance, sums of weight times value, median depth."""

    source: Source

    @property
    def results(self) -> int:
        return 4 + self.source.channels + 2 * self.source.depth

    def fresh(self) -> list[float]:
        stops = self.source.rule.stop is not None
        return [1.0] + [0.0] * (self.results - 1) + [1.0] * stops

    def begun(self, data: list[Array], x: Array, y: Array, fresh: Pixels) -> Pixels:
        return fresh

    def finished(self, tile: Pixels) -> Array:
        dr, stop = self.source.device.dr, self.source.rule.stop
        running = 0 if stop is None else -1
        most = tile[0][running]
        for pixel in tile[1:]:
            most = dr.select(pixel[running] > most, pixel[running], most)
        return most < (NEARLY_OPAQUE if stop is None else stop)

    def shows(self, splat: list[Array], exponent: Array, pixel: list[Array]) -> Array:
        """Whether a splat is blended."""
        return self.source.hit(exponent)

    def fragment(self, splat: list[Array], exponent: Array, pixel: list[Array]) -> list[Array]:
        dr, stop = self.source.device.dr, self.source.rule.stop
        before = pixel[0 if stop is None else -1]
        weight = dr.select(self.shows(splat, exponent, pixel), self.source.alpha(splat, exponent) * before, 0)
        left = before - weight
        kept = True if stop is None else left >= stop

        def where_kept(new: Array, old: Array) -> Array:
            return new if stop is None else dr.select(kept, new, old)

        out = [where_kept(left, pixel[0])]
        out += [
            where_kept(dr.fma(weight, v, p), p)
            for v, p in zip(splat[self.source.values :], pixel[1 : self.results - self.source.depth], strict=True)
        ]
        if self.source.depth:
            median = pixel[self.results - 1]
            out.append(dr.select(kept & (before > 0.5) & (left <= 0.5), splat[-1], median))
        return out + [left] * (stop is not None)


@dataclass(frozen=True, slots=True)
class _InFront(_Over):
    """The same of splats in front of a depth of the pixel's own, which stands behind the results.

    A splat's one other value is the depth of its far side; data holds the depths of whole tiles, and a row's length.
    """

    def fresh(self) -> list[float]:
        plain = _Over.fresh(self)
        return [*plain[: self.results], 0.0, *plain[self.results :]]

    def begun(self, data: list[Array], x: Array, y: Array, fresh: Pixels) -> Pixels:
        dr, types, device = self.source.device.dr, self.source.device.types, self.source.device
        depths, row = data[2], data[3]
        first = types.UInt32(y) * row + types.UInt32(x)
        for k, pixel in enumerate(fresh):
            place = first + k // device.tile_width * row + k % device.tile_width
            pixel[self.results] = dr.gather(types.Float, depths, place)
        return fresh

    def shows(self, splat: list[Array], exponent: Array, pixel: list[Array]) -> Array:
        return self.source.hit(exponent) & (splat[-1] < pixel[self.results])

    def fragment(self, splat: list[Array], exponent: Array, pixel: list[Array]) -> list[Array]:
        plain = _Over.fragment(self, splat, exponent, pixel)
        return [*plain[: self.results], pixel[self.results], *plain[self.results :]]


@dataclass(frozen=True, slots=True)
class _EightBit:
    """Back-to-front compositing of one pixel of an RGBA8 target, which clamps and rounds after every splat."""

    source: Source

    @property
    def results(self) -> int:
        return 3

    def fresh(self) -> list[float]:
        return [0.0] * self.results

    def begun(self, data: list[Array], x: Array, y: Array, fresh: Pixels) -> Pixels:
        return fresh

    def finished(self, tile: Pixels) -> Array:
        """Never: what lies in front comes last."""
        return tile[0][0] < 0

    def fragment(self, splat: list[Array], exponent: Array, pixel: list[Array]) -> list[Array]:
        dr = self.source.device.dr
        alpha = self.source.alpha(splat, exponent)
        out = []
        for value, below in zip(splat[self.source.values :], pixel, strict=False):
            added = alpha * value
            over = dr.fma(-alpha, below, dr.select(added < 1, added, 1) + below)
            level = dr.floor(dr.fma(dr.select(over < 1, over, 1), 255, 0.5)) * (1 / 255)
            out.append(dr.select(self.source.hit(exponent), level, below))
        return out


def blend(source: Source, data: list[Array], lists: TileLists, band: Band, frame: Blended) -> None:
    """Blend a band's tiles into `frame`, front to back.

    Args:
        data: records in depth order, and as many rows of other values where `source` has channels.
    """
    over = _Over(source)
    states = for_each_tile(source.device, lists, band, source, data, over)
    values = 4 + source.channels  # slots: transmittance, colour, other values, depth, median
    images = {"transmittance": range(1), "color": range(1, 4)}
    if source.channels:
        images["values"] = range(4, values)
    if source.depth:
        images |= {"depth": range(values, values + 1), "median": range(values + 1, values + 2)}
    untile(source.device, states, over.fresh()[: over.results], lists, band, frame, images)


def blend_in_front(source: Source, data: list[Array], lists: TileLists, band: Band, frame: Blended) -> None:
    """Blend what lies in front of a depth of each pixel's own, colour and transmittance alone.

    Args:
        data: records, one other value of each, the depth of its far side; depths of pixels, and how many in a row.
    """
    program = _InFront(source)
    states = for_each_tile(source.device, lists, band, source, data, program)
    images = {"transmittance": range(1), "color": range(1, 4)}
    untile(source.device, states, program.fresh()[: program.results], lists, band, frame, images)


def blend_eight_bit(source: Source, data: list[Array], lists: TileLists, band: Band, frame: Blended) -> None:
    """Blend a band's colours as the engine's RGBA8 target does. The records run back to front."""
    program = _EightBit(source)
    states = for_each_tile(source.device, lists, band, source, data, program)
    untile(source.device, states, program.fresh(), lists, band, frame, {"color": range(3)})

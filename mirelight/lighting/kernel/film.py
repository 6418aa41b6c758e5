"""The film: sums over samples, per pixel, in device memory."""

from __future__ import annotations

from typing import TypeAlias

import drjit as dr
import mitsuba as mi
import numpy as np
from numpy.typing import NDArray

from mirelight.lighting.develop import SURFACE, Sums
from mirelight.lighting.kernel.proxy import Point
from mirelight.lighting.kernel.types import Bool, Float, UInt32, Vector2f, Vector3f, Vector4f
from mirelight.lighting.layers import Layers
from mirelight.model import F32

# Direct and indirect light of one path, where layers are together; None where they are separate.
PathSums: TypeAlias = tuple[Vector3f, Vector3f] | None


class Film:
    """Flat sums over samples, and over squares of what each batch of samples brought.

    light: (layer, direct and indirect, pixel, rgb).
    squares: (layer, pixel, rgb) of a layer's batches, and where layers are separate those of the beauty behind them.
    surface: (pixel, SURFACE).
    Where paths that begin on inserted objects are kept apart, as many rows, and pixels, follow for those.
    parts: (layer, 2, pixel, rgb) over every second batch and over one in four; only where they are asked for.
    again: (layer, pixel of `error_estimate.chosen`, rgb) over its second samples; only once `keep` was called.
    doubt: (layer, pixel, rgb) half the difference of two fills of the cells that were read; only where some are.

    A launch writes into buffers of its own, light by batch and the rest by pass, which `close` adds to the film. There
    a path's `spot` is its pass times the launch's pixels plus pixel, its `place` likewise with its batch.
    """

    def __init__(
        self, pixels: int, layers: Layers, *, aovs: bool, parts: bool, doubt: bool = False, objects: bool = False
    ) -> None:
        self._halves = 2 if objects else 1
        count = max(len(layers.names), 1) * self._halves
        self.aovs, self.in_parts = aovs, parts
        self.separate, self._layer_count = layers.separate, count
        self._pixels = dr.opaque(mi.UInt32, pixels)
        self._layers = dr.opaque(mi.UInt32, count)
        self.sky_layer = dr.opaque(mi.UInt32, layers.environment)
        self.glow_layer = dr.opaque(mi.UInt32, layers.emission)
        first_sky, first_glow = layers.first_bounce or (layers.environment, layers.emission)
        self.met_sky_layer, self.met_glow_layer = dr.opaque(mi.UInt32, first_sky), dr.opaque(mi.UInt32, first_glow)
        self._light = dr.zeros(mi.Float, count * 2 * pixels * 3)
        self._squares = dr.zeros(mi.Float, (count + self._halves * layers.separate) * pixels * 3)
        self._surface = dr.zeros(mi.Float, pixels * SURFACE * self._halves)
        self._again: Float | None = None
        self._counted = dr.opaque(mi.Bool, True)
        self._parts = dr.zeros(mi.Float, count * 2 * pixels * 3 if parts else 1)
        self._doubt = dr.zeros(mi.Float, count * pixels * 3) if doubt else None
        self._launch, self._launch_surface, self._launch_doubt = mi.Float(0), mi.Float(0), mi.Float(0)
        self._spots, self._stride = mi.UInt32(0), mi.UInt32(0)
        dr.eval(self._light, self._squares, self._surface, self._parts, self._doubt)

    # --- in the kernel ---

    @property
    def second_half(self) -> tuple[UInt32, UInt32]:
        """How far the spots and the places of a launch lie on, of paths that begin on objects."""
        return self._spots, self._layers * self._stride

    def add_surface(self, spot: UInt32, at: Point, depth: Float, active: Bool, cover: Float | None = None) -> None:
        """Adds the surface point that one sample meets; `cover`: how much it counts; None: as one."""
        p, n, g, a = at.p, at.normal, at.geometric_normal, at.albedo
        groups: tuple[Vector4f | Vector2f, ...] = (
            mi.Vector4f(1, depth, p.x, p.y),
            mi.Vector4f(p.z, n.x, n.y, n.z),
            mi.Vector4f(g.x, g.y, g.z, a.x),
            mi.Vector2f(a.y, a.z),
        )
        for k, group in enumerate(groups):
            _add(
                self._launch_surface,
                group if cover is None else group * cover,
                spot * (SURFACE // len(group)) + k * (4 // len(group)),
                active & self._counted,
            )

    def add_openness(self, spot: UInt32, sunlit: Float, unoccluded: Float, active: Bool) -> None:
        """How much of the suns' light and of the hemisphere one sample's surface point sees, 0 to 1 each."""
        place = spot * (SURFACE // 2) + 7
        _add(self._launch_surface, mi.Vector2f(sunlit, unoccluded), place, active & self._counted)

    def add_doubt(self, spot: UInt32, layer: UInt32, value: Vector3f, active: Bool) -> None:
        """By how much one sample would be darker in one of two fills, and brighter in the other; with its sign."""
        _add(self._launch_doubt, value, layer * self._spots + spot, active & self._counted)

    def no_sums(self) -> PathSums:
        """What a path begins with; None where layers are separate."""
        return None if self.separate else (mi.Vector3f(0), mi.Vector3f(0))

    def add_light(
        self,
        sums: PathSums,
        place: UInt32,
        layer: UInt32,
        indirect: Bool,
        value: Vector3f,
        active: Bool,
    ) -> PathSums:
        """Radiance that one source brings, Vector3f.

        Where layers are not separate the film is left for `add_sums`: returned are the path's (direct, indirect).
        """
        if sums is not None:
            value = dr.select(active, value, 0)
            return sums[0] + dr.select(indirect, 0, value), sums[1] + dr.select(indirect, value, 0)
        self._add_row(place, layer, indirect, value, active)
        return sums

    def add_sums(self, sums: PathSums, place: UInt32, active: Bool) -> None:
        """What `add_light` has kept of a path that has ended."""
        if sums is not None:
            self._add_row(place, mi.UInt32(0), mi.Bool(False), sums[0], active)
            self._add_row(place, mi.UInt32(0), mi.Bool(True), sums[1], active)

    def _add_row(self, place: UInt32, layer: UInt32, indirect: Bool, value: Vector3f, active: Bool) -> None:
        row = layer * 2 + dr.select(indirect, mi.UInt32(1), mi.UInt32(0))
        _add(self._launch, value, row * self._stride + place, active)

    # --- between kernels ---

    def open(self, pixels: int, batches: int, passes: int, *, counted: bool = True) -> None:
        """Room for one launch: light (layer, direct and indirect, batch, pixel, rgb), doubt (layer, pass, pixel, rgb)
        and surface (pass, pixel, SURFACE).

        Not counted: a launch for `keep`, which leaves the surface and the doubt as they are.
        """
        self._counted = dr.opaque(mi.Bool, counted)
        spots = passes * pixels
        self._spots, self._stride = dr.opaque(mi.UInt32, spots), dr.opaque(mi.UInt32, batches * pixels)
        self._launch = dr.zeros(mi.Float, self._layer_count * 2 * batches * pixels * 3)
        self._launch_surface = dr.zeros(mi.Float, self._halves * spots * SURFACE)
        self._launch_doubt = dr.zeros(mi.Float, 1 if self._doubt is None else self._layer_count * spots * 3)
        dr.eval(self._launch, self._launch_surface, self._launch_doubt)

    def close(self, pixels: UInt32, first_batches: UInt32, count: int, batches: int, passes: int) -> None:
        """Run what has been recorded, then add the launch to the film.

        Args:
            pixels: UInt32 (count,) the film's pixel of each of the launch's, no two alike.
            first_batches: UInt32 (count,) how many batches each had before.
            count: pixels of the launch.
            batches: of each pixel in the launch.
            passes: of the launch.
        """
        dr.eval(self._launch, self._launch_surface, self._launch_doubt)
        n, b = dr.opaque(mi.UInt32, count * 3), dr.opaque(mi.UInt32, batches)
        lane = dr.arange(mi.UInt32, self._layer_count * count * 3)
        layer = lane // n
        here = lane - layer * n
        pixel = dr.gather(mi.UInt32, pixels, here // 3)
        place = 3 * pixel + here % 3
        first = layer * 2 * b * n + here
        row = 3 * self._pixels
        direct, indirect, squares = _layer_sums(self._launch, first, b, n)
        _put(self._light, direct, layer * 2 * row + place)
        _put(self._light, indirect, (layer * 2 + 1) * row + place)
        _put(self._squares, squares, layer * row + place)
        if self.in_parts:
            before = dr.gather(mi.UInt32, first_batches, here // 3)
            even, fourth = _part_sums(self._launch, first, before, b, n)
            _put(self._parts, even, layer * 2 * row + place)
            _put(self._parts, fourth, (layer * 2 + 1) * row + place)
        times = dr.opaque(mi.UInt32, passes)
        if self._doubt is not None:
            _put(self._doubt, _sums(self._launch_doubt, layer * times * n + here, times, n), layer * row + place)
        dr.eval(self._light, self._squares, self._parts, self._doubt)
        self._close_surface(pixels, count, times)
        if self.separate:
            here = dr.arange(mi.UInt32, count * 3)
            place = 3 * dr.gather(mi.UInt32, pixels, here // 3) + here % 3
            rows = 2 * self._layers // self._halves
            for half in range(self._halves):
                squares = _squared_batches(self._launch, here + half * rows * b * n, b, n, rows)
                _put(self._squares, squares, (self._layers + half) * row + place)
            dr.eval(self._squares)
        self._forget_launch()

    def _close_surface(self, pixels: UInt32, count: int, passes: UInt32) -> None:
        lane, n = dr.arange(mi.UInt32, self._halves * count * SURFACE), dr.opaque(mi.UInt32, count * SURFACE)
        half = lane // n
        here = lane - half * n
        pixel = half * self._pixels + dr.gather(mi.UInt32, pixels, here // SURFACE)
        sums = _sums(self._launch_surface, half * passes * n + here, passes, n)
        _put(self._surface, sums, pixel * SURFACE + here % SURFACE)
        dr.eval(self._surface)

    def _forget_launch(self) -> None:
        """Ends a launch: what it wrote is in the film."""
        self._launch, self._launch_surface, self._launch_doubt = mi.Float(0), mi.Float(0), mi.Float(0)
        dr.sync_thread()

    def keep(self, first: int, count: int, batches: int, pixels: int) -> None:
        """Run what has been recorded, and add the launch to the second samples.

        Args:
            first: place of the launch's first pixel among those that are sampled twice.
            count: pixels of the launch.
            batches: of each pixel in the launch.
            pixels: that are sampled twice.
        """
        if self._again is None:
            self._again = dr.zeros(mi.Float, self._layer_count * pixels * 3)
        dr.eval(self._launch, self._again)
        n, b = dr.opaque(mi.UInt32, count * 3), dr.opaque(mi.UInt32, batches)
        lane = dr.arange(mi.UInt32, self._layer_count * count * 3)
        layer = lane // n
        here = lane - layer * n
        direct, indirect, _ = _layer_sums(self._launch, layer * 2 * b * n + here, b, n)
        place = layer * dr.opaque(mi.UInt32, 3 * pixels) + dr.opaque(mi.UInt32, 3 * first) + here
        _put(self._again, direct + indirect, place)
        dr.eval(self._again)
        self._forget_launch()

    def beauty(self) -> tuple[F32, F32, F32, F32 | None]:
        """NumPy arrays, flat: the beauty's sums (pixel, rgb), those of its squared batches, samples that hit, and the
        beauty's doubt (pixel, rgb), None where nothing was read. Of a film that keeps objects apart, first those of the
        surface, then those of objects."""
        size = dr.width(self._surface) // SURFACE * 3
        lane, row = dr.arange(mi.UInt32, size), 3 * self._pixels
        half, rows = lane // row, 2 * self._layers // self._halves
        total = _sums(self._light, lane + half * (rows - 1) * row, rows, row)
        hits = dr.gather(mi.Float, self._surface, dr.arange(mi.UInt32, size // 3) * SURFACE)
        doubt = None if self._doubt is None else self._doubt.numpy().reshape(-1, size).sum(axis=0)
        return total.numpy(), self._squares.numpy()[-size:], hits.numpy(), doubt

    def on_objects(self) -> NDArray[np.float32]:
        """(pixels,) how many paths began on inserted objects, of a film that keeps those apart."""
        size = dr.width(self._surface) // SURFACE
        hits = dr.gather(mi.Float, self._surface, dr.arange(mi.UInt32, size) * SURFACE).numpy()
        return np.asarray(hits[size // 2 :], np.float32)

    def sums(self) -> Sums:
        """Everything; on a CPU the film's own memory, which `develop` turns into means in place."""
        parts = self._parts.numpy() if self.in_parts else None
        doubt = None if self._doubt is None else self._doubt.numpy()
        again = None if self._again is None else self._again.numpy()
        return Sums(self._light.numpy(), self._squares.numpy(), self._surface.numpy(), parts, doubt, again)


@dr.syntax
def _layer_sums(launch: Float, place: UInt32, batches: UInt32, stride: UInt32) -> tuple[Float, Float, Float]:
    """(direct, indirect, sum of squared batches) of one layer and channel."""
    direct, indirect, squares, batch = mi.Float(0), mi.Float(0), mi.Float(0), mi.UInt32(0)
    while batch < batches:
        d = dr.gather(mi.Float, launch, place + batch * stride)
        i = dr.gather(mi.Float, launch, place + (batch + batches) * stride)
        direct += d
        indirect += i
        squares += dr.square(d + i)
        batch += 1
    return direct, indirect, squares


@dr.syntax
def _part_sums(launch: Float, place: UInt32, before: UInt32, batches: UInt32, stride: UInt32) -> tuple[Float, Float]:
    """(batches 0, 2, 4 …, batches 1, 5, 9 …), each summed, of one layer and channel."""
    second, fourth, batch = mi.Float(0), mi.Float(0), mi.UInt32(0)
    while batch < batches:
        d = dr.gather(mi.Float, launch, place + batch * stride)
        i = dr.gather(mi.Float, launch, place + (batch + batches) * stride)
        number = before + batch
        second += dr.select((number & 1) == 0, d + i, 0)
        fourth += dr.select((number & 3) == 1, d + i, 0)
        batch += 1
    return second, fourth


@dr.syntax
def _squared_batches(launch: Float, place: UInt32, batches: UInt32, stride: UInt32, rows: UInt32) -> Float:
    """Sum of squared batches of one channel of the beauty, which is the sum over all rows of layers."""
    squares, batch = mi.Float(0), mi.UInt32(0)
    while batch < batches:
        total, row = mi.Float(0), mi.UInt32(0)
        while row < rows:
            total += dr.gather(mi.Float, launch, place + (row * batches + batch) * stride)
            row += 1
        squares += dr.square(total)
        batch += 1
    return squares


@dr.syntax
def _sums(rows: Float, place: UInt32, count: UInt32, stride: UInt32) -> Float:
    """Of so many rows from a place on."""
    total, row = mi.Float(0), mi.UInt32(0)
    while row < count:
        total += dr.gather(mi.Float, rows, row * stride + place)
        row += 1
    return total


def _put(target: Float, value: Float, place: UInt32) -> None:
    """Add where no two lanes meet."""
    dr.scatter_reduce(dr.ReduceOp.Add, target, value, place, mode=dr.ReduceMode.NoConflicts)


def _add(target: Float, value: Float | Vector2f | Vector3f | Vector4f, place: UInt32, active: Bool) -> None:
    """Add a packet's lanes among themselves, then to the film: one order of sums whatever the number of threads."""
    dr.scatter_reduce(dr.ReduceOp.Add, target, value, place, active, mode=dr.ReduceMode.Local)

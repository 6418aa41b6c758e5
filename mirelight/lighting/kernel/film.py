"""The film: sums over samples, per pixel, in device memory."""

from __future__ import annotations

from typing import Any

import drjit as dr
import mitsuba as mi

from mirelight.lighting.develop import SURFACE
from mirelight.lighting.kernel.surface import Point
from mirelight.lighting.layers import Layers


class Film:
    """Flat sums: layers (layer, direct and indirect, pixel, rgb), surface (pixel, SURFACE), and squares (pixel, rgb) of
    what each batch of samples brought."""

    def __init__(self, pixels: int, layers: Layers) -> None:
        self.pixels = dr.opaque(mi.UInt32, pixels)
        self.sky_layer = dr.opaque(mi.UInt32, layers.environment)
        self.glow_layer = dr.opaque(mi.UInt32, layers.emission)
        self.layers = dr.zeros(mi.Float, max(len(layers.names), 1) * 2 * pixels * 3)
        self.surface = dr.zeros(mi.Float, pixels * SURFACE)
        self.squares = dr.zeros(mi.Float, pixels * 3)
        self.batches = mi.Float(0)
        dr.eval(self.layers, self.surface, self.squares)

    def add_surface(self, pixel: Any, at: Point, depth: Any, active: Any) -> None:
        """One sample's AOVs."""
        p, n, g, a = at.p, at.normal, at.geometric_normal, at.albedo
        groups = (
            mi.Vector4f(1, depth, p.x, p.y),
            mi.Vector4f(p.z, n.x, n.y, n.z),
            mi.Vector4f(g.x, g.y, g.z, a.x),
            mi.Vector4f(a.y, a.z, 0, 0),
        )
        for k, group in enumerate(groups):
            _add(self.surface, group, pixel * 4 + k, active)

    def add_light(self, pixel: Any, layer: Any, indirect: Any, value: Any, active: Any) -> None:
        """Radiance that one source brings, Vector3f."""
        place = (layer * 2 + dr.select(indirect, mi.UInt32(1), mi.UInt32(0))) * self.pixels + pixel
        _add(self.layers, value, place, active)

    def open_batches(self, pixels: int, batches: int) -> None:
        """Room for the sums of one launch's batches, (batch, pixel, rgb)."""
        self.batches = dr.zeros(mi.Float, batches * pixels * 3)
        dr.eval(self.batches)

    def add_path(self, place: Any, radiance: Any, active: Any) -> None:
        """A finished path's radiance, to its batch; `place` is batch times the launch's pixels plus pixel."""
        _add(self.batches, radiance, place, active)

    def close_batches(self, first_pixel: Any, pixels: int, batches: int) -> None:
        """Run what has been recorded, then square the batches' sums."""
        dr.eval(self.layers, self.surface, self.batches)
        place = dr.arange(mi.UInt32, pixels * 3)
        stride, count = dr.opaque(mi.UInt32, pixels * 3), dr.opaque(mi.UInt32, batches)
        squares = _sum_of_squares(self.batches, place, stride, count)
        dr.scatter_reduce(
            dr.ReduceOp.Add, self.squares, squares, first_pixel * 3 + place, mode=dr.ReduceMode.NoConflicts
        )
        dr.eval(self.squares)
        dr.sync_thread()


@dr.syntax
def _sum_of_squares(batches: Any, place: Any, stride: Any, count: Any) -> Any:
    total, batch = mi.Float(0), mi.UInt32(0)
    while batch < count:
        total += dr.square(dr.gather(mi.Float, batches, batch * stride + place))
        batch += 1
    return total


def _add(target: Any, value: Any, place: Any, active: Any) -> None:
    """Add a packet's lanes among themselves, then to the film: one order of sums whatever the number of threads."""
    dr.scatter_reduce(dr.ReduceOp.Add, target, value, place, active, mode=dr.ReduceMode.Local)

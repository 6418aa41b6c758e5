"""The film: sums over samples, per pixel, in device memory."""

from __future__ import annotations

from typing import Any

import drjit as dr
import mitsuba as mi

from mirelight.lighting.develop import SURFACE
from mirelight.lighting.kernel.surface import Point
from mirelight.lighting.layers import Layers


class Film:
    """Layers (layer, direct and indirect, pixel, rgb), surface sums (pixel, SURFACE) and squares (pixel, rgb), flat."""

    def __init__(self, pixels: int, layers: Layers) -> None:
        self.pixels = dr.opaque(mi.UInt32, pixels)
        self.sky_layer = dr.opaque(mi.UInt32, layers.environment)
        self.glow_layer = dr.opaque(mi.UInt32, layers.emission)
        self.layers = dr.zeros(mi.Float, max(len(layers.names), 1) * 2 * pixels * 3)
        self.surface = dr.zeros(mi.Float, pixels * SURFACE)
        self.squares = dr.zeros(mi.Float, pixels * 3)
        dr.eval(self.layers, self.surface, self.squares)

    def add_surface(self, pixel: Any, at: Point, depth: Any, active: Any) -> None:
        """One sample's AOVs."""
        values = [mi.Float(1), depth, *at.p, *at.normal, *at.geometric_normal, *at.albedo]
        for k, value in enumerate(values):
            dr.scatter_reduce(dr.ReduceOp.Add, self.surface, value, pixel * SURFACE + k, active)

    def add_light(self, pixel: Any, layer: Any, indirect: Any, value: Any, active: Any) -> None:
        """Radiance that one light brings, Vector3f."""
        place = (layer * 2 + dr.select(indirect, mi.UInt32(1), mi.UInt32(0))) * self.pixels + pixel
        dr.scatter_reduce(dr.ReduceOp.Add, self.layers, value, place, active)

    def add_path(self, pixel: Any, radiance: Any) -> None:
        """A finished path's radiance, squared for the variance."""
        dr.scatter_reduce(dr.ReduceOp.Add, self.squares, dr.square(radiance), pixel)

    def eval(self) -> None:
        """Run what has been recorded."""
        dr.eval(self.layers, self.surface, self.squares)
        dr.sync_thread()

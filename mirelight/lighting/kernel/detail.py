"""Colours of faces finer than at their corners (`mirelight.lighting.lattices`), on the device."""

from __future__ import annotations

import drjit as dr
import mitsuba as mi

from mirelight.lighting.kernel.memory import in_fours, integers, rgb
from mirelight.lighting.kernel.types import Bool, Point2f, UInt32, Vector3f
from mirelight.lighting.lattices import Detail


class DeviceDetail:
    """Looks colours up between the points of a face's lattice."""

    def __init__(self, detail: Detail) -> None:
        self._count = dr.opaque(mi.UInt32, len(detail.steps))
        self._steps, self._first = integers(detail.steps), integers(detail.first)
        self._colors = in_fours(detail.colors)

    @dr.syntax
    def of(self, face: UInt32, uv: Point2f, otherwise: Vector3f, active: Bool) -> Vector3f:
        """The colour at a point of a face; `otherwise` where the face has no lattice."""
        there = active & (face < self._count)
        found = mi.Vector3f(otherwise)
        if there:
            found = self._between(face, uv, otherwise, there)
        return found

    def _between(self, face: UInt32, uv: Point2f, otherwise: Vector3f, there: Bool) -> Vector3f:
        """As `of`, of faces that may have one."""
        steps = dr.gather(mi.UInt32, self._steps, face, there)
        there &= steps > 0
        first = dr.gather(mi.UInt32, self._first, face, there)
        n = mi.Float(steps)
        x, y = dr.clip(uv.x, 0, 1) * n, dr.clip(uv.y, 0, 1) * n
        j = dr.minimum(mi.UInt32(y), dr.maximum(steps, 1) - 1)
        i = dr.minimum(mi.UInt32(x), dr.maximum(steps, 1) - 1 - j)
        fx, fy = dr.clip(x - mi.Float(i), 0, 1), dr.clip(y - mi.Float(j), 0, 1)
        row = first + j * (steps + 1) - (j * dr.maximum(j, 1) - j) // 2
        above = row + (steps + 1 - j)

        def color(index: UInt32) -> Vector3f:
            return rgb(self._colors, index, there)

        over = (fx + fy > 1) & (i + j + 2 <= steps)  # the cell's other half
        corner = dr.select(over, color(above + i + 1), color(row + i))
        a, b = dr.select(over, 1 - fy, fx), dr.select(over, 1 - fx, fy)
        found = corner * dr.maximum(1 - a - b, 0) + color(row + i + 1) * a + color(above + i) * b
        return dr.select(there, found, otherwise)

"""The materials of `mirelight.lighting.materials.Atlas` on the device: factors, their textures, which are mirrors."""

from __future__ import annotations

import drjit as dr
import mitsuba as mi
import numpy as np
from numpy.typing import NDArray

from mirelight.lighting.kernel.memory import floats, integers
from mirelight.lighting.kernel.types import Bool, Corners, Float, UInt32, Vector3f, Vector4f, Weights
from mirelight.lighting.materials import ROW, TEXTURED, WRAP_CODE, pack_materials, textured
from mirelight.model import ProxyMesh

SILVER = 0.9  # what a mirror throws back, and where light that bounces meets it, to all sides
WEIGHT = 8 * TEXTURED  # float of a row


class DeviceAtlas:
    """Looks materials up by face."""

    def __init__(self, proxy: ProxyMesh) -> None:
        atlas = pack_materials(proxy)
        self.textured = textured(proxy)
        self.materials = floats(atlas.rows)
        self.material_of_face = integers(atlas.of_face)
        if atlas.texels is not None and proxy.uvs is not None:
            self.texels = floats(atlas.texels)
            self.uvs = floats(np.append(proxy.uvs.ravel(), np.zeros(4, np.float32)))

    def row(self, face: UInt32, active: Bool) -> UInt32:
        """Of a face's material."""
        return dr.gather(mi.UInt32, self.material_of_face, face, active)

    def weight(self, row: UInt32, active: Bool) -> Float:
        """Reflectance at grazing angles of what is no metal."""
        return dr.gather(mi.Float, self.materials, row * ROW + WEIGHT, active)

    def factor(self, row: UInt32, group: int, active: Bool) -> Vector4f:
        """A group of a row."""
        return dr.gather(mi.Vector4f, self.materials, row * (ROW // 4) + group, active)

    def value(self, group: int, face: UInt32, i: Corners, b: Weights, active: Bool) -> Vector3f:
        """Factor times texture of a face's material: its base colour, emission or finish."""
        row = self.row(face, active)
        factor = self.factor(row, group, active)
        value = mi.Vector3f(factor.x, factor.y, factor.z)
        if group not in self.textured:
            return value
        texel = self.texel(row, group, i, b, active)
        return value * mi.Vector3f(texel.x, texel.y, texel.z)

    def texel(self, row: UInt32, group: int, i: Corners, b: Weights, active: Bool) -> Vector4f:
        """The texture of a group, bilinear between texel centres."""
        uv = [dr.gather(mi.Vector2f, self.uvs, k, active) for k in i]
        at = mi.Point2f(uv[0] * b[0] + uv[1] * b[1] + uv[2] * b[2])
        wrap, place = self.factor(row, group, active).w, self.factor(row, group + TEXTURED, active)
        w = mi.UInt32(place.x)
        first = mi.UInt32(place.z) + (mi.UInt32(place.w) << 16)
        wrap_v = dr.floor(wrap / 3)
        x0, x1, fx = _texels_along(at.x, place.x, wrap - 3 * wrap_v)
        y0, y1, fy = _texels_along(at.y, place.y, wrap_v)

        def texel(x: UInt32, y: UInt32) -> Vector4f:
            return dr.gather(mi.Vector4f, self.texels, first + y * w + x, active)

        return dr.lerp(
            dr.lerp(texel(x0, y0), texel(x1, y0), fx),
            dr.lerp(texel(x0, y1), texel(x1, y1), fx),
            fy,
        )


def _texels_along(a: Float, size: Float, wrap: Float) -> tuple[UInt32, UInt32, Float]:
    """Along one axis: the texels before and after a coordinate, and how far it is between their centres."""
    n, repeats = mi.UInt32(size), wrap == WRAP_CODE["repeat"]
    mirrored = 1 - abs(1 - (a - 2 * dr.floor(a * 0.5)))
    inside = dr.select(repeats, a - dr.floor(a), dr.select(wrap == WRAP_CODE["mirror"], mirrored, dr.clip(a, 0, 1)))
    x = inside * size - 0.5
    low = dr.floor(x)
    before = dr.select(low < 0, dr.select(repeats, n - 1, 0), dr.minimum(mi.UInt32(dr.maximum(low, 0)), n - 1))
    after = dr.select(low + 1 >= size, dr.select(repeats, 0, n - 1), dr.minimum(mi.UInt32(low + 1), n - 1))
    return before, after, x - low


class DeviceMirrors:
    """Tells which faces are mirrors of the capture."""

    def __init__(self, faces: NDArray[np.bool_]) -> None:
        """`faces`: (F,) those that are."""
        self._faces = integers(np.append(faces, (0, 0)).astype(np.int32))

    @staticmethod
    def of(proxy: ProxyMesh, first_inserted: int | None) -> DeviceMirrors | None:
        """Of a mesh, whose faces from there on are inserted objects', which mirror by their materials; None: it has
        none."""
        if proxy.mirrors is None:
            return None
        own = np.arange(len(proxy.faces)) < (len(proxy.faces) if first_inserted is None else first_inserted)
        return DeviceMirrors(proxy.mirrors & own) if (proxy.mirrors & own).any() else None

    def are(self, face: UInt32, active: Bool) -> Bool:
        """Whether faces are."""
        return dr.gather(mi.UInt32, self._faces, face, active) > 0

    def silvered(self, face: UInt32, albedo: Vector3f, active: Bool) -> Vector3f:
        """The albedo of a point, where light that bounces meets it."""
        return dr.select(self.are(face, active), mi.Vector3f(SILVER), albedo)

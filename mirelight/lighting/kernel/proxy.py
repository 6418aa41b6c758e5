"""The proxy on the device: ray queries through Mitsuba's scene, and everything else about a surface point."""

from __future__ import annotations

from typing import NamedTuple

import drjit as dr
import mitsuba as mi
import numpy as np

from mirelight.lighting.kernel.detail import DeviceDetail
from mirelight.lighting.kernel.fresnel import fresnel, of_coat
from mirelight.lighting.kernel.memory import floats, integers, rgb
from mirelight.lighting.kernel.see_through import MOST, OFFSET, Passed, beyond
from mirelight.lighting.kernel.tables import DeviceAtlas, DeviceMirrors
from mirelight.lighting.kernel.types import (
    Bool,
    Corners,
    Float,
    Hit,
    MitsubaScene,
    Point2f,
    Point3f,
    Ray3f,
    UInt32,
    Vector3f,
    Weights,
)
from mirelight.lighting.lattices import Detail
from mirelight.lighting.materials import (
    ALPHA,
    BASE_COLOR,
    EMISSION,
    FINISH,
    LAYERS,
    NORMAL,
    SPECULAR,
    has_coats,
    has_cutouts,
    has_glass,
    is_emissive,
    is_flat,
    is_plain,
    pack_glow,
)
from mirelight.model import F32, ProxyMesh


class Finish(NamedTuple):
    """How a point reflects that has more than Lambert's law."""

    on: Bool  # it is an inserted object's, or one of a proxy whose lobes alone are traced and that has one
    metallic: Float
    roughness: Float
    specular: Vector3f  # reflectance of what is no metal, from above
    weight: Float  # the same at grazing angles
    coat: Float | None  # strength of a clear coat; None: nothing has one
    coat_alpha: Float
    transmission: Float | None = None  # share of the base that lets light through; None: nothing does


class Point(NamedTuple):
    """A surface point as the viewer sees it: both normals on the viewer's side."""

    p: Point3f  # on the triangle
    start: Point3f  # where rays leave
    geometric_normal: Vector3f
    normal: Vector3f  # shading normal
    albedo: Vector3f
    emission: Vector3f  # radiance
    finish: Finish | None = None  # where objects are inserted, or lobes traced
    smooth: Vector3f | None = None  # the shading normal without a map of normals; None: the same


class DeviceProxy:
    """The mesh in device memory and Mitsuba's scene over it. The kinds of data it has are compiled in, not values."""

    def __init__(
        self,
        proxy: ProxyMesh,
        first_inserted: int | None = None,
        *,
        lobes: bool = False,
        detail: Detail | None = None,
    ) -> None:
        """`first_inserted`: faces from there on are inserted objects', which reflect as glTF says; None: none are.
        `lobes`: what a path meets first reflects by the lobe of its material alone. `detail`: what mirrors show."""
        self.bounds = proxy.bounds
        self.lobes = lobes
        self.detail = None if detail is None else DeviceDetail(detail)
        self.has_objects = first_inserted is not None
        self.first_inserted = dr.opaque(mi.UInt32, first_inserted or 0)
        self.scene = _scene(proxy)
        self.faces = integers(np.append(proxy.faces.ravel(), np.zeros(6, np.int32)))
        self.vertices = _vectors(proxy.vertices)
        self.normals = None if proxy.normals is None else _vectors(proxy.normals)
        from_file = proxy.albedo is None
        self.colors = _vectors(proxy.vertex_colors) if from_file and proxy.vertex_colors is not None else None
        albedo = proxy.materials[0].base_color if proxy.albedo is None else proxy.albedo
        self.albedo = mi.Vector3f(*(dr.opaque(mi.Float, float(x)) for x in albedo))
        self.emissive = is_emissive(proxy)
        needed = (from_file and _needs_materials(proxy)) or self.emissive or self.has_objects or lobes
        self.atlas = DeviceAtlas(proxy) if needed else None
        if self.emissive:
            glow = pack_glow(proxy)
            self.glow_slots, self.glow_density = integers(glow.slots), floats(glow.density)
            self.glow_count = dr.opaque(mi.UInt32, len(glow.slots))
        self.colored = from_file and self.atlas is not None
        # where the proxy needs less than its objects, packets of rays that meet none of these are spared the rest
        below = first_inserted or 0
        self.flat_below = self.has_objects and is_flat(proxy, below)
        self.plain_below = self.has_objects and is_plain(proxy, below)
        self.coated, self.glassy = (self.has_objects and there(proxy) for there in (has_coats, has_glass))
        self.cut_out = self.has_objects and (has_cutouts(proxy) or self.glassy)
        self.mirrors = DeviceMirrors.of(proxy, first_inserted)

    def recolor(self, vertex_colors: F32) -> None:
        """Other vertex colours for a mesh that has some."""
        self.colors = _vectors(vertex_colors)

    # --- rays ---

    def nearest(self, ray: Ray3f, active: Bool, *, coherent: bool = False) -> Hit:
        """Mitsuba's PreliminaryIntersection3f of the nearest hit."""
        return self.seen(ray, active, coherent=coherent)[0]

    def seen(self, ray: Ray3f, active: Bool, *, coherent: bool = False) -> tuple[Hit, Passed | None]:
        """(the nearest hit, what the ray went through); None: nothing lets rays through but by not being there."""
        found = self.scene.ray_intersect_preliminary(ray, coherent=coherent, active=active)
        if not self.cut_out:
            return found, None
        found, passed = beyond(self, found, ray, active, MOST)
        return found, passed if self.glassy else None

    def blocked(self, ray: Ray3f, active: Bool) -> Bool:
        """Bool: something lies on the ray."""
        return ~self.reached(ray, active)[0]

    def reached(self, ray: Ray3f, active: Bool, *, coherent: Bool | bool = False) -> tuple[Bool, Vector3f | None]:
        """(Bool: nothing lies on the ray, what light loses on its way); None: nothing."""
        if not self.cut_out:
            return ~self.scene.ray_test(ray, coherent, active), None
        found = self.scene.ray_intersect_preliminary(ray, coherent=False, active=active)
        found, passed = beyond(self, found, ray, mi.Bool(active), 1.0)
        return ~mi.Bool(found.is_valid()), passed.tint if self.glassy else None

    # --- a surface point ---

    def at(self, face: UInt32, uv: Point2f, d: Vector3f, active: Bool) -> Point:
        """The point with barycentric coordinates `uv` on a face, seen along direction d."""
        i, b = self._around(face, uv, active)
        v = [rgb(self.vertices, k, active) for k in i]
        e1, e2 = v[1] - v[0], v[2] - v[0]
        p = v[0] + e1 * uv.x + e2 * uv.y
        longest = dr.maximum(dr.max(abs(e1)), dr.max(abs(e2)))
        ng = dr.normalize(dr.cross(e1 / longest, e2 / longest))  # scaled: a tiny face's product would underflow
        side = dr.select(dr.dot(ng, d) > 0, mi.Float(-1), mi.Float(1))
        ng = ng * side
        n, lifted = (ng, p) if self.normals is None else self._shading(face, i, v, b, p, ng, side, active)
        start = lifted + ng * (OFFSET * (dr.max(abs(p)) + longest))
        albedo, emission = self._material(face, i, b, active)
        finish = self._finish(face, i, b, active) if self.has_objects or self.lobes else None
        smooth = None
        if self.has_objects and self.atlas is not None and NORMAL in self.atlas.textured:
            smooth, n = n, self._mapped(face, i, b, (e1, e2), n, (ng, side, d), active)
        return Point(mi.Point3f(p), mi.Point3f(start), ng, n, albedo, emission, finish, smooth)

    def alpha(self, face: UInt32, uv: Point2f, active: Bool) -> tuple[Float, Float]:
        """(how much of a point is there, below which alpha nothing is; 0: as much as alpha says)."""
        row = self._atlas.row(face, active)
        factor = self._atlas.factor(row, ALPHA, active)
        alpha = factor.x
        if ALPHA in self._atlas.textured:
            alpha = alpha * self._atlas.texel(row, ALPHA, *self._around(face, uv, active), active).x
        return alpha, dr.select(factor.z > 0, factor.y, 0)

    def through(self, face: UInt32, uv: Point2f, d: Vector3f, active: Bool) -> Vector3f:
        """What of light along d goes straight on behind a point of glass."""
        i, b = self._around(face, uv, active)
        finish, (base, _) = self._finish(face, i, b, active), self._material(face, i, b, active)
        v = [rgb(self.vertices, k, active) for k in i]
        cosine = abs(dr.dot(dr.normalize(dr.cross(v[1] - v[0], v[2] - v[0])), d))
        kept = (1 - fresnel(finish.specular, finish.weight, cosine)) * (finish.transmission * (1 - finish.metallic))
        if finish.coat is not None:
            kept *= 1 - of_coat(finish.coat, cosine)
        return dr.select(active, kept * base, 0)

    @property
    def _atlas(self) -> DeviceAtlas:
        """The materials, where there are some."""
        assert self.atlas is not None
        return self.atlas

    def _around(self, face: UInt32, uv: Point2f, active: Bool) -> tuple[Corners, Weights]:
        """(the corners of a face, their weights at a point)."""
        i = [dr.gather(mi.UInt32, self.faces, face * 3 + k, active) for k in range(3)]
        return i, (1 - uv.x - uv.y, uv.x, uv.y)

    def shows_front(self, face: UInt32, d: Vector3f, active: Bool) -> Bool:
        """Whether a ray along d meets a face from the side that its winding points to."""
        a, b, c = (rgb(self.vertices, dr.gather(mi.UInt32, self.faces, face * 3 + k, active), active) for k in range(3))
        return dr.dot(dr.cross(b - a, c - a), d) < 0

    def is_inserted(self, face: UInt32) -> Bool:
        """Whether a face is an object's."""
        return face >= self.first_inserted

    def glow_pdf(self, face: UInt32, distance: Float, cosine: Float, active: Bool) -> Float:
        """Density per solid angle of `sample_glow` at a point that far away on a face that slanted."""
        density = dr.gather(mi.Float, self.glow_density, face, active)
        return dr.select(cosine > 1e-6, density * dr.square(distance) / cosine, 0)

    def sample_glow(
        self, p: Point3f, choice: Float, inside: Point2f, active: Bool
    ) -> tuple[Vector3f, Float, Float, Vector3f]:
        """A point on an emissive face: (way to it, distance, density per solid angle, its radiance)."""
        slot = dr.minimum(mi.UInt32(choice * mi.Float(self.glow_count)), self.glow_count - 1)
        face = dr.gather(mi.UInt32, self.glow_slots, slot, active)
        i = [dr.gather(mi.UInt32, self.faces, face * 3 + k, active) for k in range(3)]
        v = [rgb(self.vertices, k, active) for k in i]
        b = mi.warp.square_to_uniform_triangle(inside)
        e1, e2 = v[1] - v[0], v[2] - v[0]
        way = v[0] + e1 * b.x + e2 * b.y - mi.Vector3f(p)
        distance = dr.norm(way)
        way = way / distance
        pdf = self.glow_pdf(face, distance, abs(dr.dot(dr.normalize(dr.cross(e1, e2)), way)), active)
        return way, distance, pdf, self._emission(face, i, (1 - b.x - b.y, b.x, b.y), active)

    @dr.syntax
    def _shading(
        self,
        face: UInt32,
        i: Corners,
        v: list[Vector3f],
        b: Weights,
        p: Vector3f,
        ng: Vector3f,
        side: Float,
        active: Bool,
    ) -> tuple[Vector3f, Vector3f]:
        """As `_smooth`, where there is anything smooth."""
        n, lifted = mi.Vector3f(ng), mi.Vector3f(p)
        bent = active
        if dr.hint(self.flat_below, mode="scalar"):
            bent = active & self.is_inserted(face)
            if bent:
                n, lifted = self._smooth(i, v, b, p, ng, side, bent)
        else:
            n, lifted = self._smooth(i, v, b, p, ng, side, bent)
        return n, lifted

    def _smooth(
        self, i: Corners, v: list[Vector3f], b: Weights, p: Vector3f, ng: Vector3f, side: Float, active: Bool
    ) -> tuple[Vector3f, Vector3f]:
        """Shading normal, and p lifted onto the smooth surface that the vertex normals describe.

        Rays start from the lifted point, so facets do not shadow their neighbours at the terminator (Hanika, "Hacking
        the Shadow Terminator", Ray Tracing Gems II, 2021).
        """
        ns = [rgb(self.normals, k, active) * side for k in i]
        n = ns[0] * b[0] + ns[1] * b[1] + ns[2] * b[2]
        length2 = dr.squared_norm(n)
        n = dr.select(length2 > 1e-12, n * dr.rsqrt(length2), ng)
        n = dr.select(dr.dot(n, ng) > 0, n, ng)  # a normal that contradicts its face is no use
        lifted = mi.Vector3f(p)
        for k in range(3):
            lifted -= ns[k] * (b[k] * dr.minimum(dr.dot(p - v[k], ns[k]), 0))
        return n, lifted

    def _material(self, face: UInt32, i: Corners, b: Weights, active: Bool) -> tuple[Vector3f, Vector3f]:
        albedo, emission = mi.Vector3f(self.albedo), mi.Vector3f(0)
        if self.emissive:
            emission = self._emission(face, i, b, active)
        if self.colored:
            albedo = self._base_color(face, i, b, active)
        if self.colors is not None:
            c = [rgb(self.colors, k, active) for k in i]
            albedo = albedo * (c[0] * b[0] + c[1] * b[1] + c[2] * b[2])
        if self.mirrors is not None:
            albedo = self.mirrors.silvered(face, albedo, active)
        return dr.clip(albedo, 0, 1), emission

    @dr.syntax
    def _base_color(self, face: UInt32, i: Corners, b: Weights, active: Bool) -> Vector3f:
        """Of a face's material."""
        albedo = mi.Vector3f(self.albedo)
        if dr.hint(self.plain_below, mode="scalar"):
            inserted = active & self.is_inserted(face)
            if inserted:
                albedo = self._atlas.value(BASE_COLOR, face, i, b, inserted)
        else:
            albedo = self._atlas.value(BASE_COLOR, face, i, b, active)
        return albedo

    def _emission(self, face: UInt32, i: Corners, b: Weights, active: Bool) -> Vector3f:
        """Radiance of a glowing point."""
        return self._atlas.value(EMISSION, face, i, b, active)

    def _finish(self, face: UInt32, i: Corners, b: Weights, active: Bool) -> Finish:
        if self.lobes:
            metallic, roughness, specular, weight, layers = self._reflectances(face, i, b, active)
            on = (metallic > 0) | (roughness < 1)
            if self.mirrors is not None:
                on &= ~self.mirrors.are(face, active)
        else:
            on = self.is_inserted(face)
            metallic, roughness, specular, weight, layers = self._of_objects(face, i, b, active & on)
        return Finish(
            on=on,
            metallic=metallic,
            roughness=roughness,
            specular=specular,
            weight=weight,
            coat=layers.x if self.coated else None,
            coat_alpha=dr.maximum(dr.square(layers.y), 1e-3),
            transmission=dr.select(on, layers.z, 0) if self.glassy else None,
        )

    @dr.syntax
    def _of_objects(
        self, face: UInt32, i: Corners, b: Weights, there: Bool
    ) -> tuple[Float, Float, Vector3f, Float, Vector3f]:
        """As `_reflectances`; packets of lanes with nothing there are spared them, and are matt."""
        metallic, roughness, weight = mi.Float(0), mi.Float(1), mi.Float(0)
        specular, layers = mi.Vector3f(0), mi.Vector3f(0)
        if there:
            metallic, roughness, specular, weight, layers = self._reflectances(face, i, b, there)
        return metallic, roughness, specular, weight, layers

    def _reflectances(
        self, face: UInt32, i: Corners, b: Weights, active: Bool
    ) -> tuple[Float, Float, Vector3f, Float, Vector3f]:
        """(metallic, roughness, specular reflectance, the same at grazing angles, layers over that)."""
        atlas = self._atlas
        value, row = atlas.value(FINISH, face, i, b, active), atlas.row(face, active)
        specular, weight = atlas.value(SPECULAR, face, i, b, active), atlas.weight(row, active)
        if SPECULAR in atlas.textured:
            share = atlas.texel(row, SPECULAR, i, b, active).w
            specular, weight = specular * share, weight * share
        layers = atlas.value(LAYERS, face, i, b, active) if self.coated or self.glassy else mi.Vector3f(0)
        return dr.clip(value.z, 0, 1), dr.clip(value.y, 0, 1), specular, weight, layers

    def _mapped(
        self,
        face: UInt32,
        corners: Corners,
        weights: Weights,
        edges: tuple[Vector3f, Vector3f],
        n: Vector3f,
        seen: tuple[Vector3f, Float, Vector3f],
        active: Bool,
    ) -> Vector3f:
        """The shading normal as an object's map has it, by tangents of each face's texture coordinates.

        `seen`: the face's normal, 1 from outside and -1 from inside, the way of the ray.
        """
        ng, side, d = seen
        row = self._atlas.row(face, active)
        factor = self._atlas.factor(row, NORMAL, active)
        texel = self._atlas.texel(row, NORMAL, corners, weights, active)
        t = 2 * mi.Vector3f(texel.x, texel.y, texel.z) - 1
        uv = [dr.gather(mi.Vector2f, self._atlas.uvs, k, active) for k in corners]
        a, b, (e1, e2) = uv[1] - uv[0], uv[2] - uv[0], edges
        turned = dr.select(a.x * b.y - a.y * b.x < 0, mi.Float(-1), mi.Float(1))
        front = n * side
        u = (e1 * b.y - e2 * a.y) * turned
        u -= front * dr.dot(front, u)
        v = (e1 * b.x - e2 * a.x) * turned  # against v, which goes down a picture
        length2 = dr.squared_norm(u)
        on = active & self.is_inserted(face) & (factor.x > 0) & (length2 > 1e-30)
        u = u * dr.select(on, dr.rsqrt(length2), 0)
        up = dr.cross(front, u)
        up = dr.select(dr.dot(up, v) < 0, -up, up)
        mapped = (u * (t.x * factor.x) + up * (t.y * factor.x) + front * dr.maximum(t.z, 1e-3)) * side
        mapped = dr.normalize(mapped)
        low = 0.01 - dr.dot(mapped, -d)  # turned away from the viewer it would be black
        mapped = dr.select(low > 0, dr.normalize(mapped - d * low), mapped)
        return dr.select(on & (dr.dot(mapped, ng) > 0), mapped, n)


def _vectors(rows: F32) -> Float:
    """(n, 3) as a flat buffer of n + 2 groups of four, which one packet gather reads."""
    padded = np.zeros((len(rows) + 2, 4), np.float32)
    padded[: len(rows), :3] = rows
    return floats(padded)


def _scene(proxy: ProxyMesh) -> MitsubaScene:
    mesh = mi.Mesh("proxy", vertex_count=len(proxy.vertices), face_count=len(proxy.faces))
    if len(proxy.faces):
        parameters = mi.traverse(mesh)
        parameters["vertex_positions"] = mi.Float(proxy.vertices.ravel())
        parameters["faces"] = mi.UInt32(proxy.faces.astype(np.uint32).ravel())
        parameters.update()
    return mi.load_dict({"type": "scene", "proxy": mesh})


def _needs_materials(proxy: ProxyMesh) -> bool:
    return len(proxy.materials) > 1 or any(m.base_color_texture is not None for m in proxy.materials)

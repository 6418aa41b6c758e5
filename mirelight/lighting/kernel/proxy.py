"""The proxy on the device: ray queries through Mitsuba's scene, and everything else about a surface point."""

from __future__ import annotations

from typing import NamedTuple

import drjit as dr
import mitsuba as mi
import numpy as np

from mirelight.lighting.kernel.memory import floats, integers
from mirelight.lighting.kernel.samples import mix, number
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
    Vector4f,
    Weights,
)
from mirelight.lighting.materials import (
    ROW,
    TEXTURED,
    WRAP_CODE,
    Atlas,
    has_coats,
    has_cutouts,
    has_emissive_texture,
    is_emissive,
    pack_glow,
    pack_materials,
)
from mirelight.model import F32, F64, ProxyMesh

# A ray starts this far off the surface, times the largest coordinate there plus the triangle's longest edge: 64 times
# the rounding of single precision, above the error of barycentric interpolation and of Embree's intersection.
OFFSET = 2.0**-18

BASE_COLOR, EMISSION, FINISH, NORMAL, ALPHA = range(TEXTURED)  # groups of an atlas row; textures' places follow
SPECULAR, COAT = 2 * TEXTURED, 2 * TEXTURED + 1
_LAYERS = 64  # that a ray passes of what is not wholly there


class Finish(NamedTuple):
    """How a point reflects that has more than Lambert's law."""

    on: Bool  # it is an inserted object's, or one of a proxy whose lobes alone are traced and that has one
    metallic: Float
    roughness: Float
    specular: Vector3f  # reflectance of what is no metal, from above
    weight: Float  # the same at grazing angles
    coat: Float | None  # strength of a clear coat; None: nothing has one
    coat_alpha: Float


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

    def __init__(self, proxy: ProxyMesh, first_inserted: int | None = None, *, lobes: bool = False) -> None:
        """`first_inserted`: faces from there on are inserted objects', which reflect as glTF says; None: none are.
        `lobes`: what a path meets first reflects by the lobe of its material alone."""
        self.bounds = proxy.bounds
        self.lobes = lobes
        self.has_objects = first_inserted is not None
        self.first_inserted = dr.opaque(mi.UInt32, first_inserted or 0)
        self.scene = _scene(proxy)
        self.faces = integers(np.append(proxy.faces.ravel(), np.zeros(6, np.int32)))
        self.vertices = _vectors(proxy.vertices)
        self.normals = None if proxy.normals is None else _vectors(proxy.normals)
        from_file = proxy.albedo is None
        self.colors = _vectors(proxy.vertex_colors) if from_file and proxy.vertex_colors is not None else None
        self.albedo = mi.Vector3f(*(dr.opaque(mi.Float, float(x)) for x in _constant_albedo(proxy)))
        self.emissive = is_emissive(proxy)
        self.atlas: Atlas | None = None
        if (from_file and _needs_materials(proxy)) or self.emissive or self.has_objects or lobes:
            self.atlas = pack_materials(proxy)
            self.materials = floats(self.atlas.rows)
            self.material_of_face = integers(self.atlas.of_face)
        if self.emissive:
            glow = pack_glow(proxy)
            self.glow_slots, self.glow_density = integers(glow.slots), floats(glow.density)
            self.glow_count = dr.opaque(mi.UInt32, len(glow.slots))
        self.colored = from_file and self.atlas is not None
        self.textured = self.colored and proxy.uvs is not None and _has_base_texture(proxy)
        self.glow_textured = has_emissive_texture(proxy)
        self.finish_textured = proxy.uvs is not None and any(m.finish_texture is not None for m in proxy.materials)
        self.normal_textured = proxy.uvs is not None and any(m.normal_texture is not None for m in proxy.materials)
        self.alpha_textured = proxy.uvs is not None and any(m.alpha_texture is not None for m in proxy.materials)
        self.coated, self.cut_out = self.has_objects and has_coats(proxy), self.has_objects and has_cutouts(proxy)
        if self.atlas is not None and self.atlas.texels is not None and proxy.uvs is not None:
            self.texels = floats(self.atlas.texels)
            self.uvs = floats(np.append(proxy.uvs.ravel(), np.zeros(4, np.float32)))

    def recolor(self, vertex_colors: F32) -> None:
        """Other vertex colours for a mesh that has some."""
        self.colors = _vectors(vertex_colors)

    # --- rays ---

    def nearest(self, ray: Ray3f, active: Bool, *, coherent: bool = False) -> Hit:
        """Mitsuba's PreliminaryIntersection3f of the nearest hit."""
        found = self.scene.ray_intersect_preliminary(ray, coherent=coherent, active=active)
        return self._beyond(found, ray, active) if self.cut_out else found

    @dr.syntax
    def _beyond(self, found: Hit, ray: Ray3f, active: Bool) -> Hit:
        """The hit, or the first one behind it of what is there."""
        passing, layers = active & self._is_clear(found, ray, active), mi.UInt32(0)
        while passing & (layers < _LAYERS):
            gone = mi.Float(found.t)
            step = mi.Ray3f(ray)
            start = ray.o + ray.d * gone
            lift = OFFSET * (dr.max(abs(start)) + gone * dr.max(abs(ray.d)))
            skipped = gone + lift / dr.norm(ray.d)
            step.o = ray.o + ray.d * skipped
            step.maxt = ray.maxt - skipped
            found = self.scene.ray_intersect_preliminary(step, active=passing)
            found.t = found.t + skipped
            passing &= self._is_clear(found, ray, passing)
            layers += 1
        return found

    def _is_clear(self, found: Hit, ray: Ray3f, active: Bool) -> Bool:
        """Whether a hit is at a place where an object is not: by its cutoff, or drawn by its alpha."""
        face, uv = mi.UInt32(found.prim_index), mi.Point2f(found.prim_uv)
        hit = active & found.is_valid() & self.is_inserted(face)
        i = [dr.gather(mi.UInt32, self.faces, face * 3 + k, hit) for k in range(3)]
        b = (1 - uv.x - uv.y, uv.x, uv.y)
        row = dr.gather(mi.UInt32, self.material_of_face, face, hit) * (ROW // 4) + ALPHA
        factor = dr.gather(mi.Vector4f, self.materials, row, hit)
        alpha = factor.x
        if self.alpha_textured:
            alpha = alpha * self._texel_of(row, factor.w, i, b, hit).x
        salt = mix(mix(dr.reinterpret_array(mi.UInt32, uv.x), dr.reinterpret_array(mi.UInt32, uv.y)), face)
        drawn = number(mix(salt, dr.reinterpret_array(mi.UInt32, ray.d.x)), mi.UInt32(0))
        return hit & (alpha < dr.select(factor.z > 0, factor.y, drawn))

    def blocked(self, ray: Ray3f, active: Bool, *, coherent: Bool | bool = False) -> Bool:
        """Bool: something lies on the ray. `coherent` (Bool): lanes side by side go nearly the same way."""
        if self.cut_out:
            return mi.Bool(self.nearest(ray, mi.Bool(active)).is_valid())
        return self.scene.ray_test(ray, coherent, active)

    # --- a surface point ---

    def at(self, face: UInt32, uv: Point2f, d: Vector3f, active: Bool) -> Point:
        """The point with barycentric coordinates `uv` on a face, seen along direction d."""
        i = [dr.gather(mi.UInt32, self.faces, face * 3 + k, active) for k in range(3)]
        v = [self._vector(self.vertices, k, active) for k in i]
        b = (1 - uv.x - uv.y, uv.x, uv.y)
        e1, e2 = v[1] - v[0], v[2] - v[0]
        p = v[0] + e1 * uv.x + e2 * uv.y
        longest = dr.maximum(dr.max(abs(e1)), dr.max(abs(e2)))
        ng = dr.normalize(dr.cross(e1 / longest, e2 / longest))  # scaled: a tiny face's product would underflow
        side = dr.select(dr.dot(ng, d) > 0, mi.Float(-1), mi.Float(1))
        ng = ng * side
        n, lifted = (ng, p) if self.normals is None else self._smooth(i, v, b, p, ng, side, active)
        start = lifted + ng * (OFFSET * (dr.max(abs(p)) + longest))
        albedo, emission = self._material(face, i, b, active)
        finish = self._finish(face, i, b, active) if self.has_objects or self.lobes else None
        smooth = None
        if self.has_objects and self.normal_textured:
            smooth, n = n, self._mapped(face, i, b, (e1, e2), n, (ng, side, d), active)
        return Point(mi.Point3f(p), mi.Point3f(start), ng, n, albedo, emission, finish, smooth)

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
        v = [self._vector(self.vertices, k, active) for k in i]
        b = mi.warp.square_to_uniform_triangle(inside)
        e1, e2 = v[1] - v[0], v[2] - v[0]
        way = v[0] + e1 * b.x + e2 * b.y - mi.Vector3f(p)
        distance = dr.norm(way)
        way = way / distance
        pdf = self.glow_pdf(face, distance, abs(dr.dot(dr.normalize(dr.cross(e1, e2)), way)), active)
        return way, distance, pdf, self._emission(face, i, (1 - b.x - b.y, b.x, b.y), active)

    def _vector(self, buffer: Float, index: UInt32, active: Bool) -> Vector3f:
        q = dr.gather(mi.Vector4f, buffer, index, active)
        return mi.Vector3f(q.x, q.y, q.z)

    def _smooth(
        self, i: Corners, v: list[Vector3f], b: Weights, p: Vector3f, ng: Vector3f, side: Float, active: Bool
    ) -> tuple[Vector3f, Vector3f]:
        """Shading normal, and p lifted onto the smooth surface that the vertex normals describe.

        Rays start from the lifted point, so facets do not shadow their neighbours at the terminator (Hanika, "Hacking
        the Shadow Terminator", Ray Tracing Gems II, 2021).
        """
        ns = [self._vector(self.normals, k, active) * side for k in i]
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
            albedo = self._of_material(BASE_COLOR, face, i, b, active, textured=self.textured)
        if self.colors is not None:
            c = [self._vector(self.colors, k, active) for k in i]
            albedo = albedo * (c[0] * b[0] + c[1] * b[1] + c[2] * b[2])
        return dr.clip(albedo, 0, 1), emission

    def _emission(self, face: UInt32, i: Corners, b: Weights, active: Bool) -> Vector3f:
        """Radiance of a glowing point."""
        return self._of_material(EMISSION, face, i, b, active, textured=self.glow_textured)

    def _finish(self, face: UInt32, i: Corners, b: Weights, active: Bool) -> Finish:
        value = self._of_material(FINISH, face, i, b, active, textured=self.finish_textured)
        row = dr.gather(mi.UInt32, self.material_of_face, face, active) * (ROW // 4)
        specular = dr.gather(mi.Vector4f, self.materials, row + SPECULAR, active)
        coat = dr.gather(mi.Vector2f, self.materials, (row + COAT) * 2, active) if self.coated else None
        metallic, roughness = dr.clip(value.z, 0, 1), dr.clip(value.y, 0, 1)
        on = self.is_inserted(face)
        if self.lobes:
            on = (metallic > 0) | (roughness < 1)
        return Finish(
            on=on,
            metallic=metallic,
            roughness=roughness,
            specular=mi.Vector3f(specular.x, specular.y, specular.z),
            weight=specular.w,
            coat=None if coat is None else coat.x,
            coat_alpha=mi.Float(0) if coat is None else coat.y,
        )

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
        row = dr.gather(mi.UInt32, self.material_of_face, face, active) * (ROW // 4) + NORMAL
        factor = dr.gather(mi.Vector4f, self.materials, row, active)
        t = 2 * self._texel_of(row, factor.w, corners, weights, active) - 1
        uv = [dr.gather(mi.Vector2f, self.uvs, k, active) for k in corners]
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

    def _of_material(
        self, group: int, face: UInt32, i: Corners, b: Weights, active: Bool, *, textured: bool
    ) -> Vector3f:
        """Factor times texture of a face's material: its base colour, emission or finish."""
        row = dr.gather(mi.UInt32, self.material_of_face, face, active) * (ROW // 4) + group
        factor = dr.gather(mi.Vector4f, self.materials, row, active)
        value = mi.Vector3f(factor.x, factor.y, factor.z)
        if not textured:
            return value
        return value * self._texel_of(row, factor.w, i, b, active)

    def _texel_of(self, row: UInt32, wrap: Float, i: Corners, b: Weights, active: Bool) -> Vector3f:
        """The texture of a group of an atlas row."""
        uv = [dr.gather(mi.Vector2f, self.uvs, k, active) for k in i]
        at = uv[0] * b[0] + uv[1] * b[1] + uv[2] * b[2]
        place = dr.gather(mi.Vector4f, self.materials, row + TEXTURED, active)
        return self._texture(place, wrap, at, active)

    def _texture(self, place: Vector4f, wrap: Float, at: Point2f, active: Bool) -> Vector3f:
        """A texture of the atlas (`materials.Atlas`), bilinear between texel centres."""
        w = mi.UInt32(place.x)
        first = mi.UInt32(place.z) + (mi.UInt32(place.w) << 16)
        wrap_v = dr.floor(wrap / 3)
        x0, x1, fx = _texels_along(at.x, place.x, wrap - 3 * wrap_v)
        y0, y1, fy = _texels_along(at.y, place.y, wrap_v)

        def texel(x: UInt32, y: UInt32) -> Vector3f:
            return self._vector(self.texels, first + y * w + x, active)

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


def _constant_albedo(proxy: ProxyMesh) -> F64:
    return proxy.albedo if proxy.albedo is not None else proxy.materials[0].base_color


def _has_base_texture(proxy: ProxyMesh) -> bool:
    return any(m.base_color_texture is not None for m in proxy.materials)


def _needs_materials(proxy: ProxyMesh) -> bool:
    return len(proxy.materials) > 1 or _has_base_texture(proxy)

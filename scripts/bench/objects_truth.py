"""Objects of the part `objects` in Mitsuba's `path`: glTF's metallic-roughness model as a BSDF of its own.

It shares no code with `mirelight.lighting`: the formulas are those of appendix B of glTF 2.0, microscopic normals are
drawn by Trowbridge and Reitz's distribution itself.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scenegen.geometry import Part, lathe, place
from scenegen.truth import Looks, Truth

from mirelight.base.backend import mitsuba
from mirelight.model import F32, F64, Camera, Material, ProxyMesh

Bool = NDArray[np.bool_]
DIELECTRIC = 0.04
_AT_ONCE = 256  # samples of a pixel


@dataclass(frozen=True, slots=True, eq=False)
class Thing:
    """An object on the ground, and how it looks."""

    name: str
    part: Part
    base: tuple[float, float, float]
    metallic: float
    roughness: float

    @property
    def is_mirror(self) -> bool:
        """Whether what Fresnel's term leaves of white is white."""
        return self.metallic == 1 and self.roughness == 0


def things() -> tuple[Thing, ...]:
    """A gray vase, a plastic ring and a chrome ball on the courtyard's tiles."""
    turn = np.linspace(0, 2 * np.pi, 65)
    ring = lathe(np.stack([0.24 + 0.09 * np.cos(turn), 0.09 + 0.09 * np.sin(turn)], -1), "plastic", 96)
    vase = [(0, 0), (0.15, 0), (0.2, 0.06), (0.27, 0.22), (0.24, 0.4), (0.13, 0.52), (0.12, 0.6), (0.17, 0.66)]
    inside = [(0.15, 0.64), (0.1, 0.58), (0.1, 0.5), (0, 0.48)]
    half = np.linspace(-np.pi / 2, np.pi / 2, 65)
    ball = np.stack([0.3 * np.cos(half), 0.3 + 0.3 * np.sin(half)], -1)
    return (
        Thing("gray", lathe(vase + inside, "gray", 64).moved(place(-1.35, 0, 2.25)), (0.5, 0.5, 0.5), 0, 1),
        Thing("plastic", ring.moved(place(-0.62, 0, 3.0)), (0.55, 0.04, 0.03), 0, 0.3),
        Thing("chrome", lathe(ball, "chrome", 128).moved(place(-2.0, 0, 3.1)), (1.0, 1.0, 1.0), 1, 0),
    )


def surface(looks: Looks) -> ProxyMesh:
    """A scene's true surface with its textures; what is glossy of it is matt, as proxies are."""
    vertices = np.concatenate([x.positions.reshape(-1, 3) for x in looks.soups])
    uvs = [x.uvs.reshape(-1, 2) / looks.surfaces[x.material].size for x in looks.soups]
    textures = [np.ascontiguousarray(looks.surfaces[x.material].texture, np.float32) for x in looks.soups]
    return ProxyMesh(
        vertices=vertices.astype(np.float32),
        faces=np.arange(len(vertices), dtype=np.int32).reshape(-1, 3),
        normals=np.concatenate([x.normals.reshape(-1, 3) for x in looks.soups]).astype(np.float32),
        uvs=np.concatenate(uvs).astype(np.float32),
        face_materials=np.repeat(np.arange(len(textures), dtype=np.int32), [len(x.positions) for x in looks.soups]),
        materials=tuple(Material(base_color_texture=x) for x in textures),
        albedo=None,
    )


def covered_by(ball: Thing, camera: Camera) -> Bool:
    """(H, W) pixels that a ball fills, whatever stands before it."""
    low, high = ball.part.vertices.min(0), ball.part.vertices.max(0)
    centre, radius = (low + high) / 2, float((high - low).min()) / 2
    inside = np.ones((camera.height, camera.width), bool)
    for shift in ((0, 0), (0, 1), (1, 0), (1, 1)):
        ways = _ways(camera, np.argwhere(np.ones_like(inside)), np.array(shift, float))
        to = centre - camera.world_from_camera[:3, 3]
        off = np.linalg.norm(to - (ways @ to)[:, None] * ways, axis=1).reshape(inside.shape)
        inside &= off < radius
    return inside


def seen_along(scene: Truth, camera: Camera, pixels: NDArray[np.int64], spp: int, seed: int) -> F32:
    """(N, 3) radiance of pixels (N, 2), row and column, each with so many samples."""
    rng, total = np.random.default_rng(seed), np.zeros((len(pixels), 3))
    for done in range(0, spp, _AT_ONCE):
        count = min(_AT_ONCE, spp - done)
        ways = _ways(camera, np.repeat(pixels, count, axis=0), rng.random((len(pixels) * count, 2)))
        starts = np.broadcast_to(camera.world_from_camera[:3, 3], (len(ways), 1, 3))
        every = np.full(len(ways), np.inf, np.float32)
        found, _ = scene.radiance(
            starts.astype(np.float32), ways.astype(np.float32), every, 1, seed=seed * 100_000 + done
        )
        total += found.reshape(len(pixels), count, 3).sum(axis=1, dtype=np.float64)
    return np.asarray(total / spp, np.float32)


def _ways(camera: Camera, pixels: NDArray[np.int64], within: F64) -> F64:
    """(N, 3) unit directions through places (N, 2) or (2,) within pixels (N, 2), row and column."""
    y, x = (pixels + within).T
    ways = np.stack(
        [(x - camera.width / 2) / camera.fx, (camera.height / 2 - y) / camera.fx, np.full(len(x), -1.0)], axis=-1
    )
    ways = ways @ camera.world_from_camera[:3, :3].T
    return np.asarray(ways / np.linalg.norm(ways, axis=1, keepdims=True))


def bsdf(thing: Thing) -> Any:
    """Its look, seen from both sides."""
    mi = mitsuba()
    if thing.is_mirror:
        inner = {"type": "conductor", "material": "none"}
        return mi.load_dict({"type": "twosided", "bsdf": inner})
    mi.register_bsdf("bench_gltf", _kind(mi))
    return mi.load_dict({"type": "bench_gltf", "base": {"type": "rgb", "value": list(thing.base)}, **_finish(thing)})


def _finish(thing: Thing) -> dict[str, float]:
    return {"metallic": float(thing.metallic), "alpha": float(thing.roughness) ** 2}


def _kind(mi: Any) -> Any:
    import drjit as dr

    class Gltf(mi.BSDF):  # type: ignore[misc]
        """One-sided as seen, two-sided by turning over."""

        def __init__(self, props: Any) -> None:
            super().__init__(props)
            self._base, self._metallic, self._alpha = props["base"], props["metallic"], props["alpha"]
            flags = mi.BSDFFlags.GlossyReflection | mi.BSDFFlags.FrontSide | mi.BSDFFlags.BackSide
            self.m_components = [flags]
            self.m_flags = flags

        def _value(self, si: Any, wo: Any, active: Any) -> tuple[Any, Any]:
            """(BRDF times cosine, density) of a pair of directions, turned to the side that is seen."""
            up = dr.select(mi.Frame3f.cos_theta(si.wi) < 0, -1, 1)
            v, w = mi.Vector3f(si.wi), mi.Vector3f(wo)
            v.z, w.z = v.z * up, w.z * up
            seen = active & (v.z > 0) & (w.z > 0)
            base = mi.Color3f(self._base)
            h = dr.normalize(v + w)
            f0 = dr.lerp(mi.Color3f(DIELECTRIC), base, self._metallic)
            fresnel = f0 + (1 - f0) * (1 - dr.clip(dr.dot(v, h), 0, 1)) ** 5
            a2 = self._alpha**2
            d = a2 / (dr.pi * (h.z * h.z * (a2 - 1) + 1) ** 2)

            def g(cosine: Any) -> Any:
                return 2 * cosine / (cosine + dr.sqrt(a2 + (1 - a2) * cosine * cosine))

            lobe = fresnel * d * g(v.z) * g(w.z) / (4 * v.z * w.z)
            value = ((1 - fresnel) * base * (1 - self._metallic) / dr.pi + lobe) * w.z
            pdf = 0.5 * w.z / dr.pi + 0.5 * d * h.z / (4 * dr.dot(v, h))
            return dr.select(seen, value, 0), dr.select(seen, pdf, 0)

        def sample(self, ctx: Any, si: Any, sample1: Any, sample2: Any, active: Any) -> tuple[Any, Any]:
            up = dr.select(mi.Frame3f.cos_theta(si.wi) < 0, -1, 1)
            v = mi.Vector3f(si.wi)
            v.z *= up
            cosine = dr.sqrt((1 - sample2.x) / (1 + (self._alpha**2 - 1) * sample2.x))
            sine = dr.safe_sqrt(1 - cosine * cosine)
            s, c = dr.sincos(2 * dr.pi * sample2.y)
            h = mi.Vector3f(sine * c, sine * s, cosine)
            wo = dr.select(sample1 < 0.5, mi.warp.square_to_cosine_hemisphere(sample2), h * 2 * dr.dot(v, h) - v)
            wo.z *= up
            value, pdf = self._value(si, wo, active)
            bs = dr.zeros(mi.BSDFSample3f)
            bs.wo, bs.pdf, bs.eta = wo, pdf, 1.0
            bs.sampled_type, bs.sampled_component = mi.UInt32(+mi.BSDFFlags.GlossyReflection), mi.UInt32(0)
            return bs, dr.select(pdf > 0, value / pdf, 0)

        def eval(self, ctx: Any, si: Any, wo: Any, active: Any) -> Any:
            return self._value(si, wo, active)[0]

        def pdf(self, ctx: Any, si: Any, wo: Any, active: Any) -> Any:
            return self._value(si, wo, active)[1]

        def eval_pdf(self, ctx: Any, si: Any, wo: Any, active: Any) -> Any:
            return self._value(si, wo, active)

        def to_string(self) -> str:
            return "Gltf[]"

    return Gltf

"""Ground truth by Mitsuba's `path`: the textured geometry under any lighting, seen by a camera or along given rays.

Independent of `mirelight.lighting` on purpose: only native plugins and the formula of the KHR spot are used, so that
what the relighting is measured against shares no code with it.
"""

from __future__ import annotations

import importlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mirelight.base.backend import mitsuba
from mirelight.model import (
    AreaLight,
    Camera,
    DirectionalLight,
    Environment,
    Light,
    Lighting,
    PointLight,
    SpotLight,
    SunLight,
)
from scenegen.geometry import Soup
from scenegen.textures import Surface

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]
SUN_DISTANCE = 1e5  # metres: across a scene of ten its direction differs by a hundredth of its width
DEPTH = 8  # Mitsuba's max_depth counts the edges of a path


@dataclass(frozen=True, kw_only=True)
class Looks:
    """A scene's surfaces: triangles by material, and how the materials look."""

    soups: Sequence[Soup]
    surfaces: dict[str, Surface]


def _texture(mi: Any, surface: Surface) -> Any:
    scale = np.diag([1 / surface.size, 1 / surface.size, 1, 1])
    bitmap = mi.Bitmap(np.ascontiguousarray(surface.texture))
    return {
        "type": "bitmap",
        "bitmap": bitmap,
        "raw": True,
        "to_uv": mi.ScalarTransform4f(scale),
        "wrap_mode": "repeat",
    }


def _bsdf(mi: Any, surface: Surface) -> Any:
    texture = _texture(mi, surface)
    inner: dict[str, Any] = {"type": "diffuse", "reflectance": texture}
    if surface.metal:
        inner = {
            "type": "roughconductor",
            "material": "none",
            "alpha": surface.roughness,
            "specular_reflectance": texture,
        }
    elif surface.roughness is not None:
        inner = {"type": "roughplastic", "diffuse_reflectance": texture, "alpha": surface.roughness, "int_ior": 1.5}
    return mi.load_dict({"type": "twosided", "bsdf": inner})


def _mesh(mi: Any, soup: Soup, bsdf: Any, name: str) -> Any:
    props = mi.Properties()
    props["mesh_bsdf"] = bsdf
    count = len(soup.positions)
    mesh = mi.Mesh(name, 3 * count, count, has_vertex_normals=True, has_vertex_texcoords=True, props=props)
    values = mi.traverse(mesh)
    values["vertex_positions"] = mi.Float(soup.positions.astype(np.float32).ravel())
    values["vertex_normals"] = mi.Float(soup.normals.astype(np.float32).ravel())
    values["vertex_texcoords"] = mi.Float(soup.uvs.astype(np.float32).ravel())
    values["faces"] = mi.UInt32(np.arange(3 * count, dtype=np.uint32))
    values.update()
    return mesh


def _frame(direction: F64) -> F64:
    """Rotation (3, 3) whose third column is `direction`."""
    helper = np.array([0.0, 1.0, 0.0]) if abs(direction[1]) < 0.9 else np.array([1.0, 0.0, 0.0])
    x = np.cross(helper, direction)
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(direction, x), direction], axis=1)


def _rgb(color: F64, scale: float) -> dict[str, Any]:
    return {"type": "rgb", "value": [float(c) * scale for c in color]}


def _emitter(mi: Any, light: Light) -> Any:
    """The Mitsuba emitter of one light. No scene uses windows of `range`, or area lights that are no rectangles."""
    if isinstance(light, DirectionalLight):
        direction = [float(x) for x in light.direction]
        return {"type": "directional", "direction": direction, "irradiance": _rgb(light.color, light.intensity)}
    if isinstance(light, SunLight):
        half = np.radians(light.angular_diameter) / 2
        to_world = np.eye(4)
        to_world[:3, :3] = _frame(light.direction) * (SUN_DISTANCE * np.tan(half))
        to_world[:3, 3] = -light.direction * SUN_DISTANCE
        radiance = _rgb(light.color, light.intensity / (np.pi * np.sin(half) ** 2))
        return {
            "type": "disk",
            "to_world": mi.ScalarTransform4f(to_world),
            "emitter": {"type": "area", "radiance": radiance},
        }
    if isinstance(light, AreaLight) and light.shape == "rectangle":
        half = np.divide(light.size, 2)
        to_world = light.world_from_light @ np.diag([*half, -1.0, 1.0])  # Mitsuba's shines along +Z
        return {
            "type": "rectangle",
            "to_world": mi.ScalarTransform4f(to_world),
            "bsdf": {"type": "diffuse", "reflectance": 0.0},
            "emitter": {"type": "area", "radiance": _rgb(light.color, light.intensity)},
        }
    if isinstance(light, PointLight) and np.isinf(light.range) and light.radius == 0:
        position = [float(x) for x in light.position]
        return {"type": "point", "position": position, "intensity": _rgb(light.color, light.intensity)}
    if isinstance(light, SpotLight) and np.isinf(light.range) and light.radius == 0:
        return _khr_spot(mi, light)
    raise ValueError(f"light {light.name!r} has no ground-truth emitter")


def _khr_spot(mi: Any, light: SpotLight) -> Any:
    """A spot with the squared cone of KHR_lights_punctual, which Mitsuba's own spot does not have."""
    import drjit as dr

    inner, outer = float(np.cos(light.inner_cone_angle)), float(np.cos(light.outer_cone_angle))
    axis, position = [float(x) for x in light.direction], [float(x) for x in light.position]
    intensity = [float(x) * light.intensity for x in light.color]

    class Spot(mi.Emitter):  # type: ignore[misc]
        def __init__(self, props: Any) -> None:
            super().__init__(props)
            self.m_flags = mi.EmitterFlags.DeltaPosition

        def _arriving(self, it: Any, d: Any, squared: Any) -> Any:
            cone = dr.clip((dr.dot(-d, mi.Vector3f(axis)) - outer) / (inner - outer), 0, 1)
            return mi.Color3f(intensity) * cone * cone / squared

        def sample_direction(self, it: Any, sample: Any, active: Any = True) -> Any:
            ds = dr.zeros(mi.DirectionSample3f)
            ds.p = mi.Point3f(position)
            ds.d = ds.p - it.p
            squared = dr.squared_norm(ds.d)
            ds.dist = dr.sqrt(squared)
            ds.d /= ds.dist
            ds.pdf = 1.0
            ds.delta = True
            ds.time = it.time
            ds.emitter = mi.EmitterPtr(self)
            return ds, self._arriving(it, ds.d, squared) & active

        def pdf_direction(self, it: Any, ds: Any, active: Any = True) -> Any:
            return mi.Float(0)

        def eval_direction(self, it: Any, ds: Any, active: Any = True) -> Any:
            return self._arriving(it, ds.d, ds.dist * ds.dist) & active

        def eval(self, si: Any, active: Any = True) -> Any:
            return mi.Color3f(0)

        def bbox(self) -> Any:
            return mi.ScalarBoundingBox3f(mi.ScalarPoint3f(position))

        def to_string(self) -> str:
            return f"KhrSpot[{light.name}]"

    mi.register_emitter("scenegen_khr_spot", Spot)
    return mi.load_dict({"type": "scenegen_khr_spot"})


def _sky(mi: Any, environment: Environment) -> Any:
    radiance = environment.pixels * np.float32(environment.intensity)
    if environment.is_constant:
        return {"type": "constant", "radiance": _rgb(radiance[0, 0].astype(np.float64), 1.0)}
    turn = mi.ScalarTransform4f().rotate([0, 1, 0], 90 + environment.rotation)
    return {"type": "envmap", "bitmap": mi.Bitmap(np.ascontiguousarray(radiance)), "to_world": turn}


class Truth:
    """The geometry under one lighting, ready for pictures and rays."""

    def __init__(self, looks: Looks, lighting: Lighting, more: Mapping[str, Any] | None = None) -> None:
        """`more`: BSDFs of materials that are no surface of the looks."""
        mi = mitsuba()
        self._mi = mi
        bsdfs = {name: _bsdf(mi, surface) for name, surface in looks.surfaces.items()} | dict(more or {})
        scene: dict[str, Any] = {"type": "scene"}
        self._mirrors: list[Any] = []
        for k, soup in enumerate(looks.soups):
            scene[f"mesh_{k}"] = _mesh(mi, soup, bsdfs[soup.material], f"mesh_{k}")
            if soup.material in looks.surfaces and looks.surfaces[soup.material].is_mirror:
                self._mirrors.append(scene[f"mesh_{k}"])
        for k, light in enumerate(lighting.lights):
            scene[f"light_{k}"] = _emitter(mi, light)
        if lighting.environment:
            scene["sky"] = _sky(mi, lighting.environment)
        self._scene = mi.load_dict(scene)
        self._path = mi.load_dict({"type": "path", "max_depth": DEPTH, "rr_depth": 6, "hide_emitters": True})

    def picture(self, camera: Camera, spp: int, seed: int = 0) -> F32:
        """(H, W, 4) linear premultiplied radiance and coverage, box filter, in passes of at most 32 samples."""
        return self._rendered(self._path, camera, spp, seed)[..., :4]

    def photograph(self, camera: Camera, spp: int, seed: int) -> F32:
        """(H, W, 4) linear radiance on black and coverage, few samples denoised by their guides: to fit to, not as
        truth."""
        pyoidn = importlib.import_module("pyoidn")
        guides = {"type": "aov", "aovs": "albedo:albedo,normal:sh_normal", "path": self._path}
        image = self._rendered(self._mi.load_dict(guides), camera, spp, seed)
        colour, albedo, normal = (np.ascontiguousarray(image[..., k : k + 3]) for k in (0, 4, 7))
        clean = np.asarray(pyoidn.denoise(colour, albedo=albedo, normal=normal, hdr=True), dtype=np.float32)
        coverage = image[..., 3:4]
        return np.concatenate([clean * (coverage > 0), coverage], axis=-1)  # it leaves a trace of light on nothing

    def _rendered(self, integrator: Any, camera: Camera, spp: int, seed: int) -> F32:
        mi = self._mi
        if not np.isclose(camera.fx, camera.fy, rtol=1e-3):
            raise ValueError(f"camera {camera.name!r} has pixels that are not square, and Mitsuba's have no others")
        to_world = camera.world_from_camera @ np.diag([-1.0, 1.0, -1.0, 1.0])
        sensor = mi.load_dict(
            {
                "type": "perspective",
                "fov": float(np.degrees(2 * np.arctan(camera.width / 2 / camera.fx))),
                "fov_axis": "x",
                "near_clip": 0.01,
                "far_clip": 1e4,
                "to_world": mi.ScalarTransform4f(to_world),
                "film": {
                    "type": "hdrfilm",
                    "width": camera.width,
                    "height": camera.height,
                    "pixel_format": "rgba",
                    "component_format": "float32",
                    "rfilter": {"type": "box"},
                },
                "sampler": {"type": "independent"},
            }
        )
        done, total = 0, np.zeros(())
        while done < spp:
            now = min(32, spp - done)
            image = mi.render(self._scene, sensor=sensor, integrator=integrator, spp=now, seed=seed * 1000 + done)
            total = total + np.array(image, dtype=np.float64) * now
            done += now
        return (total / spp).astype(np.float32)

    def distance(self, origins: F64, directions: F64) -> F64:
        """(N,) metres along each ray (N, 3) to the first surface, in a mirror to what it shows; infinite where there is
        none."""
        mi = self._mi
        ray = mi.Ray3f(
            mi.Point3f(origins.T.astype(np.float32).copy()), mi.Vector3f(directions.T.astype(np.float32).copy())
        )
        if not self._mirrors:
            return np.array(self._scene.ray_intersect_preliminary(ray).t, dtype=np.float64)
        met = self._scene.ray_intersect(ray)
        away = np.array(met.t, dtype=np.float64)
        shows = np.any([np.array(met.shape == mi.ShapePtr(x)) for x in self._mirrors], axis=0)
        if shows.any():
            onward = met.spawn_ray(met.to_world(mi.reflect(met.wi)))
            away[shows] += np.array(self._scene.ray_intersect_preliminary(onward).t, dtype=np.float64)[shows]
        return away

    def hits(self, origins: F32, directions: F32, reach: F32) -> NDArray[np.bool_]:
        """Whether anything lies along each ray (N, 3) nearer than `reach` (N,)."""
        mi = self._mi
        ray = mi.Ray3f(
            mi.Point3f(origins.T.copy()), mi.Vector3f(directions.T.copy()), mi.Float(reach), mi.Float(0), mi.Color0f()
        )
        return np.array(self._scene.ray_test(ray))

    def radiance(self, origins: F32, directions: F32, reach: F32, spp: int, seed: int) -> tuple[F32, F32]:
        """Mean radiance (N, 3) seen along rays whose surface lies within `reach`, and the share (N,) of such rays.

        Args:
            origins: (N, spp, 3); every sample has its own start.
            directions: (N, 3).
            reach: (N,) metres.
            spp: samples a ray.
            seed: of the sampler.
        """
        mi = self._mi
        count = len(origins)
        flat = np.ascontiguousarray(origins.reshape(-1, 3).T)
        along = np.ascontiguousarray(np.repeat(directions, spp, axis=0).T)
        ray = mi.Ray3f(mi.Point3f(flat), mi.Vector3f(along))
        sampler = mi.load_dict({"type": "independent"})
        sampler.seed(seed, count * spp)
        near = self._scene.ray_intersect_preliminary(ray).t < mi.Float(np.repeat(reach, spp))
        colour, _, _ = self._path.sample(self._scene, sampler, mi.RayDifferential3f(ray), active=near)
        rgb = np.array(colour).T.reshape(count, spp, 3)
        seen = np.array(near).reshape(count, spp)
        share = seen.mean(axis=1)
        mean = (rgb * seen[..., None]).sum(axis=1) / np.maximum(seen.sum(axis=1), 1)[:, None]
        return mean.astype(np.float32), share.astype(np.float32)

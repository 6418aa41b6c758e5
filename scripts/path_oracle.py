"""The same scene for Mitsuba's own `path` integrator: the independent check of our loop.

Lights are Mitsuba's emitters where they match (directional, point, area, constant, envmap) and small plugins where
none does (spots' cones, range windows, suns, cameras with off-centre or non-square pixels). Nothing here
shares code with the tracer but the packed light table's numbers.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from mirelight.base.errors import RenderError
from mirelight.lighting.lights import spot_cone
from mirelight.model import (
    F32,
    AreaLight,
    Camera,
    DirectionalLight,
    Environment,
    IesProfile,
    Light,
    Lighting,
    Material,
    PointLight,
    ProxyMesh,
    SpotLight,
    SunLight,
    TubeLight,
    Wraps,
)
from mirelight.model.ies import AROUND, DOWN


def _rgb(mi: Any, value: Any) -> dict[str, Any]:
    return {"type": "rgb", "value": [float(x) for x in value]}


def _pointer(mi: Any, emitter: Any) -> Any:
    return emitter if mi.variant().startswith("scalar") else mi.EmitterPtr(emitter)


def _khr_class(mi: Any) -> Any:
    """A point or spot light by KHR_lights_punctual: squared cone (or a smoothstep), range window."""
    import drjit as dr

    class KhrPunctual(mi.Emitter):  # type: ignore[misc]
        def __init__(self, props: Any) -> None:
            super().__init__(props)
            self.m_flags = mi.EmitterFlags.DeltaPosition
            self.position = mi.ScalarPoint3f(props["position"])
            self.axis = mi.ScalarVector3f(props["axis"])
            self.strength = mi.ScalarColor3f(props["strength"])
            self.scale, self.offset, self.smooth = (props[f"cone_{x}"] for x in ("scale", "offset", "smooth"))
            self.inverse_range = props["inverse_range"]
            self.table = props.get("table", None)
            if self.table is not None:
                self.frame = [mi.ScalarVector3f(props[x]) for x in ("nadir", "zero", "quarter")]

        def sample_direction(self, it: Any, sample: Any, active: Any = True) -> Any:
            ds = mi.DirectionSample3f()
            ds.p, ds.n, ds.uv, ds.time = mi.Point3f(self.position), mi.Normal3f(0), mi.Point2f(0), it.time
            ds.pdf, ds.delta, ds.emitter = mi.Float(1), mi.Bool(True), _pointer(mi, self)
            way = ds.p - it.p
            ds.dist = dr.norm(way)
            ds.d = way / ds.dist
            cosine = -dr.dot(ds.d, mi.Vector3f(self.axis))
            t = dr.clip(cosine * self.scale + self.offset, 0, 1)
            cone = t * t * (3 - 2 * t) if self.smooth else t * t
            if self.table is not None:
                cone = cone * self._measured(-ds.d)
            fourth = (ds.dist * self.inverse_range) ** 4
            window = dr.clip(1 - fourth, 0, 1) / (ds.dist * ds.dist)
            return ds, mi.Color3f(self.strength) * (cone * window)

        def _measured(self, way: Any) -> Any:
            """The profile in a direction, by Mitsuba's own bitmap, whose texels' centres lie half a texel inside."""
            nadir, zero, quarter = (mi.Vector3f(x) for x in self.frame)
            around = dr.atan2(dr.dot(way, quarter), dr.dot(way, zero)) / dr.two_pi
            down = dr.acos(dr.clip(dr.dot(way, nadir), -1, 1)) / dr.pi
            si = dr.zeros(mi.SurfaceInteraction3f)
            si.uv = mi.Point2f((down * (DOWN - 1) + 0.5) / DOWN, around + 0.5 / AROUND)
            return self.table.eval_1(si)

        def pdf_direction(self, it: Any, ds: Any, active: Any = True) -> Any:
            return mi.Float(0)

        def eval(self, si: Any, active: Any = True) -> Any:
            return mi.Color3f(0)

        def bbox(self) -> Any:
            return mi.ScalarBoundingBox3f(self.position)

    return KhrPunctual


def _profile(mi: Any, profile: IesProfile) -> dict[str, Any]:
    """Properties of a lamp whose light was measured."""
    pixels = mi.Bitmap(profile.share[..., None].copy())  # not of a read-only array
    table = {"type": "bitmap", "bitmap": pixels, "raw": True, "filter_type": "bilinear", "wrap_mode": "repeat"}
    frame = {name: getattr(profile, name).tolist() for name in ("nadir", "zero", "quarter")}
    return {"table": table, **frame}


def _sun_class(mi: Any) -> Any:
    """A disc at infinity, even over its solid angle."""
    import drjit as dr

    class SunDisc(mi.Emitter):  # type: ignore[misc]
        def __init__(self, props: Any) -> None:
            super().__init__(props)
            self.m_flags = mi.EmitterFlags.DeltaDirection
            self.to_sun = mi.ScalarVector3f(props["to_sun"])
            self.strength = mi.ScalarColor3f(props["strength"])
            self.cosine = props["cosine"]
            self.far = props["far"]

        def sample_direction(self, it: Any, sample: Any, active: Any = True) -> Any:
            local = mi.warp.square_to_uniform_cone(sample, self.cosine)
            ds = mi.DirectionSample3f()
            ds.d = mi.Frame3f(mi.Vector3f(self.to_sun)).to_world(local)
            ds.dist = mi.Float(self.far)
            ds.p, ds.n, ds.uv, ds.time = it.p + ds.d * ds.dist, mi.Normal3f(-ds.d), mi.Point2f(0), it.time
            ds.pdf, ds.delta, ds.emitter = mi.Float(1), mi.Bool(True), _pointer(mi, self)
            solid_angle = 2 * dr.pi * (1 - self.cosine)
            projected = dr.pi * (1 - self.cosine * self.cosine)
            return ds, mi.Color3f(self.strength) * (solid_angle / projected)

        def pdf_direction(self, it: Any, ds: Any, active: Any = True) -> Any:
            return mi.Float(0)

        def eval(self, si: Any, active: Any = True) -> Any:
            return mi.Color3f(0)

        def bbox(self) -> Any:
            return mi.ScalarBoundingBox3f()

    return SunDisc


def _camera_class(mi: Any) -> Any:
    """Rays of `model.Camera`, for what Mitsuba's own sensors cannot express."""
    import drjit as dr

    class PixelCamera(mi.Sensor):  # type: ignore[misc]
        def __init__(self, props: Any) -> None:
            super().__init__(props)
            self.numbers = [float(props[k]) for k in ("fx", "fy", "cx", "cy", "near", "far", "perspective")]
            self.axes = [mi.ScalarVector3f(props[k]) for k in ("right", "up", "back", "eye")]
            self.m_needs_sample_3 = False

        def sample_ray_differential(
            self, time: Any, wavelength: Any, film: Any, aperture: Any, active: Any = True
        ) -> Any:
            ray, weight = self.sample_ray(time, wavelength, film, aperture, active)
            return mi.RayDifferential3f(ray), weight

        def sample_ray(self, time: Any, wavelength: Any, film: Any, aperture: Any, active: Any = True) -> Any:
            fx, fy, cx, cy, near, far, perspective = self.numbers
            width, height = self.film().crop_size()
            x, y = (film.x * width - cx) / fx, (cy - film.y * height) / fy
            right, up, back, eye = (mi.Vector3f(v) for v in self.axes)
            across = right * x + up * y
            d = across * perspective - back
            start = eye + across * (near if perspective else 1.0) - back * near
            length = dr.norm(d)
            ray = mi.Ray3f(mi.Point3f(start), d / length)
            ray.maxt = min(far - near, 1e30) * length
            ray.time = time
            return ray, mi.Color3f(1)

    return PixelCamera


def _register(mi: Any) -> None:
    mi.register_emitter("khr_punctual", _khr_class(mi))
    mi.register_emitter("sun_disc", _sun_class(mi))
    mi.register_sensor("pixel_camera", _camera_class(mi))


def _transform(mi: Any, matrix: NDArray[np.float64]) -> Any:
    return mi.ScalarTransform4f(matrix.tolist())


def emitter(mi: Any, light: Light, reach: float) -> dict[str, Any]:
    """One light as a Mitsuba dictionary; `reach` is the scene's size, how far away a sun's disc is put."""
    strength = light.color * light.intensity
    match light:
        case DirectionalLight():
            return {"type": "directional", "direction": light.direction.tolist(), "irradiance": _rgb(mi, strength)}
        case SunLight():
            return {
                "type": "sun_disc",
                "to_sun": (-light.direction).tolist(),
                "strength": strength.tolist(),
                "cosine": float(np.cos(np.radians(light.angular_diameter) / 2)),
                "far": reach,
            }
        case PointLight() | SpotLight() if light.radius == 0:
            spot = isinstance(light, SpotLight)
            measured = light.profile
            if not spot and np.isinf(light.range) and measured is None:
                return {"type": "point", "position": light.position.tolist(), "intensity": _rgb(mi, strength)}
            scale, offset, smooth = 0.0, 1.0, 0.0
            axis = np.array([0.0, 0.0, 1.0])
            if isinstance(light, SpotLight):
                scale, offset, smooth = spot_cone(light)
                axis = light.direction
            return {
                "type": "khr_punctual",
                "position": light.position.tolist(),
                "axis": axis.tolist(),
                "strength": strength.tolist(),
                "cone_scale": scale,
                "cone_offset": offset,
                "cone_smooth": smooth > 0,
                "inverse_range": 1.0 / light.range,
                **({} if measured is None else _profile(mi, measured)),
            }
        case PointLight() if np.isinf(light.range) and light.profile is None:
            matrix = np.eye(4)
            matrix[:3, 3] = light.position
            return _glowing(mi, "sphere", matrix, (light.radius, light.radius), strength / (np.pi * light.radius**2))
        case AreaLight():
            return _glowing(mi, light.shape, light.world_from_light, (light.size[0] / 2, light.size[1] / 2), strength)
        case TubeLight():
            return {
                "type": "cylinder",
                "p0": [0, 0, -light.length / 2],
                "p1": [0, 0, light.length / 2],
                "radius": light.radius,
                "to_world": _transform(mi, light.world_from_light),
                "emitter": {"type": "area", "radiance": _rgb(mi, strength)},
                "bsdf": {"type": "diffuse", "reflectance": {"type": "rgb", "value": 0.0}},
            }
        case _:
            raise RenderError(
                f"light {light.name!r}: Mitsuba has no lamp with both a radius and a cone, range or profile"
            )


def _glowing(
    mi: Any, shape: str, matrix: NDArray[np.float64], half: tuple[float, float], radiance: Any
) -> dict[str, Any]:
    # Mitsuba's rectangle and disk shine along +Z, ours along -Z: turned about X
    scaled = matrix @ np.diag([half[0], -half[1] if shape != "sphere" else half[1], -half[0], 1.0])
    if shape == "sphere":
        scaled = matrix @ np.diag([half[0]] * 3 + [1.0])
    return {
        "type": shape,
        "to_world": _transform(mi, scaled),
        "emitter": {"type": "area", "radiance": _rgb(mi, radiance)},
        "bsdf": {"type": "diffuse", "reflectance": {"type": "rgb", "value": 0.0}},
    }


def sky(mi: Any, environment: Environment) -> dict[str, Any]:
    """The environment as `constant` or `envmap`, turned into our convention."""
    if environment.is_constant:
        return {"type": "constant", "radiance": _rgb(mi, environment.pixels[0, 0] * environment.intensity)}
    pixels = _rows_on_poles(environment.pixels * np.float32(environment.intensity))
    turn = mi.ScalarTransform4f().rotate([0, 1, 0], 90.0 + environment.rotation)
    return {"type": "envmap", "bitmap": mi.Bitmap(pixels), "to_world": turn}


def _rows_on_poles(pixels: F32) -> F32:
    """The map with rows at equal steps from pole to pole, as Mitsuba's `envmap` takes them; others put pixel centres
    half a row away from the poles. Four times as many rows keep what lies between them."""
    h = len(pixels)
    at = np.clip(np.linspace(0, 1, 4 * h) * h - 0.5, 0, h - 1)
    low = np.minimum(at.astype(np.int64), h - 2) if h > 1 else np.zeros(4 * h, np.int64)
    share = (at - low)[:, None, None]
    resampled = pixels[low] * (1 - share) + pixels[np.minimum(low + 1, h - 1)] * share
    return np.ascontiguousarray(resampled, dtype=np.float32)


def mesh(mi: Any, proxy: ProxyMesh, bsdf: dict[str, Any], faces: NDArray[np.int32], glow: Any = None) -> Any:
    """Some faces of the proxy as a Mitsuba mesh with its own material."""
    props = mi.Properties()
    props["bsdf"] = mi.load_dict({"type": "twosided", "bsdf": bsdf})
    if glow is not None:
        props["emitter"] = mi.load_dict({"type": "area", "radiance": glow})
    out = mi.Mesh(
        "proxy",
        vertex_count=len(proxy.vertices),
        face_count=len(faces),
        has_vertex_normals=proxy.normals is not None,
        has_vertex_texcoords=proxy.uvs is not None,
        props=props,
    )
    if proxy.vertex_colors is not None:
        out.add_attribute("vertex_color", 3, proxy.vertex_colors.ravel())
    parameters = mi.traverse(out)
    parameters["vertex_positions"] = proxy.vertices.ravel()
    parameters["faces"] = faces.astype(np.uint32).ravel()
    if proxy.normals is not None:
        parameters["vertex_normals"] = proxy.normals.ravel()
    if proxy.uvs is not None:
        parameters["vertex_texcoords"] = proxy.uvs.ravel()
    parameters.update()
    return out


def _bsdf(mi: Any, proxy: ProxyMesh, index: int) -> dict[str, Any]:
    if proxy.albedo is not None:
        return {"type": "diffuse", "reflectance": _rgb(mi, proxy.albedo)}
    material = proxy.materials[index]
    if proxy.vertex_colors is not None:
        return {"type": "diffuse", "reflectance": {"type": "mesh_attribute", "name": "vertex_color"}}
    if material.base_color_texture is not None:
        image = _image(mi, material.base_color_texture, material.base_color, material.base_color_wrap)
        return {"type": "diffuse", "reflectance": image}
    return {"type": "diffuse", "reflectance": _rgb(mi, material.base_color)}


def _emission(mi: Any, material: Material) -> dict[str, Any] | None:
    """A material's radiance; None where it does not glow."""
    if not np.any(material.emissive > 0):
        return None
    if material.emissive_texture is not None:
        return _image(mi, material.emissive_texture, material.emissive, material.emissive_wrap)
    return _rgb(mi, material.emissive)


def _image(mi: Any, texture: F32, factor: NDArray[np.float64], wraps: Wraps) -> dict[str, Any]:
    if wraps[0] != wraps[1]:
        raise RenderError("a texture that wraps differently along u and v: Mitsuba's have one way for both")
    pixels = np.ascontiguousarray(texture * factor.astype(np.float32))
    return {"type": "bitmap", "bitmap": mi.Bitmap(pixels), "raw": True, "wrap_mode": wraps[0]}


def sensor(mi: Any, camera: Camera) -> dict[str, Any]:
    """The camera: Mitsuba's `perspective` where it can, our plugin elsewhere."""
    film = {
        "type": "hdrfilm",
        "width": camera.width,
        "height": camera.height,
        "rfilter": {"type": "box"},
        "pixel_format": "rgba",
        "component_format": "float32",
    }
    far = min(camera.far, 1e30)
    if camera.projection == "perspective" and camera.fx == camera.fy:
        lens = camera.exposure
        thin = {} if lens is None else {x: getattr(lens, x) for x in ("aperture_radius", "focus_distance")}
        offset = {"x": 0.5 - camera.cx / camera.width, "y": 0.5 - camera.cy / camera.height}  # thinlens has none
        return {
            "type": "thinlens" if thin else "perspective",
            **thin,
            "fov_axis": "x",
            "fov": float(np.degrees(2 * np.arctan(camera.width / 2 / camera.fx))),
            **({} if thin else {f"principal_point_offset_{x}": v for x, v in offset.items()}),
            "near_clip": camera.near,
            "far_clip": min(far, 1e6),
            "to_world": _transform(mi, camera.world_from_camera @ np.diag([-1.0, 1.0, -1.0, 1.0])),
            "film": film,
        }
    return {
        "type": "pixel_camera",
        "fx": camera.fx,
        "fy": camera.fy,
        "cx": camera.cx,
        "cy": camera.cy,
        "near": camera.near,
        "far": far,
        "perspective": 1.0 if camera.projection == "perspective" else 0.0,
        **{k: camera.world_from_camera[:3, n].tolist() for n, k in enumerate(("right", "up", "back", "eye"))},
        "film": film,
    }


def scene(mi: Any, proxy: ProxyMesh, lighting: Lighting, camera: Camera) -> Any:
    """The whole as a Mitsuba scene."""
    _register(mi)
    low, high = proxy.bounds
    reach = float(np.linalg.norm(high - low)) * 4
    out: dict[str, Any] = {"type": "scene", "sensor": sensor(mi, camera)}
    of_face = np.zeros(len(proxy.faces), np.int32) if proxy.face_materials is None else proxy.face_materials
    for index, material in enumerate(proxy.materials):
        faces = proxy.faces[of_face == index]
        if len(faces):
            out[f"mesh{index}"] = mesh(mi, proxy, _bsdf(mi, proxy, index), faces, _emission(mi, material))
    for number, light in enumerate(lighting.lights):
        out[f"light{number}"] = emitter(mi, light, reach)
    if lighting.environment is not None:
        out["sky"] = sky(mi, lighting.environment)
    return mi.load_dict(out)


def path_beauty(
    mi: Any, world: Any, *, spp: int, max_depth: int, seed: int, hide_lights: bool = True
) -> tuple[F32, F32]:
    """What Mitsuba's `path` makes of it: ((H, W, 3) premultiplied radiance, (H, W) coverage). `max_depth` is ours.

    `hide_lights` keeps the sky and glowing shapes out of what the camera sees directly."""
    integrator = mi.load_dict({"type": "path", "max_depth": max_depth + 1, "rr_depth": 5, "hide_emitters": hide_lights})
    picture = np.asarray(mi.render(world, integrator=integrator, spp=spp, seed=seed), np.float32)
    return np.ascontiguousarray(picture[..., :3]), np.ascontiguousarray(picture[..., 3])

"""Lamps and environments as UsdLux, cameras as UsdGeom; what USD has no words for stands beside (`exact`)."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import fields
from types import MappingProxyType
from typing import Any

import numpy as np

from mirelight.base import conventions
from mirelight.io.usd.exact import keep
from mirelight.io.usd.lights import X_AIMED
from mirelight.io.usd.write import StageWriter
from mirelight.model import (
    F64,
    AreaLight,
    Camera,
    DirectionalLight,
    Environment,
    Light,
    PointLight,
    PosedLight,
    SpotLight,
    SunLight,
)
from mirelight.model.light_classes import punctual
from mirelight.model.surface_lights import GlowingLight

_FILM = 0.24  # tenths of a metre high, of cameras: 24 mm
_CODES = 24.0  # time codes a second
_RENDER = "/Render"  # where OpenUSD looks for what is to be rendered
_NO_FRAMES: Mapping[str, str] = MappingProxyType({})
_KINDS = {"rectangle": "RectLight", "disk": "DiskLight", "sphere": "SphereLight"}


def add_light(writer: StageWriter, light: Light) -> None:
    """A lamp below /World/lights; what faces it is lit as here, up to the shape of a spot's edge."""
    match light:
        case DirectionalLight():
            prim = _prim(writer, light, "DistantLight", _aimed(light.direction, np.zeros(3)))
            _inputs(prim, intensity=light.intensity, angle=0.0)
        case SunLight():
            prim = _prim(writer, light, "DistantLight", _aimed(light.direction, np.zeros(3)))
            _inputs(prim, intensity=light.intensity, angle=light.angular_diameter, normalize=True)
        case PointLight():
            prim = _prim(writer, light, "SphereLight", conventions.compose(light.position))
            _ball(prim, light.intensity, light.radius)
        case SpotLight():
            prim = _prim(writer, light, "SphereLight", _aimed(light.direction, light.position))
            _ball(prim, light.intensity, light.radius)
            _cone(prim, light)
        case AreaLight():
            prim = _prim(writer, light, _KINDS[light.shape], light.world_from_light)
            _inputs(prim, intensity=light.intensity)
            if light.shape == "rectangle":
                _inputs(prim, width=light.size[0], height=light.size[1])
            else:
                _inputs(prim, radius=light.size[0] / 2)
        case PosedLight():
            _surface(writer, light)
            return
    if getattr(light, "profile", None) is None:
        keep(prim, _described(light))


def _surface(writer: StageWriter, light: GlowingLight) -> None:
    """A lamp of a class that its record describes: as the prim that it names, else as a point or a spot."""
    usd = light.KIND.usd
    if usd is None:
        plain = punctual(light)
        prim = _prim(writer, light, "SphereLight", light.world_from_light)
        _ball(prim, plain.intensity, 0.0)
        if isinstance(plain, SpotLight):
            _cone(prim, plain)
    else:
        pose = light.world_from_light
        prim = _prim(writer, light, usd.name, pose @ X_AIMED if usd.axis == "X" else pose)
        _inputs(prim, intensity=light.intensity, **{x.name: float(getattr(light, x.name)) for x in light.KIND.fields})
    keep(prim, _described(light))


def add_environment(writer: StageWriter, environment: Environment) -> None:
    """Writes an environment as a dome light below /World/lights."""
    from pxr import Sdf

    prim = writer.stage.DefinePrim(writer.path(environment.name, "lights"), "DomeLight")
    pixels = environment.pixels
    turn = conventions.rotation_from_euler((0, environment.rotation + 90, 0))
    writer.place(prim, conventions.compose(rotation=turn))
    _inputs(prim, intensity=environment.intensity)
    if environment.is_constant:
        _color(prim, pixels[0, 0].astype(np.float64))
        return
    prim.GetAttribute("inputs:texture:file").Set(Sdf.AssetPath(writer.picture(prim.GetName(), pixels)[0]))
    prim.GetAttribute("inputs:texture:format").Set("latlong")


def add_camera(writer: StageWriter, cameras: Sequence[Camera], frames: Mapping[str, str] = _NO_FRAMES) -> None:
    """A camera below /World/cameras: one, or the moments of one that moves.

    Args:
        writer: the stage.
        cameras: at least one; several have a time each.
        frames: by a camera's name the picture that was rendered of it, as a path from the stage's folder.
    """
    from pxr import UsdGeom

    first = cameras[0]
    moves = len(cameras) > 1
    name = first.name.rpartition(".")[0] if moves else first.name
    camera = UsdGeom.Camera.Define(writer.stage, writer.path(name or first.name, "cameras"))
    prim = camera.GetPrim()
    codes = [(one.time or 0.0) * _CODES for one in cameras] if moves else []
    writer.place(prim, np.stack([x.world_from_camera for x in cameras]) if moves else first.world_from_camera, codes)
    flat = first.projection == "orthographic"
    camera.CreateProjectionAttr("orthographic" if flat else "perspective")
    unit = 10 * first.height / first.fy if flat else _FILM  # tenths of a unit that the film is high
    pixel = unit / first.height
    camera.CreateVerticalApertureAttr(unit)
    camera.CreateHorizontalApertureAttr(pixel * first.width)
    camera.CreateHorizontalApertureOffsetAttr((first.width / 2 - first.cx) * pixel)
    camera.CreateVerticalApertureOffsetAttr((first.cy - first.height / 2) * pixel)
    camera.CreateClippingRangeAttr((first.near, first.far if math.isfinite(first.far) else 1e9))
    focal = camera.CreateFocalLengthAttr(50.0 if flat else first.fy * pixel)
    _add_lens(camera, cameras, codes)
    if moves and not flat:
        for code, one in zip(codes, cameras, strict=True):
            focal.Set(one.fy / one.height * _FILM, code)
        span = [writer.stage.GetStartTimeCode(), writer.stage.GetEndTimeCode()]
        writer.stage.SetTimeCodesPerSecond(_CODES)
        writer.stage.SetStartTimeCode(min(codes[0], span[0]))
        writer.stage.SetEndTimeCode(max(codes[-1], span[1]))
    if not flat and len({(x.width, x.height, x.cx, x.cy, x.near, x.far, x.fx == x.fy) for x in cameras}) == 1:
        lens = {"focal": first.fy, "apertures": [first.width, first.height], "clipping": [first.near, first.far]}
        lens |= {"offsets": [first.width / 2 - first.cx, first.cy - first.height / 2], "unit": 1.0}
        lens |= _exposure_values(first)
        if moves:
            lens["keys"] = [
                [code, {"focal": one.fy, **_exposure_values(one)}] for code, one in zip(codes, cameras, strict=True)
            ]
        if first.fx == first.fy:
            keep(prim, lens)
    there = [i for i, one in enumerate(cameras) if one.name in frames]
    if there:
        _add_frames(writer, prim, first, [(codes[i] if moves else None, frames[cameras[i].name]) for i in there])


def _add_lens(camera: Any, cameras: Sequence[Camera], codes: Sequence[float]) -> None:
    """Aperture and focus of a camera, or at each of several moments, and its shutter; nothing of a pinhole."""
    lenses = [x.exposure for x in cameras]
    shutter = next((x.shutter for x in lenses if x is not None and x.shutter is not None), None)
    if shutter is not None:
        camera.CreateShutterOpenAttr(shutter[0] * _CODES)
        camera.CreateShutterCloseAttr(shutter[1] * _CODES)
    if not any(x is not None and x.aperture_radius > 0 for x in lenses):
        return
    stop, focus = camera.CreateFStopAttr(), camera.CreateFocusDistanceAttr()
    for k, (one, lens) in enumerate(zip(cameras, lenses, strict=True)):
        at = (codes[k],) if codes else ()
        radius = 0.0 if lens is None else lens.aperture_radius
        stop.Set(one.fy * _FILM / one.height / 10 / (2 * radius) if radius > 0 else 0.0, *at)
        focus.Set(0.0 if lens is None else lens.focus_distance, *at)


def _exposure_values(camera: Camera) -> dict[str, float]:
    lens = camera.exposure
    if lens is None or lens.aperture_radius == 0:
        return {}
    return {"aperture_radius": lens.aperture_radius, "focus_distance": lens.focus_distance}


def _add_frames(writer: StageWriter, camera: Any, size: Camera, frames: Sequence[tuple[float | None, str]]) -> None:
    """The pictures of a camera as a render product of OpenUSD below /Render: (time code, path) each."""
    from pxr import Gf, UsdRender

    settings = UsdRender.Settings.Define(writer.stage, f"{_RENDER}/settings")
    writer.stage.SetMetadata("renderSettingsPrimPath", str(settings.GetPath()))
    product = UsdRender.Product.Define(writer.stage, f"{_RENDER}/products/{camera.GetName()}")
    settings.CreateProductsRel().AddTarget(product.GetPath())
    product.CreateCameraRel().SetTargets([camera.GetPath()])
    product.CreateResolutionAttr(Gf.Vec2i(size.width, size.height))
    name = product.CreateProductNameAttr(frames[0][1])
    for code, file in frames:
        if code is not None:
            name.Set(file, code)


def _prim(writer: StageWriter, light: Light, kind: str, pose: F64) -> Any:
    prim = writer.stage.DefinePrim(writer.path(light.name, "lights"), kind)
    writer.place(prim, pose)
    _color(prim, light.color)
    return prim


def _aimed(way: F64, place: F64) -> F64:
    return conventions.look_at(place, place + way)


def _inputs(prim: Any, **values: float | bool) -> None:
    for name, value in values.items():
        prim.GetAttribute(f"inputs:{name}").Set(value)


def _color(prim: Any, color: F64) -> None:
    prim.GetAttribute("inputs:color").Set(tuple(float(x) for x in color))


def _ball(prim: Any, candela: float, radius: float) -> None:
    """A sphere of so many candela; without a radius the limit of small ones: a normalised sphere has a quarter."""
    prim.GetAttribute("inputs:radius").Set(radius)
    if radius > 0:
        _inputs(prim, intensity=candela / (math.pi * radius**2))
        return
    prim.GetAttribute("treatAsPoint").Set(True)
    _inputs(prim, intensity=4 * candela, normalize=True)


def _cone(prim: Any, light: SpotLight) -> None:
    from pxr import UsdLux

    UsdLux.ShapingAPI.Apply(prim)
    outer = light.outer_cone_angle
    softness = 1 - light.inner_cone_angle / outer
    angle = UsdLux.ShapingAPI(prim)
    angle.CreateShapingConeAngleAttr(math.degrees(outer))
    angle.CreateShapingConeSoftnessAttr(softness)


def _described(light: Light) -> dict[str, object]:
    out: dict[str, object] = {"type": type(light).__name__}
    for one in fields(light):
        value = getattr(light, one.name)
        value = value.tolist() if isinstance(value, np.ndarray) else value
        out[one.name] = value
    return out

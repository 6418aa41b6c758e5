"""Lights of a stage as lamps and an environment, in its world: metres, Y up.

UsdLux gives luminance, after `intensity`, `exposure`, `normalize` and the rest (schema documentation of LightAPI); so
what faces a light is lit by the luminance times the projected solid angle. What lamps here do not have is put together:
a textured rectangle of small ones, shaped lights as points with a table of directions.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mirelight.base import conventions
from mirelight.base.errors import InputError
from mirelight.io import records
from mirelight.io.environment import read_environment
from mirelight.io.gltf.names import unique_names
from mirelight.io.ies import read_ies
from mirelight.io.usd.cameras import moments
from mirelight.io.usd.dome import dome_map
from mirelight.io.usd.process import Read, ask
from mirelight.io.usd.rows import LightRow, Request
from mirelight.model import (
    F32,
    F64,
    LIGHT_CLASSES,
    AreaLight,
    DirectionalLight,
    IesProfile,
    Light,
    PointLight,
    SpotLight,
    SunLight,
)
from mirelight.model.ies import AROUND, DOWN
from mirelight.model.surface_lights import DESCRIBED, described_light

_CELLS = 8  # along each side of a textured rectangle
_CLASSES = {x.__name__: x for x in LIGHT_CLASSES}
# A prim whose X axis stands where -Z of a light's pose is.
X_AIMED = np.array([[0, 0, 1, 0], [0, 1, 0, 0], [-1, 0, 0, 0], [0, 0, 0, 1.0]])
_EDGE = 1e-6  # rad: inner and outer half angle of a hard cone are this far apart


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class UsdLights:
    """The lights of a stage."""

    lights: tuple[Light, ...]
    environment: F32 | None  # (h, w, 3) radiance of all domes, in the axes of an environment map
    notes: tuple[str, ...]  # what is not followed


def read_lights(path: str | Path, time: float | None = None) -> UsdLights:
    """The lights of a stage.

    Args:
        path: the stage.
        time: seconds of its animation; None: as it stands.

    Raises:
        InputError: a light that cannot be used, with its prim.
    """
    with ask(path, Request(path=str(path), part="lights", time=time)) as read:
        rows = [row for row in read.answer.lights if row.kind != "DomeLight"]
        names = unique_names([(row.name, row.prim, "light") for row in rows])
        lamps = [light for row, name in zip(rows, names, strict=True) for light in _lamps(read, row, name)]
        domes = [row for row in read.answer.lights if row.kind == "DomeLight"]
        around = dome_map([(_picture(read, row), row) for row in domes], read.path) if domes else None
        return UsdLights(lights=tuple(lamps), environment=around, notes=tuple(read.answer.notes))


def read_domes(path: str | Path) -> F32:
    """(H, W, 3) the environment that a stage's dome lights make. Raises InputError: there is none."""
    found = read_lights(path).environment
    if found is None:
        raise InputError(path, "no dome light in it", "name a picture, or leave environment out")
    return found


def light_times(path: str | Path, fps: float | None, count: int | None) -> list[float]:
    """Moments (s) from the stage's first time code to its last (or from key to key), as for cameras.

    Raises:
        InputError: nothing moves or changes a light.
    """
    with ask(path, Request(path=str(path), part="times")) as read:
        ends = read.answer.times
    if not ends:
        raise InputError(path, "nothing moves or changes a light", "leave fps and frames out, or animate one")
    return moments(path, ends, fps, count)


def _lamps(read: Read, row: LightRow, name: str) -> list[Light]:
    if row.exact is not None:
        return [_exact(read, row, name)]
    pose = conventions.rigid_part(np.array(row.world))
    color, strength = _split(row.candela if row.point else row.radiance)
    if row.kind == "DistantLight":
        way = -pose[:3, 2]
        if row.size[0] == 0:
            return [DirectionalLight(name=name, direction=way, color=color, intensity=strength)]
        if row.size[0] > 180:
            raise InputError(read.path, f"an angle of {row.size[0]:g} degrees", "use a DomeLight", field=row.prim)
        angle = row.size[0]
        return [SunLight(name=name, direction=way, color=color, intensity=strength, angular_diameter=angle)]
    if row.cone_angle < 180 or row.focus > 0 or row.ies_file:
        return [_shaped(read, row, name, pose)]
    if row.kind == "SphereLight":
        if row.point:
            return [PointLight(name=name, position=pose[:3, 3], color=color, intensity=strength)]
        return [_area(name, "sphere", pose, (2 * row.size[0],) * 2, color, strength)]
    if row.kind == "DiskLight":
        return [_area(name, "disk", pose, (2 * row.size[0],) * 2, color, strength)]
    for described in (x.KIND for x in DESCRIBED):
        if described.usd is not None and described.usd.name == row.kind:
            own = {x.name: value for x, value in zip(described.fields, row.size, strict=True)}  # in the fields' order
            pose = pose @ X_AIMED.T if described.usd.axis == "X" else pose
            return [described_light(described, name, pose, own, color=color, intensity=strength)]
    return _rectangle(read, name, pose, row, color, strength)


def _exact(read: Read, row: LightRow, name: str) -> Light:
    """A lamp as this package wrote it beside UsdLux's words."""
    values = {**(row.exact or {}), "name": name}
    try:
        return records.made(_CLASSES[values["type"]], values)
    except (KeyError, TypeError, ValueError):
        found = "mirelight's own values of a light, damaged"
        raise InputError(read.path, found, "clear the prim's customData", field=row.prim) from None


def _area(
    name: str, shape: str, pose: F64, size: tuple[float, ...], color: F64, strength: float, group: str | None = None
) -> Light:
    width, height = size
    return AreaLight(
        name=name,
        shape=shape,  # type: ignore[arg-type]
        world_from_light=pose,
        size=(width, height),
        color=color,
        intensity=strength,
        group=group,
    )


def _rectangle(read: Read, name: str, pose: F64, row: LightRow, color: F64, strength: float) -> list[Light]:
    width, height = row.size
    if not row.texture_file:
        return [_area(name, "rectangle", pose, (width, height), color, strength)]
    picture = _picture(read, row)
    assert picture is not None
    means = _means(picture)
    rows, columns = means.shape[:2]
    out = list[Light]()
    for i in range(rows):
        for k in range(columns):
            tint, factor = _split((means[i, k] * color * strength).tolist())
            if factor == 0:
                continue
            own = np.eye(4)
            own[:2, 3] = width / 2 - (k + 0.5) * width / columns, height / 2 - (i + 0.5) * height / rows
            size = width / columns, height / rows
            out.append(_area(f"{name}.{len(out) + 1}", "rectangle", pose @ own, size, tint, factor, name))
    return out


def _means(picture: F32) -> F64:
    """(rows, columns, 3) means of the cells of a picture; its mean as a whole stays."""
    for axis in (0, 1):
        cells = min(_CELLS, picture.shape[axis])
        edges = np.linspace(0, picture.shape[axis], cells + 1)
        sums = np.concatenate(
            [np.zeros_like(picture.take([0], axis), np.float64), picture.cumsum(axis, np.float64)], axis
        )
        low = edges.astype(int)
        part = np.expand_dims(edges - low, tuple(x for x in range(3) if x != axis))
        at = sums.take(low, axis)
        at = at + part * (sums.take(np.minimum(low + 1, picture.shape[axis]), axis) - at)
        picture = np.diff(at, axis=axis) / (picture.shape[axis] / cells)
    return np.asarray(picture, np.float64)


def _shaped(read: Read, row: LightRow, name: str, pose: F64) -> Light:
    """A light whose luminance differs by direction: as bright, from afar, as its surface seen from there."""
    theta = np.linspace(0, math.pi, DOWN)[None, :]
    phi = np.arange(AROUND)[:, None] * (2 * math.pi / AROUND)
    # Directions of the table, in the light's own axes: from its -Z, around from its +X (counter-clockwise from +Z).
    own = np.stack(np.broadcast_arrays(np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), -np.cos(theta)), -1)
    table = _facing(row, own) * _factor(read, row, theta, own)
    hard = row.cone_softness == 0 and row.cone_angle <= 90
    if not hard:
        table = table * _cone(row, theta)
    peak = float(table.max())
    if not peak > 0:
        raise InputError(read.path, "a shaped light that sends out nothing", "give a wider cone", field=row.prim)
    color, strength = _split(row.candela if row.point else row.radiance)
    profile = None
    if not np.allclose(table, peak, rtol=1e-9, atol=0):
        share = np.asarray(table / peak, np.float32)
        profile = IesProfile(share=share, nadir=-pose[:3, 2], zero=pose[:3, 0])
    radius = 0.0 if row.point else _radius(row)
    place = {"name": name, "position": pose[:3, 3], "color": color, "intensity": strength * peak}
    if not hard:
        return PointLight(**place, radius=radius, profile=profile)  # type: ignore[arg-type]
    edge = max(math.radians(row.cone_angle), 2 * _EDGE)
    return SpotLight(
        **place,  # type: ignore[arg-type]
        direction=-pose[:3, 2],
        inner_cone_angle=edge - _EDGE,
        outer_cone_angle=edge,
        cone="playcanvas",
        radius=radius,
        profile=profile,
    )


def _facing(row: LightRow, own: F64) -> F64:
    """(AROUND, DOWN) m² of the light that is seen from each direction; of a point, 1."""
    if row.point:
        return np.ones(own.shape[:2])
    if row.kind == "SphereLight":
        return np.full(own.shape[:2], math.pi * row.size[0] ** 2)
    if row.kind == "CylinderLight":
        return np.asarray(2 * row.size[1] * row.size[0] * np.sqrt(np.maximum(1 - own[..., 0] ** 2, 0)))
    area = math.pi * row.size[0] ** 2 if row.kind == "DiskLight" else row.size[0] * row.size[1]
    return np.asarray(area * np.maximum(-own[..., 2], 0))


def _radius(row: LightRow) -> float:
    """Of the ball that has the light's area, seen from its axis."""
    if row.kind == "RectLight":
        return math.sqrt(row.size[0] * row.size[1] / math.pi)
    return math.sqrt(2 * row.size[0] * row.size[1] / math.pi) if row.kind == "CylinderLight" else row.size[0]


def _cone(row: LightRow, theta: F64) -> F64:
    """1 - smoothstep from (1 - softness) of the angle to the whole (ShapingAPI, cone:softness)."""
    edge = math.radians(min(row.cone_angle, 180.0))
    start = edge * (1 - row.cone_softness)
    t = np.clip((theta - start) / max(edge - start, 1e-9), 0, 1)
    return np.asarray((1 - t * t * (3 - 2 * t)) * (theta <= edge))


def _factor(read: Read, row: LightRow, theta: F64, own: F64) -> F64:
    """Focus and IES profile, by direction."""
    out = np.abs(own[..., 2]) ** row.focus
    if not row.ies_file:
        return np.asarray(out)
    try:
        found = read_ies(read.folder / row.ies_file)
    except InputError as e:
        raise InputError(read.path, f"an IES profile: {e.found}", e.remedy, field=row.prim) from None
    profile = IesProfile(share=found.share, nadir=np.array([0.0, 0.0, -1.0]), zero=np.array([1.0, 0.0, 0.0]))
    strength = 1 / profile.solid_angle if row.ies_normalize else found.peak
    scaled, scale = theta, row.ies_angle_scale
    if scale > 0:
        scaled = np.minimum(theta / scale, math.pi)
    elif scale < 0:
        scaled = np.clip((theta - math.pi) / -scale + math.pi, 0, math.pi)
    around = np.arctan2(own[..., 1], own[..., 0])
    ways = np.stack(
        np.broadcast_arrays(np.sin(scaled) * np.cos(around), np.sin(scaled) * np.sin(around), -np.cos(scaled)), -1
    )
    return np.asarray(out * strength * profile.toward(ways))


def _picture(read: Read, row: LightRow) -> F32 | None:
    if not row.texture_file:
        return None
    try:
        return read_environment(read.folder / row.texture_file)
    except InputError as e:
        raise InputError(read.path, f"a texture: {e.found}", e.remedy, field=row.prim) from None


def _split(rgb: list[float]) -> tuple[F64, float]:
    """A colour of at most 1, and its strength."""
    values = np.array(rgb, np.float64)
    peak = float(values.max())
    return (values / peak, peak) if peak > 0 else (np.ones(3), 0.0)

"""Lights of an open stage (UsdLux), as luminance in cd/m² by colour channel."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mirelight.io.usd.exact import kept
from mirelight.io.usd.rows import Answer, LightRow, Request
from mirelight.io.usd.stage import RefusedError, Stage, rows
from mirelight.io.usd.take_cameras import keys

_KINDS = ("DistantLight", "SphereLight", "RectLight", "DiskLight", "CylinderLight", "DomeLight", "DomeLight_1")
_SIZES = {"SphereLight": ("radius",), "DiskLight": ("radius",), "RectLight": ("width", "height")}
_SIZES |= {"CylinderLight": ("length", "radius")}
_BRIGHTEST = 1e12
_TO_Z = np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0.0]])  # a dome's pole along +Z, and -Y in its middle


def times(stage: Stage, _: Request) -> Answer:
    """First and last moment at which a light moves or changes."""
    from pxr import UsdLux

    return Answer(times=keys(stage, [prim for prim in stage.prims() if prim.HasAPI(UsdLux.LightAPI)]))


def lights(stage: Stage, _: Request) -> Answer:
    """Every light of a kind that is known; the others are noted."""
    from pxr import UsdLux

    found: list[LightRow] = []
    for prim in stage.prims():
        if not prim.HasAPI(UsdLux.LightAPI):
            continue
        kind = str(prim.GetTypeName())
        if kind not in _KINDS:
            stage.note(f"{prim.GetPath()}: a {kind or 'light without a type'}, which is not followed")
            continue
        row = _light(stage, prim, kind)
        if row is not None:
            found.append(replace(row, exact=kept(prim)))
    return Answer(lights=found)


def _light(stage: Stage, prim: Any, kind: str) -> LightRow | None:
    where = str(prim.GetPath())
    radiance = _luminance(stage, prim)
    _linking(stage, prim)
    world = stage.world(prim)
    if kind.startswith("DomeLight"):
        return _dome(stage, prim, world, radiance)
    if not min(np.linalg.norm(world[:3, i]) for i in range(3)) > 0:
        raise RefusedError("a light that is scaled to nothing", "give it a size", where)
    if kind == "DistantLight":
        angle = min(max(float(_input(stage, prim, "angle", 0.53)), 0.0), 360.0)
        factor = _spread_of(angle)
        illuminance = radiance if _input(stage, prim, "normalize", False) or angle == 0 else radiance * factor
        _unshaped(stage, prim)
        return LightRow(
            name=prim.GetName(), prim=where, kind=kind, world=rows(world), radiance=_listed(illuminance), size=[angle]
        )
    size = _size(stage, prim, kind, world)
    point = kind == "SphereLight" and bool(prim.GetAttribute("treatAsPoint").Get(stage.code))
    area = _area(kind, [x / stage.unit for x in size])  # in the stage's own units
    candela = np.zeros(3)
    if _input(stage, prim, "normalize", False):
        if area > 0:
            radiance = radiance / area
        elif point:  # the limit of ever smaller spheres
            candela = radiance / 4 * stage.unit**2
        else:
            raise RefusedError("a light of no size that is normalised", "give it a size, or take normalize out", where)
    elif area == 0:
        stage.note(f"{where}: a light of no size, which sends out nothing")
        return None
    if point and area > 0:
        candela = radiance * math.pi * size[0] ** 2
    return LightRow(
        name=prim.GetName(),
        prim=where,
        kind=kind,
        world=rows(world),
        radiance=_listed(radiance),
        size=size,
        point=point,
        candela=_listed(candela),
        texture_file=_texture(stage, prim) if kind == "RectLight" else "",
        **_shaping(stage, prim),
    )


def _spread_of(angle: float) -> float:
    """Illuminance (lux) on what faces the middle of a disc of this angle (degrees) and luminance 1."""
    half = math.radians(angle) / 2
    square = math.sin(half) ** 2
    return math.pi * (square if half <= math.pi / 2 else 2 - square)


def _dome(stage: Stage, prim: Any, world: NDArray[np.float64], radiance: NDArray[np.float64]) -> LightRow:
    turned = world.copy()
    axis = prim.GetAttribute("poleAxis").Get() if prim.GetTypeName() == "DomeLight_1" else "Y"
    if axis == "Z" or (axis == "scene" and stage.turn[1, 2] != 0):
        turned[:3, :3] = turned[:3, :3] @ _TO_Z
    return LightRow(
        name=prim.GetName(),
        prim=str(prim.GetPath()),
        kind="DomeLight",
        world=rows(turned),
        radiance=_listed(radiance),
        size=[],
        texture_file=_texture(stage, prim),
        texture_format=str(_input(stage, prim, "texture:format", "automatic")),
    )


def _luminance(stage: Stage, prim: Any) -> NDArray[np.float64]:
    """intensity 2^exposure diffuse colour, times that of the temperature where it is enabled (UsdLux, LightAPI)."""
    from pxr import UsdLux

    where = str(prim.GetPath())
    usual = 50000.0 if prim.GetTypeName() == "DistantLight" else 1.0
    color = np.array(_input(stage, prim, "color", (1, 1, 1)), dtype=np.float64)
    exposure = float(_input(stage, prim, "exposure", 0.0))
    scale = float(_input(stage, prim, "intensity", usual)) * float(_input(stage, prim, "diffuse", 1.0))
    scale *= 2.0 ** min(max(exposure, -1000.0), 1000.0) if math.isfinite(exposure) else math.nan
    if _input(stage, prim, "enableColorTemperature", False):
        kelvin = float(_input(stage, prim, "colorTemperature", 6500.0))
        color = color * np.array(UsdLux.BlackbodyTemperatureAsRgb(kelvin), dtype=np.float64)
    out = np.asarray(color * scale)
    if color.shape != (3,) or not np.isfinite(out).all() or out.min() < 0 or out.max() > _BRIGHTEST:
        raise RefusedError(f"light of {out.tolist()}", f"expected 0 to {_BRIGHTEST:g} in every channel", where)
    return out


def _size(stage: Stage, prim: Any, kind: str, world: NDArray[np.float64]) -> list[float]:
    """Metres; what the transforms scale is scaled."""
    where = str(prim.GetPath())
    own = [float(_input(stage, prim, name, 0.5 if name == "radius" else 1.0)) for name in _SIZES[kind]]
    if not all(math.isfinite(x) and 0 <= x < 1e9 for x in own):
        raise RefusedError(f"a size of {own}", "give one that is finite and not negative", where)
    x, y, z = (float(np.linalg.norm(world[:3, i])) for i in range(3))
    if kind == "RectLight":
        return [own[0] * x, own[1] * y]
    across = {"SphereLight": (x, y, z), "DiskLight": (x, y), "CylinderLight": (y, z)}[kind]
    if max(across) > 1.001 * min(across):
        stage.note(f"{where}: a light scaled unevenly, taken as round")
    mean = float(np.mean(across))
    return [own[0] * x, own[1] * mean] if kind == "CylinderLight" else [own[0] * mean]


def _area(kind: str, size: list[float]) -> float:
    if kind == "SphereLight":
        return 4 * math.pi * size[0] ** 2
    if kind == "DiskLight":
        return math.pi * size[0] ** 2
    return size[0] * size[1] if kind == "RectLight" else 2 * math.pi * size[0] * size[1]


def _shaping(stage: Stage, prim: Any) -> dict[str, Any]:
    """What ShapingAPI says of a light, where it is applied."""
    from pxr import UsdLux

    if not prim.HasAPI(UsdLux.ShapingAPI):
        return {}
    tint = np.array(_input(stage, prim, "shaping:focusTint", (0, 0, 0)), dtype=np.float64)
    focus = float(_input(stage, prim, "shaping:focus", 0.0))
    if tint.any() and focus > 0:
        stage.note(f"{prim.GetPath()}: a focus tint, which is not followed")
    file = _input(stage, prim, "shaping:ies:file", None)
    return {
        "cone_angle": float(_input(stage, prim, "shaping:cone:angle", 90.0)),
        "cone_softness": min(max(float(_input(stage, prim, "shaping:cone:softness", 0.0)), 0.0), 1.0),
        "focus": max(focus, 0.0),
        "ies_file": stage.asset(file, prim),
        "ies_normalize": bool(_input(stage, prim, "shaping:ies:normalize", False)),
        "ies_angle_scale": float(_input(stage, prim, "shaping:ies:angleScale", 0.0)),
    }


def _unshaped(stage: Stage, prim: Any) -> None:
    from pxr import UsdLux

    if prim.HasAPI(UsdLux.ShapingAPI):
        stage.note(f"{prim.GetPath()}: the shaping of a distant light, which is not followed")


def _texture(stage: Stage, prim: Any) -> str:
    return stage.asset(_input(stage, prim, "texture:file", None), prim)


def _linking(stage: Stage, prim: Any) -> None:
    """Say where light links to some things alone, or passes filters."""
    for name, what in (("lightLink", "light linking"), ("shadowLink", "shadow linking")):
        ends = (prim.GetRelationship(f"collection:{name}:{side}") for side in ("includes", "excludes"))
        root = prim.GetAttribute(f"collection:{name}:includeRoot")
        if any(x and x.GetTargets() for x in ends) or (root and root.HasAuthoredValue() and not root.Get()):
            stage.note(f"{prim.GetPath()}: {what}, which is not followed; it lights everything")
    filters = prim.GetRelationship("light:filters")
    if filters and filters.GetTargets():
        stage.note(f"{prim.GetPath()}: light filters, which are not followed")


def _input(stage: Stage, prim: Any, name: str, fallback: Any) -> Any:
    attribute = prim.GetAttribute(f"inputs:{name}")
    value = attribute.Get(stage.code) if attribute else None
    return fallback if value is None else value


def _listed(values: NDArray[np.float64]) -> list[float]:
    return [float(x) for x in values]

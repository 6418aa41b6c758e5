"""lights.json: the lights of a data set in its own world, and which of them each lighting takes."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np

from mirelight.base.conventions import Matrix
from mirelight.dataset.layouts.pictures import Lamp, Shared
from mirelight.dataset.layouts.world import scale_of
from mirelight.dataset.view import DataSet
from mirelight.model import LIGHT_CLASSES, AreaLight, IesProfile, Light, PointLight, PosedLight, SpotLight, SunLight
from mirelight.relighting.surroundings import Sun
from mirelight.store.layer_index import UnitLight

_UNITS = {
    **{x.KIND.name: x.KIND.unit.of_data_sets for x in LIGHT_CLASSES},
    "environment": "candela per square metre for a value of 1",
}


def only_lamp(data: DataSet, lighting: str, world: Matrix) -> Lamp | None:
    """The point or spot light that is all of a lighting; None where there is more, or something else."""
    weighted = data.index.lightings[data.lightings.index(lighting)]
    on = [(i, w) for i, w in zip(weighted.units, weighted.weights, strict=True) if any(w)]
    if len(on) != 1:
        return None
    unit, weight = data.lights[on[0][0]], np.asarray(on[0][1])
    shining = [x for x in unit.lights if (x.color * x.intensity).any()]
    dark = all(not any(x.color) or not x.intensity for x in unit.around)
    if not dark or len(shining) != 1 or not isinstance(shining[0], PointLight | SpotLight):
        return None
    light = shining[0]
    candela = weight * light.color * light.intensity * scale_of(world) ** 2
    return Lamp(world[:3, :3] @ light.position + world[:3, 3], candela)


def described(
    data: DataSet, names: Sequence[str], file_names: Mapping[str, str], shared: Shared, written: Collection[str]
) -> dict[str, Any]:
    """The lights of a data set, as lights.json has them.

    Args:
        data: the data set.
        names: of the lightings that are written.
        file_names: what each is called there.
        shared: what all pictures have in common.
        written: names of files.
    """
    index = data.index
    lightings = []
    for one in index.lightings:
        if one.name in names:
            own = file_names[one.name]
            lights = [
                {"light": index.units[i].name, "weight": [float(v) for v in w]}
                for i, w in zip(one.units, one.weights, strict=True)
            ]
            maps = [f"environments/{own}{suffix}" for suffix in (".exr", ".hdr")]
            there = next((name for name in maps if name in written), None)
            lightings.append({"name": one.name, "file_name": own, "lights": lights, "environment": there})
    return {
        "world_from_job": shared.world.tolist(),
        "scale": shared.scale,
        "units": _UNITS,
        "exposure_stops": index.display.exposure,
        "tone": index.display.tone,
        "lights": [_described(data, unit, shared.world) for unit in index.units],
        "lightings": lightings,
    }


def _described(data: DataSet, unit: UnitLight, world: Matrix) -> dict[str, Any]:
    parts = [_light(light, world) for light in unit.lights]
    for around in unit.around:
        suns = data.suns(around)
        parts += [_sun(sun, world) for sun in suns or ()]
        if suns is None:
            strength = {"color": list(around.color), "intensity": around.intensity}
            parts.append({"type": "environment", **strength, "rotation_degrees": around.rotation})
    return {"name": unit.name, "kind": unit.kind, "parts": parts}


def _light(light: Light, world: Matrix) -> dict[str, Any]:
    scale = scale_of(world)
    part: dict[str, Any] = {"type": light.KIND.name, "color": light.color.tolist()}
    part["intensity"] = light.intensity * scale**light.KIND.unit.grows
    if isinstance(light, PosedLight):
        part["pose"] = (world @ light.world_from_light).tolist()
        for one in light.KIND.fields:
            part[one.name] = getattr(light, one.name) * (scale if one.unit == "world units" else 1.0)
    if isinstance(light, AreaLight):
        part["size"] = [x * scale for x in light.size]
    if isinstance(light, PointLight | SpotLight):
        part["position"] = (world[:3, :3] @ light.position + world[:3, 3]).tolist()
        part |= {"radius": light.radius * scale}
        if np.isfinite(light.range):
            part["range"] = light.range * scale
    if isinstance(light, SpotLight):
        part |= {"inner_cone_angle": light.inner_cone_angle, "outer_cone_angle": light.outer_cone_angle}
        part["cone"] = light.cone
    if isinstance(light, PointLight | SpotLight) and light.profile is not None:
        part["ies"] = _measured(light.profile, world[:3, :3] / scale)
    direction = getattr(light, "direction", None)
    if direction is not None:
        part["direction"] = (world[:3, :3] / scale @ direction).tolist()
    if isinstance(light, SunLight):
        part["angular_diameter_degrees"] = light.angular_diameter
    return part


def _measured(profile: IesProfile, turned: Matrix) -> dict[str, Any]:
    """A luminaire's light by direction: rows around its axis (one where all are alike), columns from nadir up."""
    share = np.round(profile.share.astype(np.float64), 5)
    rows = share[:1] if np.array_equal(share, np.broadcast_to(share[0], share.shape)) else share
    ways = {name: (turned @ getattr(profile, name)).tolist() for name in ("nadir", "zero")}
    return ways | {"share": rows.tolist()}


def _sun(sun: Sun, world: Matrix) -> dict[str, Any]:
    return {
        "type": "sun",
        "color": sun.lux.tolist(),
        "intensity": 1.0,
        "direction": (world[:3, :3] / scale_of(world) @ sun.direction).tolist(),
        "angular_diameter_degrees": sun.diameter,
    }

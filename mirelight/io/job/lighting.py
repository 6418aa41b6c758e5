"""Tables of lights and environments as the model's lightings."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from mirelight.base import conventions
from mirelight.base.conventions import Matrix
from mirelight.base.names import FreeNames
from mirelight.io.job.assets import Assets
from mirelight.io.job.described_tables import DescribedTable
from mirelight.io.job.lamp_tables import (
    AreaTable,
    ConeName,
    DirectionalTable,
    PointTable,
    SpotTable,
    SunTable,
)
from mirelight.io.job.light_kinds import AnyLight, PlayCanvasTable
from mirelight.io.job.light_tables import LightsFromTable, Lit
from mirelight.io.job.light_units import candela
from mirelight.io.job.mistakes import MOST, Mistake
from mirelight.io.job.moon import MoonTable
from mirelight.io.job.placing import environment_rotation, matrix
from mirelight.io.job.positions import Path
from mirelight.io.job.scene_tables import EnvironmentTable
from mirelight.io.job.sun_position import to_sun
from mirelight.io.job.words import meant, shown, shown_path
from mirelight.model import (
    F32,
    AreaLight,
    Deferred,
    DirectionalLight,
    EngineSettings,
    Environment,
    IesProfile,
    Light,
    Lighting,
    PointLight,
    SkyModel,
    SpotLight,
    SunLight,
    cones,
)
from mirelight.model.lights import SKY, SUN
from mirelight.model.playcanvas_lights import EngineLight, lumens, physical_light

ENVIRONMENT = "environment"  # its layer's name


def lighting(name: str, table: Lit, at: Path, files: Assets, wrong: list[Mistake]) -> Lighting:
    """The lighting of a table that stands `at` a path of the job; what is wrong is added to `wrong`."""
    for i, lamp in enumerate(table.lights):
        wrong += _engine_mistakes(lamp, (*at, "lights", i), files.engine)
    lights = [_light(light, files) for light in table.lights]
    for i, one in enumerate(table.lights_from):
        lights += _from_file(one, (*at, "lights_from", i), files, wrong)
    around = table.environment
    if around is not None and around.sky is not None:
        return Lighting(name=name, lights=unique(lights, {SUN, SKY}), sky=_sky(around))
    environment = _environment(around, files) if around else None
    return Lighting(name=name, lights=unique(lights), environment=environment)


def unique(lights: list[Light], around: Iterable[str] = (ENVIRONMENT,)) -> tuple[Light, ...]:
    """The lights with names that differ from each other and from those of the environment's layers."""
    names = FreeNames(around)
    return tuple(x if (name := names.take(x.name)) == x.name else replace(x, name=name) for x in lights)


def choose(
    names: list[str], wanted: list[str] | None, at: Path, what: str, file: str, wrong: list[Mistake]
) -> Iterator[int]:
    """Indices of the wanted names (None: of all); one that does not exist is added to `wrong`."""
    if wanted is None:
        if not names:
            wrong.append(Mistake(at, f"{shown_path(file)} holds no {what}", "name a file that does, or leave it out"))
        yield from range(len(names))
        return
    places = {name: i for i, name in reversed(list(enumerate(names)))}
    for i, name in enumerate(wanted):
        if name in places:
            yield places[name]
            continue
        if len(wrong) >= MOST:
            return
        remedy = meant(name, names, f"it has {', '.join(names[:10])}" if names else "it has none")
        wrong.append(Mistake((*at, "names", i), f"no {what} {shown(name)} in {shown_path(file)}", remedy))


def _from_file(table: LightsFromTable, at: Path, files: Assets, wrong: list[Mistake]) -> list[Light]:
    time = None if isinstance(table.time, str) else table.time
    found, default = files.scene_lights(table.path, table.unit, time)
    m = matrix(table.transform) if table.transform else default
    chosen = choose([x.name for x in found], table.names, at, "light", table.path, wrong)
    lights = [_with_cone(found[i], table.cone).carried(m) for i in chosen]
    return [
        replace(light, intensity=light.intensity * table.intensity, group=table.group or light.group)
        for light in lights
    ]


def _with_cone(light: Light, cone: ConeName) -> Light:
    """A light of a file whose spots fade by another law than the file's."""
    if not isinstance(light, SpotLight) or cone == "khr":
        return light
    inner, outer = light.inner_cone_angle, light.outer_cone_angle
    if cone == "blender":
        inner = cones.of_blender(outer, cones.blend_of_export(inner, outer))
    return replace(light, inner_cone_angle=inner, cone="playcanvas")


def _light(table: AnyLight, files: Assets) -> Light:
    if isinstance(table, PlayCanvasTable):
        return _engine_light(table, files.engine)
    if isinstance(table, DescribedTable):
        return table.light(table.name or table.type)
    own: dict[str, Any] = {"name": table.name or table.type, "group": table.group, "color": table.rgb}
    match table:
        case DirectionalTable():
            return DirectionalLight(**own, intensity=table.intensity, direction=table.way)
        case SunTable():
            across = table.angular_diameter
            return SunLight(**own, intensity=table.intensity, direction=table.way, angular_diameter=across)
        case MoonTable():
            return SunLight(**own, intensity=table.lux, direction=table.way, angular_diameter=table.seen.diameter)
        case PointTable():
            own |= _lamp(table, table.direction or (0, -1, 0), files)
            return PointLight(**own)
        case SpotTable():
            inner, outer = table.angles
            way = _direction(table)
            own |= _lamp(table, way, files)
            return SpotLight(**own, direction=way, inner_cone_angle=inner, outer_cone_angle=outer, cone=table.law)
        case AreaTable():
            pose = conventions.compose(table.position)
            if table.shape != "sphere":
                position = np.asarray(table.position)
                pose = conventions.look_at(position, position + _direction(table), table.up)
            size = table.size[0], table.size[1]
            return AreaLight(**own, intensity=table.nits, shape=table.shape, world_from_light=pose, size=size)


def _lamp(table: PointTable | SpotTable, axis: ArrayLike, files: Assets) -> dict[str, Any]:
    """What points and spots have alike."""
    candela, profile = _strength(table, axis, files)
    place, reach = np.asarray(table.position), table.range or math.inf
    return {"intensity": candela, "profile": profile, "position": place, "range": reach, "radius": table.radius}


def _strength(table: PointTable | SpotTable, axis: ArrayLike, files: Assets) -> tuple[float, IesProfile | None]:
    """Candela, and the profile where the light has one: then of the brightest direction; plane 0 along +X where the
    nadir points down."""
    if table.ies is None:
        return table.candela, None
    nadir = conventions.unit(axis)
    across = np.array([1.0, 0.0, 0.0]) if abs(nadir[0]) < 0.99 else np.array([0.0, 0.0, 1.0])
    zero = conventions.unit(across - (across @ nadir) * nadir)
    turn = math.radians(table.turn)
    zero = zero * math.cos(turn) + np.cross(-nadir, zero) * math.sin(turn)
    found = files.ies(table.ies)
    profile = IesProfile(share=found.share, nadir=nadir, zero=zero)
    if "intensity" not in table.model_fields_set:
        return found.peak, profile
    if isinstance(table, PointTable):
        lit = profile.solid_angle  # what lumens go to
    else:
        lit = profile.solid_angle_in(partial(cones.share, table.law, *table.angles))
    return candela(table.intensity, table.unit, lit), profile


def _engine_light(table: PlayCanvasTable, engine: EngineSettings) -> Light:
    """In physical units; the profile playcanvas gets the engine's own numbers back."""
    intensity = table.intensity
    if table.luminance is not None:
        intensity = table.luminance / lumens(table.kind, table.inner_cone_angle, table.outer_cone_angle)
    light = EngineLight(
        name=table.name or table.kind,
        kind=table.kind,
        color=np.asarray(table.color),
        intensity=intensity,
        position=np.asarray(table.position or (0, 0, 0)),
        direction=np.array([0.0, -1.0, 0.0]) if table.kind == "omni" else _direction(table),
        range=table.range,
        falloff=table.falloff,
        inner_cone_angle=table.inner_cone_angle,
        outer_cone_angle=table.outer_cone_angle,
        cast_shadows=table.cast_shadows,
        penumbra=table.penumbra_size or 0.0,
        penumbra_falloff=table.penumbra_falloff,
        clustered=engine.clustered,
    )
    return replace(physical_light(light), group=table.group)


def _engine_mistakes(table: AnyLight, at: Path, engine: EngineSettings) -> Iterator[Mistake]:
    """What of a light the engine would not count by the job's settings of it."""
    if not isinstance(table, PlayCanvasTable):
        return
    if engine.physical_units and table.luminance is None:
        yield Mistake(at, "no luminance, and engine.physical_units counts by it", "give luminance")
    if engine.physical_units and "intensity" in table.model_fields_set:
        remedy = "leave it out, or give it without physical_units"
        yield Mistake((*at, "intensity"), "intensity, which engine.physical_units does not count", remedy)
    if not engine.physical_units and table.luminance is not None:
        remedy = "add physical_units = true to [engine], or give intensity"
        yield Mistake((*at, "luminance"), "luminance, which the engine counts with physicalUnits alone", remedy)
    if engine.clustered and table.penumbra_size is not None and table.kind != "directional":
        found = f"a penumbra of a light of kind {table.kind}, which clustered lighting does not have"
        yield Mistake((*at, "penumbra_size"), found, "leave it out, or add clustered = false to [engine]")


def _direction(table: SpotTable | AreaTable | PlayCanvasTable) -> Matrix:
    if table.direction is not None:
        return conventions.unit(table.direction)
    return conventions.unit(np.subtract(table.target or (0, 0, 0), table.position or (0, 0, 0)))


def _environment(table: EnvironmentTable, files: Assets) -> Environment:
    radiance: F32 | Deferred[F32]
    if table.path is not None:
        radiance = files.panorama(table.path)
    else:
        radiance = np.asarray(table.radiance, dtype=np.float32).reshape(1, 1, 3)
    return Environment(
        name=ENVIRONMENT,
        radiance=radiance,
        intensity=table.intensity,
        rotation=environment_rotation(table.rotation, table.orientation),
    )


def _sky(table: EnvironmentTable) -> SkyModel:
    assert table.sky is not None
    return SkyModel(
        to_sun=to_sun(*table.sky.sun, table.rotation),
        turbidity=table.sky.turbidity,
        albedo=np.asarray(table.sky.albedo),
        intensity=table.intensity,
    )

"""Physical light units and those of the real-time engine, in one table used both ways.

PlayCanvas 2.23 (WebGL2, clustered lighting, its default) shades a Lambert surface as ``albedo * L * N·L * falloff``,
without 1/pi, with ``L = color^2.2 * intensity`` (intensity >= 1).

| physical                     | engine                                | where the engine differs |
|---|---|---|
| albedo a (linear)            | diffuse = a^(1/2.2), display-encoded  | - |
| directional, I lux           | L = I color / pi                      | - |
| sun of some diameter         | directional with PCSS shadows         | width of the penumbra |
| point, I candela             | omni, inverse squared,                | falloff 16 / (d² + 1) |
|                              | L = I color / (16 pi)                 | instead of 16 / d² |
| range r of a point or spot   | range r; none: RANGE_FACTOR times the | window (1 - (d/r)^4)², |
|                              | way to the furthest surface           | not 1 - (d/r)^4 |
| spot, half angles i and o    | in degrees, divided by CONE_SHRINK    | cone "khr": smoothstep(t) |
| area light                   | omni or spot, same candela on axis    | no area, no soft shadows |
| environment, rotation r      | the same map, rotation -r - 90        | 64 x 32 pixels of 8 bit, 64 at most |
| constant radiance c          | scene ambient c^(1/2.2)               | - |
| falloff "linear"             | omni or spot, max(0, 1 - d / range),  | physical light obeys the inverse |
|                              | equal to its candela at half the range| square law |

The engine's own numbers, where a job gives them, come back by the same rows read from right to left.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from mirelight.base import colour
from mirelight.model import (
    F64,
    Camera,
    DirectionalLight,
    Environment,
    Falloff,
    Light,
    Lighting,
    ParallelLight,
    PointLight,
    PosedLight,
    ProxyMesh,
    SpotLight,
    SunLight,
)
from mirelight.model.arrays import freeze
from mirelight.model.light_classes import punctual

INVERSE_SQUARED_GAIN = 16.0  # the engine's falloff is 16 / (d² + 1), windowed
CONE_SHRINK = 0.99  # clustered lighting stores cone angles times this, so that the shadow map's edge is not seen
DEFAULT_RANGE = 10.0  # of the engine's light component, world units
RANGE_FACTOR = 10.0  # range of a light without one, in distances to the furthest surface: the window stays above 0.9998
NEAR_LIGHT = 3.0  # world units; nearer than this the engine's d² + 1 loses more than a tenth
NORMAL_OFFSET_BIAS = 0.02  # world units; of exported lights: half of it shows acne on proxies of some metres
ENVIRONMENT_LIMIT = 64.0  # brightest radiance that the engine's RGBP encoding holds


EngineKind: TypeAlias = Literal["omni", "spot", "directional"]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class EngineLight:
    """A light component of the engine, in its own units."""

    name: str
    kind: EngineKind
    color: F64 = field(default_factory=lambda: np.ones(3))  # (3,) display-encoded, 2.2 power
    intensity: float = 1.0  # see linear_color
    position: F64 = field(default_factory=lambda: np.zeros(3))  # (3,) world units
    direction: F64 = field(default_factory=lambda: np.array([0.0, -1.0, 0.0]))  # (3,) unit, the way the light travels
    range: float = DEFAULT_RANGE  # world units; omni and spot
    falloff: Falloff = "linear"  # omni and spot
    inner_cone_angle: float = 40.0  # degrees, half angle
    outer_cone_angle: float = 45.0  # degrees, half angle
    cast_shadows: bool = False
    penumbra: float = 0.0  # its penumbraSize, of a sun the angular diameter in rad; above 0: PCSS shadows, not PCF
    penumbra_falloff: float = 1.0  # of directional ones
    clustered: bool = True  # shaded by clustered lighting, which narrows cones

    def __post_init__(self) -> None:
        for name in ("color", "position", "direction"):
            freeze(self, name, (3,), np.float64)

    @property
    def linear_color(self) -> F64:
        """(3,) what the shader multiplies by: color^2.2 * intensity; below intensity 1, (color * intensity)^2.2."""
        if self.intensity >= 1:
            return np.asarray(self.color**colour.ENGINE_GAMMA * self.intensity)
        return np.asarray((self.color * self.intensity) ** colour.ENGINE_GAMMA)

    @property
    def cone(self) -> tuple[float, float]:
        """Inner and outer half angle that the shader fades a spot between, rad."""
        shrink = CONE_SHRINK if self.clustered else 1.0
        return math.radians(self.inner_cone_angle * shrink), math.radians(self.outer_cone_angle * shrink)

    @property
    def luminance(self) -> float:
        """What `intensity` is in the engine's physicalUnits: lumens, of directional lights lux."""
        return self.intensity * lumens(self.kind, self.inner_cone_angle, self.outer_cone_angle)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class EngineLighting:
    """All that lights the engine's proxy."""

    lights: tuple[EngineLight, ...] = ()
    environment: Environment | None = None  # with mirelight's rotation; see engine_rotation
    ambient: F64 = field(default_factory=lambda: np.zeros(3))  # (3,) display-encoded scene ambient

    def __post_init__(self) -> None:
        freeze(self, "ambient", (3,), np.float64)


# --- single quantities -----------------------------------------------------------------------------------------------


def engine_diffuse(albedo: ArrayLike) -> F64:
    """(..., 3) StandardMaterial.diffuse (display-encoded) that the engine decodes to this linear albedo."""
    return np.asarray(np.asarray(albedo, dtype=np.float64) ** (1 / colour.ENGINE_GAMMA))


def engine_color(linear: ArrayLike) -> tuple[F64, float]:
    """Light color and intensity whose `linear_color` is `linear` (3,): intensity never below 1, colour at most 1."""
    value = np.maximum(np.asarray(linear, dtype=np.float64), 0)
    intensity = max(float(value.max()), 1.0)
    return (value / intensity) ** (1 / colour.ENGINE_GAMMA), intensity


def lumens(kind: EngineKind, inner_cone_angle: float, outer_cone_angle: float) -> float:
    """The luminance of the engine's light of intensity 1 (its `Light.getLightUnitConversion`); angles in degrees."""
    if kind == "directional":
        return 1.0
    if kind == "omni":
        return 4 * math.pi
    inner, outer = math.cos(math.radians(inner_cone_angle)), math.cos(math.radians(outer_cone_angle))
    return 2 * math.pi * (1 - inner + (inner - outer) / 2)


def engine_rotation(rotation: float) -> float:
    """Degrees for scene.skyboxRotation about Y from an environment's rotation, in -180..180.

    The engine's map looks to +Z at u = 0.5, ours to +X, and its rotation turns the light the other way. It is its own
    inverse.
    """
    return (-rotation - 90.0 + 180.0) % 360.0 - 180.0


# --- physical to engine ----------------------------------------------------------------------------------------------


def to_engine(
    lighting: Lighting, proxy: ProxyMesh, *, shadows: bool = True, clustered: bool = True
) -> tuple[EngineLighting, tuple[str, ...]]:
    """The engine's lights for a physical lighting, and a line for each thing that the engine cannot follow.

    Args:
        lighting: physical units.
        proxy: what is lit, world space; lights without a range reach all of it.
        shadows: False: no light casts shadow maps.
        clustered: whether the engine's clustered lighting is on; a spot is as wide either way.
    """
    warnings: list[str] = []
    lights = tuple(_engine_light(light, proxy, shadows, clustered, warnings) for light in lighting.lights)
    native = {x.name for x in lighting.lights if isinstance(x, PointLight | SpotLight) and x.falloff}
    warnings += _distance_warnings([light for light in lights if light.name not in native], proxy)
    if any(material.emissive.any() for material in proxy.materials):
        warnings.append("the proxy's surfaces that glow are dark in the engine: its material there is matt")
    environment = lighting.environment
    if environment is None:
        return EngineLighting(lights=lights), tuple(warnings)
    if shadows:
        warnings.append(f"{environment.name}: the engine's environment light casts no shadows")
    if environment.is_constant:
        ambient = engine_diffuse(environment.pixels[0, 0].astype(np.float64) * environment.intensity)
        return EngineLighting(lights=lights, ambient=ambient), tuple(warnings)
    brightest = float(environment.pixels.max(initial=0.0))  # its intensity is multiplied in after the tiles
    if brightest > ENVIRONMENT_LIMIT:
        warnings.append(
            f"{environment.name}: radiance up to {brightest:.3g} is prefiltered by the engine into "
            f"8-bit tiles that hold at most {ENVIRONMENT_LIMIT:g}; add its sun as a light of its own"
        )
    return EngineLighting(lights=lights, environment=environment), tuple(warnings)


def _engine_light(light: Light, proxy: ProxyMesh, shadows: bool, clustered: bool, warnings: list[str]) -> EngineLight:
    if isinstance(light, PosedLight):
        what = f"{light.KIND.name} lights become punctual ones of the same candela; soft shadows are lost"
        warnings.append(f"{light.name}: {what}")
        light = punctual(light)
    if isinstance(light, ParallelLight):
        color, intensity = engine_color(light.color * light.intensity / math.pi)
        return EngineLight(
            name=light.name,
            kind="directional",
            color=color,
            intensity=intensity,
            direction=light.direction,
            cast_shadows=shadows and (isinstance(light, SunLight) or light.shadows),
            penumbra=math.radians(light.angular_diameter) if isinstance(light, SunLight) else light.penumbra,
            penumbra_falloff=1.0 if isinstance(light, SunLight) else light.penumbra_falloff,
        )
    if light.profile is not None:
        where = "all around" if isinstance(light, PointLight) else "in all of its cone"
        warnings.append(f"{light.name}: the engine has no IES profile; it shines as its brightest direction {where}")
    if light.radius > 0:
        warnings.append(f"{light.name}: the engine has no radius for this light; its shadow edges differ")
    if light.falloff == "linear":
        color, intensity = engine_color(light.color * light.intensity / _linear_candela(light.range))
    else:
        if math.isfinite(light.range) and light.falloff is None:
            warnings.append(f"{light.name}: the engine squares the range's window, so it is darker towards the range")
        color, intensity = engine_color(light.color * light.intensity / (INVERSE_SQUARED_GAIN * math.pi))
    omni = EngineLight(
        name=light.name,
        kind="omni",
        color=color,
        intensity=intensity,
        position=light.position,
        range=light.range if math.isfinite(light.range) else RANGE_FACTOR * _furthest(light.position, proxy),
        falloff=light.falloff or "inverse-squared",
        cast_shadows=shadows and light.shadows,
        penumbra=light.penumbra,
        clustered=clustered,
    )
    if isinstance(light, PointLight):
        return omni
    shrink = CONE_SHRINK if clustered else 1.0
    return replace(
        omni,
        kind="spot",
        direction=light.direction,
        inner_cone_angle=math.degrees(light.inner_cone_angle) / shrink,
        outer_cone_angle=min(math.degrees(light.outer_cone_angle) / shrink, 90.0),
    )


def _linear_candela(reach: float) -> float:
    """Candela that, by the inverse square law, light a surface at half the range as a linear falloff of 1 does."""
    half, window = reach / 2, 1 - 0.5**4
    return math.pi * half**2 / 2 / window


def _furthest(position: F64, proxy: ProxyMesh) -> float:
    """From a light to the proxy's furthest corner, at least a millimetre of a metre's world."""
    if not len(proxy.vertices):
        return 1.0
    low, high = proxy.bounds
    return max(float(np.linalg.norm(np.maximum(np.abs(position - low), np.abs(position - high)))), 1e-3)


def camera_warnings(camera: Camera) -> tuple[str, ...]:
    """A line for each thing of a camera that GsplatRelighting, which copies fov, near and far, does not follow."""
    out = []
    if camera.projection == "orthographic":
        out.append(f"{camera.name} is orthographic; the engine's relighting follows perspective cameras only")
    elif not math.isclose(camera.fx, camera.fy, rel_tol=1e-4):
        out.append(f"{camera.name}: fx {camera.fx:g} is not fy {camera.fy:g}; the engine's pixels are square")
    if abs(camera.cx - camera.width / 2) > 0.01 or abs(camera.cy - camera.height / 2) > 0.01:
        out.append(f"{camera.name}: the principal point is off the centre, the only place the engine knows")
    if camera.exposure is not None:
        out.append(f"{camera.name}: the engine has no lens and no shutter; all is sharp there")
    return tuple(out)


def _distance_warnings(lights: list[EngineLight], proxy: ProxyMesh) -> list[str]:
    """A line for each light that stands so near to the proxy that 16 / (d² + 1) departs from the inverse square law."""
    out = []
    for light in lights:
        if light.kind == "directional" or not len(proxy.vertices):
            continue
        nearest = float(np.linalg.norm(proxy.vertices - light.position, axis=1).min())
        if nearest < NEAR_LIGHT:
            kept = nearest**2 / (nearest**2 + 1)
            out.append(
                f"{light.name}: {nearest:.3g} units from the proxy, where the engine's 16 / (d² + 1) gives {kept:.0%} "
                "of the inverse square law"
            )
    return out


# --- engine to physical ----------------------------------------------------------------------------------------------


def physical_warnings(lights: tuple[Light, ...]) -> tuple[str, ...]:
    """A line for each light whose engine's falloff physical light does not follow, or whose penumbra."""
    falloffs = tuple(
        f"{light.name}: linear falloff becomes the inverse square law, equal at half the range"
        for light in lights
        if isinstance(light, PointLight | SpotLight) and light.falloff == "linear"
    )
    return falloffs + penumbra_warnings(lights)


def penumbra_warnings(lights: tuple[Light, ...]) -> tuple[str, ...]:
    """A line for each light whose soft shadows are the engine's alone: mirelight follows it with hard ones."""
    return tuple(
        f"{light.name}: its penumbra is the engine's own; shadows are hard here (a sun or a radius makes soft ones)"
        for light in lights
        if isinstance(light, DirectionalLight | PointLight | SpotLight) and light.penumbra > 0
    )


def physical_light(light: EngineLight) -> DirectionalLight | PointLight | SpotLight:
    """One light of the engine in physical units."""
    linear = light.linear_color
    peak = float(linear.max()) or 1.0
    own: dict[str, Any] = {"name": light.name, "color": linear / peak, "shadows": light.cast_shadows}
    own["penumbra"] = light.penumbra
    if light.kind == "directional":
        softer = light.penumbra_falloff
        return DirectionalLight(**own, direction=light.direction, intensity=peak * math.pi, penumbra_falloff=softer)
    gain = _linear_candela(light.range) if light.falloff == "linear" else math.pi * INVERSE_SQUARED_GAIN
    own |= {"position": light.position, "intensity": peak * gain, "range": light.range, "falloff": light.falloff}
    if light.kind == "omni":
        return PointLight(**own)
    inner, outer = light.cone
    own |= {"inner_cone_angle": min(inner, outer - 1e-8), "outer_cone_angle": outer, "cone": "playcanvas"}
    return SpotLight(**own, direction=light.direction)

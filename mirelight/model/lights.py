"""Lights and environments. KHR = glTF extension KHR_lights_punctual."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from mirelight.base import conventions
from mirelight.model import shown
from mirelight.model.arrays import F32, F64, ArrayHolder, freeze
from mirelight.model.cameras import Camera
from mirelight.model.cones import ConeLaw
from mirelight.model.deferred import Deferred
from mirelight.model.ies import IesProfile
from mirelight.model.inserted import Inserted
from mirelight.model.relight_settings import RelightSettings

Falloff: TypeAlias = Literal["linear", "inverse-squared"]  # the real-time engine's two


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DirectionalLight(ArrayHolder):
    """KHR directional light: parallel, no position, hard shadows."""

    name: str
    direction: F64  # (3,) unit, the way the light travels
    color: F64 = field(default_factory=lambda: np.ones(3))  # (3,) linear Rec.709
    intensity: float = 1.0  # lux (illuminance on a facing surface)
    shadows: bool = True  # playcanvas: casts shadows; physical light always does
    penumbra: float = 0.0  # of the real-time engine's soft shadows (its penumbraSize); 0: hard ones
    penumbra_falloff: float = 1.0  # of those, directional ones (its penumbraFalloff)
    group: str | None = None  # names the layer that it shares; None: one of its own

    def __post_init__(self) -> None:
        freeze(self, "color", (3,), np.float64)
        object.__setattr__(self, "direction", conventions.unit(self.direction))
        freeze(self, "direction", (3,), np.float64)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PointLight(ArrayHolder):
    """KHR point light, or a sphere of that radius with the same candela."""

    name: str
    position: F64  # (3,) world units
    color: F64 = field(default_factory=lambda: np.ones(3))  # (3,) linear
    intensity: float = 1.0  # candela
    range: float = float("inf")  # world units; KHR window max(min(1 - (d/range)^4, 1), 0); inf: none
    radius: float = 0.0  # world units; 0: a point with hard shadows
    profile: IesProfile | None = None  # by direction, times the candela; None: the same all around
    falloff: Falloff | None = None  # of a light written in the real-time engine's terms; physical light has its own law
    shadows: bool = True  # playcanvas: casts shadows; physical light always does
    penumbra: float = 0.0  # of the real-time engine's soft shadows (its penumbraSize); 0: hard ones
    group: str | None = None  # names the layer that it shares; None: one of its own

    def __post_init__(self) -> None:
        freeze(self, "color", (3,), np.float64)
        freeze(self, "position", (3,), np.float64)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SpotLight(ArrayHolder):
    """KHR spot light: light fades between two half angles by a law (`model.cones`), `range` as for points."""

    name: str
    position: F64  # (3,) world units
    direction: F64  # (3,) unit, the cone's axis away from the light
    color: F64 = field(default_factory=lambda: np.ones(3))  # (3,) linear
    intensity: float = 1.0  # candela inside the inner cone
    range: float = float("inf")  # world units
    inner_cone_angle: float = 0.0  # rad, half angle, 0 <= inner < outer; equal to it: a hard edge
    outer_cone_angle: float = float(np.pi / 4)  # rad, half angle, <= pi / 2
    cone: ConeLaw = "khr"
    profile: IesProfile | None = None  # by direction, times candela and cone; its nadir is the axis
    radius: float = 0.0  # world units; 0: a point with hard shadows
    falloff: Falloff | None = None  # of a light written in the real-time engine's terms; physical light has its own law
    shadows: bool = True  # playcanvas: casts shadows; physical light always does
    penumbra: float = 0.0  # of the real-time engine's soft shadows (its penumbraSize); 0: hard ones
    group: str | None = None  # names the layer that it shares; None: one of its own

    def __post_init__(self) -> None:
        freeze(self, "color", (3,), np.float64)
        freeze(self, "position", (3,), np.float64)
        object.__setattr__(self, "direction", conventions.unit(self.direction))
        freeze(self, "direction", (3,), np.float64)
        if self.profile is not None and not np.allclose(self.profile.nadir, self.direction, atol=1e-6):
            raise ValueError("SpotLight.profile: its nadir is not the spot's direction")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SunLight(ArrayHolder):
    """A far disc: a directional light with an angular diameter, so soft shadow edges."""

    name: str
    direction: F64  # (3,) unit, the way the light travels (from the disc's centre)
    color: F64 = field(default_factory=lambda: np.ones(3))  # (3,) linear
    intensity: float = 1.0  # lux on a surface facing the disc's centre
    angular_diameter: float = 0.53  # degrees, > 0
    group: str | None = None  # names the layer that it shares; None: one of its own

    def __post_init__(self) -> None:
        freeze(self, "color", (3,), np.float64)
        object.__setattr__(self, "direction", conventions.unit(self.direction))
        freeze(self, "direction", (3,), np.float64)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class AreaLight(ArrayHolder):
    """A glowing rectangle, disk or sphere, seen by light only (it is not part of the proxy and blocks nothing)."""

    name: str
    shape: Literal["rectangle", "disk", "sphere"]
    world_from_light: F64  # (4, 4) rigid; a rectangle or disk lies in its XY plane and shines along its -Z
    size: tuple[float, float]  # world units: rectangle width and height; disk and sphere: diameter, twice
    color: F64 = field(default_factory=lambda: np.ones(3))  # (3,) linear
    intensity: float = 1.0  # candela per square metre (radiance), the same in every direction it shines
    group: str | None = None  # names the layer that it shares; None: one of its own

    def __post_init__(self) -> None:
        freeze(self, "color", (3,), np.float64)
        freeze(self, "world_from_light", (4, 4), np.float64)


Light: TypeAlias = DirectionalLight | PointLight | SpotLight | SunLight | AreaLight


def position_of(light: Light) -> F64 | None:
    """(3,) where a light is, world units; None: nowhere, as it shines from far away."""
    match light:
        case PointLight() | SpotLight():
            return light.position
        case AreaLight():
            return light.world_from_light[:3, 3]
        case DirectionalLight() | SunLight():
            return None


def moved_to(light: Light, position: ArrayLike) -> Light:
    """The light at another place (3,), world units, turned as before; one from far away as it is."""
    match light:
        case PointLight() | SpotLight():
            return replace(light, position=np.asarray(position, np.float64))
        case AreaLight():
            pose = light.world_from_light.copy()
            pose[:3, 3] = position
            return replace(light, world_from_light=pose)
        case DirectionalLight() | SunLight():
            return light


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Environment(ArrayHolder):
    """Light from all around: an equirectangular map or one constant radiance (a 1 x 1 map)."""

    name: str = "environment"
    radiance: F32 | Deferred[F32]  # (h, w, 3) linear, or what reads it; `pixels` gives the array either way
    intensity: float = 1.0  # multiplies the radiance
    rotation: float = 0.0  # degrees about +Y, counter-clockwise seen from above

    def __post_init__(self) -> None:
        if not isinstance(self.radiance, Deferred):
            freeze(self, "radiance", (None, None, 3))

    def __repr__(self) -> str:
        radiance = self.radiance
        size = radiance if isinstance(radiance, Deferred) else f"{radiance.shape[1]} x {radiance.shape[0]}"
        values = "" if isinstance(radiance, Deferred) else f", radiance {shown.span(radiance)}"
        return f"Environment({self.name!r}, {size}{values}, intensity {self.intensity:g}, rotation {self.rotation:g})"

    @property
    def pixels(self) -> F32:
        """(h, w, 3) linear radiance; row 0 is +Y; conventions.py says which way the columns look. Read now if it was
        not yet (InputError: the picture cannot be used)."""
        return self.radiance.value if isinstance(self.radiance, Deferred) else self.radiance

    @property
    def is_constant(self) -> bool:
        """True where the radiance is the same in every direction."""
        return self.pixels.shape[:2] == (1, 1)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SkyModel(ArrayHolder):
    """A clear day's sun and sky, computed for a place of the sun (Hosek and Wilkie 2012, 2013). Two layers: "sun" and
    "sky". Below the horizon it is black."""

    to_sun: F64  # (3,) unit, from the ground to the sun's centre; not below the horizon
    turbidity: float = 3.0  # 1 (arctic clarity) to 10 (haze)
    albedo: F64 = field(default_factory=lambda: np.full(3, 0.3))  # (3,) of the ground, which brightens the sky
    intensity: float = 1.0  # multiplies lux and cd/m²

    def __post_init__(self) -> None:
        freeze(self, "albedo", (3,), np.float64)
        object.__setattr__(self, "to_sun", conventions.unit(self.to_sun))
        freeze(self, "to_sun", (3,), np.float64)


@dataclass(frozen=True, slots=True, kw_only=True)
class EstimatedSky:
    """Captured light that is still to be estimated (`mirelight.estimate`), known by what it is estimated from. Two
    layers, as a sky model has: "sun", which lamps are in, and "sky"."""

    splats: str  # digest of the splats
    proxy: str  # digest of the proxy
    seed: int
    exposure: float = 0.0  # stops that the estimate is made stronger by
    lights: tuple[Light, ...] = ()  # where lamps were known to be, of intensity 1; how strong they were is estimated
    intensity: float = 1.0  # multiplies lux and radiance
    method: int = 6  # of estimating; counted up when the same splats give another light


SUN, SKY = "sun", "sky"  # names of a sky model's layers


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LayerFactor(ArrayHolder):
    """How strongly a layer of a lighting counts."""

    layer: str  # of `units.terms`: a light's name, a group's, the environment's, "sun" or "sky"
    factor: F64  # (3,) linear, 0 or more

    def __post_init__(self) -> None:
        freeze(self, "factor", (3,), np.float64)


@dataclass(frozen=True, slots=True, kw_only=True)
class Lighting:
    """A named set of lights: what one frame is lit by. Light names are unique in it."""

    name: str = "lighting"
    lights: tuple[Light, ...] = ()
    environment: Environment | None = None
    # Instead of an environment; a prepared scene makes a sun and a map of it (`lighting.sunsky.resolved` of a model).
    sky: SkyModel | EstimatedSky | None = None
    mix: tuple[LayerFactor, ...] = ()  # multiply light as given above; of layers that are not named: 1
    relight: RelightSettings | None = None  # how it meets the splats; None: as the job says
    objects: tuple[Inserted, ...] | None = None  # that stand in the capture then; None: as the job says
    time: float | None = None  # s: lights of a moment, for the cameras of that moment alone; None: for all cameras

    def __repr__(self) -> str:
        named = shown.names([x.name for x in self.lights])
        lights = f"{shown.count(len(self.lights), 'light')} ({named})" if named else "no lights"
        around = self.environment or self.sky
        return f"Lighting({self.name!r}: {lights}{f', {around!r}' if around is not None else ''})"

    @property
    def layer_names(self) -> tuple[str, ...]:
        """One name per layer: the lights in order, then the environment or the sky model's two."""
        around = (self.environment.name,) if self.environment else (SUN, SKY) if self.sky else ()
        return tuple(x.name for x in self.lights) + around

    def lights_up(self, camera: Camera) -> bool:
        """Whether the job renders this camera under it."""
        return self.time is None or self.time == camera.time

    def factors(self) -> dict[str, F64]:
        """By the name of a layer what `mix` says of it, (3,); the product where it says several things."""
        out: dict[str, F64] = {}
        for one in self.mix:
            out[one.layer] = out[one.layer] * one.factor if one.layer in out else one.factor
        return out

"""Lightings: lights, and what comes from all around."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from mirelight.base import conventions
from mirelight.model import shown
from mirelight.model.arrays import F32, F64, ArrayHolder, freeze
from mirelight.model.cameras import Camera
from mirelight.model.deferred import Deferred
from mirelight.model.inserted import Inserted
from mirelight.model.light_classes import Light
from mirelight.model.relight_settings import RelightSettings


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

"""What an estimate of captured light is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mirelight.model import F64, Environment, Lighting, PointLight, SunLight
from mirelight.model.lights import SKY, SUN

_SUN_VALUES = 7  # direction, irradiance, diameter: before the map's own


@dataclass(frozen=True, slots=True, eq=False)
class Confidence:
    """What speaks for an estimate, and what could not be known."""

    places: int  # splats that it was found from
    blocked: float  # share of their view that other surfaces take, 0..1: what colour and scale are known by
    scale_known: bool  # from light between surfaces; otherwise albedos were made 0.35 in the mean
    sun_gain: float  # how much less alike surfaces come out without a sun; 0.1 hard, 0.02 soft, less: hardly one
    sun_apart: float  # degrees between the suns that two halves of the splats give; NaN where one gives none
    halves_apart: float  # median factor, less 1, between the irradiances that both halves give
    held_out: float  # 0..1: of the colours' differences, the share that light from the other half explains
    lamps_gain: tuple[float, ...]  # how much less alike surfaces of the other half come out without each lamp
    albedo: tuple[float, float, float]  # 5 %, median and 95 % of the albedos that come out (luminance)


@dataclass(frozen=True, slots=True, eq=False)
class Estimate:
    """The light that splats were captured under, as far as they tell."""

    to_sun: F64  # (3,) unit; straight up where there is no sun
    sun: F64  # (3,) linear: irradiance of a facing surface; 0: no sun
    sun_diameter: float  # degrees
    lamps: F64  # (L, 6) position in world units, candela in linear RGB
    radiance: F64  # (48, 96, 3) linear, equirectangular, row 0 is +Y
    confidence: Confidence

    @property
    def lighting(self) -> Lighting:
        """As lights: a sun, lamps and a map."""
        return lighting_of(self.packed())

    def packed(self) -> F64:
        """All of the light as one row of numbers, for keeping."""
        lamps = [len(self.lamps)], self.lamps.ravel()
        return np.concatenate([self.to_sun, self.sun, [self.sun_diameter], *lamps, self.radiance.ravel()])


def lighting_of(packed: F64) -> Lighting:
    """The lighting of :meth:`Estimate.packed`: a light "sun", which may have intensity 0, lamps in its layer, and an
    environment "sky"."""
    values = np.asarray(packed, dtype=np.float64)
    to_sun, color, diameter = values[:3], values[3:6], float(values[6])
    lux = float(color.max())
    end = _SUN_VALUES + 1 + 6 * int(values[_SUN_VALUES])
    rows_of_lamps = values[_SUN_VALUES + 1 : end].reshape(-1, 6)
    lamps = tuple(
        PointLight(
            name=f"lamp {k}",
            position=row[:3],
            color=row[3:] / row[3:].max(),
            intensity=float(row[3:].max()),
            group=SUN,
        )
        for k, row in enumerate(rows_of_lamps, 1)
    )
    pixels = values[end:]
    rows = round((len(pixels) / 6) ** 0.5)
    sun = SunLight(
        name=SUN,
        direction=-to_sun,
        color=color / lux if lux > 0 else np.ones(3),
        intensity=lux,
        angular_diameter=diameter,
    )
    radiance = pixels.reshape(rows, 2 * rows, 3).astype(np.float32)
    return Lighting(name="captured", lights=(sun, *lamps), environment=Environment(name=SKY, radiance=radiance))

"""What an estimate of captured light is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from mirelight.model import F64, Environment, Light, Lighting, PointLight, SunLight
from mirelight.model.lights import SKY, SUN

_SUN_VALUES = 7  # direction, irradiance, diameter: before those of lamps and the map's own


@dataclass(frozen=True, slots=True, eq=False)
class Confidence:
    """What speaks for an estimate, and what could not be known."""

    places: int  # splats that it was found from
    blocked: float  # share of their view that other surfaces take, 0..1: what colour and scale are known by
    scale_known: bool  # from light between surfaces; otherwise albedos were made 0.35 in the mean
    sun_gain: float  # how much less alike surfaces come out without a sun; 0.1 hard, 0.02 soft, less: hardly one
    sun_apart: float  # degrees between the suns that two halves of the splats give; NaN where one gives none
    sun_beaten: float  # deviations by which shadows' edges speak for a sun elsewhere; below 0: for this one
    sun_disc: tuple[float, float]  # degrees, the narrowest and the widest disc that may be its own by these splats
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
    named: tuple[Light, ...]  # that were known to have been there, with the colours and intensities found
    lamps: F64  # (L, 6) of those that were searched: position in world units, candela in linear RGB
    radiance: F64  # (48, 96, 3) linear, equirectangular, row 0 is +Y
    confidence: Confidence

    @property
    def lighting(self) -> Lighting:
        """As lights: a sun, lamps and a map."""
        return lighting_of(self.packed(), self.named)

    def packed(self) -> F64:
        """(N,) all of the light as one row of numbers, for keeping."""
        named = [light.color * light.intensity for light in self.named]
        lamps = *named, [len(self.lamps)], self.lamps.ravel()
        return np.concatenate([self.to_sun, self.sun, [self.sun_diameter], *lamps, self.radiance.ravel()])


def lighting_of(packed: F64, named: Sequence[Light] = ()) -> Lighting:
    """The lighting of :meth:`Estimate.packed`, numbers (N,): a light "sun", which may have intensity 0, lamps in its
    layer (`named` ones, which the estimate was given, first), and an environment "sky"."""
    values = np.asarray(packed, dtype=np.float64)
    to_sun, color, diameter = values[:3], values[3:6], float(values[6])
    strengths, values = np.split(values[_SUN_VALUES:], [3 * len(named)])
    known = tuple(
        replace(light, color=rgb / max(rgb.max(), 1e-30), intensity=float(rgb.max()), group=SUN)
        for light, rgb in zip(named, strengths.reshape(-1, 3), strict=True)
    )
    lux = float(color.max())
    end = 1 + 6 * int(values[0])
    rows_of_lamps = values[1:end].reshape(-1, 6)
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
    return Lighting(name="captured", lights=(sun, *known, *lamps), environment=Environment(name=SKY, radiance=radiance))

"""The moon by place and time, as a light of the job file: where it stands, and how bright it is."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime
from typing import Literal, Self

import numpy as np
from pydantic import Field, model_validator

from mirelight.base.colour import blackbody
from mirelight.base.conventions import Matrix
from mirelight.io.job.fields import NotNegative, wrong
from mirelight.io.job.lamp_tables import ColouredTable
from mirelight.io.job.scene_tables import Latitude, Longitude, Moment
from mirelight.io.job.sun_position import days_of, horizontal, obliquity, sun_longitude, to_sun
from mirelight.model import F64

KELVIN = 4100.0  # of moonlight
_FULL = -12.73  # magnitude of a full moon at its mean distance, outside the air
_OF_A_LUX = -14.18  # magnitude of a star that gives one lux
_AIR = 0.21  # magnitudes that clear air takes from what stands overhead
_MEAN_PARALLAX = 0.9507  # degrees, at the mean distance


@dataclass(frozen=True, slots=True)
class Moon:
    """The moon as a place on the earth sees it; degrees."""

    elevation: float
    azimuth: float  # clockwise from north, 0..360
    phase: float  # angle between sun and earth as the moon sees them: 0 full, 180 new
    diameter: float  # of its disc
    lux: float  # on a surface that faces it, in clear air


def moon(latitude: float, longitude: float, time: datetime) -> Moon:
    """Where the moon stands, good to 0.3 degrees, and its light, good to a fifth where it is more than half lit.

    Position and parallax: the low-precision formulas of the Astronomical Almanac (section D). Magnitude by phase:
    Allen, Astrophysical Quantities. Air: 0.21 magnitudes times the air mass of Kasten and Young (1989).

    Args:
        latitude: degrees, north is positive.
        longitude: degrees, east is positive.
        time: with its time zone.
    """
    days = days_of(time)
    t = days / 36525

    def turned(start: float, rate: float) -> float:
        return float(np.radians((start + rate * t) % 360))

    anomaly, evection = turned(135.0, 477198.87), turned(259.3, -413335.36)
    variation, second = turned(235.7, 890534.22), turned(269.9, 954397.74)
    around = (
        218.32
        + 481267.881 * t
        + 6.29 * np.sin(anomaly)
        - 1.27 * np.sin(evection)
        + 0.66 * np.sin(variation)
        + 0.21 * np.sin(second)
        - 0.19 * np.sin(turned(357.5, 35999.05))
        - 0.11 * np.sin(turned(186.5, 966404.03))
    )
    above = (
        5.13 * np.sin(turned(93.3, 483202.02))
        + 0.28 * np.sin(turned(228.2, 960400.89))
        - 0.28 * np.sin(turned(318.3, 6003.15))
        - 0.17 * np.sin(turned(217.6, -407332.21))
    )
    parallax = (
        0.9508
        + 0.0518 * np.cos(anomaly)
        + 0.0095 * np.cos(evection)
        + 0.0078 * np.cos(variation)
        + 0.0028 * np.cos(second)
    )
    along, up = np.radians(around), np.radians(above)
    tilt = obliquity(days)
    x, y, z = np.cos(up) * np.cos(along), np.cos(up) * np.sin(along), np.sin(up)
    y, z = y * np.cos(tilt) - z * np.sin(tilt), y * np.sin(tilt) + z * np.cos(tilt)
    elevation, azimuth = horizontal(latitude, longitude, days, np.arctan2(y, x), np.arcsin(z))
    elevation -= float(parallax * np.cos(np.radians(elevation)))  # seen from the ground, not from the earth's middle
    away = np.cos(up) * np.cos(along - sun_longitude(days))
    phase = 180 - float(np.degrees(np.arccos(np.clip(away, -1, 1))))
    nearer = float(parallax) / _MEAN_PARALLAX
    return Moon(elevation, azimuth, phase, 0.545 * float(parallax), _lux(elevation, phase) * nearer**2)


def _lux(elevation: float, phase: float) -> float:
    """At the mean distance; nothing below the horizon."""
    if elevation <= 0:
        return 0.0
    mass = 1 / (np.sin(np.radians(elevation)) + 0.50572 * (elevation + 6.07995) ** -1.6364)
    magnitude = _FULL + 0.026 * phase + 4e-9 * phase**4 + _AIR * mass
    return float(10 ** (-0.4 * (magnitude - _OF_A_LUX)))


class MoonTable(ColouredTable):
    """The moon by place and time: a disc as bright as its phase and height make it."""

    type: Literal["moon"]
    latitude: Latitude = Field(description="Degrees, north is positive.")
    longitude: Longitude = Field(description="Degrees, east is positive.")
    time: Moment = Field(description="Date and time with its offset from UTC, without quotes.")
    intensity: NotNegative | None = Field(
        default=None,
        description="Illuminance of a surface that faces it, in lux. Default: by its phase and height, 0.2 of a full "
        "moon.",
    )

    @model_validator(mode="after")
    def _risen(self) -> Self:
        if self.seen.elevation <= 0:
            found = f"the moon is {-self.seen.elevation:.1f} degrees below the horizon then"
            raise wrong(found, "take another time", at="time")
        return self

    @property
    def seen(self) -> Moon:
        """The moon then and there."""
        return moon(self.latitude, self.longitude, self.time)

    @property
    def rgb(self) -> F64:
        """(3,) linear colour of the light: that of 4100 kelvin, where the table gives none."""
        given = self.kelvin is not None or "color" in self.model_fields_set
        return super().rgb if given else blackbody(KELVIN)

    @property
    def lux(self) -> float:
        """On a surface that faces it."""
        return self.seen.lux if self.intensity is None else self.intensity

    @property
    def way(self) -> Matrix:
        """(3,) the way the light travels."""
        return -to_sun(self.seen.elevation, self.seen.azimuth)

"""Where the sun stands, by place and time; and what stands elsewhere among the stars."""

from __future__ import annotations

from datetime import UTC, datetime

import numpy as np

from mirelight.base.conventions import Matrix

SOUTH = 180.0  # degrees: the azimuth of a sun whose azimuth is not given


def sun_position(latitude: float, longitude: float, time: datetime) -> tuple[float, float]:
    """Elevation and azimuth of the sun's centre in degrees; azimuth is clockwise from north, 0..360.

    The low-precision formulas of the Astronomical Almanac (section C), good to 0.01 degrees between 1950 and 2050; the
    air's refraction, which lifts a sun on the horizon by half a degree, is left out.

    Args:
        latitude: degrees, north is positive.
        longitude: degrees, east is positive.
        time: with its time zone.
    """
    days = days_of(time)
    along, tilt = sun_longitude(days), obliquity(days)
    ascension = np.arctan2(np.cos(tilt) * np.sin(along), np.cos(along))
    return horizontal(latitude, longitude, days, ascension, np.arcsin(np.sin(tilt) * np.sin(along)))


def days_of(time: datetime) -> float:
    """Days since noon of 1 January 2000, UTC; the time has its time zone."""
    return (time.astimezone(UTC) - datetime(2000, 1, 1, 12, tzinfo=UTC)).total_seconds() / 86400


def sun_longitude(days: float) -> float:
    """Ecliptic longitude of the sun in radians; days as of :func:`days_of`."""
    anomaly = np.radians(357.528 + 0.9856003 * days)
    mean_longitude = 280.460 + 0.9856474 * days
    return float(np.radians(mean_longitude + 1.915 * np.sin(anomaly) + 0.020 * np.sin(2 * anomaly)))


def obliquity(days: float) -> float:
    """Tilt of the earth's axis against the ecliptic in radians; days as of :func:`days_of`."""
    return float(np.radians(23.439 - 0.0000004 * days))


def horizontal(
    latitude: float, longitude: float, days: float, ascension: float, declination: float
) -> tuple[float, float]:
    """Elevation and azimuth in degrees of a place among the stars, its right ascension and declination in radians;
    latitude and longitude as of :func:`sun_position`, days as of :func:`days_of`."""
    sidereal = np.radians((280.46061837 + 360.98564736629 * days + longitude) % 360)
    hour_angle, north = sidereal - ascension, np.radians(latitude)
    up = np.sin(north) * np.sin(declination) + np.cos(north) * np.cos(declination) * np.cos(hour_angle)
    east = -np.cos(declination) * np.sin(hour_angle)
    northward = np.cos(north) * np.sin(declination) - np.sin(north) * np.cos(declination) * np.cos(hour_angle)
    azimuth = np.degrees(np.arctan2(east, northward)) % 360
    return float(np.degrees(np.arcsin(np.clip(up, -1, 1)))), float(azimuth)


def to_sun(elevation: float, azimuth: float, rotation: float = 0.0) -> Matrix:
    """(3,) unit, towards a sun there. North is -Z and east +X, as on a map seen from above; `rotation` turns that about
    +Y, counter-clockwise seen from above. All in degrees."""
    height, turn = np.radians(elevation), np.radians(azimuth - rotation)
    return np.array([np.cos(height) * np.sin(turn), np.sin(height), -np.cos(height) * np.cos(turn)])


def of_direction(towards: Matrix) -> tuple[float, float]:
    """Elevation and azimuth in degrees of what a direction (3,) points at: :func:`to_sun` back."""
    x, y, z = towards / np.linalg.norm(towards)
    return float(np.degrees(np.arcsin(np.clip(y, -1, 1)))), float(np.degrees(np.arctan2(x, -z)) % 360)

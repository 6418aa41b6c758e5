"""Procedural light maps: skies and studios, equirectangular, linear Rec.709 (see `mirelight.base.conventions`)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mirelight.model import Environment, Lighting, PointLight, SunLight

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]


def directions(height: int = 128) -> F64:
    """Unit vectors (h, 2h, 3) that the pixels' centres look along."""
    polar = (np.arange(height) + 0.5) / height * np.pi
    turn = ((np.arange(2 * height) + 0.5) / (2 * height) - 0.5) * 2 * np.pi  # 0 at +X, a quarter turn at +Z
    y, r = np.cos(polar)[:, None], np.sin(polar)[:, None]
    return np.stack(np.broadcast_arrays(r * np.cos(turn), y, r * np.sin(turn)), axis=-1)


def towards(azimuth: float, elevation: float) -> F64:
    """Unit vector at degrees of azimuth (0 along +X, 90 along +Z) and elevation."""
    a, e = np.radians(azimuth), np.radians(elevation)
    return np.array([np.cos(e) * np.cos(a), np.sin(e), np.cos(e) * np.sin(a)])


@dataclass(frozen=True, kw_only=True)
class Sky:
    """Radiance of a clear sky: zenith and horizon colours, a glow around the sun, and the ground's bounce."""

    zenith: tuple[float, float, float]
    horizon: tuple[float, float, float]
    ground: tuple[float, float, float]
    glow: tuple[float, float, float]
    sun: F64  # unit vector towards it
    spread: float = 30.0  # degrees, width of the glow
    away: float = 0.0  # share by which the horizon opposite the sun is darker


def sky(look: Sky, height: int = 128) -> F32:
    """A map (h, 2h, 3) of the sky."""
    d = directions(height)
    up = d[..., 1:2]
    zenith, horizon, ground, glow = (np.array(c) for c in (look.zenith, look.horizon, look.ground, look.glow))
    blend = np.clip(up, 0, 1) ** 0.45
    flat = look.sun * [1, 0, 1]
    side = 0.5 + 0.5 * (d @ flat / max(float(np.linalg.norm(flat)), 1e-6))[..., None]
    rim = horizon * (1 - look.away * (1 - side))
    colour = rim * (1 - blend) + zenith * blend
    angle = np.degrees(np.arccos(np.clip(d @ look.sun, -1, 1)))[..., None]
    lobe = np.exp(-0.5 * (angle / look.spread) ** 2) + 2.0 * np.exp(-0.5 * (angle / (look.spread / 4)) ** 2)
    colour = colour + glow * lobe
    below = np.clip(-up * 12, 0, 1)
    return np.asarray(colour * (1 - below) + ground * below, dtype=np.float32)


def blue(azimuth: float, elevation: float, level: float) -> Environment:
    """A clear sky with a sun in that direction, its disc left out."""
    look = Sky(
        zenith=(0.20 * level, 0.34 * level, 0.62 * level),
        horizon=(0.55 * level, 0.62 * level, 0.72 * level),
        ground=(0.20 * level, 0.18 * level, 0.14 * level),
        glow=(0.3 * level, 0.26 * level, 0.2 * level),
        sun=towards(azimuth, elevation),
    )
    return Environment(name="sky", radiance=sky(look, 64))


def clear(name: str, at: tuple[float, float], color: tuple[float, float, float], lux: float, level: float) -> Lighting:
    """A clear sky: a sun at azimuth and elevation in degrees, of so many lux, and blue of so much of that of noon."""
    disc = SunLight(name="sun", direction=-towards(*at), color=np.array(color), intensity=lux, angular_diameter=0.53)
    return Lighting(name=name, lights=(disc,), environment=blue(*at, level))


def sunlit(name: str, look: Sky, color: tuple[float, float, float], lux: float, wide: float) -> Lighting:
    """A sky with its sun, so many degrees wide."""
    disc = SunLight(name="sun", direction=-look.sun, color=np.array(color), intensity=lux, angular_diameter=wide)
    return Lighting(name=name, lights=(disc,), environment=Environment(name="sky", radiance=sky(look)))


def lamplit(position: ArrayLike, color: tuple[float, float, float], candela: float, level: float) -> Lighting:
    """A lamp under the sky of a late evening."""
    lamp = PointLight(name="lamp", position=np.array(position), color=np.array(color), intensity=candela)
    return Lighting(name="lamp", lights=(lamp,), environment=blue(0, 8, level))


def clouds() -> Lighting:
    """A sky of clouds, without a sun."""
    cloudy = Sky(
        zenith=(0.9, 0.95, 1.0), horizon=(0.7, 0.75, 0.8), ground=(0.2, 0.18, 0.14), glow=(0, 0, 0), sun=towards(0, 90)
    )
    return Lighting(name="clouds", environment=Environment(name="clouds", radiance=sky(cloudy, 64)))


@dataclass(frozen=True, kw_only=True)
class Softbox:
    """A glowing rectangle on the sphere of directions."""

    centre: F64  # unit vector
    size: tuple[float, float]  # degrees, across and upright
    radiance: tuple[float, float, float]
    softness: float = 6.0  # degrees over which its edge fades


def studio(base: ArrayLike, boxes: Sequence[Softbox], height: int = 128) -> F32:
    """A dim room (radiance `base` at its ceiling, half at its floor) with softboxes."""
    d = directions(height)
    colour = np.asarray(base, dtype=np.float64) * (0.75 + 0.25 * d[..., 1:2])
    for box in boxes:
        across = np.cross([0.0, 1.0, 0.0], box.centre)
        across = across / max(float(np.linalg.norm(across)), 1e-6)
        upright = np.cross(box.centre, across)
        depth = d @ box.centre
        x = np.degrees(np.arctan2(d @ across, depth))
        y = np.degrees(np.arctan2(d @ upright, depth))
        edge = np.minimum(box.size[0] / 2 - np.abs(x), box.size[1] / 2 - np.abs(y))
        colour = colour + np.clip(edge / box.softness + 0.5, 0, 1)[..., None] * np.array(box.radiance)
    return colour.astype(np.float32)

"""A clear day's sun and sky as a sun light and a map, from Mitsuba's `sunsky` (Hosek and Wilkie 2012, 2013).

The plugin's colours are linear Rec.709, integrated from W/(m² sr nm) against the CIE 1931 observer and divided by the
integral of its luminosity curve. `LUMINANCE` undoes that and applies 683 lm/W, which gives cd/m² and lux: against the
plugin's own spectral form the sky then agrees to 1 % in luminance, and its sun comes out 7 % brighter.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np

from mirelight.base import backend, conventions
from mirelight.base.colour import luminance
from mirelight.model import F64, Environment, EstimatedSky, Lighting, SkyModel, SunLight, Variant
from mirelight.model.lights import SKY, SUN

LUMINANCE = 683.002 * 106.7502593994140625  # cd/m² of 1 in the plugin's units
ROWS = 512  # of the map: 0.35 degrees, finer than anything in the model but the sun
SUN_DIAMETER = 0.5358  # degrees, the plugin's own
_RINGS = 24  # of the disc's quadrature


def resolved(lighting: Lighting, variant: Variant = "llvm_ad_rgb") -> Lighting:
    """The lighting with its sky model turned into a sun light and an environment, and its mix in its lights' colours
    and its environment's pixels; itself where it has neither.

    Args:
        lighting: any.
        variant: Mitsuba's, as everywhere else in the job.

    Raises:
        BackendError: the variant cannot be used on this machine.
    """
    if isinstance(lighting.sky, EstimatedSky):
        raise TypeError("captured light that is to be estimated: a prepared scene resolves it")
    if lighting.sky is not None:
        sun, sky = _parts(lighting.sky, variant)
        lighting = replace(lighting, lights=(*lighting.lights, sun), environment=sky, sky=None)
    return _mixed(lighting) if lighting.mix else lighting


def plain(lighting: Lighting) -> Lighting:
    """The lighting itself, for what lights a proxy: suns, maps and mixed colours are made once, by a prepared scene.

    Raises:
        ValueError: a sky model or a mix is still in it.
    """
    if lighting.sky is not None or lighting.mix:
        raise ValueError(f"lighting {lighting.name!r} holds a sky model or a mix; hand over sunsky.resolved(lighting)")
    return lighting


def _mixed(lighting: Lighting) -> Lighting:
    factors, around = lighting.factors(), lighting.environment
    lights = tuple(replace(x, color=x.color * factors.get(x.group or x.name, 1.0)) for x in lighting.lights)
    if around is not None and around.name in factors:
        around = replace(around, radiance=around.pixels * factors[around.name].astype(np.float32))
    return replace(lighting, lights=lights, environment=around, mix=())


@lru_cache(maxsize=8)  # by identity: the frames of a job share their lightings, and the tracer its prepared map
def _parts(model: SkyModel, variant: Variant) -> tuple[SunLight, Environment]:
    mi = backend.mitsuba(variant)
    irradiance = _sun_irradiance(mi, model) * LUMINANCE
    lux = float(luminance(irradiance))
    sun = SunLight(
        name=SUN,
        direction=-model.to_sun,
        color=irradiance / max(lux, 1e-30),
        intensity=lux * model.intensity,
        angular_diameter=SUN_DIAMETER,
    )
    above = conventions.map_pixels(ROWS)[: ROWS // 2]
    radiance = np.zeros((ROWS, 2 * ROWS, 3), np.float32)
    radiance[: ROWS // 2] = _evaluated(mi, model, above.reshape(-1, 3), sun=False).reshape(above.shape)
    return sun, Environment(name=SKY, radiance=radiance, intensity=LUMINANCE * model.intensity)


def _sun_irradiance(mi: Any, model: SkyModel) -> F64:
    """(3,) what a surface facing the disc's centre receives from it, in the plugin's units: 48 x 24 midpoints, even in
    azimuth and in the square of the radius. What lies below the horizon gives nothing."""
    half = np.radians(SUN_DIAMETER / 2)
    sine = np.sin(half) * np.sqrt((np.arange(_RINGS) + 0.5) / _RINGS)
    turn = 2 * np.pi * (np.arange(2 * _RINGS) + 0.5) / (2 * _RINGS)
    s, t = np.meshgrid(sine, turn, indexing="ij")
    x = np.cross(model.to_sun, [1.0, 0, 0] if abs(model.to_sun[0]) < 0.9 else [0, 0, 1.0])
    x /= np.linalg.norm(x)
    y = np.cross(model.to_sun, x)
    local = np.stack([s * np.cos(t), s * np.sin(t), np.sqrt(1 - s * s)], axis=-1).reshape(-1, 3)
    radiance = _evaluated(mi, model, local @ np.stack([x, y, model.to_sun]), sun=True)
    return np.asarray(radiance.mean(axis=0) * np.pi * np.sin(half) ** 2)  # projected solid angle of the disc


def _evaluated(mi: Any, model: SkyModel, directions: F64, *, sun: bool) -> F64:
    """(N, 3) radiance from directions (N, 3) in the plugin's units, of the sun's disc alone or of the sky alone.

    Rec.709 cannot hold some of its colours: components below zero become zero.
    """
    # The plugin is Z up; the sky is symmetric about the plane of sun and zenith, so only the axes' order matters.
    to_sun = [float(model.to_sun[k]) for k in (2, 0, 1)]
    emitter = mi.load_dict(
        {
            "type": "sunsky",
            "sun_direction": to_sun,
            "turbidity": model.turbidity,
            "albedo": {"type": "rgb", "value": [float(a) for a in model.albedo]},
            "sun_scale": float(sun),
            "sky_scale": float(not sun),
            "sun_aperture": SUN_DIAMETER,
        }
    )
    columns = [np.ascontiguousarray(-directions[:, k], dtype=np.float32) for k in (2, 0, 1)]
    if mi.variant().startswith("scalar"):
        si = mi.SurfaceInteraction3f()
        out = np.empty((len(directions), 3))
        for row, wi in zip(out, np.stack(columns, axis=-1).tolist(), strict=True):
            si.wi = wi
            row[:] = emitter.eval(si)
    else:
        import drjit as dr

        si = dr.zeros(mi.SurfaceInteraction3f, len(directions))
        si.wi = mi.Vector3f(*(mi.Float(column) for column in columns))
        out = np.asarray(emitter.eval(si).numpy(), np.float64).T
    return np.maximum(out, 0.0)

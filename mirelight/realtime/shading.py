"""The engine's light model in NumPy: what its relighting camera writes, without shadows and indirect light.

Source: PlayCanvas 2.23 shader chunks clusteredLight, falloffLinear, falloffInvSquared and spot; checked against its
frames (tests/realtime).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from mirelight import colour
from mirelight.model import F32, F64
from mirelight.realtime.ambient import ambient_light
from mirelight.realtime.mapping import CONE_SHRINK, EngineLight, EngineLighting, physical_albedo
from mirelight.realtime.raster import Surface


def engine_lighting(surface: Surface, lighting: EngineLighting, diffuse: ArrayLike = 0.5) -> F32:
    """The relighting texture (H, W, 4): linear lit colour and coverage, as the engine's camera writes it.

    Args:
        surface: from :func:`mirelight.realtime.raster.rasterise`.
        lighting: the engine's lights, in its units.
        diffuse: StandardMaterial.diffuse, display-encoded: one number, (3,), or (H, W, 3) per pixel.
    """
    hit = surface.coverage
    position, normal = surface.position[hit].astype(np.float64), surface.normal[hit].astype(np.float64)
    light = np.zeros_like(position)
    for source in lighting.lights:
        light += _received(source, position, normal)
    if lighting.environment is not None:
        light += ambient_light(lighting.environment, normal)
    else:
        light += lighting.ambient**colour.ENGINE_GAMMA
    albedo = np.broadcast_to(physical_albedo(diffuse), (*hit.shape, 3))[hit]
    out = np.zeros((*hit.shape, 4), dtype=np.float32)
    out[hit, :3] = albedo * light
    out[hit, 3] = 1
    return out


def _received(light: EngineLight, position: F64, normal: F64) -> F64:
    """Light (N, 3) that arrives, times the cosine; no shadows."""
    if light.kind == "directional":
        cosine = np.maximum(normal @ -light.direction, 0)
        return np.asarray(cosine[:, None] * light.linear_color)
    towards = light.position - position
    distance = np.linalg.norm(towards, axis=1)
    towards = towards / np.maximum(distance, 1e-12)[:, None]
    share = np.maximum(np.einsum("ni,ni->n", normal, towards), 0) * _falloff(light, distance)
    if light.kind == "spot":
        inner, outer = (np.cos(np.radians(a * CONE_SHRINK)) for a in (light.inner_cone_angle, light.outer_cone_angle))
        share = share * _smoothstep(outer, inner, towards @ -light.direction)
    return np.asarray(share[:, None] * light.linear_color)


def _falloff(light: EngineLight, distance: F64) -> F64:
    if light.falloff == "linear":
        return np.maximum((light.range - distance) / light.range, 0)
    window = np.clip(1 - (distance / light.range) ** 4, 0, 1) ** 2
    return np.asarray(16 / (distance**2 + 1) * window)


def _smoothstep(low: float, high: float, x: F64) -> F64:
    t = np.clip((x - low) / max(high - low, 1e-12), 0, 1)
    return np.asarray(t * t * (3 - 2 * t))

"""The engine's light model in NumPy: what its relighting shader multiplies by the albedo, without shadows.

Source: PlayCanvas 2.23 shader chunks clusteredLight, falloffLinear, falloffInvSquared and spot; checked against its
frames (tests/realtime).
"""

from __future__ import annotations

import numpy as np

from mirelight.base import colour
from mirelight.lighting.engine.ambient import ambient_light
from mirelight.model import F64
from mirelight.model.playcanvas_lights import EngineLight, EngineLighting


def ambient(lighting: EngineLighting, normal: F64) -> F64:
    """Light (N, 3) from all around, times the cosine over pi, at unit normals (N, 3); nothing blocks it."""
    if lighting.environment is not None:
        return ambient_light(lighting.environment, normal)
    return np.broadcast_to(lighting.ambient**colour.ENGINE_GAMMA, normal.shape)


def received(light: EngineLight, position: F64, normal: F64) -> F64:
    """Light (N, 3) of one lamp at points and unit normals (N, 3), times the cosine; no shadows."""
    if light.kind == "directional":
        cosine = np.maximum(normal @ -light.direction, 0)
        return np.asarray(cosine[:, None] * light.linear_color)
    towards = light.position - position
    distance = np.linalg.norm(towards, axis=1)
    towards = towards / np.maximum(distance, 1e-12)[:, None]
    share = np.maximum(np.einsum("ni,ni->n", normal, towards), 0) * _falloff(light, distance)
    if light.kind == "spot":
        inner, outer = np.cos(light.cone)
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

"""The engine's light model in NumPy: what its relighting camera writes, without shadows and indirect light.

Source: PlayCanvas 2.23 shader chunks clusteredLight, falloffLinear, falloffInvSquared, spot, ambient, and
`EnvLighting.generateAtlas`; checked against its frames (tests/realtime).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mirelight import colour
from mirelight.model import F32, F64, Environment
from mirelight.realtime.mapping import CONE_SHRINK, EngineLight, EngineLighting, physical_albedo
from mirelight.realtime.raster import Surface

AMBIENT_WIDTH, AMBIENT_HEIGHT = 64, 32  # pixels of the engine's prefiltered ambient map
_SOURCE_HEIGHT = 128  # rows to which an environment is averaged before it is prefiltered
_SAMPLE_ROWS = 8  # ambient rows computed at once; bounds the memory


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
        light += _ambient(lighting.environment, normal)
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


# --- environment -----------------------------------------------------------------------------------------------------


def _ambient(environment: Environment, normal: F64) -> F64:
    """E(n) / pi (N, 3) by bilinear lookup in the engine's 64 x 32 map; a constant environment gives its radiance."""
    tile = ambient_tile(environment)
    x, y, z = normal.T
    u = np.arctan2(x, z) / (2 * np.pi)  # columns from -Z by +X, ours to turn
    u = (u + 0.5) % 1
    v = 0.5 - np.arcsin(np.clip(y, -1, 1)) / np.pi
    return _bilinear(tile, u * AMBIENT_WIDTH - 0.5, v * AMBIENT_HEIGHT - 0.5)


def ambient_tile(environment: Environment) -> F64:
    """Cosine-weighted mean radiance (32, 64, 3): row 0 is +Y, column u looks along (sin 2 pi (u - 1/2), ., cos)."""
    directions, radiance = _source(environment)
    u = (np.arange(AMBIENT_WIDTH) + 0.5) / AMBIENT_WIDTH
    v = (np.arange(AMBIENT_HEIGHT) + 0.5) / AMBIENT_HEIGHT
    turn, polar = 2 * np.pi * (u - 0.5), np.pi * v
    normals = np.stack(
        [
            np.sin(polar)[:, None] * np.sin(turn),
            np.broadcast_to(np.cos(polar)[:, None], (AMBIENT_HEIGHT, AMBIENT_WIDTH)),
            np.sin(polar)[:, None] * np.cos(turn),
        ],
        axis=-1,
    )
    rows = [
        np.maximum(normals[i : i + _SAMPLE_ROWS].reshape(-1, 3) @ directions.T, 0) @ radiance / np.pi
        for i in range(0, AMBIENT_HEIGHT, _SAMPLE_ROWS)
    ]
    return np.asarray(np.concatenate(rows).reshape(AMBIENT_HEIGHT, AMBIENT_WIDTH, 3) * environment.intensity)


def _source(environment: Environment) -> tuple[F64, F64]:
    """Directions (M, 3) in the world and radiance times solid angle (M, 3) of a map of bounded size."""
    radiance = environment.radiance.astype(np.float64)
    h, w = radiance.shape[:2]
    rows, columns = min(h, _SOURCE_HEIGHT), min(w, 2 * _SOURCE_HEIGHT)
    if environment.is_constant:
        rows, columns = 64, 128
        radiance = np.broadcast_to(radiance, (rows, columns, 3))
        h, w = rows, columns
    edges = np.cos(np.pi * np.arange(h + 1) / h)
    weight = (edges[:-1] - edges[1:]) * 2 * np.pi / w  # solid angle of one pixel of each row
    y, x = np.arange(h) * rows // h, np.arange(w) * columns // w
    sums = np.zeros((rows, columns, 3))
    np.add.at(sums, (y[:, None], x[None, :]), radiance * weight[:, None, None])
    polar = np.pi * (np.arange(rows) + 0.5) / rows
    turn = 2 * np.pi * ((np.arange(columns) + 0.5) / columns - 0.5) - np.radians(environment.rotation)
    directions = np.stack(
        [
            np.sin(polar)[:, None] * np.cos(turn),
            np.broadcast_to(np.cos(polar)[:, None], (rows, columns)),
            np.sin(polar)[:, None] * np.sin(turn),
        ],
        axis=-1,
    )
    return directions.reshape(-1, 3), sums.reshape(-1, 3)


def _bilinear(image: F64, x: NDArray[np.float64], y: NDArray[np.float64]) -> F64:
    """Columns wrap, rows end."""
    h, w = image.shape[:2]
    x0, y0 = np.floor(x).astype(np.int64), np.floor(y).astype(np.int64)
    fx, fy = (x - x0)[:, None], (y - y0)[:, None]
    top, bottom = np.clip(y0, 0, h - 1), np.clip(y0 + 1, 0, h - 1)
    left, right = x0 % w, (x0 + 1) % w
    upper = image[top, left] * (1 - fx) + image[top, right] * fx
    lower = image[bottom, left] * (1 - fx) + image[bottom, right] * fx
    return np.asarray(upper * (1 - fy) + lower * fy)

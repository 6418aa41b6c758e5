"""The proxy's light between the engine's and the physical one: one sample a pixel, every law on its own.

All functions work at the points of a rasterised surface and give radiance (H, W, 3), linear, not premultiplied; zero
where the surface is not.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from mirelight.lighting.engine.raster import Rasterised
from mirelight.lighting.engine.shading import ambient, received
from mirelight.lighting.visibility import Bool, ShadowRays
from mirelight.model import (
    F32,
    F64,
    Camera,
    Environment,
    Light,
    Lighting,
    LightingBuffer,
    LightLayer,
    ParallelLight,
    PointLight,
    PosedLight,
    SpotLight,
    cones,
)
from mirelight.model.light_classes import punctual
from mirelight.model.playcanvas_lights import EngineLighting

_MAP = (128, 256)  # an environment's directions that its irradiance is summed over
_TABLE = (45, 90)  # normals at which it is summed: every 4 degrees, bilinear between


@dataclass(frozen=True, slots=True, eq=False)
class LitSurface:
    """What the lighting camera sees, on one pixel grid, and which lights each point sees."""

    camera: Camera
    surface: Rasterised
    albedo: F32  # (H, W, 3) linear
    visible: tuple[Bool, ...]  # (H, W) for each light: its centre is seen
    biased: tuple[Bool, ...] = ()  # (H, W) the same from the points that the engine looks up; empty: not wanted

    # --- the engine's light ---

    def engine_lights(self, engine: EngineLighting, shadows: Literal["none", "biased", "exact"]) -> F32:
        """(H, W, 3) the engine's lights by its own falloffs, without shadows or with traced hard ones.

        Args:
            shadows: biased: as seen from points moved off the surface, as the engine's shadow maps are read.
        """
        hit = self.surface.coverage
        total = np.zeros_like(self.albedo)
        position, normal = self.surface.position[hit].astype(np.float64), self.surface.normal[hit].astype(np.float64)
        masks = {"none": [hit] * len(engine.lights), "biased": self.biased, "exact": self.visible}[shadows]
        for light, visible in zip(engine.lights, masks, strict=True):
            seen = visible[hit][:, None]
            total[hit] += self.albedo[hit] * (received(light, position, normal) * seen).astype(np.float32)
        return total

    def engine_environment(self, engine: EngineLighting) -> F32:
        """(H, W, 3) the engine's prefiltered environment, or its ambient colour."""
        hit = self.surface.coverage
        out = np.zeros_like(self.albedo)
        out[hit] = self.albedo[hit] * ambient(engine, self.surface.normal[hit].astype(np.float64)).astype(np.float32)
        return out

    # --- physical light, still from points and without occlusion of the sky ---

    def lights(self, lights: tuple[Light, ...]) -> F32:
        """(H, W, 3) physical lights shrunk to their centres, with hard shadows."""
        hit = self.surface.coverage
        total = np.zeros_like(self.albedo)
        position, normal = self.surface.position[hit].astype(np.float64), self.surface.normal[hit].astype(np.float64)
        for light, visible in zip(lights, self.visible, strict=True):
            irradiance = _irradiance(light, position, normal) * visible[hit][:, None]
            total[hit] += self.albedo[hit] * irradiance.astype(np.float32) / np.float32(math.pi)
        return total

    def environment(self, environment: Environment | None) -> F32:
        """(H, W, 3) the whole environment by the cosine law; nothing blocks it."""
        hit = self.surface.coverage
        out = np.zeros_like(self.albedo)
        if environment is not None:
            mean = sky_irradiance(environment, self.surface.normal[hit].astype(np.float64)) / math.pi
            out[hit] = self.albedo[hit] * mean.astype(np.float32)
        return out

    def buffer(self, radiance: F32) -> LightingBuffer:
        """A lighting texture (H, W, 3) as the engine has it: one sample a texel, coverage 0 or 1."""
        hit = self.surface.coverage
        return texture(self.camera, np.where(hit[..., None], radiance, 0), hit.astype(np.float32))


def texture(camera: Camera, radiance: F32, coverage: F32) -> LightingBuffer:
    """A buffer of one layer from radiance (H, W, 3) premultiplied by coverage (H, W), with nothing known of the
    surface."""
    nothing = np.zeros((*coverage.shape, 3), dtype=np.float32)
    return LightingBuffer(
        camera=camera,
        coverage=coverage,
        layers=(LightLayer(name="all", direct=radiance.astype(np.float32), indirect=nothing),),
        depth=nothing[..., 0],
        position=nothing,
        normal=nothing,
        geometric_normal=nothing,
        albedo=nothing,
        spp=1,
    )


def shadows(
    rays: ShadowRays, surface: Rasterised, camera: Camera, lighting: Lighting, bias: float = 0.0
) -> tuple[Bool, ...]:
    """For each light the pixels (H, W) whose surface point sees its centre.

    Args:
        bias: the engine's normalOffsetBias, world units: points are moved off the surface as its shaders do.
    """
    hit = surface.coverage
    position, normal = surface.position[hit].astype(np.float64), surface.normal[hit].astype(np.float64)
    out = []
    for light in lighting.lights:
        seen = np.zeros(hit.shape, dtype=bool)
        offset = _offset(light, position, normal, bias) if bias else None
        seen[hit] = rays.visible(surface.face[hit], position, camera.position, _centre(light), offset)
        out.append(seen)
    return tuple(out)


def _offset(light: Light, position: F64, normal: F64, bias: float) -> F64:
    """(N, 3) how far the engine moves points before it looks up their shadow.

    Along the normal; for omni lights the more, the further the light and the flatter its rays. Source: the shader
    chunks clusteredLightShadows and lightFunctionShadow.
    """
    if not isinstance(punctual(light), PointLight):
        return normal * bias
    towards = _centre(light)[:3] - position
    distance = np.linalg.norm(towards, axis=1)
    cosine = np.einsum("ni,ni->n", normal, towards) / np.maximum(distance, 1e-12)
    return np.asarray(normal * (bias * np.clip(1 - cosine, 0, 1) * distance)[:, None])


def _centre(light: Light) -> F64:
    """(4,) homogeneous place of a light."""
    return np.append(-light.direction, 0.0) if isinstance(light, ParallelLight) else np.append(light.place, 1.0)


def _irradiance(light: Light, position: F64, normal: F64) -> F64:
    """(N, 3) irradiance from a light at its centre (KHR_lights_punctual; surfaces: radiance times seen area)."""
    if isinstance(light, ParallelLight):
        return np.asarray(np.maximum(normal @ -light.direction, 0)[:, None] * light.color * light.intensity)
    towards = _centre(light)[:3] - position
    squared = np.maximum(np.einsum("ni,ni->n", towards, towards), 1e-12)
    towards = towards / np.sqrt(squared)[:, None]
    share = np.maximum(np.einsum("ni,ni->n", towards, normal), 0) / squared
    if isinstance(light, PosedLight):
        return np.asarray((share * light.seen_area(-towards))[:, None] * light.color * light.intensity)
    if math.isfinite(light.range):
        share = share * np.clip(1 - squared**2 / light.range**4, 0, 1)
    if light.profile is not None:
        share = share * light.profile.toward(-towards)
    if isinstance(light, SpotLight):
        angles = light.inner_cone_angle, light.outer_cone_angle
        share = share * cones.share(light.cone, *angles, towards @ -light.direction)
    return np.asarray(share[:, None] * light.color * light.intensity)


# --- the sky ---------------------------------------------------------------------------------------------------------


def sky_irradiance(environment: Environment, normal: F64) -> F64:
    """(N, 3) irradiance of an environment that nothing blocks, at unit normals (N, 3) in the world."""
    if environment.is_constant:
        constant = environment.pixels[0, 0].astype(np.float64) * environment.intensity * math.pi
        return np.broadcast_to(constant, normal.shape)
    turn = math.radians(environment.rotation)
    x = normal[:, 0] * math.cos(turn) - normal[:, 2] * math.sin(turn)  # turned back into the map's own axes
    z = normal[:, 0] * math.sin(turn) + normal[:, 2] * math.cos(turn)
    rows, columns = _TABLE
    table = _irradiance_table(environment) * environment.intensity
    u = (np.arctan2(z, x) / (2 * math.pi) % 1.0) * columns
    v = np.arccos(np.clip(normal[:, 1], -1, 1)) / math.pi * (rows - 1)
    left, top = u.astype(np.int64) % columns, np.minimum(v.astype(np.int64), rows - 2)
    fu, fv = (u - np.floor(u))[:, None], (v - top)[:, None]
    right = (left + 1) % columns
    upper = table[top, left] * (1 - fu) + table[top, right] * fu
    lower = table[top + 1, left] * (1 - fu) + table[top + 1, right] * fu
    return np.asarray(upper * (1 - fv) + lower * fv)


def _irradiance_table(environment: Environment) -> F64:
    """(*_TABLE, 3) irradiance by normal: rows from +Y to -Y, columns from +X towards +Z, rotation and intensity 1."""
    flux, direction = _fluxes(environment.pixels)
    rows, columns = _TABLE
    theta, phi = np.linspace(0, math.pi, rows), np.arange(columns) * (2 * math.pi / columns)
    out = np.empty((rows, columns, 3))
    for k, angle in enumerate(theta):
        normal = np.stack(
            [
                math.sin(angle) * np.cos(phi),
                np.full(columns, math.cos(angle)),
                math.sin(angle) * np.sin(phi),
            ],
            axis=-1,
        ).astype(np.float32)
        out[k] = np.maximum(normal @ direction.T, 0) @ flux
    return out


def _fluxes(radiance: F32) -> tuple[F32, F32]:
    """Radiance times solid angle (Q, 3) of blocks of an equirectangular map, and the direction (Q, 3) of each."""
    h, w = radiance.shape[:2]
    rows, columns = min(h, _MAP[0]), min(w, _MAP[1])
    edges = np.cos(math.pi * np.arange(h + 1) / h)
    weighted = radiance.astype(np.float64) * ((edges[:-1] - edges[1:]) * (2 * math.pi / w))[:, None, None]
    row_starts, column_starts = (np.arange(n) * size // n for n, size in ((rows, h), (columns, w)))
    flux = np.add.reduceat(np.add.reduceat(weighted, row_starts, axis=0), column_starts, axis=1)
    theta = math.pi * (row_starts + np.append(row_starts[1:], h)) / (2 * h)
    # the column at u = 0.5 looks along +X, the one at 0.75 along +Z
    phi = 2 * math.pi * ((column_starts + np.append(column_starts[1:], w)) / (2 * w) - 0.5)
    sine = np.sin(theta)[:, None]
    direction = np.stack(
        [sine * np.cos(phi), np.broadcast_to(np.cos(theta)[:, None], (rows, columns)), sine * np.sin(phi)], axis=-1
    )
    return flux.reshape(-1, 3).astype(np.float32), direction.reshape(-1, 3).astype(np.float32)

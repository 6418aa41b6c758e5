"""Frames by Mitsuba's `path`, once per light: no fused loop. Slow, and there to check the fast one."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import path_oracle as oracle

from mirelight.base import backend
from mirelight.lighting.layers import Layers
from mirelight.model import F32, F64, Camera, Lighting, LightingBuffer, LightLayer, ProxyMesh, RenderSettings


def trace_by_path(
    proxy: ProxyMesh,
    lighting: Lighting,
    camera: Camera,
    settings: RenderSettings,
    layers: Layers,
    *,
    emission: bool,
) -> LightingBuffer:
    """As `Tracer.trace`, by `path`: each layer twice, with and without bounces, exactly `spp` samples each.

    Unlike there, surfaces glow from their front alone and area lights block light; variance, sun visibility and
    ambient occlusion are missing.

    Raises:
        RenderError: a light that Mitsuba has no equal of (a lamp with both a radius and a cone or range).
    """
    mi = backend.mitsuba(settings.variant, settings.threads)
    without_glow = replace(proxy, materials=tuple(replace(m, emissive=np.zeros(3)) for m in proxy.materials))
    made: list[LightLayer] = []
    apart = layers if layers.separate else Layers.of(lighting, emissive=emission)
    for name, body, source in _sources(proxy, without_glow, lighting, apart):
        world = oracle.scene(mi, body, source, camera)
        direct, total = (
            oracle.path_beauty(
                mi, world, spp=settings.spp, max_depth=depth, seed=settings.seed, hide_lights=body is without_glow
            )[0]
            for depth in (1, settings.max_depth)
        )
        made.append(LightLayer(name=name, direct=direct, indirect=total - direct))
    coverage, position, normal, facing, albedo = _surface(
        mi, oracle.scene(mi, without_glow, Lighting(), camera), settings
    )
    to_viewer = _to_viewer(camera, position)
    depth = (camera.position - position) @ camera.world_from_camera[:3, 2]
    return LightingBuffer(
        camera=camera,
        coverage=coverage,
        layers=tuple(made) if layers.separate else (_together(layers.names[0], made, camera),),
        depth=np.where(coverage > 0, depth, 0),
        position=position,
        normal=_turned(normal, to_viewer),
        geometric_normal=_turned(facing, to_viewer),
        albedo=albedo,
        spp=settings.spp,
    )


def _together(name: str, layers: list[LightLayer], camera: Camera) -> LightLayer:
    black = np.zeros((camera.height, camera.width, 3), np.float32)
    return LightLayer(
        name=name, direct=sum((x.direct for x in layers), black), indirect=sum((x.indirect for x in layers), black)
    )


def _sources(
    proxy: ProxyMesh, without_glow: ProxyMesh, lighting: Lighting, layers: Layers
) -> Iterator[tuple[str, ProxyMesh, Lighting]]:
    """(layer, the mesh, what alone lights it)."""
    of_light = layers.of_light[: len(lighting.lights)]
    for index, name in enumerate(layers.names):
        lights = tuple(x for x, layer in zip(lighting.lights, of_light, strict=True) if layer == index)
        if lights:
            yield name, without_glow, Lighting(lights=lights)
        elif lighting.environment is not None and index == layers.environment:
            yield name, without_glow, Lighting(environment=lighting.environment)
        else:
            yield name, proxy, Lighting()


def _surface(mi: Any, world: Any, settings: RenderSettings) -> tuple[F32, F32, F32, F32, F32]:
    """(coverage, position, shading normal, geometric normal, albedo), averaged over covered samples."""
    aovs = "p:position,n:sh_normal,g:geo_normal,a:albedo"
    inner = {"type": "direct", "hide_emitters": True}
    integrator = mi.load_dict({"type": "aov", "aovs": aovs, "img": inner})
    picture = np.array(mi.render(world, integrator=integrator, spp=settings.spp, seed=settings.seed), np.float32)
    coverage = np.clip(picture[..., 3], 0, 1)
    weight: F32 = np.where(coverage > 0, coverage, np.float32(1))
    means: F32 = picture[..., 4:] / weight[..., None]
    means[coverage == 0] = 0
    return coverage, means[..., 0:3], means[..., 3:6], means[..., 6:9], means[..., 9:12]


def _to_viewer(camera: Camera, position: F32) -> F64:
    if camera.projection == "orthographic":
        return np.broadcast_to(camera.world_from_camera[:3, 2], position.shape)
    return camera.position - position


def _turned(normal: F32, to_viewer: F64) -> F32:
    """Normals on the viewer's side."""
    side = np.sign(np.sum(normal * to_viewer, axis=-1, keepdims=True))
    return np.asarray(normal * side, np.float32)

"""The real-time frame without a browser: the engine's light model and splat kernel, put together here."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from mirelight import relight
from mirelight.compositor import composite
from mirelight.model import F32, Camera, Frame, Job, Lighting, LightingBuffer, LightLayer, ProxyMesh
from mirelight.realtime.bundle import scene_size
from mirelight.realtime.mapping import EngineLighting, engine_diffuse, physical_albedo, to_engine
from mirelight.realtime.raster import rasterise
from mirelight.realtime.shading import engine_lighting


def engine_frame(job: Job, camera: Camera, lighting: Lighting) -> Frame:
    """What the engine would show of a job, without shadows, in float: its kernel, its lights, its tint.

    The job's settings of the compositor and the tint are taken as those of the profile playcanvas.

    Args:
        job: scene and settings.
        camera: perspective.
        lighting: physical units; the table of :mod:`mirelight.realtime.mapping` turns them into the engine's.

    Raises:
        ValueError: the job has no splats and no proxy, or its proxy has no single albedo.
        BackendError: the compositor cannot run here.
    """
    settings = replace(job.relight, profile="playcanvas", mode="tint", space="display")
    layer = None
    if job.scene.splats is not None:
        playcanvas = replace(job.compositor, profile="playcanvas")
        layer = composite(job.scene.splats, camera, playcanvas, variant=job.render.variant, threads=job.render.threads)
    buffer = None
    if job.scene.proxy is not None:
        if job.scene.proxy.albedo is None:
            raise ValueError(
                "the proxy shows its file's own colours, which the engine's light model here does not read"
            )
        engine, _ = to_engine(lighting, scene_size(job.scene), shadows=False)
        seen = relight.lighting_camera(camera, settings)
        buffer = engine_buffer(job.scene.proxy, engine, seen, engine_diffuse(job.scene.proxy.albedo))
    return relight.apply(layer, buffer, settings)


def engine_buffer(
    proxy: ProxyMesh, lighting: EngineLighting, camera: Camera, diffuse: ArrayLike = 0.5
) -> LightingBuffer:
    """The engine's relighting texture as a lighting buffer: one layer, direct light alone, one sample a pixel.

    Args:
        proxy: world space.
        lighting: the engine's lights.
        camera: of the texture's size.
        diffuse: StandardMaterial.diffuse, display-encoded, a number or (3,).
    """
    surface = rasterise(proxy, camera)
    lit = engine_lighting(surface, lighting, diffuse)
    albedo = np.broadcast_to(physical_albedo(diffuse), surface.position.shape)
    return LightingBuffer(
        camera=camera,
        coverage=lit[..., 3],
        layers=(LightLayer(name="engine", direct=lit[..., :3], indirect=np.zeros_like(lit[..., :3])),),
        depth=surface.depth,
        position=surface.position,
        normal=surface.normal,
        geometric_normal=surface.normal,
        albedo=np.where(surface.coverage[..., None], albedo, 0).astype(np.float32),
        spp=1,
    )


def blended(frame: Frame) -> F32:
    """(H, W, 4) the frame as the engine's float target holds it: premultiplied, in the space that splats blend in.

    Raises:
        ValueError: the frame has no splats.
    """
    if frame.splats is None or frame.factor is None:
        raise ValueError("a frame without splats has no blended form")
    alpha = 1 - frame.splats.transmittance
    return np.concatenate([frame.splats.color * frame.factor, alpha[..., None]], axis=-1).astype(np.float32)

"""The real-time frame without a browser: a job by the profile `playcanvas`, whatever its own profile is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mirelight import relighting
from mirelight.compositor import composite
from mirelight.lighting import trace
from mirelight.model import F32, Camera, Frame, Job, Lighting
from mirelight.proxy import mesh_of


def engine_frame(job: Job, camera: Camera, lighting: Lighting) -> Frame:
    """What the engine would show of a job, in float and with ideal shadows: its kernel, its lights, its tint.

    Args:
        job: scene and settings; its profile is taken as `playcanvas`, its mode as `tint`.
        camera: any.
        lighting: physical units; the table of :mod:`mirelight.model.playcanvas_lights` turns them into the engine's.

    Raises:
        ValueError: the job has no splats and no proxy.
        BackendError: the compositor cannot run here.
    """
    settings = replace(job.relight, profile="playcanvas", mode="tint", space="display")
    layer = buffer = None
    if job.splats is not None:
        playcanvas = replace(job.compositor, profile="playcanvas")
        layer = composite(job.splats.value, camera, playcanvas, variant=job.render.variant, threads=job.render.threads)
    proxy = mesh_of(job)
    if proxy is not None:
        seen = relighting.lighting_camera(camera, settings)
        buffer = trace(proxy, lighting, seen, replace(job.render, profile="playcanvas"))
    return relighting.apply(layer, buffer, settings, noise=False)


def blended(frame: Frame) -> F32:
    """(H, W, 4) the frame as the engine's float target holds it: premultiplied, in the space that splats blend in.

    Raises:
        ValueError: the frame has no splats.
    """
    if frame.splats is None or frame.factor is None:
        raise ValueError("a frame without splats has no blended form")
    alpha = 1 - frame.splats.transmittance
    return np.concatenate([frame.splats.color * frame.factor, alpha[..., None]], axis=-1).astype(np.float32)

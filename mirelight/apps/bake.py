"""Relit splats: new light written into the splats' own colours, for any viewer.

Every splat's colour c becomes enc(f dec(c)), f the factor of its place on the proxy (`mirelight.pipeline.splat_light`,
the same light as the mixer's), enc the sRGB curve, or none where splats hold linear light. Where splats blend in
display space, a surface whose splats share a factor keeps its look up to the curvature of enc(f dec(c)) over the
colours that meet in a pixel.
What a colour does with the view (SH above degree 0) is multiplied by that curve's slope at the splat's mean colour.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType

import numpy as np

from mirelight.base.progress import ShareProgress
from mirelight.base.sh import C0
from mirelight.lighting import sunsky
from mirelight.model import F32, F64, Camera, Job, Lighting, RelightSettings, SplatCloud
from mirelight.pipeline import requirements
from mirelight.pipeline.scene import Scene
from mirelight.pipeline.splat_light import SplatLight
from mirelight.relighting import gloss_of

_PLAIN = RelightSettings()
_STEP = 1e-3  # of display values, for the slope
_NO_FRAMES: Mapping[str, str] = MappingProxyType({})
_NO_FACTOR = 1e-6  # below, there is nothing to see


def factors(scene: Scene, lighting: Lighting, *, spp: int, progress: ShareProgress | None = None) -> F32:
    """(N, 3) what the linear colours of the scene's splats are multiplied by under one of the job's lightings.

    Args:
        scene: a prepared job.
        lighting: one of the job's.
        spp: samples a splat.
        progress: hears what is traced.

    Raises:
        InputError: no splats, proxy or lights; the profile playcanvas.
        RenderError: no splat lies on the proxy.
        BackendError: the variant cannot be used on this machine.
    """
    requirements.check_lit_splats(scene.job)
    blend = np.float32(scene.job.relight_of(lighting).blend)
    return np.asarray(1 - blend + blend * SplatLight(scene, spp, progress).factor(lighting), np.float32)


def relit(cloud: SplatCloud, factor: F32, settings: RelightSettings = _PLAIN) -> SplatCloud:
    """Splats with the light in their colours.

    Args:
        cloud: N splats, in any axes.
        factor: (N, 3) linear, 0 or more, `blend` included.
        settings: what becomes of colour that changes with the view: kept, faded or removed, as in a frame.
    """
    shown = 0.5 + C0 * cloud.sh[:, 0].astype(np.float64)
    new = _relit(cloud, shown, factor)
    slope = (_relit(cloud, shown + _STEP, factor) - _relit(cloud, shown - _STEP, factor)) / (2 * _STEP)
    gloss = gloss_of(settings)
    if gloss == "fade":  # the slope is of the display curve and of the factor: the latter is min(f, 1)
        slope *= np.minimum(factor, 1) / np.maximum(factor, _NO_FACTOR)
    elif gloss == "remove" and settings.blend == 1:
        cloud = replace(cloud, sh=cloud.sh[:, :1])
    elif gloss == "remove":
        slope *= (1 - settings.blend) / np.maximum(factor, _NO_FACTOR)
    sh = cloud.sh * slope[:, None, :].astype(np.float32)
    sh[:, 0] = (new - 0.5) / C0
    return replace(cloud, sh=sh)


def write_stage(
    path: Path, baked: SplatCloud | None, job: Job, lighting: Lighting, frames: Mapping[str, str] = _NO_FRAMES
) -> None:
    """A stage of OpenUSD to go on with elsewhere: the relit splats, those as captured (not seen), the proxy, the lights
    that the splats are relit by, and the job's cameras; those of one animation are one that moves.

    Args:
        path: the stage.
        baked: the relit splats; None: the job has none.
        job: a prepared one, whose proxy is there.
        lighting: one of its lightings.
        frames: by a camera's name its picture under that lighting, as a path from the stage's folder.

    Raises:
        OutputError: it cannot be written.
        BackendError: the library for it is not installed.
    """
    from mirelight.io.usd.write import StageWriter
    from mirelight.io.usd.write_lights import add_camera, add_environment, add_light
    from mirelight.io.usd.write_mesh import add_proxy

    writer = StageWriter(path)
    if baked is not None and job.splats is not None:
        writer.splats(baked, "relit", captured=job.splats.value)
    if job.proxy is not None:
        add_proxy(writer, job.proxy.value)
    plain = sunsky.resolved(lighting, job.render.variant)
    for light in plain.lights:
        add_light(writer, light)
    if plain.environment is not None:
        add_environment(writer, plain.environment)
    moments: dict[str, list[Camera]] = {}
    for camera in job.cameras:
        name = camera.name.rpartition(".")[0] if camera.time is not None else camera.name
        moments.setdefault(name, []).append(camera)
    for shots in moments.values():
        add_camera(writer, shots, frames)
    writer.save()


def _relit(cloud: SplatCloud, shown: F64, factor: F32) -> F64:
    """enc(f dec(c)), by the cloud's own encoding; colours below black stay there."""
    return cloud.colors_of(cloud.light(shown.astype(np.float32)) * factor).astype(np.float64)

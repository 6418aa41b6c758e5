"""How many samples which pixels of a frame get."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mirelight.base.progress import CountProgress
from mirelight.lighting.frame import PASS, FrameInProgress, Passes
from mirelight.model import Camera, RenderSettings

_PINHOLE = 0x9E3779B1  # between the seeds of pinholes that share a picture


def for_camera(settings: RenderSettings, camera: Camera) -> RenderSettings:
    """The settings of one of several pinholes whose mean is a picture: its share of the samples, drawn anew."""
    if camera.share is None:
        return settings
    number, count = camera.share
    noise = None if settings.noise is None else settings.noise * count**0.5
    seed = (settings.seed + _PINHOLE * (number + 1)) & 0xFFFFFFFF
    return replace(settings, spp=-(-settings.spp // count), noise=noise, seed=seed)


def with_pilot(settings: RenderSettings) -> RenderSettings:
    """Under a noise target, samples everywhere for a first look: whole batches, two at least."""
    if settings.noise is None:
        return settings
    return replace(settings, spp=max(-(-settings.spp // PASS), 2) * PASS)


def sample_all(frame: FrameInProgress, settings: RenderSettings, progress: CountProgress) -> None:
    """Passes until every pixel has its samples, then more of the noisy ones while the noise is above its target."""
    size, passes = len(frame.samples), _passes(settings.spp)
    for some in passes:
        for done in frame.add_passes(some):
            progress(done, settings.spp * size)
    if settings.noise is None:
        for done in frame.add_rounds(settings.spp, _passes):
            progress(min(done, settings.spp * size), settings.spp * size)
    if settings.noise is None and not settings.denoise and settings.spp > 1:
        frame.sample_again(passes)
    while settings.noise is not None:
        estimate = frame.estimate()
        wanted = estimate.wanted(settings.noise)
        if np.array_equal(wanted, estimate.samples):
            break
        total = int(wanted.sum())
        while len(noisy := np.flatnonzero(frame.samples < wanted)):
            fewest = int((wanted - frame.samples)[noisy].min())
            for done in frame.add_passes(Passes(PASS, -(-fewest // PASS)), noisy):
                progress(done, total)


def _passes(spp: int) -> list[Passes]:
    """So many samples in passes of PASS, and what is left by its powers of two."""
    left = [Passes(1 << k) for k in range(PASS.bit_length() - 2, -1, -1) if spp % PASS >> k & 1]
    return [Passes(PASS, spp // PASS), *left] if spp >= PASS else left

"""Denoising by Intel Open Image Denoise, only when asked: biased, and therefore recorded by the caller."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from mirelight.errors import BackendError
from mirelight.model import F32, LightingBuffer, LightLayer


def denoise(buffer: LightingBuffer) -> LightingBuffer:
    """Every layer denoised, guided by albedo and normal.

    The sum of the denoised layers is the denoised beauty only approximately, so the sum is denoised as well and the
    layers are scaled to it, pixel by pixel. `variance` becomes None: it described the noisy picture.

    Raises:
        BackendError: the optional package `pyoidn` is not installed.
    """
    run = _filter(buffer)
    noisy = buffer.beauty
    target = run(noisy)
    layers = [
        LightLayer(name=x.name, direct=run(x.direct), indirect=run(x.indirect) if x.indirect.any() else x.indirect)
        for x in buffer.layers
    ]
    total = sum((x.total for x in layers), np.zeros_like(noisy))
    scale: F32 = np.where(total > 0, target / np.where(total > 0, total, np.float32(1)), np.float32(0))
    fitted = tuple(LightLayer(name=x.name, direct=x.direct * scale, indirect=x.indirect * scale) for x in layers)
    return replace(buffer, layers=fitted, variance=None)

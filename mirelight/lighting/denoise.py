"""Denoising by Intel Open Image Denoise, only when asked: it is biased, and what it returns carries no variance."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from mirelight.errors import BackendError
from mirelight.model import F32, LightingBuffer, LightLayer


def denoise(buffer: LightingBuffer) -> LightingBuffer:
    """The beauty and every layer denoised, guided by albedo and normals that are denoised first.

    Denoised layers do not add up to the denoised beauty, so they are scaled to it pixel by pixel. `variance` becomes
    None: it described the noisy picture, and nothing says how far a denoised one is from the truth.

    Raises:
        BackendError: the optional package `pyoidn` is not installed.
    """
    try:
        import pyoidn  # type: ignore[import-untyped]
    except ImportError as missing:
        raise BackendError(
            "denoising needs Open Image Denoise: pip install pyoidn, or set denoise = false"
        ) from missing
    with pyoidn.Device() as device:
        device.commit()
        clean = _Denoiser(pyoidn, device, buffer)
        beauty = clean(buffer.beauty)
        layers = [
            LightLayer(
                name=x.name, direct=clean(x.direct), indirect=clean(x.indirect) if x.indirect.any() else x.indirect
            )
            for x in buffer.layers
        ]
    total = sum((x.total for x in layers), np.zeros_like(beauty))
    lit = total > 0
    scale: F32 = np.where(lit, beauty / np.where(lit, total, np.float32(1)), np.float32(0))
    fitted = tuple(LightLayer(name=x.name, direct=x.direct * scale, indirect=x.indirect * scale) for x in layers)
    return replace(buffer, layers=fitted, variance=None)


class _Denoiser:
    """One frame's guides, and the filter that uses them."""

    def __init__(self, pyoidn: Any, device: Any, buffer: LightingBuffer) -> None:
        self._pyoidn, self._device = pyoidn, device
        covered = buffer.coverage[..., None]
        self._guides: dict[str, F32] = {}
        guides = {"albedo": buffer.albedo * covered, "normal": buffer.normal * covered}
        for name, image in guides.items():
            self._guides[name] = self._run({name: np.ascontiguousarray(image)})

    def __call__(self, color: F32) -> F32:
        """A linear picture, (H, W, 3), denoised and not below 0."""
        images = {"color": np.ascontiguousarray(color), **self._guides}
        return np.maximum(self._run(images, hdr=True, cleanAux=True), np.float32(0))

    def _run(self, images: dict[str, F32], **flags: bool) -> F32:
        images = {name: np.array(image) for name, image in images.items()}  # writeable: the binding asks for it
        out = np.zeros_like(next(iter(images.values())))
        with self._pyoidn.Filter(self._device, "RT") as run:
            for name, image in {**images, "output": out}.items():
                run.set_image(name, image, self._pyoidn.OIDN_FORMAT_FLOAT3)
            for flag, value in flags.items():
                run.set_bool(flag, value)
            run.commit()
            run.execute()
        error = self._device.get_error()
        if error is not None:
            raise BackendError(f"Open Image Denoise failed: {error}")
        return out

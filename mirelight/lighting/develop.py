"""From the film's sums to a LightingBuffer. NumPy only."""

from __future__ import annotations

import os

import numpy as np
from numpy.typing import NDArray

from mirelight.errors import RenderError
from mirelight.lighting.layers import Layers
from mirelight.model import F32, Camera, LightingBuffer, LightLayer

SURFACE = 16  # floats a pixel: coverage, depth | position | shading normal | geometric normal | albedo, 2 unused


def develop(
    camera: Camera, layers: Layers, light: F32, surface: F32, squares: F32, samples: NDArray[np.int64], batch: int = 1
) -> LightingBuffer:
    """Sums to means.

    Args:
        camera: of H x W pixels.
        layers: K of them.
        light: (K * 2 * H * W * 3) radiance, direct and indirect, flat.
        surface: (H * W * SURFACE) AOVs, flat.
        squares: (H * W * 3) of the radiance summed over each batch, flat.
        samples: (H * W) taken, all above 0.
        batch: samples in a batch.
    """
    h, w = camera.height, camera.width
    n = samples.reshape(h, w).astype(np.float32)
    sums = surface.reshape(h, w, SURFACE)
    hits = sums[..., 0]
    seen: F32 = np.maximum(hits, np.float32(1))
    mean: F32 = sums / seen[..., None]
    films = light[: len(layers.names) * 2 * h * w * 3].reshape(-1, 2, h, w, 3) / n[..., None]
    made = tuple(LightLayer(name=k, direct=x[0], indirect=x[1]) for k, x in zip(layers.names, films, strict=True))
    beauty = sum((x.total for x in made), np.zeros((h, w, 3), np.float32))
    batches = n[..., None] / np.float32(batch)
    spread: F32 = np.maximum(squares.reshape(h, w, 3) / (batch * n[..., None]) - beauty * beauty, np.float32(0))
    return LightingBuffer(
        camera=camera,
        coverage=hits / n,
        layers=made,
        depth=mean[..., 1],
        position=mean[..., 2:5],
        normal=mean[..., 5:8],
        geometric_normal=mean[..., 8:11],
        albedo=mean[..., 11:14],
        variance=spread / (batches - 1) if batches.min() > 1 else None,
        spp=int(samples.min()),
    )


def dark(camera: Camera, layers: Layers, spp: int) -> LightingBuffer:
    """What an empty mesh gives: no coverage and no light, without tracing."""
    pixels = camera.height * camera.width
    return develop(
        camera,
        layers,
        np.zeros(len(layers.names) * 6 * pixels, np.float32),
        np.zeros(pixels * SURFACE, np.float32),
        np.zeros(pixels * 3, np.float32),
        np.full(pixels, spp, np.int64),
    )


def relative_noise(buffer: LightingBuffer) -> float:
    """Predicted root mean square error over covered pixels, relative to each pixel.

    sqrt(mean(variance / (beauty² + 0.01 mean²))): the second term keeps dark pixels from deciding. 0 without coverage,
    infinite where one sample says nothing of its spread.
    """
    covered = buffer.coverage > 0
    if not covered.any():
        return 0.0
    if buffer.variance is None:
        return float("inf")
    beauty = buffer.beauty[covered].astype(np.float64)
    floor = 0.01 * float(beauty.mean()) ** 2
    if floor == 0:
        return 0.0
    return float(np.sqrt(np.mean(buffer.variance[covered] / (beauty**2 + floor))))


def refuse_if_too_large(camera: Camera, layers: Layers) -> None:
    """Stop before a film is allocated that this machine cannot hold.

    Raises:
        RenderError: says the size needed.
    """
    pixels = camera.width * camera.height
    needed = 2 * 4 * pixels * (6 * len(layers.names) + SURFACE + 3)  # the film, and the buffer made of it
    there = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    if needed > 0.9 * there or 3 * pixels >= 2**32:
        raise RenderError(
            f"lighting of {camera.width} x {camera.height} pixels in {len(layers.names)} layers needs "
            f"{needed / 2**30:.1f} GiB and this machine has {there / 2**30:.1f}; "
            "render fewer lights at once, or set texture_scale below 1"
        )

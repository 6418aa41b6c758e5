"""Buffers on another pixel grid, as a GPU's linear filter reads them."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from mirelight.model import F32, Camera, LightingBuffer, LightLayer
from mirelight.model.planes import Owner, Plane, planes_of
from mirelight.relighting.pixels import divide, unit_or_zero


def upsample(lighting: LightingBuffer, camera: Camera) -> LightingBuffer:
    """The buffer on the pixel grid of `camera`: bilinear between pixel centres, edges repeated.

    On twice as many pixels along each axis that is the mean over each frame pixel's four. Colours stay premultiplied.
    AOVs are averages weighted by coverage, normals are made unit again. The variance of a weighted sum of independent
    pixels has squared weights; neighbours become correlated, which it does not say. What a denoiser leaves is shared by
    neighbours, so there it is the mean: an upper bound.
    """
    size = camera.height, camera.width
    if lighting.coverage.shape == size:
        return lighting
    coverage = bilinear(lighting.coverage, size)

    def resampled(values: F32 | None, plane: Plane) -> F32 | None:
        if values is None:
            return None
        if plane.upsampling == "variance":
            return bilinear(values, size, squared_weights=not lighting.noisy)
        if plane.upsampling == "bilinear":
            return bilinear(values, size)
        flat = values.reshape(*values.shape[:2], -1)
        summed = bilinear(flat * lighting.coverage[..., None], size)
        average = divide(summed, coverage[..., None]).reshape((*size, *values.shape[2:]))
        return unit_or_zero(average) if plane.upsampling == "unit" else average

    def by_table(of: LightingBuffer | LightLayer, owner: Owner) -> dict[str, Any]:
        return {x.field: resampled(getattr(of, x.field), x) for x in planes_of(owner) if x.upsampling != "none"}

    return replace(
        lighting,
        camera=camera,
        coverage=coverage,
        layers=tuple(replace(x, **by_table(x, "layer")) for x in lighting.layers),
        noisy=tuple(replace(x, **by_table(x, "layer")) for x in lighting.noisy),
        objects=None if lighting.objects is None else upsample(lighting.objects, camera),
        **by_table(lighting, "lighting"),
    )


def bilinear(image: F32, size: tuple[int, int], *, squared_weights: bool = False) -> F32:
    """The image (h, w) or (h, w, c) on a grid of `size` (rows, columns), as a GPU's linear filter reads it.

    Pixel centres lie at +0.5 on both grids; beyond the outermost centres the edge repeats. `squared_weights` squares
    the four weights of each sample, which turns variances of independent pixels into those of the interpolated ones.
    """
    if image.shape[:2] == size:
        return image
    rows = _along(image, 0, size[0], squared_weights)
    return _along(rows, 1, size[1], squared_weights)


def _along(image: F32, axis: int, count: int, squared_weights: bool) -> F32:
    n = image.shape[axis]
    at = (np.arange(count, dtype=np.float64) + 0.5) * (n / count) - 0.5
    low = np.floor(at)
    share = (at - low).astype(np.float32).reshape((-1, *(1,) * (image.ndim - axis - 1)))
    first = np.take(image, np.clip(low, 0, n - 1).astype(np.intp), axis=axis)
    second = np.take(image, np.clip(low + 1, 0, n - 1).astype(np.intp), axis=axis)
    if squared_weights:
        # where both samples are one clamped edge pixel, the weights add before they are squared
        clamped = ((low < 0) | (low + 1 > n - 1)).reshape(share.shape)
        return np.asarray(np.where(clamped, first, first * (1 - share) ** 2 + second * share**2), dtype=np.float32)
    return np.asarray(first * (1 - share) + second * share, dtype=np.float32)

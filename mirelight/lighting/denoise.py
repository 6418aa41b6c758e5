"""Denoising by Intel Open Image Denoise, only when asked: it is biased. The noisy picture is kept beside it.

Filters eat what objects show, highlights and mirrors, but where few paths find the light, noise is worse than that. So
objects are mixed of both, by how far either is off as the samples tell.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mirelight.base import extras
from mirelight.base.errors import BackendError
from mirelight.base.progress import ShareProgress, passed, quiet
from mirelight.lighting.adaptive import window_sum
from mirelight.model import F32, LightingBuffer, LightLayer

REACH = 7  # pixels to each side over which the noisy variance is averaged
OBJECT_REACH = 4  # the same on objects, over which the filter's error is told, too
_INSIDE = 0.999  # coverage from which a pixel is an object's alone: the light of others goes with how much they show
_MARGIN = 16  # pixels round objects that the filter sees

# OIDN's filter sizes (OIDNQuality): the half that tells the error is a tenth worse by the middle one, in half the time.
_BALANCED, _HIGH = 5, 6

# Samples from which guides serve as they are: no light is in them, so all that is left to clean are edges (at 8 samples
# they cost 5 % of error and save a third of the time, at 16 nothing is lost).
_CLEAN_GUIDES = 8


def denoise(buffer: LightingBuffer, *, layers: bool = True, progress: ShareProgress = quiet) -> LightingBuffer:
    """The beauty denoised, and every layer, guided by albedo and normals.

    Denoised layers do not add up to the denoised beauty, so they are scaled to it pixel by pixel; with `layers` False
    the noisy ones are. `noisy` holds the layers as they were, with their variance.

    `variance` becomes an estimate of the denoised beauty's mean square error, bias included: one half of the samples is
    denoised and compared with two quarters of independent noise, E[(D - B)(D - C)] = E[(D - truth)²] (cross-validation
    in the manner of Rousselle, Knaus and Zwicker's dual buffers, 2012). That holds on the average over a frame; a pixel
    of its own tells too little, so the noisy variance, averaged over a window, is scaled to it. None where the layers
    do not hold those halves and quarters (`RenderSettings.denoise` keeps them).

    Of inserted objects the mean of denoised and noisy is taken that such halves and quarters round each pixel promise
    the least error of, and their layers are scaled to it; edges stay noisy.

    A buffer is denoised after its layers are re-weighted: what a filter makes of a sum is not the sum of what it makes
    of the layers. One without layers is returned as it is.

    Args:
        buffer: light as it was traced or mixed.
        layers: whether each layer is denoised, or their sum alone.
        progress: hears of each picture before it is denoised: a large one takes seconds.

    Raises:
        BackendError: the optional package `pyoidn` is not installed.
    """
    try:
        import pyoidn  # type: ignore[import-untyped]
    except ImportError:
        raise extras.needed("denoise") from None
    if not buffer.layers:
        return buffer
    parts = _Parts.of(buffer)
    with pyoidn.Device() as device:
        device.commit()
        pictures = range(1 + (2 * len(buffer.layers) if layers else 0) + (parts is not None))
        begun = passed(pictures, progress, "removing noise")
        clean = _Denoiser.of(pyoidn, device, buffer, partial(next, begun, None))
        beauty = clean(buffer.beauty)
        made = [_cleaned(x, clean) for x in buffer.layers] if layers else list(buffer.layers)
        half = clean(parts.half, _BALANCED) if parts is not None else None
        objects = None if buffer.objects is None else _objects(buffer.objects, pyoidn, device)
    return replace(
        buffer,
        objects=objects,
        layers=_fitted(made, beauty),
        noisy=buffer.layers,
        variance=None if parts is None or half is None else _error(buffer, parts, half),
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Parts:
    """The beauty from three sets of samples, (H, W, 3) each; the errors of the last two are independent."""

    half: F32
    quarter: F32
    other_quarter: F32

    @classmethod
    def of(cls, buffer: LightingBuffer) -> _Parts | None:
        """Summed over the layers; None where a layer does not hold them."""
        half, quarter, other = (np.zeros_like(buffer.beauty) for _ in range(3))
        for x in buffer.layers:
            if x.half is None or x.quarter is None or x.other_quarter is None:
                return None
            half, quarter, other = half + x.half, quarter + x.quarter, other + x.other_quarter
        return cls(half, quarter, other)


def _cleaned(layer: LightLayer, clean: _Denoiser) -> LightLayer:
    indirect = clean(layer.indirect) if layer.indirect.any() else layer.indirect
    return LightLayer(name=layer.name, direct=clean(layer.direct), indirect=indirect)


def _fitted(layers: list[LightLayer], beauty: F32) -> tuple[LightLayer, ...]:
    """The layers scaled so that they add up to the beauty; where all are black and it is not, the first gets it."""
    total = sum((x.total for x in layers), np.zeros_like(beauty))
    lit = total > 0
    scale: F32 = np.where(lit, beauty / np.where(lit, total, np.float32(1)), np.float32(0))
    missing: F32 = np.where(lit, np.float32(0), beauty)
    return tuple(
        LightLayer(name=x.name, direct=x.direct * scale + (missing if k == 0 else 0), indirect=x.indirect * scale)
        for k, x in enumerate(layers)
    )


def _error(buffer: LightingBuffer, parts: _Parts, half: F32) -> F32 | None:
    """(H, W, 3) mean square error of the denoised half, in proportion to the noisy variance round each pixel.

    Errors count relative to brightness, as in `LightingBuffer.relative_noise`. The proportion is never taken above 1:
    denoised is then as good as noisy.
    """
    if buffer.variance is None:
        return None
    around = _mean_around(buffer.variance, buffer.coverage > 0)
    covered = buffer.coverage > 0
    bright = half[covered]
    if not bright.any():
        return around
    weight = 1 / (bright**2 + np.float32(0.01) * bright.mean() ** 2)
    before = np.sum(around[covered] * weight, dtype=np.float64)
    product = (half - parts.quarter)[covered] * (half - parts.other_quarter)[covered]
    after = np.sum(product * weight, dtype=np.float64)
    return np.asarray(around * np.float32(np.clip(after / before, 0, 1) if before > 0 else 0))


def _objects(objects: LightingBuffer, pyoidn: Any, device: Any) -> LightingBuffer:
    """Light on inserted objects, denoised as far as that lessens its error."""
    parts, inside = _Parts.of(objects), objects.coverage > _INSIDE
    if parts is None or objects.variance is None or not inside.any():
        return objects
    part = _round(inside)
    covered, beauty = objects.coverage[part][..., None], objects.beauty
    guides = {"albedo": objects.albedo[part] * covered, "normal": objects.normal[part] * covered}
    clean = _Denoiser(pyoidn, device, guides, np.ones(1, np.float32), clean=objects.spp >= _CLEAN_GUIDES)
    variance, near = objects.variance[part], inside[part]
    half, first, second = clean(parts.half[part]), parts.quarter[part], parts.other_quarter[part]
    level = np.float32(max(float(np.median(half[near])), 1e-30))
    seen, one, other = (np.log1p(np.maximum(x, 0) / level) for x in (half, first, second))  # a lamp is not all there is
    slope = np.asarray(1 / (level + half), dtype=np.float32)
    before = _mean_around(np.asarray(variance * slope**2, dtype=np.float32), near, OBJECT_REACH).mean(axis=-1)
    after = _mean_around((seen - one) * (seen - other), near, OBJECT_REACH).mean(axis=-1)
    share = before / np.maximum(before + np.maximum(after, 0), np.float32(1e-30))  # of errors that are independent
    share = np.where(near, share, 0)[..., None].astype(np.float32)
    mixed, error = beauty.copy(), objects.variance.copy()
    mixed[part] += share * (clean(beauty[part]) - beauty[part])
    error[part] *= 1 - share
    return replace(objects, layers=_fitted(list(objects.layers), mixed), variance=error)


def _round(inside: NDArray[np.bool_]) -> tuple[slice, slice]:
    """Rows and columns of those pixels, and of some about them."""
    rows, columns = (np.flatnonzero(inside.any(axis=k)) for k in (1, 0))
    sides = ((int(x[0]) - _MARGIN, int(x[-1]) + _MARGIN + 1) for x in (rows, columns))
    top, left = (slice(max(first, 0), end) for first, end in sides)
    return top, left


def _mean_around(image: F32, covered: NDArray[np.bool_], reach: int = REACH) -> F32:
    """Mean over the covered pixels of a window round each, which is about what the denoiser mixes."""
    count = np.maximum(window_sum(covered.astype(np.float64), reach), 1)
    sums = [window_sum(np.where(covered, image[..., c], 0).astype(np.float64), reach) / count for c in range(3)]
    return np.asarray(np.where(covered[..., None], np.stack(sums, axis=-1), 0), dtype=np.float32)


class _Denoiser:
    """One frame's guides, and the filter that uses them; `begins` is called before each picture but guides."""

    def __init__(
        self,
        pyoidn: Any,
        device: Any,
        guides: dict[str, F32],
        scale: F32,
        begins: Callable[[], object] = bool,
        *,
        clean: bool,
    ) -> None:
        self._pyoidn, self._device, self._guides, self._scale = pyoidn, device, guides, scale
        self._begins = begins
        if not clean:
            self._guides = {name: self._run({name: image}, _BALANCED) for name, image in guides.items()}

    @classmethod
    def of(cls, pyoidn: Any, device: Any, buffer: LightingBuffer, begins: Callable[[], object]) -> _Denoiser:
        """For the light of the surface."""
        covered = buffer.coverage[..., None]
        scale: F32 = np.ones(1, np.float32)
        if buffer.objects is not None:  # where an object cuts a pixel, the surface is seen as if it filled it
            there = covered > 0
            whole = np.where(there, np.minimum(covered + buffer.objects.coverage[..., None], 1), 0)
            scale = np.where(there, whole / np.where(there, covered, 1), 1).astype(np.float32)
            covered = whole.astype(np.float32)
        guides = {"albedo": buffer.albedo * covered, "normal": buffer.normal * covered}
        return cls(pyoidn, device, guides, scale, begins, clean=buffer.spp >= _CLEAN_GUIDES)

    def __call__(self, color: F32, quality: int = _HIGH) -> F32:
        """A linear picture, (H, W, 3), denoised and not below 0."""
        self._begins()
        images = {"color": np.ascontiguousarray(color * self._scale), **self._guides}
        made = self._run(images, quality, hdr=True, cleanAux=True)
        return np.asarray(np.maximum(made, np.float32(0)) / self._scale, np.float32)

    def _run(self, images: dict[str, F32], quality: int, **flags: bool) -> F32:
        images = {name: np.array(image) for name, image in images.items()}  # writeable: the binding asks for it
        out = np.zeros_like(next(iter(images.values())))
        with self._pyoidn.Filter(self._device, "RT") as run:
            for name, image in {**images, "output": out}.items():
                run.set_image(name, image, self._pyoidn.OIDN_FORMAT_FLOAT3)
            for flag, value in flags.items():
                run.set_bool(flag, value)
            run.set_int("quality", quality)
            run.commit()
            run.execute()
        error = self._device.get_error()
        if error is not None:
            raise BackendError(f"Open Image Denoise failed: {error}")
        return out

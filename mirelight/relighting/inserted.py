"""Inserted objects in a relit frame: split at their depth, so that what is in front of them veils them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mirelight.model import F32, Camera, Frame, LightingBuffer, RelightSettings, SplatLayer
from mirelight.relighting.frame import covered
from mirelight.relighting.mode import Lit
from mirelight.relighting.resample import bilinear


def with_objects(frame: Frame, front: SplatLayer | None, settings: RelightSettings) -> Frame:
    """The frame with the objects of its light (:func:`mirelight.relighting.frame.covered`); without any as it is, bit
    for bit.

    Args:
        frame: relit, with its lighting.
        front: the splats in front of the objects, from the same camera; None: there are no splats.
        settings: the frame's own.
    """
    objects = None if frame.lighting is None else frame.lighting.objects
    if objects is None:
        return frame
    rgba = covered(frame.rgba, frame.factor, front, objects.rgba, settings)
    if front is None:
        return replace(frame, rgba=rgba)
    through = front.transmittance[..., None]
    return replace(frame, rgba=rgba, noise=_noise(frame, objects.variance, objects.coverage[..., None], through))


def shadow(new: LightingBuffer, bare: LightingBuffer, camera: Camera) -> F32:
    """(H, W, 3) light beside objects over the same light without them, linear; 1 where neither or no surface is.

    Args:
        new: with the objects.
        bare: of the same camera without them.
        camera: whose pixels are wanted.
    """
    return shadow_of(Lit.of(new), Lit.of(bare), (camera.height, camera.width))


def shadow_of(new: Lit, bare: Lit, size: tuple[int, int]) -> F32:
    """(H, W, 3) the same of any light, on pixels of `size` (rows, columns)."""
    shares = [bilinear(x.coverage, size)[..., None] for x in (new, bare)]
    light, before = (
        bilinear(x.beauty, size) / np.maximum(share, 1e-6) for x, share in zip((new, bare), shares, strict=True)
    )
    known = (shares[0] > 0) & (before > 0)
    return np.where(known, light / np.where(known, before, 1), 1).astype(np.float32)


def _noise(frame: Frame, variance: F32 | None, share: F32, through: F32) -> F32 | None:
    """That of the composite, as far as it is seen, and of the objects' own light, which knows nothing of it."""
    if frame.noise is None:
        return None
    own = np.zeros_like(frame.noise) if variance is None else np.sqrt(np.maximum(variance, np.float32(0)))
    return np.asarray(np.hypot((1 - share) * frame.noise, through * own), np.float32)

"""Inserted objects in a relit frame: split at their depth, so that what is in front of them veils them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mirelight.model import F32, Frame, RelightSettings, SplatLayer
from mirelight.relighting.frame import multiplied, unlit_rgba


def with_objects(frame: Frame, front: SplatLayer | None, settings: RelightSettings) -> Frame:
    """The frame with the objects of its light, F' + (1 - a) (C' - F') + T a O.

    C' is the relit composite, F' that of the splats in front of the objects, which let T through; a is the objects'
    coverage, O what they send out. All linear and premultiplied; without objects the frame stays as it is, bit for bit.

    Args:
        frame: relit, with its lighting.
        front: the splats in front of the objects, from the same camera; None: there are no splats.
        settings: the frame's own.
    """
    objects = None if frame.lighting is None else frame.lighting.objects
    if objects is None:
        return frame
    if front is None:  # the light of the proxy beside them is premultiplied by what is seen of it
        return replace(frame, rgba=frame.rgba + objects.rgba)
    assert frame.factor is not None
    share = objects.coverage[..., None]
    before = multiplied(front, unlit_rgba(front), frame.factor, settings)
    rgba = before + (1 - share) * (frame.rgba - before) + front.transmittance[..., None] * objects.rgba
    return replace(frame, rgba=rgba, noise=_noise(frame, objects.variance, share, front.transmittance[..., None]))


def _noise(frame: Frame, variance: F32 | None, share: F32, through: F32) -> F32 | None:
    """That of the composite, as far as it is seen, and of the objects' own light, which knows nothing of it."""
    if frame.noise is None:
        return None
    own = np.zeros_like(frame.noise) if variance is None else np.sqrt(np.maximum(variance, np.float32(0)))
    return np.asarray(np.hypot((1 - share) * frame.noise, through * own), np.float32)

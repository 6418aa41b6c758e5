"""How noisy a relit frame is, from the variance of its light."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from mirelight.model import F32, LightingBuffer
from mirelight.relighting.mode import Lit


def noise(
    relit: Callable[[Lit, Lit | None], F32],
    lighting: LightingBuffer,
    captured: LightingBuffer | None,
) -> F32 | None:
    """(H, W, 3) standard deviation of the relit colour that the lighting's variance leaves; None where it is unknown.

    The frame is relit one standard deviation up and down, in any mode and space. Errors of new and captured light count
    as independent; traced with one seed they partly cancel, so for a ratio this is an upper bound.

    Args:
        relit: the frame (H, W, 3 or 4) under some new and captured light.
        lighting: the new light.
        captured: the captured one, where the mode uses it.
    """
    new, old = Lit.of(lighting), None if captured is None else Lit.of(captured)
    total: F32 | None = None
    if lighting.variance is not None:
        sigma = _deviation(lighting.variance)
        total = _half_apart(relit(new.moved(sigma), old), relit(new.moved(-sigma), old))
    if captured is not None and old is not None and captured.variance is not None:
        sigma = _deviation(captured.variance)
        from_captured = _half_apart(relit(new, old.moved(sigma)), relit(new, old.moved(-sigma)))
        total = from_captured if total is None else np.asarray(np.hypot(total, from_captured), dtype=np.float32)
    return total


def _deviation(variance: F32) -> F32:
    return np.sqrt(np.maximum(variance, np.float32(0)))


def _half_apart(up: F32, down: F32) -> F32:
    return np.asarray(np.abs(up[..., :3] - down[..., :3]) / 2, dtype=np.float32)

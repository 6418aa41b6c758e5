"""What the proxy's materials mirror of the new light, added to a relit frame."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mirelight.model import F32, Frame, LightingBuffer, RelightSettings
from mirelight.relighting.pixels import divide
from mirelight.relighting.resample import upsample


def with_lobes(
    frame: Frame, lobes: LightingBuffer, settings: RelightSettings, captured: LightingBuffer | None = None
) -> Frame:
    """F (1 - b) + b (F (1 - m) (1 - a S' / C) + a S): F the relit frame, C the capture, a its alpha, b the blend, S and
    S' what lobes of the proxy reflect of the new and of the captured light, m the metal's share of the surface.

    The capture's own highlights are taken out as far as they are known, and a metal has no colour beside its lobe.

    Args:
        frame: relit, without objects.
        lobes: of the same camera, on the frame's pixels or others: the light of a tracer of lobes.
        settings: the frame's own.
        captured: the same of the captured light; None: its highlights are not known, and stay.
    """
    seen = upsample(lobes, frame.camera)
    cover, blend, alpha = seen.coverage[..., None], np.float32(settings.blend), frame.rgba[..., 3:]
    rest = 1 - seen.albedo[..., :1] * (cover > 0) * np.ones(3, np.float32)
    if captured is not None and frame.unlit is not None:
        own = upsample(captured, frame.camera)
        mirrored = alpha * _over(own.beauty, own.coverage[..., None])
        rest *= np.maximum(1 - divide(mirrored, np.ascontiguousarray(frame.unlit[..., :3])), np.float32(0))
    rest = 1 - blend * (1 - rest)
    rgba = frame.rgba.copy()
    rgba[..., :3] = frame.rgba[..., :3] * rest + blend * alpha * _over(seen.beauty, cover)
    if frame.noise is None or seen.variance is None:
        return replace(frame, rgba=rgba)
    noise = blend * alpha * _over(np.sqrt(np.maximum(seen.variance, np.float32(0))), cover)
    return replace(frame, rgba=rgba, noise=np.asarray(np.hypot(frame.noise * rest, noise), np.float32))


def _over(values: F32, cover: F32) -> F32:
    """(H, W, 3) what is premultiplied by a coverage (H, W, 1), over it; 0 where nothing is covered."""
    return divide(values, np.broadcast_to(cover, values.shape))

"""What the proxy's materials mirror of the new light, added to a relit frame."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mirelight.model import F32, Frame, LightingBuffer, RelightSettings
from mirelight.relighting.mode import Lit
from mirelight.relighting.pixels import divide
from mirelight.relighting.resample import bilinear, upsample

MATT_SHARE = np.float32(0.8)  # of what a matt proxy shows: its albedo is told by pictures that show gloss, too
_ALIKE = 1e-3  # albedo within which a proxy is of one colour, which nobody told


def with_lobes(
    frame: Frame,
    lobes: LightingBuffer,
    settings: RelightSettings,
    captured: LightingBuffer | None = None,
    matt: LightingBuffer | None = None,
) -> Frame:
    """F (1 - b) + b (F (1 - m) (1 - a S' / C) + a S): F the relit frame, C the capture, a its alpha, b the blend, S and
    S' what lobes of the proxy reflect of the new and of the captured light, m the metal's share of the surface.

    The capture's own highlights are taken out as far as they are known, and as far as it shows them; a metal has no
    colour beside its lobe.

    Args:
        frame: relit, without objects.
        lobes: of the same camera, on the frame's pixels or others: the light of a tracer of lobes.
        settings: the frame's own.
        captured: the same of the captured light; None: its highlights are not known, and stay.
        matt: the captured light on the proxy without its lobes; None: all of S' is taken out.
    """
    old, plain = (None if x is None else Lit.of(x) for x in (captured, matt))
    rest = matt_share(Lit.of(lobes), old, frame.rgba[..., 3:], frame.unlit, settings, plain)
    rgba = glossed(frame.rgba, rest, Lit.of(lobes), settings)
    seen = upsample(lobes, frame.camera)
    if frame.noise is None or seen.variance is None:
        return replace(frame, rgba=rgba)
    shown = np.float32(settings.blend) * frame.rgba[..., 3:]
    noise = shown * _over(np.sqrt(np.maximum(seen.variance, np.float32(0))), seen.coverage[..., None])
    return replace(frame, rgba=rgba, noise=np.asarray(np.hypot(frame.noise * rest, noise), np.float32))


def matt_share(
    lobes: Lit,
    captured: Lit | None,
    alpha: F32,
    unlit: F32 | None,
    settings: RelightSettings,
    matt: Lit | None = None,
) -> F32:
    """(H, W, 3) what is left of a matt frame, 1 - b + b (1 - m) (1 - a S' / C), whatever the new light.

    Splats do not show all that a lobe reflects: theirs is blurred, or was never seen. So no more is taken away than
    stands out from what the matt surface shows of the captured light: S' is C - M at most, where M is that.

    Args:
        lobes: of a tracer of lobes; its beauty is not read.
        captured: the same of the captured light; None: it is not known.
        alpha: (H, W, 1) of the frame.
        unlit: (H, W, 4) the frame as captured; None: there are no splats.
        settings: the frame's own.
        matt: the captured light on the proxy; not heeded where its albedo is not told, but one colour for all.
    """
    size, blend = (alpha.shape[0], alpha.shape[1]), np.float32(settings.blend)
    cover = bilinear(lobes.coverage, size)[..., None]
    metal = lobes.albedo
    if metal.shape[:2] != size:
        summed = bilinear(metal * lobes.coverage[..., None], size)
        metal = divide(summed, np.broadcast_to(cover, summed.shape))
    rest = 1 - metal[..., :1] * (cover > 0) * np.ones(3, np.float32)
    if captured is not None and unlit is not None:
        mirrored, shown = alpha * _seen(captured, size), np.ascontiguousarray(unlit[..., :3])
        if matt is not None and _is_told(matt):
            mirrored = np.minimum(mirrored, np.maximum(shown - MATT_SHARE * alpha * _seen(matt, size), np.float32(0)))
        rest *= np.maximum(1 - divide(mirrored, shown), np.float32(0))
    return np.asarray(1 - blend * (1 - rest), np.float32)


def glossed(rgba: F32, rest: F32, lobes: Lit, settings: RelightSettings) -> F32:
    """(H, W, 4) a matt frame, as far as `rest` (H, W, 3) leaves it, and what lobes reflect of the new light."""
    out = rgba.copy()
    shown = np.float32(settings.blend) * rgba[..., 3:]
    out[..., :3] = rgba[..., :3] * rest + shown * _seen(lobes, (rgba.shape[0], rgba.shape[1]))
    return out


def _is_told(matt: Lit) -> bool:
    """Whether the albedo is the surface's own."""
    albedo = matt.albedo[matt.coverage > 0]
    return bool(len(albedo)) and bool(np.ptp(albedo, axis=0).max() > _ALIKE)


def _seen(lobes: Lit, size: tuple[int, int]) -> F32:
    """(H, W, 3) light of lobes on a frame's pixels, not premultiplied."""
    return _over(bilinear(lobes.beauty, size), bilinear(lobes.coverage, size)[..., None])


def _over(values: F32, cover: F32) -> F32:
    """(H, W, 3) what is premultiplied by a coverage (H, W, 1), over it; 0 where nothing is covered."""
    return divide(values, np.broadcast_to(cover, values.shape))

"""Captured shadows as the splats show them.

A ratio divides the splats' picture by captured light. Where that light ends, the picture fades over the width of a
splat, and light that is found for each pixel of a proxy does not: what is left of the edge is a bright and a dark line.
Light that is found at the splats and blended as they are fades as the picture does. With w_i a splat's weight in a
pixel, a its albedo and E_i its light, the picture is a sum(w E), and over sum(w E) the albedo is left.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mirelight.model import F32, LightingBuffer, LightLayer
from mirelight.relighting.pixels import divide

_SEEN = np.float32(1 / 255)  # alpha from which splats say what light fell on them
_AROUND = 4  # pixels to each side, over which light that does not come straight from a lamp changes little
_LEAST = np.float32(0.5)  # of its mean over them, which a pixel has at least


def softened(captured: LightingBuffer, lamps: LightingBuffer, on_splats: F32, alpha: F32) -> LightingBuffer:
    """The captured light with the direct light of its lamps as splats have it; all else stays as it is.

    Light from all around and reflected light change slowly over a surface, and are cleaner as they were traced. Where a
    pixel is all lamp, what is left of the difference is noise, so it is held above half its mean around.

    Args:
        captured: H x W pixels of the lit proxy.
        lamps: the same pixels by the direct light of the captured lamps alone.
        on_splats: (H, W, 3) that light at the splats, irradiance / pi, blended as their colours are, premultiplied.
        alpha: (H, W) of the splats.

    Returns:
        The captured buffer, its light in one layer. Where no splat is seen it is the captured light bit for bit.

    Raises:
        ValueError: pictures of different sizes.
    """
    sizes = captured.coverage.shape, lamps.coverage.shape, on_splats.shape[:2], alpha.shape
    if len(set(sizes)) > 1:
        raise ValueError("captured light, its lamps, splats and their alpha of sizes {}, {}, {}, {}".format(*sizes))
    beauty = captured.beauty
    weight = captured.albedo * captured.coverage[..., None]
    rest = divide(np.maximum(beauty - lamps.beauty, np.float32(0)), weight)
    rest = np.maximum(rest, _LEAST * divide(_around(rest), _around(captured.coverage[..., None])))
    made = (rest + divide(on_splats, alpha[..., None])) * weight
    out = np.asarray(np.where((alpha > _SEEN)[..., None], made, beauty), np.float32)
    return replace(captured, layers=(LightLayer(name="captured", direct=out, indirect=np.zeros_like(out)),))


def _around(image: F32) -> F32:
    """(H, W, n) sums over the pixels around each, itself among them; outside of the picture is nothing."""
    for axis in (0, 1):
        ends = np.arange(image.shape[axis])
        summed = np.concatenate([np.zeros_like(image.take([0], axis)), image], axis).cumsum(axis, dtype=np.float64)
        high = np.minimum(ends + _AROUND + 1, len(ends))
        image = np.asarray(summed.take(high, axis) - summed.take(np.maximum(ends - _AROUND, 0), axis), np.float32)
    return np.maximum(image, np.float32(0))

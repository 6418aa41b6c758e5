"""Mode `ratio`: the splats times new light over captured light."""

from __future__ import annotations

import numpy as np

from mirelight import colour
from mirelight.model import F32
from mirelight.relighting.fill import continued
from mirelight.relighting.mode import Lit, Mode, Task
from mirelight.relighting.pixels import divide, multiply
from mirelight.relighting.resample import bilinear

_NO_LIGHT = 1e-20  # keeps 0 / 0 at a ratio of 1 where the whole capture is black


def factor(task: Task) -> F32:
    """min((E_new + d m) / (E_captured + d m), max) wherever the proxy covers anything, filled outwards from there.

    E is the lit proxy's radiance (premultiplied over coverage) over its albedo, so light alone, and m the mean
    luminance of E_captured: of the scene's surface where the task knows it, so that a point has one factor in every
    view, else of this view's. It is the ratio of two averages over a pixel, and it is applied in full at partly covered
    pixels: the splats there are the same surface. (Against path-traced truth, averaging sub-pixel ratios costs 0.4 dB,
    fading by coverage 0.1 to 0.4 dB.)
    """
    assert task.captured is not None, "apply() refuses a mode without what it needs"
    settings = task.settings
    (above, new), (below, old) = _light(task.new, task.size), _light(task.captured, task.size)
    level = _mean(below, old) if task.captured_level is None else task.captured_level
    floor = np.float32(max(settings.delta * level, _NO_LIGHT))
    above += floor
    below += floor
    above /= below
    np.minimum(above, np.float32(settings.max_ratio), out=above)
    return continued(above, np.minimum(new, old) > 0, settings.background)


def _light(lit: Lit, size: tuple[int, int]) -> tuple[F32, F32]:
    """(H, W, 3) radiance over albedo, 0 where nothing is covered or the albedo is 0; (H, W) coverage."""
    if not lit.albedo.any() and (lit.beauty * lit.coverage[..., None]).any():
        raise ValueError("mode 'ratio' divides by the albedo, and this light comes without (a file without 'albedo'?)")
    # both premultiplied; the albedo is an average over the covered part
    weight = np.empty_like(lit.albedo)
    multiply(lit.albedo, lit.coverage[..., None], weight)
    return divide(bilinear(lit.beauty, size), bilinear(weight, size)), bilinear(lit.coverage, size)


def _mean(light: F32, coverage: F32) -> float:
    """Mean luminance over the covered part; 0 where nothing is."""
    covered = coverage.sum(dtype=np.float64)
    summed = (colour.luminance(light) * coverage).sum(dtype=np.float64)
    return float(summed / covered) if covered > 0 else 0.0


RATIO = Mode(
    name="ratio",
    needs_captured=True,
    uses_proxy_colours=True,
    reads=frozenset({"delta", "max_ratio", "background"}),
    space="linear",
    factor=factor,
)

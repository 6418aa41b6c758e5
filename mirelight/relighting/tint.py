"""Mode `tint`: the splats times the lit proxy, as the real-time engine's GsplatRelighting means it."""

from __future__ import annotations

from functools import partial

import numpy as np

from mirelight.model import F32, rules_of
from mirelight.relighting.factor_extension import Continuation
from mirelight.relighting.mode import Factor, Mode, Task
from mirelight.relighting.pixels import divide
from mirelight.relighting.resample import bilinear

_FULL_COVERAGE = np.float32(0.5)  # unit texels: the share of a texel from which its one sample counts as a hit


def prepared(task: Task) -> Factor:
    """The lit proxy's radiance times `brightness` wherever it covers anything, filled outwards from there.

    It is applied in full at partly covered pixels, and continued past the proxy: the splats there are the same surface,
    and would stand out as an outline in the captured light.
    """
    if rules_of(task.settings.profile).unit_texels:
        return partial(_of_unit_texels, task)
    coverage = bilinear(task.new.coverage, task.size)
    outwards = Continuation(coverage > 0)

    def factor(beauty: F32, far: F32 | None) -> F32:
        lit = divide(bilinear(beauty, task.size), coverage[..., None])
        lit *= np.float32(task.settings.brightness)
        return outwards(lit, task.settings.far_number)

    return factor


def _of_unit_texels(task: Task, beauty: F32, far: F32 | None) -> F32:
    """The tint as GsplatRelighting's shader computes it from its texture.

    The texture has one sample a texel: colour and coverage 1, or zeros. Between texels both are interpolated and then
    multiplied again by `mix`, so scaled textures darken towards silhouettes; that is the engine's look, kept here.
    """
    settings, lit = task.settings, task.new
    hit = (lit.coverage >= _FULL_COVERAGE)[..., None]
    texel = np.where(hit, divide(beauty, lit.coverage[..., None]), np.float32(0))
    coverage = bilinear(hit.astype(np.float32), task.size)
    background = np.float32(settings.far_number)
    return background * (1 - coverage) + bilinear(texel, task.size) * np.float32(settings.brightness) * coverage


TINT = Mode(
    name="tint",
    needs_captured=False,
    uses_proxy_colours=False,
    leaves_floor=False,
    reads=frozenset({"brightness", "background"}),
    space=None,
    prepared=prepared,
)

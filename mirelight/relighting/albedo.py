"""Mode `albedo`: the captured light divided out for a surface's own colour, which is then lit anew."""

from __future__ import annotations

import numpy as np

from mirelight.model import F32
from mirelight.model.profiles import BRIGHTEST
from mirelight.relighting.mode import Factor, Mode, Task
from mirelight.relighting.pixels import divide
from mirelight.relighting.ratio import Beyond, Weight, captured_light

_BLACK = np.float32(1e-6)  # linear; keeps the bound of black splats finite


def prepared(task: Task) -> Factor:
    """a E_new / c with the albedo a = min(c / (E_captured + d m), 0.95), c the splats' colour in linear light.

    E is the lit proxy's radiance over its albedo (irradiance / pi) and m the mean luminance of E_captured, both as in
    mode `ratio`. Unlike the ratio it adds nothing to the new light, so darkness is dark, and what bounds it is the
    surface and no clamp: a pixel never sends out more than 0.95 of the new light that falls on it, whatever was
    captured there (highlights, lamps, noise in captured shadow). What is seen past the proxy is no surface, and takes
    the quotient of new over captured far light.
    """
    new = Weight(task.new, task.size)
    below, floor, outwards = captured_light(task)
    beyond = Beyond(task, outwards, floor)
    color = divide(task.unlit[..., :3], task.unlit[..., 3:])
    most = np.float32(BRIGHTEST) / np.maximum(color, _BLACK)
    per_light = np.minimum(1 / below, most)

    def factor(beauty: F32, far: F32 | None) -> F32:
        above = new.light(beauty)
        above *= per_light
        return outwards(above, beyond.factor(far, with_floor=False))

    return factor


ALBEDO = Mode(
    name="albedo",
    needs_captured=True,
    uses_proxy_colours=True,
    leaves_floor=False,
    reads=frozenset({"delta", "background"}),
    space="linear",
    prepared=prepared,
)

"""The strongest distant lamp of the captured light, as a view sees it: for `relight.repair`."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from mirelight import relighting
from mirelight.model import (
    F32,
    Camera,
    Light,
    Lighting,
    LightingBuffer,
    LightLayer,
    ParallelLight,
)
from mirelight.model.unit_lights import LightSet, Mixture

if TYPE_CHECKING:
    from mirelight.lighting import Tracer


def seen_sun(
    mixture: Mixture,
    there: Mapping[str, LightingBuffer],
    camera: Camera,
    tracer: Tracer,
    *,
    resolved: Callable[[Lighting], Lighting],
    denoised: bool,
    apart: bool,
) -> relighting.Sun | None:
    """The sun of a view's captured light; None where no lamp of it is distant.

    Where lights were traced in layers of their own, the sun's is taken, and nothing is traced.

    Args:
        mixture: how the captured light is made.
        there: its sets as traced, by their digests.
        camera: the lighting's.
        tracer: what lights the proxy.
        resolved: gives a lighting with a sun and a map in place of its sky model.
        denoised: whether the job's light is.
        apart: whether frames can be mixed from kept layers, which know no sun where a lighting was traced as a whole.
    """
    if not mixture.terms:
        suns = [x for x in mixture.sets[0].as_lighting(resolved).lights if isinstance(x, ParallelLight)]
        lamp = max(suns, key=lambda x: float(_falling(x).mean()), default=None)
        return None if lamp is None or apart else _traced(lamp, camera, tracer, denoised)
    found: list[relighting.Sun] = []
    for term in mixture.terms:
        home = mixture.home(term.unit)
        unit, layer = LightSet((term.unit,)).as_lighting(resolved), home.layer_of(term.unit)
        lamp = one_distant(unit.lights) if unit.environment is None else None
        own = [x for x in there[home.digest].layers if x.name == layer]
        if lamp is not None and own:
            beauty = _cleaned(there[home.digest], own[0].direct, denoised)
            found.append(sun_of(lamp, beauty, np.asarray(term.weight, np.float32)))
    return strongest(found)


def one_distant(lamps: Sequence[Light]) -> ParallelLight | None:
    """The one distant lamp that a unit light is; None: it is more, or another."""
    lamp = lamps[0] if len(lamps) == 1 else None
    return lamp if isinstance(lamp, ParallelLight) else None


def strongest(suns: Sequence[relighting.Sun]) -> relighting.Sun | None:
    """The one that lights most."""
    return max(suns, key=lambda x: float(x.irradiance.mean()), default=None)


def sun_of(lamp: ParallelLight, direct: F32, weight: F32) -> relighting.Sun:
    """A lamp whose direct light (h, w, 3), at unit strength, counts so many times (3,)."""
    irradiance = np.asarray(_falling(lamp) * weight, np.float32)
    return relighting.Sun(direct * weight, np.asarray(lamp.direction, np.float32), irradiance)


def _falling(lamp: ParallelLight) -> F32:
    """(3,) irradiance / pi on a surface that faces it."""
    return np.asarray(lamp.color * lamp.intensity / np.pi, np.float32)


def _traced(lamp: ParallelLight, camera: Camera, tracer: Tracer, denoised: bool) -> relighting.Sun:
    from mirelight.lighting.splat_light import lamps_in_view

    buffer = lamps_in_view(tracer, Lighting(name="sun", lights=(lamp,)), camera)
    if denoised:
        from mirelight.lighting.denoise import denoise

        buffer = denoise(buffer, layers=False)
    return sun_of(lamp, buffer.beauty, np.ones(3, np.float32))


def _cleaned(buffer: LightingBuffer, direct: F32, denoised: bool) -> F32:
    if not denoised:
        return direct
    from mirelight.lighting.denoise import denoise

    layer = LightLayer(name="sun", direct=direct, indirect=np.zeros_like(direct))
    return denoise(replace(buffer, layers=(layer,), noisy=(), variance=None), layers=False).beauty

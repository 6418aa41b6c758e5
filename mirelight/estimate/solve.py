"""The captured light from splats and proxy: transport, the sun's search, the fit, and two halves that check it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from mirelight.base.errors import RenderError
from mirelight.base.progress import ShareProgress, quiet
from mirelight.estimate import fit, lamps
from mirelight.estimate.descent import Found, fitted
from mirelight.estimate.edges import spoken
from mirelight.estimate.fit import Fitted, Pairs
from mirelight.estimate.sky import as_map
from mirelight.estimate.sun import Search
from mirelight.estimate.transport import Places, places_of
from mirelight.estimate.tuning import TUNING
from mirelight.estimate.types import Confidence, Estimate
from mirelight.estimate.which_sun import apart, best_of, settled, sun_share, suns_by_half, telling, thinned
from mirelight.model import F64, Light, ProxyMesh, RenderSettings, SplatCloud, SplatLayer

_LEAST_DISC = 0.53  # degrees, the sun's own


def estimate(
    splats: SplatCloud,
    proxy: ProxyMesh,
    settings: RenderSettings,
    exposure: float = 0.0,
    lights: Sequence[Light] = (),
    views: Sequence[SplatLayer] = (),
    progress: ShareProgress = quiet,
) -> Estimate:
    """The light that splats were captured under, as a sun, a sky, and up to three lamps.

    Args:
        splats: world space; their colours, in their colour space, are taken as captured light.
        proxy: world space; what casts shadows and stands in the way. Its own colours count for nothing.
        settings: seed, variant and threads of the rays.
        exposure: stops by which the light is stronger than it seems, where a person knows better.
        lights: that are known to have been there, but not how strong: their own colours and intensities do not count.
        views: as for :func:`mirelight.lighting.colored_by`.
        progress: hears what is being done.

    Returns:
        The same to the bit for the same input.

    Raises:
        RenderError: too few splats lie on the proxy; none of them sees the sky through it.
        BackendError: the variant cannot be used on this machine.
    """
    progress("looking where light comes from", 0.0)
    places = places_of(splats, proxy, settings, lights, views)
    if 1 - places.blocked < TUNING.least_open and not lights:
        raise RenderError(
            f"only {1 - places.blocked:.2%} of what the splats on the proxy face is open, so no light comes in from "
            "outside; name the lamps inside in the job's [captured], or leave windows open"
        )
    halves = [places.taken(np.arange(k, len(places), 2)) for k in (0, 1)]
    rng = np.random.default_rng(settings.seed)
    pairs = [fit.pairs_of(half.points, half.color, rng) for half in halves]
    progress("looking for the sun by shadows' edges", 0.25)
    edges = spoken(places.close, np.random.default_rng(settings.seed))
    progress("looking for the sun by what it lights", 0.4)
    suns = suns_by_half(halves, pairs, rng, edges)
    progress("fitting sun and sky", 0.7)
    every = fit.pairs_of(places.points, places.color, rng)
    best, gain = best_of(places, every, suns, edges)
    if sun_share(places, best) < TUNING.least_share:
        best = fitted(places, every, None)
    found = [settled(half, p, best.sun and s) for half, p, s in zip(halves, pairs, suns, strict=True)]
    progress("looking for lamps", 0.85)
    shining, lamp_gains = _lamps(halves, pairs, found[0], rng)
    if len(shining):
        told, firm = telling(places, every, best.sun)
        dark = fitted(places, told, None, shining, firm)
        best = dark if best.sun is None else fitted(places, told, best.sun, shining, firm)
        gain = dark.light.loss - best.light.loss
        if gain < TUNING.least_gain:  # the sun was the lamps
            best = dark
        found = [settled(half, p, best.sun and s, shining) for half, p, s in zip(halves, pairs, suns, strict=True)]
    known = places.blocked >= TUNING.least_blocked
    scale = 1.0 if known else _scale_for_albedo(places, best)
    light = best.at(places) if known else _scaled(best, scale).at(places)
    both = [one.at(places) for one in found]
    radius, radii = (0.0, (0.0, 0.0)) if best.sun is None else (best.sun.radius, best.sun.radii)
    confidence = Confidence(
        places=len(places),
        blocked=places.blocked,
        scale_known=known,
        sun_gain=gain,
        sun_apart=apart(suns),
        sun_beaten=math.nan if best.sun is None else edges.beaten(best.sun.to_sun),
        sun_disc=(_diameter(radii[0]), _diameter(radii[1])),
        halves_apart=fit.differ(*both),
        held_out=float(np.mean([_explained(halves[1 - k], pairs[1 - k], found[k]) for k in (0, 1)])),
        lamps_gain=tuple(lamp_gains),
        albedo=fit.albedos(places.color, light),
    )
    strength = scale * 2.0**exposure
    return Estimate(
        to_sun=np.array([0.0, 1.0, 0.0]) if best.sun is None else best.sun.to_sun,
        sun=np.zeros(3) if best.sun is None else np.pi * best.light.beams[0] * strength,
        sun_diameter=_diameter(radius),
        named=tuple(_shining(*pair) for pair in zip(lights, strength * _named(best, places), strict=True)),
        lamps=np.concatenate([best.lamps, np.pi * strength * _strengths(best)], axis=1),
        radiance=as_map(best.light.sky * strength, None if best.sun is None else best.sun.to_sun).astype(np.float64),
        confidence=confidence,
    )


def _diameter(radius: float) -> float:
    """Degrees: no disc is narrower than the sun's own."""
    return max(2 * radius, _LEAST_DISC)


def _named(found: Found, places: Places) -> F64:
    """(L, 3) strengths of lights that are known to have been there."""
    end = len(found.light.beams) - len(found.lamps)
    return found.light.beams[end - places.named.shape[1] : end]


def _shining(light: Light, strength: F64) -> Light:
    return replace(light, color=strength / strength.max(), intensity=float(strength.max()))


def _strengths(found: Found) -> F64:
    """(L, 3) of its lamps, candela / pi."""
    return found.light.beams[len(found.light.beams) - len(found.lamps) :]


def _lamps(halves: list[Places], pairs: list[Pairs], base: Found, rng: np.random.Generator) -> tuple[F64, list[float]]:
    """(L, 3) positions of lamps that the first half asks for and the second confirms; and how much each of them makes
    the second half's albedos more alike.

    Args:
        halves, pairs: of the places.
        base: light of the first half without lamps.
        rng: for where they are looked for.
    """
    half, other = halves
    some = half.taken(thinned(half))
    search = Search.of(some, fit.pairs_of(some.points, some.color, rng))
    positions, gains = np.zeros((0, 3)), list[float]()
    while len(positions) < TUNING.most_lamps:
        over = lamps.over(search, base.at(some) - some.met)
        lamp = lamps.search(over, rng)
        if lamp is None or float(over.losses(np.zeros(len(some))).min()) - lamp.loss < TUNING.least_gain:
            break
        more = np.concatenate([positions, lamp.position[None]])
        found = settled(half, pairs[0], base.sun, more)
        before, after = (fit.judged(other.color, one.at(other), pairs[1]) for one in (base, found))
        if before - after < TUNING.least_gain:
            break
        positions, base = more, found
        gains.append(before - after)
    return positions, gains


def _scaled(found: Found, scale: float) -> Found:
    light = Fitted(found.light.sky * scale, found.light.beams * scale, found.light.loss)
    return replace(found, light=light)


def _scale_for_albedo(places: Places, found: Found) -> float:
    """The factor that makes the mean albedo `TUNING.mean_albedo`: 24 halvings of a range of 1/64 to 64."""
    direct = found.at(places) - places.met
    low, high = -6.0, 6.0
    for _ in range(24):
        middle = (low + high) / 2
        albedo = np.clip(places.color / (direct * 2.0**middle + places.met), 0, 1).mean()
        low, high = (middle, high) if albedo > TUNING.mean_albedo else (low, middle)
    return float(2.0 ** ((low + high) / 2))


def _explained(places: Places, pairs: Pairs, found: Found) -> float:
    """Of the differences between pairs, the share that light found elsewhere takes away."""
    even = np.full_like(places.color, places.color.mean())
    unlit = fit.judged(places.color, even, pairs)
    return max(1 - fit.judged(places.color, found.at(places), pairs) / max(unlit, 1e-12), 0.0)

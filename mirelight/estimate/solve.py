"""The captured light from splats and proxy: transport, the sun's search, the fit, and two halves that check it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mirelight.base.errors import RenderError
from mirelight.estimate import fit, lamps, sun
from mirelight.estimate.edges import Spoken, spoken
from mirelight.estimate.fit import Fitted, Pairs
from mirelight.estimate.groups import groups
from mirelight.estimate.sky import PATCHES, as_map, glow, ground_under
from mirelight.estimate.sun import Search, Sun
from mirelight.estimate.transport import Places, places_of
from mirelight.estimate.tuning import TUNING
from mirelight.estimate.types import Confidence, Estimate
from mirelight.model import F64, Light, ProxyMesh, RenderSettings, SplatCloud, SplatLayer

_LEAST_DISC = 0.53  # degrees, the sun's own
_NO_LAMPS = np.zeros((0, 3))


@dataclass(frozen=True, slots=True, eq=False)
class _Found:
    """Light from some of the places."""

    sun: Sun | None
    lamps: F64  # (L, 3) positions
    light: Fitted

    def at(self, places: Places) -> F64:
        """(N, 3) irradiance / pi."""
        seen = _beams(places, self.sun, self.lamps)
        return fit.light_of(places.open, places.met, seen, self.light.sky, self.light.beams)


def _beams(places: Places, one: Sun | None, positions: F64) -> F64:
    """(N, K) what the sun, if there is one, lights that are known and lamps at positions (L, 3) bring at strength 1."""
    suns = [] if one is None else [sun.disc(places, one.to_sun, one.radius)[None]]
    return np.concatenate([*suns, places.named.T, lamps.lit(places, positions)]).T


def estimate(
    splats: SplatCloud,
    proxy: ProxyMesh,
    settings: RenderSettings,
    exposure: float = 0.0,
    lights: Sequence[Light] = (),
    views: Sequence[SplatLayer] = (),
) -> Estimate:
    """The light that splats were captured under, as a sun, a sky, and up to three lamps.

    Args:
        splats: world space; their colours, in their colour space, are taken as captured light.
        proxy: world space; what casts shadows and stands in the way. Its own colours count for nothing.
        settings: seed, variant and threads of the rays.
        exposure: stops by which the light is stronger than it seems, where a person knows better.
        lights: that are known to have been there, but not how strong: their own colours and intensities do not count.
        views: as for :func:`mirelight.lighting.colored_by`.

    Returns:
        The same to the bit for the same input.

    Raises:
        RenderError: too few splats lie on the proxy; none of them sees the sky through it.
        BackendError: the variant cannot be used on this machine.
    """
    places = places_of(splats, proxy, settings, lights, views)
    if 1 - places.blocked < TUNING.least_open and not lights:
        raise RenderError(
            f"only {1 - places.blocked:.2%} of what the splats on the proxy face is open, so no light comes in from "
            "outside; name the lamps inside in the job's [captured], or leave windows open"
        )
    halves = [places.taken(np.arange(k, len(places), 2)) for k in (0, 1)]
    rng = np.random.default_rng(settings.seed)
    pairs = [fit.pairs_of(half.points, half.color, rng) for half in halves]
    edges = spoken(places.close, np.random.default_rng(settings.seed))
    suns = _suns(halves, pairs, rng, edges)
    every = fit.pairs_of(places.points, places.color, rng)
    best, gain = _best(places, every, suns, edges)
    found = [_settled(half, p, best.sun and s) for half, p, s in zip(halves, pairs, suns, strict=True)]
    shining, lamp_gains = _lamps(halves, pairs, found[0], rng)
    if len(shining):
        told, firm = _telling(places, every, best.sun)
        dark = _fitted(places, told, None, shining, firm)
        best = dark if best.sun is None else _fitted(places, told, best.sun, shining, firm)
        gain = dark.light.loss - best.light.loss
        if gain < TUNING.least_gain:  # the sun was the lamps
            best = dark
        found = [_settled(half, p, best.sun and s, shining) for half, p, s in zip(halves, pairs, suns, strict=True)]
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
        sun_apart=_apart(suns),
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


def _suns(halves: list[Places], pairs: list[Pairs], rng: np.random.Generator, edges: Spoken) -> list[Sun | None]:
    """The sun by each half of the places; None where there is none.

    Of those for which edges of shadows speak it is the one with which light explains both halves best: the one that
    edges surely tell, and else that or one of the half's own search.
    """
    searches = []
    for half in halves:
        some = half.taken(_thinned(half))
        searches.append(Search.of(some, fit.pairs_of(some.points, some.color, rng)))
    most = 1 if edges.sure else TUNING.sun_voted
    by_edges = [
        [_agreed(half, p, one) for one in sun.voted(search, edges, most)]
        for half, p, search in zip(halves, pairs, searches, strict=True)
    ]
    together = [sum(one.gain for one in both) for both in zip(*by_edges, strict=True)]
    chosen = [[x[int(np.argmax(together))]] if together else [] for x in by_edges]
    return [
        _likeliest(half, p, [*own, *([] if edges.sure else _searched(half, p, search))], edges)
        for half, p, search, own in zip(halves, pairs, searches, chosen, strict=True)
    ]


def _searched(half: Places, pairs: Pairs, search: Search) -> list[_Agreed]:
    """Suns of the search. It asks with a steady sky and one albedo for all; where a proxy is bumpy the whole fit alone
    tells suns apart."""
    return [_agreed(half, pairs, one) for one in sun.search(search)]


def _likeliest(half: Places, pairs: Pairs, tried: list[_Agreed], edges: Spoken) -> Sun | None:
    """The sun with which light explains most where proxy and picture agree, moved to where the half likes it best."""
    best = max(tried, key=lambda one: one.gain, default=None)
    if best is None or best.light.sun is None:
        return None
    return sun.moved(half, best.pairs, best.light.sun, best.light.light, edges)


def _named(found: _Found, places: Places) -> F64:
    """(L, 3) strengths of lights that are known to have been there."""
    end = len(found.light.beams) - len(found.lamps)
    return found.light.beams[end - places.named.shape[1] : end]


def _shining(light: Light, strength: F64) -> Light:
    return replace(light, color=strength / strength.max(), intensity=float(strength.max()))


def _strengths(found: _Found) -> F64:
    """(L, 3) of its lamps, candela / pi."""
    return found.light.beams[len(found.light.beams) - len(found.lamps) :]


def _lamps(halves: list[Places], pairs: list[Pairs], base: _Found, rng: np.random.Generator) -> tuple[F64, list[float]]:
    """(L, 3) positions of lamps that the first half asks for and the second confirms; and how much each of them makes
    the second half's albedos more alike.

    Args:
        halves, pairs: of the places.
        base: light of the first half without lamps.
        rng: for where they are looked for.
    """
    half, other = halves
    some = half.taken(_thinned(half))
    search = Search.of(some, fit.pairs_of(some.points, some.color, rng))
    positions, gains = np.zeros((0, 3)), list[float]()
    while len(positions) < TUNING.most_lamps:
        over = lamps.over(search, base.at(some) - some.met)
        lamp = lamps.search(over, rng)
        if lamp is None or float(over.losses(np.zeros(len(some))).min()) - lamp.loss < TUNING.least_gain:
            break
        more = np.concatenate([positions, lamp.position[None]])
        found = _settled(half, pairs[0], base.sun, more)
        before, after = (fit.judged(other.color, one.at(other), pairs[1]) for one in (base, found))
        if before - after < TUNING.least_gain:
            break
        positions, base = more, found
        gains.append(before - after)
    return positions, gains


def _thinned(half: Places) -> NDArray[np.int64]:
    """Rows of the places that are searched with."""
    return np.arange(0, len(half), max(-(-len(half) // TUNING.searched), 1))


def _firm(places: Places, found: Sun | None) -> NDArray[np.bool_]:
    """(N,) places that a sun's strength is fitted to."""
    return np.ones(len(places), bool) if found is None else sun.firm(places, found)


def _fitted(
    places: Places,
    pairs: Pairs,
    found: Sun | None,
    positions: F64 = _NO_LAMPS,
    firm: NDArray[np.bool_] | None = None,
) -> _Found:
    """Radiances with that sun, started from what it was found with, and with lamps at positions (L, 3).

    Fitted to those of the places `firm` (N,), off that sun's shadow edges where none are named, that see about what is
    seen beside them.

    They are the mean of two fits. Single places err by their splats' noise and by the proxy's, which groups of them
    average; groups err where light changes within them. So the errors differ, and those of the mean are less.
    """
    firm = _firm(places, found) if firm is None else firm
    seen = _beams(places, found, positions)
    sunlit = np.zeros(len(places), bool) if found is None else sun.lit(places, seen[:, 0], found.to_sun)
    beside = groups(places, firm, sunlit)
    single = _steadied(_Task(places, pairs, found, positions, seen, beside.sound))
    together = replace(
        places,
        color=beside.mean(places.even),
        open=beside.mean(places.open),
        met=beside.mean(places.met),
        named=beside.mean(places.named),
    )
    # the nearest share most of their groups
    grouped = _Task(together, pairs.farther(), found, positions, beside.mean(seen), beside.sound, TUNING.robust_grouped)
    means = _steadied(grouped)
    return replace(single, light=single.light.mixed(means.light, TUNING.grouped))


@dataclass(frozen=True, slots=True, eq=False)
class _Task:
    """What light is fitted to."""

    places: Places
    pairs: Pairs
    sun: Sun | None
    lamps: F64  # (L, 3) positions
    seen: F64  # (N, K) what the sun, lights that are known and lamps bring
    firm: NDArray[np.bool_]  # (N,) places that count
    robust: float = TUNING.fit_robust


def _steadied(task: _Task) -> _Found:
    """The fit with a sky that changes little with height, unless one that may change explains places far better.

    What a proxy gets wrong lets a free sky drift, as dark above or as bright as it takes; a soft box over a yard is
    as uneven in truth. How much of the differences either explains tells them apart.
    """
    steady, free = _descended(task, TUNING.even, TUNING.fit_steady), _descended(task)
    return free if free.light.loss < steady.light.loss - TUNING.uneven else steady


def _descended(task: _Task, start: tuple[float, float] | None = None, steady: float = 0.0) -> _Found:
    """The fit from an even sky, and a sun of that mean albedo and share, or of those that it was found with."""
    places = task.places
    albedo, share = (TUNING.mean_albedo, 0.0) if task.sun is None else start or task.sun.begin
    level = places.color.mean() / albedo
    direct = max(level - places.met.mean(), 0.1 * level)
    opening = float(places.open.sum(axis=1).mean())
    sky = direct * (1 - share) / max(opening, 1e-6) if opening >= TUNING.least_open else 0.0
    shares = [share] * (task.sun is not None) + [TUNING.lamps_share] * (places.named.shape[1] + len(task.lamps))
    beams = [direct * of / max(float(mean), 1e-9) for of, mean in zip(shares, task.seen.mean(axis=0), strict=True)]
    # a sky with a sun is fitted by what it differs from one that glows around it, as bright at these places
    shape = np.ones(PATCHES) if task.sun is None else glow(task.sun.to_sun)
    shape *= opening / max(float(places.open.mean(axis=0) @ shape), 1e-9)
    sunlight = None if task.sun is None else sun.sunlight(places, task.pairs, task.seen[:, 0], task.sun.to_sun)
    # one that is surely there may fade away on either way down; of others, the strict way tells right ones from wrong
    starts = (0, TUNING.fit_steps // 2) if sunlight is not None and task.sun and task.sun.sure else (0,)
    ground = ground_under(None if task.sun is None else task.sun.to_sun, shape, task.seen.shape[1])
    ways = [fit.Weighing(task.firm, task.robust, steady, ground, sunlight, start) for start in starts]
    asked = (places.color, places.open * shape, places.met, task.seen, task.pairs, sky, beams)
    light = min((fit.fit(*asked, way) for way in ways), key=lambda found: found.loss)
    return _Found(task.sun, task.lamps, replace(light, sky=light.sky * shape[:, None]))


def _best(places: Places, pairs: Pairs, suns: list[Sun | None], edges: Spoken) -> tuple[_Found, float]:
    """The better of both halves' suns, moved to where all places like it best; and what it gains over none."""
    tried = [_agreed(places, pairs, one) for one in suns if one is not None]
    if not tried:
        return _fitted(places, pairs, None), 0.0
    best = max(tried, key=lambda x: x.gain)
    least, gain = edges.least_gain, _gain(places, pairs, best.light.sun)
    if _apart(suns) <= TUNING.no_chance:  # what both halves ask for
        gain = max(gain, best.gain)
    if gain < least or best.light.sun is None:
        return _fitted(places, pairs, None), gain
    moved = sun.moved(places, best.pairs, best.light.sun, best.light.light, edges)
    if moved.radius > TUNING.widest_sun:
        return _fitted(places, pairs, None), gain
    rough = _agreed(places, pairs, moved)
    firm = _firm(places, moved) & rough.rows
    found, dark = (_fitted(places, rough.pairs, one, firm=firm) for one in (moved, None))
    if dark.light.loss - found.light.loss < least:  # away from shadows' edges nothing tells of it: they do
        return (rough.light, rough.gain) if rough.gain >= least else (_each(places, pairs, moved), gain)
    return found, dark.light.loss - found.light.loss


@dataclass(frozen=True, slots=True, eq=False)
class _Agreed:
    """A sun where picture and proxy agree on light and shadow."""

    light: _Found
    pairs: Pairs  # with those across its shadows' edges counting for more
    rows: NDArray[np.bool_]  # (N,) where they agree
    gain: float  # by how much less light explains there without a sun


def _agreed(places: Places, pairs: Pairs, one: Sun) -> _Agreed:
    """The fit to places one by one, off shadows' edges and where it agrees: a proxy that has light where the picture
    has shadow, or the other way round, makes the sun too weak, and hides it."""
    seen = _beams(places, one, _NO_LAMPS)
    across = pairs.across(sun.lit(places, seen[:, 0], one.to_sun))
    rows = firm = _firm(places, one)
    for _ in range(TUNING.agreed):
        first = _descended(_Task(places, across, one, _NO_LAMPS, seen, rows), TUNING.even, TUNING.fit_steady)
        rows = firm & sun.agreeing(places, across, one, seen[:, 0], first.at(places), first.light.beams[0])
    found, dark = (
        _descended(_Task(places, across, x, _NO_LAMPS, _beams(places, x, _NO_LAMPS), rows)) for x in (one, None)
    )
    return _Agreed(found, across, rows, dark.light.loss - found.light.loss)


def _telling(places: Places, pairs: Pairs, one: Sun | None) -> tuple[Pairs, NDArray[np.bool_]]:
    """Pairs, and (N,) places, that a sun's strength is fitted to: off its shadows' edges, where it agrees."""
    if one is None:
        return pairs, np.ones(len(places), bool)
    agreed = _agreed(places, pairs, one)
    return agreed.pairs, agreed.rows


def _settled(places: Places, pairs: Pairs, one: Sun | None, positions: F64 = _NO_LAMPS) -> _Found:
    """Radiances with that sun and lamps at positions (L, 3), fitted to what tells of them."""
    told, rows = _telling(places, pairs, one)
    return _fitted(places, told, one, positions, rows)


def _gain(places: Places, pairs: Pairs, one: Sun | None) -> float:
    """By how much less light explains all places without a sun."""
    return _each(places, pairs, None).light.loss - _each(places, pairs, one).light.loss


def _each(places: Places, pairs: Pairs, found: Sun | None) -> _Found:
    """The fit to every place by itself: edges of shadows tell the sun's direction."""
    seen = _beams(places, found, _NO_LAMPS)
    return _descended(_Task(places, pairs, found, _NO_LAMPS, seen, np.ones(len(places), bool)))


def _scaled(found: _Found, scale: float) -> _Found:
    light = Fitted(found.light.sky * scale, found.light.beams * scale, found.light.loss)
    return replace(found, light=light)


def _scale_for_albedo(places: Places, found: _Found) -> float:
    """The factor that makes the mean albedo `TUNING.mean_albedo`: 24 halvings of a range of 1/64 to 64."""
    direct = found.at(places) - places.met
    low, high = -6.0, 6.0
    for _ in range(24):
        middle = (low + high) / 2
        albedo = np.clip(places.color / (direct * 2.0**middle + places.met), 0, 1).mean()
        low, high = (middle, high) if albedo > TUNING.mean_albedo else (low, middle)
    return float(2.0 ** ((low + high) / 2))


def _apart(suns: list[Sun | None]) -> float:
    a, b = suns
    if a is None or b is None:
        return float("nan")
    return float(np.degrees(np.arccos(np.clip(a.to_sun @ b.to_sun, -1, 1))))


def _explained(places: Places, pairs: Pairs, found: _Found) -> float:
    """Of the differences between pairs, the share that light found elsewhere takes away."""
    even = np.full_like(places.color, places.color.mean())
    unlit = fit.judged(places.color, even, pairs)
    return max(1 - fit.judged(places.color, found.at(places), pairs) / max(unlit, 1e-12), 0.0)

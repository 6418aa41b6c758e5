"""Which sun is taken: that of each half of the places, and the better of both for all of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mirelight.estimate import fit, sun
from mirelight.estimate.descent import NO_LAMPS, Found, Task, beams_at, descended, firm_places, fitted, fitted_each
from mirelight.estimate.edges import Spoken
from mirelight.estimate.fit import Pairs
from mirelight.estimate.sun import Search, Sun
from mirelight.estimate.transport import Places
from mirelight.estimate.tuning import TUNING
from mirelight.model import F64


def suns_by_half(halves: list[Places], pairs: list[Pairs], rng: np.random.Generator, edges: Spoken) -> list[Sun | None]:
    """The sun by each half of the places; None where there is none.

    Of those for which edges of shadows speak it is the one with which light explains both halves best: the one that
    edges surely tell, and else that or one of the half's own search.
    """
    searches = []
    for half in halves:
        some = half.taken(thinned(half))
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


def best_of(places: Places, pairs: Pairs, suns: list[Sun | None], edges: Spoken) -> tuple[Found, float]:
    """The better of both halves' suns, moved to where all places like it best; and what it gains over none."""
    tried = [_agreed(places, pairs, one) for one in suns if one is not None]
    if not tried:
        return fitted(places, pairs, None), 0.0
    best = max(tried, key=lambda x: x.gain)
    least, gain = edges.least_gain, _gain(places, pairs, best.light.sun)
    if apart(suns) <= TUNING.no_chance:  # what both halves ask for
        gain = max(gain, best.gain)
    if gain < least or best.light.sun is None:
        return fitted(places, pairs, None), gain
    moved = sun.moved(places, best.pairs, best.light.sun, best.light.light, edges)
    if moved.radius > TUNING.widest_sun:
        return fitted(places, pairs, None), gain
    rough = _agreed(places, pairs, moved)
    firm = firm_places(places, moved) & rough.rows
    found, dark = (fitted(places, rough.pairs, one, firm=firm) for one in (moved, None))
    if dark.light.loss - found.light.loss < least:  # away from shadows' edges nothing tells of it: they do
        return (rough.light, rough.gain) if rough.gain >= least else (fitted_each(places, pairs, moved), gain)
    return found, dark.light.loss - found.light.loss


def sun_share(places: Places, found: Found) -> float:
    """Its sun's share of all light at the places that it lights, 0..1; 0 where it lights none, or there is none."""
    if found.sun is None:
        return 0.0
    seen = beams_at(places, found.sun, NO_LAMPS)[:, 0]
    rows = sun.lit(places, seen, found.sun.to_sun)
    beam = float(seen[rows].sum()) * float(found.light.beams[0].mean())
    return beam / max(float(found.at(places)[rows].sum()) / 3, 1e-12)


@dataclass(frozen=True, slots=True, eq=False)
class _Agreed:
    """A sun where picture and proxy agree on light and shadow."""

    light: Found
    pairs: Pairs  # with those across its shadows' edges counting for more
    rows: NDArray[np.bool_]  # (N,) where they agree
    gain: float  # by how much less light explains there without a sun


def _agreed(places: Places, pairs: Pairs, one: Sun) -> _Agreed:
    """The fit to places one by one, off shadows' edges and where it agrees: a proxy that has light where the picture
    has shadow, or the other way round, makes the sun too weak, and hides it."""
    seen = beams_at(places, one, NO_LAMPS)
    across = pairs.across(sun.lit(places, seen[:, 0], one.to_sun))
    rows = firm = firm_places(places, one)
    for _ in range(TUNING.agreed):
        first = descended(Task(places, across, one, NO_LAMPS, seen, rows), TUNING.even, TUNING.fit_steady)
        rows = firm & sun.agreeing(places, across, one, seen[:, 0], first.at(places), first.light.beams[0])
    found, dark = (
        descended(Task(places, across, x, NO_LAMPS, beams_at(places, x, NO_LAMPS), rows)) for x in (one, None)
    )
    return _Agreed(found, across, rows, dark.light.loss - found.light.loss)


def telling(places: Places, pairs: Pairs, one: Sun | None) -> tuple[Pairs, NDArray[np.bool_]]:
    """Pairs, and (N,) places, that a sun's strength is fitted to: off its shadows' edges, where it agrees."""
    if one is None:
        return pairs, np.ones(len(places), bool)
    agreed = _agreed(places, pairs, one)
    return agreed.pairs, agreed.rows


def settled(places: Places, pairs: Pairs, one: Sun | None, positions: F64 = NO_LAMPS) -> Found:
    """Radiances with that sun and lamps at positions (L, 3), fitted to what tells of them."""
    told, rows = telling(places, pairs, one)
    return fitted(places, told, one, positions, rows)


def _gain(places: Places, pairs: Pairs, one: Sun | None) -> float:
    """By how much less light explains all places without a sun."""
    return fitted_each(places, pairs, None).light.loss - fitted_each(places, pairs, one).light.loss


def apart(suns: list[Sun | None]) -> float:
    """Degrees between the suns of both halves; NaN where one has none."""
    a, b = suns
    if a is None or b is None:
        return float("nan")
    return float(np.degrees(np.arccos(np.clip(a.to_sun @ b.to_sun, -1, 1))))


def thinned(half: Places) -> NDArray[np.int64]:
    """(n,) rows of the places that are searched with."""
    return np.arange(0, len(half), max(-(-len(half) // TUNING.searched), 1))

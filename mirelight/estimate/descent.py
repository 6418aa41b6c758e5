"""Light from places when the sun and lamps are known: what a descent is asked, and its mean over places and groups."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mirelight.estimate import fit, lamps, sun
from mirelight.estimate.fit import Fitted, Pairs
from mirelight.estimate.groups import groups
from mirelight.estimate.sky import PATCHES, glow, ground_under
from mirelight.estimate.sun import Sun
from mirelight.estimate.transport import Places
from mirelight.estimate.tuning import TUNING
from mirelight.model import F64

NO_LAMPS = np.zeros((0, 3))


@dataclass(frozen=True, slots=True, eq=False)
class Found:
    """Light from some of the places."""

    sun: Sun | None
    lamps: F64  # (L, 3) positions
    light: Fitted

    def at(self, places: Places) -> F64:
        """(N, 3) irradiance / pi."""
        seen = beams_at(places, self.sun, self.lamps)
        return fit.light_of(places.open, places.met, seen, self.light.sky, self.light.beams)


def beams_at(places: Places, one: Sun | None, positions: F64) -> F64:
    """(N, K) what the sun, if there is one, lights that are known and lamps at positions (L, 3) bring at strength 1."""
    suns = [] if one is None else [sun.disc(places, one.to_sun, one.radius)[None]]
    return np.concatenate([*suns, places.named.T, lamps.lit(places, positions)]).T


@dataclass(frozen=True, slots=True, eq=False)
class Task:
    """What light is fitted to."""

    places: Places
    pairs: Pairs
    sun: Sun | None
    lamps: F64  # (L, 3) positions
    seen: F64  # (N, K) what the sun, lights that are known and lamps bring
    firm: NDArray[np.bool_]  # (N,) places that count
    robust: float = TUNING.fit_robust
    ground: float = 1.0  # highest albedo outside; where suns are searched it may stand for what a proxy gets wrong


def firm_places(places: Places, found: Sun | None) -> NDArray[np.bool_]:
    """(N,) places that a sun's strength is fitted to."""
    return np.ones(len(places), bool) if found is None else sun.firm(places, found)


def fitted(
    places: Places,
    pairs: Pairs,
    found: Sun | None,
    positions: F64 = NO_LAMPS,
    firm: NDArray[np.bool_] | None = None,
) -> Found:
    """Radiances with that sun, started from what it was found with, and with lamps at positions (L, 3).

    Fitted to those of the places `firm` (N,), off that sun's shadow edges where none are named, that see about what is
    seen beside them.

    They are the mean of two fits. Single places err by their splats' noise and by the proxy's, which groups of them
    average; groups err where light changes within them. So the errors differ, and those of the mean are less.
    """
    firm = firm_places(places, found) if firm is None else firm
    seen = beams_at(places, found, positions)
    sunlit = np.zeros(len(places), bool) if found is None else sun.lit(places, seen[:, 0], found.to_sun)
    beside = groups(places, firm, sunlit)
    # through windows the sun is too weak, as its patches show white, and would make ground out there too dark
    ground = TUNING.fit_ground if 1 - places.blocked > TUNING.doubt_open else 1.0
    single = _steadied(Task(places, pairs, found, positions, seen, beside.sound, ground=ground))
    together = replace(
        places,
        color=beside.mean(places.even),
        open=beside.mean(places.open),
        met=beside.mean(places.met),
        named=beside.mean(places.named),
    )
    # the nearest share most of their groups
    grouped = Task(together, pairs.farther(), found, positions, beside.mean(seen), beside.sound, ground=ground)
    means = _steadied(replace(grouped, robust=TUNING.robust_grouped))
    return replace(single, light=single.light.mixed(means.light, TUNING.grouped))


def fitted_each(places: Places, pairs: Pairs, found: Sun | None) -> Found:
    """The fit to every place by itself: edges of shadows tell the sun's direction."""
    seen = beams_at(places, found, NO_LAMPS)
    return descended(Task(places, pairs, found, NO_LAMPS, seen, np.ones(len(places), bool)))


def _steadied(task: Task) -> Found:
    """The fit with a sky that changes little with height, unless one that may change explains places far better.

    What a proxy gets wrong lets a free sky drift, as dark above or as bright as it takes; a soft box over a yard is
    as uneven in truth. How much of the differences either explains tells them apart.
    """
    steady, free = descended(task, TUNING.even, TUNING.fit_steady), descended(task)
    return free if free.light.loss < steady.light.loss - TUNING.uneven else steady


def descended(task: Task, start: tuple[float, float] | None = None, steady: float = 0.0) -> Found:
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
    to_sun = None if task.sun is None else task.sun.to_sun
    ground = task.ground * ground_under(to_sun, shape, task.seen.shape[1])
    most = math.inf if task.sun is None else sun.most(places, task.seen[:, 0], task.sun.to_sun)
    ways = [fit.Weighing(task.firm, task.robust, steady, ground, most, sunlight, start) for start in starts]
    asked = (places.color, places.open * shape, places.met, task.seen, task.pairs, sky, beams)
    light = min((fit.fit(*asked, way) for way in ways), key=lambda found: found.loss)
    return Found(task.sun, task.lamps, replace(light, sky=light.sky * shape[:, None]))

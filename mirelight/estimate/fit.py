"""The sky's radiances and the sun's, so that surfaces alike come out alike: gradient descent on their logarithms.

With irradiance / pi = open @ sky + seen * sun + met, the logarithm of albedo is log color - log(irradiance / pi). The
loss is a robust mean over pairs of places, near and farther ones, whose albedos have the same chroma, of how much these
differ. It knows scale from what surfaces send each other alone, and colour hardly. So the sun is drawn to sunlight's
colour, or without one what comes from sky and lamps (not what surfaces send, which has their colour) to white in the
mean; and albedos between bounds. Few places see much of what comes from below the horizon, and left free it takes what
the proxy gets wrong (40 times too bright in a park, which hid the sun): ground reflects no more than comes down to it.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from mirelight.base.colour import REC709_LUMINANCE
from mirelight.estimate.sky import ABOVE, PATCHES, RING_OF, RINGS
from mirelight.estimate.tuning import TUNING
from mirelight.model import F64

Int: TypeAlias = NDArray[np.int64]
Chosen: TypeAlias = Int | NDArray[np.bool_]

_BEAMS = len(RINGS) + PATCHES  # row of the first beam


@dataclass(frozen=True, slots=True, eq=False)
class Pairs:
    """Pairs of places, P of them."""

    a: Int  # (P,)
    b: Int  # (P,)
    nearest: NDArray[np.bool_]  # (P,) of the first band
    clipped: NDArray[np.bool_]  # (N, 3) of places, not of pairs: the picture says no more than "at least so bright"
    worth: F64  # (P,) by how much each counts

    def across(self, lit: NDArray[np.bool_]) -> Pairs:
        """Those of a place in the sun (N,) and one in its shadow count for `ACROSS` of all, where they are fewer.

        They alone tell how strong the sun is; by number what a proxy gets wrong in the shade outweighs them.
        """
        both = lit[self.a] != lit[self.b]
        share = float(both.mean()) if len(both) else 1.0
        if not 0 < share < TUNING.fit_across:
            return self
        more = min(TUNING.fit_across / (1 - TUNING.fit_across) * (1 - share) / share, TUNING.fit_most_worth)
        return replace(self, worth=np.where(both, more, 1.0))

    def of_rows(self, rows: NDArray[np.bool_]) -> Pairs:
        """Those of which both places are among rows (N,), which are counted anew."""
        kept = self._taken(rows[self.a] & rows[self.b])
        new = np.cumsum(rows) - 1
        return replace(kept, a=new[kept.a], b=new[kept.b], clipped=self.clipped[rows])

    def farther(self) -> Pairs:
        """All pairs of places but the nearest."""
        return self._taken(~self.nearest)

    def _taken(self, kept: NDArray[np.bool_]) -> Pairs:
        return replace(self, a=self.a[kept], b=self.b[kept], nearest=self.nearest[kept], worth=self.worth[kept])

    def apart(self, log_albedo: F64) -> F64:
        """(P, 3) how far albedos (N, 3) surely differ, see :func:`surely`."""
        return surely(log_albedo[self.a] - log_albedo[self.b], self.clipped[self.a], self.clipped[self.b])

    def alike(self, places: F64, others: F64) -> F64:
        """(N,) with how many of the places that each is paired with it agrees in chroma and albedo, if its albedo is
        that of `places` (N, 3) and theirs that of `others` (N, 3)."""
        out = np.zeros(len(places))
        for own, other in ((self.a, self.b), (self.b, self.a)):
            d = places[own] - others[other]
            like = self._one_material(d, own, other)
            surely(d, self.clipped[own], self.clipped[other])
            out += np.bincount(
                own, like * (TUNING.fit_robust**2 / (d * d + TUNING.fit_robust**2)).mean(axis=1), len(out)
            )
        return out

    def weights(self, log_albedo: F64) -> F64:
        """(P,) how likely each pair is of one material, by the chroma of albedos (N, 3); they sum to 1."""
        w = self._one_material(log_albedo[self.a] - log_albedo[self.b], self.a, self.b)
        return np.asarray(w / max(w.sum(), 1e-12))

    def _one_material(self, d: F64, first: Int, second: Int) -> F64:
        """(P,) how likely pairs of places (P,) whose albedos differ by d (P, 3) are of one material. Channels that are
        clipped tell no chroma."""
        known = ~(self.clipped[first] | self.clipped[second])
        apart, told = np.zeros(len(d)), np.zeros(len(d), bool)
        for i, j in ((0, 1), (0, 2), (1, 2)):  # a third of the squares of these is the square of the chroma
            both = known[:, i] & known[:, j]
            apart += both * (d[:, i] - d[:, j]) ** 2 / 3
            told |= both
        return np.asarray(self.worth * told * np.exp(apart / (-2 * TUNING.fit_alike**2)))


def surely(d: F64, first: Chosen, second: Chosen) -> F64:
    """How far pairs surely differ, of which the first, or second, place shows white: a lower bound does not differ from
    what lies above it.

    Args:
        d: (P, 3) logarithms of first places' albedos over second ones', written over.
        first, second: which of them, as masks or indices.
    """
    d[first] = np.maximum(d[first], 0)
    d[second] = np.minimum(d[second], 0)
    return d


def pairs_of(points: F64, color: F64, rng: np.random.Generator) -> Pairs:
    """Each of places (N, 3) of those colours with others at all distances, `EACH` from every band of nearness: near
    places are of one material, but seldom one in light and one in shadow; the farther ones tell light from shadow."""
    from scipy.spatial import cKDTree

    n = len(points)
    last = min(TUNING.fit_bands[-1], n)
    _, order = cKDTree(points).query(points, k=last, workers=-1)  # ties at one place are in any order, but the same one
    own, other, nearest = [], [], []
    for first, end in itertools.pairwise(min(b, n - 1) for b in TUNING.fit_bands):
        if end > first:
            rank = rng.integers(first, end, (n, TUNING.fit_each))
            own.append(np.repeat(np.arange(n), TUNING.fit_each))
            other.append(np.take_along_axis(order, rank, axis=1).ravel())
            nearest.append(np.full(n * TUNING.fit_each, first == TUNING.fit_bands[0]))
    a, b = np.concatenate(own).astype(np.int64), np.concatenate(other).astype(np.int64)
    return Pairs(a, b, np.concatenate(nearest), color >= TUNING.fit_white_out, np.ones(len(a)))


@dataclass(frozen=True, slots=True, eq=False)
class Fitted:
    """Radiances found, and how well they explain the colours."""

    sky: F64  # (PATCHES, 3)
    beams: F64  # (K, 3) strengths: of a sun the irradiance / pi of a facing surface, of a lamp candela / pi
    loss: float

    def mixed(self, other: Fitted, share: float) -> Fitted:
        """With that share of another."""
        own = 1 - share
        sky, beams = own * self.sky + share * other.sky, own * self.beams + share * other.beams
        return Fitted(sky, beams, own * self.loss + share * other.loss)


def light_of(open_: F64, met: F64, seen: F64, sky: F64, beams: F64) -> F64:
    """(N, 3) irradiance / pi."""
    return np.asarray(np.einsum("np,pc->nc", open_, sky) + met + np.einsum("nk,kc->nc", seen, beams))


def judged(color: F64, light: F64, pairs: Pairs) -> float:
    """The robust mean difference, 0..1, of log albedos over pairs, which the fit makes small; `color`, `light`: (N,
    3)."""
    return float(compared(color, light, pairs).sum())


def compared(color: F64, light: F64, pairs: Pairs) -> F64:
    """(P,) what each pair adds to that."""
    a = np.log(color) - np.log(light + TUNING.fit_floor * light.mean())
    d = pairs.apart(a)
    return np.asarray(pairs.weights(a) * (d * d / (d * d + TUNING.fit_robust**2)).mean(axis=1))


@dataclass(frozen=True, slots=True, eq=False)
class Weighing:
    """What counts in a fit, and how much."""

    firm: NDArray[np.bool_] | None = None  # (N,) places that are fitted to; None: all
    robust: float = TUNING.fit_robust  # of the logarithm of albedo: less where colours are means
    steady: float = 0.0  # weight of squared logarithms of quotients of neighbouring rings above the horizon
    # (PATCHES + K,) as `ground_under` has it: no more than that, of all sources, comes from below the horizon
    ground: F64 | None = None
    sun_most: float = math.inf  # the strongest that the first beam may be, in any channel
    sunlight: F64 | None = None  # (3,) colour that the first beam is drawn to, from that step on;
    sunlight_from: int = 0  # before, or without one, all direct light is drawn to white


_ALIKE = Weighing()


def fit(
    color: F64,
    open_: F64,
    met: F64,
    seen: F64,
    pairs: Pairs,
    sky: float,
    beams: Sequence[float],
    by: Weighing = _ALIKE,
) -> Fitted:
    """Descent (Adam, Kingma and Ba 2015) from an even sky.

    Args:
        color: (N, 3) linear colours of places.
        open_: (N, PATCHES), and met: (N, 3), as in `Places`.
        seen: (N, K) what beams of strength 1 bring: the sun's cosine where it is seen, a lamp's over distance squared.
        pairs: of places.
        sky: radiance to start from.
        beams: their strengths to start from.
        by: what counts.
    """
    firm = np.ones(len(color), bool) if by.firm is None else by.firm
    task = _Compared.of(color, open_, met, seen, pairs, firm, by)
    # ring means, each patch's departure from its ring's, the beams
    theta = np.zeros((_BEAMS + seen.shape[1], 3))
    theta[: len(RINGS)] = np.log(max(sky, 1e-6))
    theta[_BEAMS:] = np.log(np.maximum(beams, 1e-6))[:, None]
    lone = np.asarray(RINGS)[RING_OF] == 1
    first, second = np.zeros_like(theta), np.zeros_like(theta)
    weights = np.zeros(0)
    for step in range(TUNING.fit_steps):
        sources = _radiances(theta)
        a, soft = task.albedo(sources)
        if step % TUNING.fit_again == 0:
            weights = task.pairs.weights(a.T)
        sunlight = by.sunlight if step >= by.sunlight_from else None
        white = TUNING.fit_white if sunlight is None else 0.0
        by_source = task.gradient(sources, a, soft, weights, white) * sources
        apart = theta[len(RINGS) : _BEAMS]
        gradient = np.zeros_like(theta)
        np.add.at(gradient, RING_OF, by_source[:PATCHES])
        step_up = 2 * by.steady * np.diff(theta[:ABOVE], axis=0)
        gradient[1:ABOVE] += step_up
        gradient[: ABOVE - 1] -= step_up
        gradient[len(RINGS) : _BEAMS] = by_source[:PATCHES] + (2 * TUNING.fit_smooth / PATCHES) * apart
        gradient[len(RINGS) : _BEAMS][lone] = 0
        gradient[_BEAMS:] = by_source[PATCHES:]
        if sunlight is not None:
            gradient[_BEAMS] += TUNING.fit_white * 2 * _chroma(theta[_BEAMS] - np.log(sunlight))
        first = 0.9 * first + 0.1 * gradient
        second = 0.99 * second + 0.01 * gradient**2
        rate = TUNING.fit_rate * 0.5 * (1 + np.cos(np.pi * step / TUNING.fit_steps))
        theta -= rate * (first / (1 - 0.9 ** (step + 1))) / (np.sqrt(second / (1 - 0.99 ** (step + 1))) + 1e-7)
        if by.ground is not None:
            theta[ABOVE : len(RINGS)] = np.minimum(theta[ABOVE : len(RINGS)], np.log(by.ground @ sources))
        if by.sun_most < math.inf:
            theta[_BEAMS] = np.minimum(theta[_BEAMS], math.log(by.sun_most))
    sources = _radiances(theta)
    return Fitted(sources[:PATCHES], sources[PATCHES:], task.loss(sources, weights))


def _chroma(level: F64) -> F64:
    """Logarithms (3,) less their mean."""
    return np.asarray(level - level.mean())


def _radiances(theta: F64) -> F64:
    """(PATCHES + K, 3) of the sky's patches, and the beams' strengths."""
    sky = theta[: len(RINGS)][RING_OF] + theta[len(RINGS) : _BEAMS]
    return np.asarray(np.exp(np.clip(np.concatenate([sky, theta[_BEAMS:]]), -16, 16)))


@dataclass(frozen=True, slots=True, eq=False)
class _Compared:
    """What a descent asks at every step, laid out for speed: channels first, and only the F places that it is fitted
    to. Of the N-F others their mean alone is needed, which is linear in the light."""

    log_color: F64  # (3, F)
    parts: F64  # (PATCHES + K, F) what each source brings at strength 1
    met: F64  # (3, F)
    mean_parts: F64  # (PATCHES + K,) over all places
    mean_met: F64  # (3,)
    pairs: Pairs  # of the F places
    robust: float
    bounded: tuple[tuple[Int, Int], ...]  # by channel, pairs whose first, and second, place shows white
    spread: Any  # (F, P) sparse: adds what pairs ask for to their first place, and takes it from the second

    @staticmethod
    def of(
        color: F64, open_: F64, met: F64, seen: F64, pairs: Pairs, firm: NDArray[np.bool_], by: Weighing
    ) -> _Compared:
        """The pairs of all N places."""
        from scipy.sparse import csr_array

        pairs = pairs.of_rows(firm)
        count, places = len(pairs.a), int(firm.sum())
        rows, columns = np.concatenate([pairs.a, pairs.b]), np.tile(np.arange(count), 2)
        sign = np.repeat([1.0, -1.0], count)
        parts = np.concatenate([open_, seen], axis=1)
        return _Compared(
            log_color=np.ascontiguousarray(np.log(color[firm]).T),
            parts=np.ascontiguousarray(parts[firm].T),
            met=np.ascontiguousarray(met[firm].T),
            mean_parts=parts.mean(axis=0),
            mean_met=met.mean(axis=0),
            pairs=pairs,
            robust=by.robust,
            bounded=tuple(
                (np.flatnonzero(white[pairs.a]), np.flatnonzero(white[pairs.b])) for white in pairs.clipped.T
            ),
            spread=csr_array((sign, (rows, columns)), shape=(places, count)),
        )

    def albedo(self, sources: F64) -> tuple[F64, F64]:
        """(3, F) logarithms of albedos under sources (PATCHES + K, 3), and (3, F) that light, with what is added."""
        soft = np.einsum("pc,pn->cn", sources, self.parts)
        soft += self.met
        soft += TUNING.fit_floor * self._mean(sources).mean()
        return self.log_color - np.log(soft), soft

    def gradient(self, sources: F64, a: F64, soft: F64, weights: F64, white: float) -> F64:
        """(PATCHES + K, 3) of the loss and all that is asked of light, by sources; `white`: weight of direct light that
        is white in the mean."""
        by_light = np.empty_like(a)
        for k, d in enumerate(self._apart(a)):
            below = d * d
            below += self.robust**2
            d *= weights
            d /= below
            d /= below
            by_light[k] = self.spread @ d
        by_light *= 2 * self.robust**2 / 3
        over = TUNING.fit_brights * np.maximum(a - np.log(TUNING.fit_bright), 0)
        over -= TUNING.fit_bounds * np.maximum(np.log(TUNING.fit_dark) - a, 0)
        by_light += (2 / (3 * a.shape[1])) * over
        by_light /= -soft
        direct = np.maximum(self._mean(sources) - self.mean_met, 1e-12)
        by_mean = TUNING.fit_floor * by_light.sum() / 3 + white * 2 * _chroma(np.log(direct)) / direct
        return np.asarray(np.einsum("pn,cn->pc", self.parts, by_light) + self.mean_parts[:, None] * by_mean)

    def loss(self, sources: F64, weights: F64) -> float:
        """The robust mean difference over pairs, 0..1."""
        a, _ = self.albedo(sources)
        return float(sum((weights * (d * d / (d * d + self.robust**2))).sum() for d in self._apart(a)) / 3)

    def _mean(self, sources: F64) -> F64:
        """(3,) mean light over all places."""
        return np.asarray(np.einsum("p,pc->c", self.mean_parts, sources) + self.mean_met)

    def _apart(self, a: F64) -> Iterator[F64]:
        """As `Pairs.apart`, (P,) of each channel."""
        for of_channel, (first, second) in zip(a, self.bounded, strict=True):
            d = of_channel.take(self.pairs.a)
            d -= of_channel.take(self.pairs.b)
            yield surely(d, first, second)


def differ(one: F64, other: F64) -> float:
    """The median factor, less 1, between lights (N, 3) of the same places; a place that meets black ones alone has none
    and tells nothing. NaN where no place has light."""
    lit = np.minimum(one, other).min(axis=1) > 0
    if not lit.any():
        return math.nan
    return float(np.expm1(np.median(np.abs(np.log(one[lit] / other[lit])))))


def albedos(color: F64, light: F64) -> tuple[float, float, float]:
    """5 %, median and 95 % of what places that have light (N, 3) are like, as luminance."""
    lit = light.min(axis=1) > 0
    if not lit.any():
        return math.nan, math.nan, math.nan
    albedo = (color[lit] / light[lit]) @ REC709_LUMINANCE.astype(np.float64)
    low, middle, high = (float(x) for x in np.quantile(albedo, [0.05, 0.5, 0.95]))
    return low, middle, high

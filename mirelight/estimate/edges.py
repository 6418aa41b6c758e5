"""Where the sun stood by the edges of its shadows alone: near places in one plane, of which one is in the sun.

How much of the colours' differences a light explains tells little of its direction where a surface has texture, or a
proxy is bumpy. Paint and bumps take no side to a sun's edges, so in many pairs across them they cancel: of two places
close together the one in the sun shows more, however little else of the picture is understood. That takes places as
close as shadows are sharp, many times as many as light is fitted to.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mirelight.base.colour import REC709_LUMINANCE
from mirelight.estimate.fit import Pairs, surely
from mirelight.estimate.sky import apart, refined, sphere
from mirelight.estimate.transport import Close, cosine_directions
from mirelight.estimate.tuning import TUNING
from mirelight.model import F64

Int = NDArray[np.int64]


@dataclass(frozen=True, slots=True, eq=False)
class _Band:
    """V pairs of places in one plane, all about as close."""

    a: Int  # (V,)
    b: Int  # (V,)
    vote: F64  # (V,) how much more the first shows, weighed by how likely both are of one material

    def said(self, lit: NDArray[np.bool_], faces: NDArray[np.bool_]) -> float:
        """Standard errors by which places in the sun show more, of places lit (N,) among those that face it (N,)."""
        known = faces[self.a] & faces[self.b] & (lit[self.a] != lit[self.b])
        side, vote = np.where(lit[self.a[known]], 1.0, -1.0), self.vote[known]
        return float(side @ vote / np.sqrt((vote**2).sum() + 1e-300))


@dataclass(frozen=True, slots=True, eq=False)
class Edges:
    """Places, and pairs of them from close ones to ones farther apart."""

    close: Close
    bands: tuple[_Band, ...]

    @staticmethod
    def of(close: Close, rng: np.random.Generator) -> Edges:
        """Each place with a few of those nearest, from every band of nearness."""
        from scipy.spatial import cKDTree

        n = len(close)
        white = close.color >= TUNING.fit_white_out
        shown = np.log(close.color @ REC709_LUMINANCE.astype(np.float64)) - _shade(close, rng)
        ends = [min(k, n - 1) for k in TUNING.edge_bands]
        _, order = cKDTree(close.points).query(close.points, k=ends[-1] + 1, workers=-1)
        bands = []
        for first, end in itertools.pairwise(ends):
            if end <= first:
                continue
            rank = rng.integers(first, end, (n, TUNING.edge_each))
            a, b = np.repeat(np.arange(n), TUNING.edge_each), np.take_along_axis(order, rank, axis=1).ravel()
            plane = np.einsum("nk,nk->n", close.normals[a], close.normals[b]) > TUNING.edge_plane
            between = close.points[b] - close.points[a]
            off = np.abs(np.einsum("nk,nk->n", between, close.normals[a]))
            plane &= off < TUNING.edge_off * np.linalg.norm(between, axis=1)
            a, b = a[plane], b[plane]
            alike = Pairs(a, b, np.ones(len(a), bool), white, np.ones(len(a))).weights(np.log(close.color))
            more = surely(shown[a] - shown[b], white[a].any(axis=1), white[b].any(axis=1))
            vote = alike * np.clip(more, -TUNING.edge_most, TUNING.edge_most)
            bands.append(_Band(a, b, vote))
        return Edges(close, tuple(bands))

    def said(self, ways: F64) -> F64:
        """(D, B) what the pairs of each band say for suns in directions (D, 3), in standard errors as of pairs that
        know nothing of each other; NaN for those that reach too few places."""
        out = np.full((len(ways), len(self.bands)), np.nan)
        for k, way in enumerate(ways):
            cosine = self.close.normals @ way
            lit = np.zeros(len(cosine), bool)
            rows = np.flatnonzero(cosine > TUNING.edge_least_cosine)
            lit[rows] = ~self.close.sight.blocked(self.close.points[rows], np.broadcast_to(way, (len(rows), 3)))
            if lit.mean() >= TUNING.sun_least_lit:
                out[k] = [band.said(lit, cosine > TUNING.edge_towards) for band in self.bands]
        return out


@dataclass(frozen=True, slots=True, eq=False)
class Spoken:
    """For which suns edges speak, and how surely: in standard deviations of what they say for directions at random."""

    ways: F64  # (K, 3) unit, the likeliest first, none near another
    scores: F64  # (K,)
    edges: Edges
    spread: F64  # (B,) of what each band says

    @property
    def sure(self) -> bool:
        """Whether the first stands out so far that edges alone tell where the sun was."""
        return self.lead > TUNING.edge_sure

    @property
    def lead(self) -> float:
        """By how much the first stands out."""
        return self._lead(self.ways[0], float(self.scores[0])) if len(self.ways) else 0.0

    @property
    def least_gain(self) -> float:
        """Of the loss, what a sun must explain to be there: the less, the surer edges are."""
        if self.lead > TUNING.edge_certain:
            return -math.inf
        return TUNING.sure_gain if self.sure else TUNING.least_gain

    def score(self, ways: F64) -> F64:
        """(D,) of suns in directions (D, 3)."""
        return _scores(self.edges.said(ways), self.spread)

    def beaten(self, way: F64) -> float:
        """By how much edges speak rather for the likeliest sun elsewhere than for one in a direction (3,), or for the
        likeliest one beside that, as those elsewhere were moved to where they are likeliest; below 0: they speak for
        this one."""
        beside = self.scores[self.ways @ way > TUNING.edge_apart]
        return -self._lead(way, float(np.append(beside, self.score(way[None])).max()))

    def _lead(self, way: F64, score: float) -> float:
        """By how much a direction (3,) of that score leads the likeliest sun elsewhere."""
        others = self.scores[self.ways @ way < TUNING.sun_elsewhere]
        return score - (float(others.max()) if len(others) else 0.0)


def _shade(close: Close, rng: np.random.Generator) -> F64:
    """(N,) logarithms of the light of an even sky, as a mean of a few places."""
    from scipy.spatial import cKDTree

    open_ = np.zeros(len(close))
    step = max((1 << 20) // TUNING.edge_rays, 1)
    for first in range(0, len(close), step):
        rows = slice(first, first + step)
        ways = cosine_directions(close.normals[rows], TUNING.edge_rays, rng)
        starts = np.repeat(close.points[rows], TUNING.edge_rays, axis=0)
        open_[rows] = 1 - close.sight.blocked(starts, ways.reshape(-1, 3)).reshape(ways.shape[:2]).mean(axis=1)
    _, near = cKDTree(close.points).query(close.points, k=min(8, len(close)), workers=-1)
    open_ = open_[near.reshape(len(close), -1)].mean(axis=1)
    return np.asarray(np.log(open_ + TUNING.edge_hidden * (1 - open_)))


def spoken(close: Close, rng: np.random.Generator) -> Spoken:
    """For which suns the edges of a captured surface's shadows speak.

    Directions all around are asked for with a share of the places, the best ones and some at random with all of them,
    and the best of these are moved to where edges say most.
    """
    every = Edges.of(close, rng)
    few = Edges.of(close.taken(np.arange(0, len(close), TUNING.edge_share)), rng)
    directions = sphere(TUNING.edge_directions)
    said = few.said(directions)
    rough = _scores(said, _spread(said))
    chosen = apart(directions, -rough, TUNING.edge_tried, TUNING.edge_apart)
    spread = _spread(every.said(directions[:: TUNING.edge_every]))

    def losses(near: F64) -> F64:
        return -_scores(every.said(near), spread)

    ways, least, fine = directions[chosen], losses(directions[chosen]), sphere(TUNING.edge_fine)
    for k in np.argsort(least, kind="stable")[: TUNING.edge_refined]:
        around = fine[fine @ ways[k] > TUNING.edge_around]  # through bars edges speak for a sun within a degree of it
        start = around[int(np.argmax(_scores(few.said(around), spread)))]
        if float(losses(start[None])[0]) < least[k]:
            ways[k] = start
        ways[k], least[k] = refined(losses, ways[k], TUNING.edge_steps, 3)
    kept = apart(ways, least, len(ways), TUNING.edge_apart)
    return Spoken(ways[kept], -least[kept], every, spread)


def _spread(said: F64) -> F64:
    """(B,) standard deviations of what bands say for directions (D, B)."""
    known = said[~np.isnan(said).any(axis=1)]
    spread = known.std(axis=0) if len(known) > 1 else np.zeros(said.shape[1])
    return np.where(spread > 0, spread, np.inf)


def _scores(said: F64, spread: F64) -> F64:
    """(D,) of what bands say (D, B) in their spreads (B,); never the best where it is not known."""
    return np.asarray(np.nan_to_num((said / spread).sum(axis=1), nan=-np.inf))

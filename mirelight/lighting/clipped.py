"""Colours of what was captured brighter than white, guessed from what was not.

A channel that ends at white says only how bright a surface is at least. What its others say is exact, and mostly more
of the same surface lies near by in less light. So each patch of a mesh takes the mean of the patches around that could
be the same surface by all that it shows: whose colour agrees with its whole channels, and is not below what the clipped
ones show at least.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mirelight.lighting.albedo_inpainting import add_rows
from mirelight.model import F32, F64
from mirelight.model.profiles import BRIGHTEST

NEAREST = 256  # patches that are asked
ALIKE = 0.25  # how far the logarithms of albedos of one surface lie apart
_ASIDE = 4.0  # what a distance off the surface counts, against one along it: a table is not the floor that it stands on
_WHOLE = 0.1  # share of a channel that is not clipped from which it is known half
_STRANGER = 0.01  # what the least that a patch shows counts, against others that are the same
_NEARER = 4  # half the power of the distance by which those count less: what else is near agrees too where all is white
_AT_ONCE = 1024  # patches that ask
_DARKEST = 1e-3

Int = NDArray[np.int64]
Bool = NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class Shown:
    """What N places of a mesh show, of which some lie in light that brings white to display white."""

    patch: Int  # (N, 3) which of P patches the corners of their faces lie in
    corners: F32  # (N, 3) barycentric weights of those
    weight: F64  # (N,)
    color: F64  # (N, 3) linear
    light: F64  # (N, 3) irradiance
    over: Bool  # (N,) in such light
    clipped: Bool  # (N, 3) channels that end at white there

    def sums(self, values: F64, count: int) -> F64:
        """(count, C) weighted sums over patches of values (N, C)."""
        out = np.zeros((count, values.shape[1]))
        for k in range(3):
            add_rows(out, self.patch[:, k], values * (self.weight * self.corners[:, k])[:, None])
        return out


@dataclass(frozen=True, slots=True, eq=False)
class _Evidence:
    """What P patches tell of their albedo, three channels each."""

    told: F64  # by places in less light
    known: Bool  # (P,) that there are such
    least: F64  # what those in light as bright show
    likely: F64  # what those are then, if colours lie as far apart as those of one surface
    exact: F64  # what the whole ones among those show
    share: F64  # of the light, that falls on those
    asking: Bool  # (P,) that there are such
    pure: F64  # (P,) share of the light that falls on places in less

    @staticmethod
    def of(shown: Shown, count: int) -> _Evidence:
        """What is shown of each of `count` patches of the surface."""
        over, log = shown.over[:, None], np.log(np.maximum(np.pi * shown.color, 1e-9) / np.maximum(shown.light, 1e-9))
        values = [shown.color * ~over, shown.light * ~over, shown.color * over, shown.light * over]
        whole = over & ~shown.clipped
        values += [shown.color * whole, shown.light * whole, shown.light * over * (log + ALIKE * shown.clipped)]
        sums = shown.sums(np.concatenate(values, axis=1), count)
        told, lit, least, light, exact, exact_light, logs = np.split(sums, 7, axis=1)

        def albedo(x: F64) -> F64:
            return np.asarray(np.clip(x, _DARKEST, BRIGHTEST))

        share = exact_light / np.maximum(light, 1e-300)
        return _Evidence(
            told=albedo(np.pi * told / np.maximum(lit, 1e-300)),
            known=lit.min(axis=1) > 0,
            least=albedo(np.pi * least / np.maximum(light, 1e-300)),
            likely=albedo(np.exp(logs / np.maximum(light, 1e-300))),
            exact=albedo(np.pi * exact / np.maximum(exact_light, 1e-300)),
            share=share,
            asking=light.min(axis=1) > 0,
            pure=lit.sum(axis=1) / np.maximum((lit + light).sum(axis=1), 1e-300),
        )

    def likeness(self, of: Int, to: Int) -> F64:
        """(A, K) how like patches (A,) that ask are to those (A, K) that tell: 1, the same."""
        share, theirs = self.share[of], np.log(self.told[to])
        whole = (share / (share + _WHOLE))[:, None]
        off = theirs - np.log(self.likely[of])[:, None]
        short = np.maximum(np.log(self.least[of])[:, None] - theirs, 0)
        return np.asarray(np.exp(-(whole * off**2 + (1 - whole) * short**2).sum(axis=2) / (2 * ALIKE**2)))


def hidden(shown: Shown, places: F64, ways: Int, spacing: float) -> F64:
    """(P, 3) albedo of what is clipped in each patch, so that with what is not the mean is that of patches alike.

    Args:
        shown: by places.
        places: (P, 3) of the patches, world units.
        ways: (P,) 0 to 5, which way they look: only those that look the same way are asked.
        spacing: between patches, world units.
    """
    evidence = _Evidence.of(shown, len(places))
    mean = np.where(evidence.asking[:, None], evidence.least, 0.0)
    for way in range(6):
        there, asked = np.flatnonzero(evidence.known & (ways == way)), np.flatnonzero(evidence.asking & (ways == way))
        if len(there) and len(asked):
            stretch = np.where(np.arange(3) == way // 2, _ASIDE, 1.0)
            mean[asked] = _of_alike(evidence, places * stretch, there, asked, spacing)
    share = np.minimum(evidence.share, 0.99)
    rest = (mean - share * evidence.exact) / (1 - share)
    return np.asarray(np.clip(np.where(share > 0, rest, mean), mean, mean * (1 + ALIKE)))


def _of_alike(evidence: _Evidence, places: F64, there: Int, asked: Int, spacing: float) -> F64:
    """(A, 3) albedo of patches (A,), no less than what they show, by those (K,) that tell."""
    from scipy.spatial import cKDTree

    tree, ranks = cKDTree(places[there]), np.arange(min(NEAREST, len(there))) + 1
    out = evidence.least[asked]
    for first in range(0, len(asked), _AT_ONCE):
        rows = asked[first : first + _AT_ONCE]
        away, near = tree.query(places[rows], k=ranks, workers=-1)
        near = there[near]
        like = evidence.likeness(rows, near) * evidence.pure[near]
        trust = like / (1 + (away / np.maximum(away[:, :1], spacing)) ** 2) ** _NEARER
        mean = np.einsum("ak,akc->ac", trust, evidence.told[near]) / np.maximum(trust.sum(axis=1), 1e-300)[:, None]
        belief, least = like.max(axis=1)[:, None], evidence.least[rows]
        out[first : first + _AT_ONCE] = np.maximum(least, (belief * mean + _STRANGER * least) / (belief + _STRANGER))
    return out

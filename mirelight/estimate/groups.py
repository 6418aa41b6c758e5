"""Places taken together with those beside them, so that a proxy's unevenness does not pass for light and shadow.

Of neighbours in one plane the colours and all that light is a sum of are averaged alike, so what holds for one place
holds for their mean. What is wrong at single places, a dent of the proxy or few rays, is wrong there by less: errors
in how much of the sky places see make the sky come out too dark.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from mirelight.estimate.transport import Places
from mirelight.model import F64

Bool: TypeAlias = NDArray[np.bool_]

TOGETHER = 4  # places, each counted as one of its own group
_LOOKED_AT = 40  # nearest places, of which those in the plane count
_JUDGES = 10  # of these, the nearest: what a place sees is compared with the middle of what they see
_FEWEST_JUDGES = 4
_FACING = 0.9  # least cosine between both planes
_OFF = 0.1  # of the distance: how far off the plane
_UNLIKE = 1.25  # factor between the light of an even sky at a place and around it
_ALBEDO = 0.35  # by which that sky is as bright as the colours ask for
_GUESSED = 0.3  # share of the surfaces that a place faces, beyond which too few are shown by splats
_LEAST = 0.5  # share of the places that must be left: in a room seen from inside most of what places face is guessed


@dataclass(frozen=True, slots=True, eq=False)
class Groups:
    """Rows of places that are averaged, for each of N places."""

    near: NDArray[np.int64]  # (N, K)
    weight: F64  # (N, K), of sum 1
    sound: Bool  # (N,) places that light is fitted to

    def mean(self, values: F64) -> F64:
        """(N, C) means over groups of values (N, C)."""
        return np.asarray(np.einsum("nk,nkc->nc", self.weight, values[self.near]))


def groups(places: Places, firm: Bool, sunlit: Bool) -> Groups:
    """Each place with others in its plane.

    Args:
        places: of the proxy.
        firm: (N,) those that may be averaged.
        sunlit: (N,) in the sun, where what they face is little of their light, and may be guessed.

    Returns:
        `sound` are those that are firm and see about as much as others in their plane; all firm ones if those are few.
    """
    from scipy.spatial import cKDTree

    count = min(_LOOKED_AT, len(places))
    distance, near = cKDTree(places.points).query(places.points, k=[*range(1, count + 1)], workers=-1)
    away = places.points[near] - places.points[:, None]
    extent = float(np.median(np.linalg.norm(places.spread, axis=2).max(axis=1)))
    off = np.abs(np.einsum("nkj,nj->nk", away, places.normals))
    beside = np.einsum("nkj,nj->nk", places.normals[near], places.normals) > _FACING
    beside &= off < np.maximum(_OFF * distance, extent)
    sound = firm & _alike(places, near, beside) & (sunlit | (places.guessed < _GUESSED))
    if sound.sum() < _LEAST * firm.sum():
        sound = firm
    taken = beside & sound[near]
    taken[:, 0] = True  # itself
    taken &= np.cumsum(taken, axis=1) <= TOGETHER
    return Groups(near=near, weight=taken / taken.sum(axis=1, keepdims=True), sound=sound)


def _alike(places: Places, near: NDArray[np.int64], beside: Bool) -> Bool:
    """(N,) whether under an even sky a place has about the light of the nearest `beside` it; False if these are few, as
    on leaves and wires, where a splat's place and what it sees are least sure."""
    level = np.median(places.color) / _ALBEDO
    light = np.log(np.maximum(places.open.sum(axis=1) * level + places.met.mean(axis=1), 1e-12))
    judges = beside & (np.cumsum(beside, axis=1) <= _JUDGES)
    enough = judges.sum(axis=1) >= _FEWEST_JUDGES
    out = np.zeros(len(places), bool)
    middle = np.nanmedian(np.where(judges[enough], light[near[enough]], np.nan), axis=1)
    out[enough] = np.abs(light[enough] - middle) < np.log(_UNLIKE)
    return out

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
from mirelight.estimate.tuning import TUNING
from mirelight.model import F64

Bool: TypeAlias = NDArray[np.bool_]


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

    count = min(TUNING.group_looked_at, len(places))
    distance, near = cKDTree(places.points).query(places.points, k=[*range(1, count + 1)], workers=-1)
    away = places.points[near] - places.points[:, None]
    extent = float(np.median(np.linalg.norm(places.spread, axis=2).max(axis=1)))
    off = np.abs(np.einsum("nkj,nj->nk", away, places.normals))
    beside = np.einsum("nkj,nj->nk", places.normals[near], places.normals) > TUNING.group_facing
    beside &= off < np.maximum(TUNING.group_off * distance, extent)
    sound = firm & _alike(places, near, beside) & (sunlit | (places.guessed < TUNING.group_guessed))
    if sound.sum() < TUNING.group_least * firm.sum():
        sound = firm
    taken = beside & sound[near]
    taken[:, 0] = True  # itself
    taken &= np.cumsum(taken, axis=1) <= TUNING.group_together
    return Groups(near=near, weight=taken / taken.sum(axis=1, keepdims=True), sound=sound)


def _alike(places: Places, near: NDArray[np.int64], beside: Bool) -> Bool:
    """(N,) whether under an even sky a place has about the light of the nearest `beside` it; False if these are few, as
    on leaves and wires, where a splat's place and what it sees are least sure."""
    level = np.median(places.color) / TUNING.group_albedo
    light = np.log(np.maximum(places.open.sum(axis=1) * level + places.met.mean(axis=1), 1e-12))
    judges = beside & (np.cumsum(beside, axis=1) <= TUNING.group_judges)
    enough = judges.sum(axis=1) >= TUNING.group_fewest_judges
    out = np.zeros(len(places), bool)
    middle = np.nanmedian(np.where(judges[enough], light[near[enough]], np.nan), axis=1)
    out[enough] = np.abs(light[enough] - middle) < np.log(TUNING.group_unlike)
    return out

"""Which side of each disc of a capture was seen: the one that faces the places where a camera can have been.

A disc does not say. Light does not care, but what is found from light does: the walls of a room are lit by the sun from
outside, and their colours are not.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from mirelight.lighting.sight import Sight
from mirelight.model import F64
from mirelight.proxy.capture import Capture
from mirelight.proxy.inside import places
from mirelight.proxy.tuning import TUNING
from mirelight.proxy.types import Int
from mirelight.proxy.views import lattice

Seen: TypeAlias = NDArray[np.int8]
Look: TypeAlias = Callable[[F64, Int], Seen]


def seen_sides(capture: Capture, at: F64, normals: F64, sight: Sight) -> F64:
    """(N,) 1 where a disc was seen from the side that its normal points to, else -1.

    Places around the capture and inside it are tried. From each as a start, more places are taken that see further
    discs and agree about those seen already; so all lie in one space that is not cut by surfaces. The start whose
    places see the most discs is right: of a room those inside see the furniture, of a thing those around see all.
    Discs that none of these places sees side with their neighbours.

    Args:
        capture: where to look from.
        at: (N, 3) middles of discs, in the capture's space.
        normals: (N, 3) unit, of either sign.
        sight: into the mesh of all discs.
    """

    def look(eye: F64, rows: Int) -> Seen:
        step = at[rows] - eye
        far = np.linalg.norm(step, axis=1)
        way = step / np.maximum(far, 1e-30)[:, None]
        cosine = -np.einsum("nk,nk->n", way, normals[rows])
        out = np.zeros(len(rows), np.int8)
        there = np.flatnonzero(np.abs(cosine) > TUNING.side_edge_on)
        _, distance = sight.first_hits(eye, way[there])
        clear = distance > far[there] - capture.spacing
        out[there[clear]] = np.sign(cosine[there[clear]])
        return out

    eyes = np.concatenate(
        [TUNING.side_away * capture.radius * lattice(TUNING.side_around), places(capture, TUNING.side_inside)]
    )
    some = np.arange(0, len(at), max(len(at) // TUNING.side_sample, 1))
    chosen = _chosen(np.stack([look(eye, some) for eye in eyes]))
    every = np.arange(len(at))
    votes = np.stack([look(eyes[k], every) for k in chosen]).sum(axis=0, dtype=np.float64)
    return _with_neighbours(at, normals, votes)


def _chosen(seen: Seen) -> list[int]:
    """Places (P, S), the side of each disc that they see or 0: those of one space that see the most discs."""
    best: list[int] = []
    most = 0.0
    for start in range(len(seen)):
        found, votes = _grown(seen, start)
        share = float((votes != 0).mean())
        if share > (most if start < TUNING.side_around else most / TUNING.side_outside_first):
            best, most = found, share
    return best


def _grown(seen: Seen, start: int) -> tuple[list[int], NDArray[np.int64]]:
    """A start and the places that agree with it, and (S,) how often discs are seen from either side."""
    chosen, votes = [start], seen[start].astype(np.int64)
    while True:
        side = np.sign(votes)
        agree, against = ((seen * side == sign).sum(axis=1) for sign in (1, -1))
        new = ((seen != 0) & (side == 0)).sum(axis=1)
        fits = (
            (against <= TUNING.side_conflict * (agree + against))
            & (agree > 0)
            & (new - against >= TUNING.side_least_new * seen.shape[1])
        )
        fits[chosen] = False
        if not fits.any():
            return chosen, votes
        k = int(np.argmax(np.where(fits, new - against, -1)))
        chosen.append(k)
        votes = votes + seen[k]


def _with_neighbours(at: F64, normals: F64, votes: F64) -> F64:
    """(N,) signs of votes; where there is none that of the nearest discs with one, each as its normal agrees."""
    from scipy.spatial import cKDTree

    out, known = np.sign(votes), np.flatnonzero(votes)
    rest = np.flatnonzero(votes == 0)
    if len(rest) and len(known):
        _, near = cKDTree(at[known]).query(at[rest], k=min(TUNING.side_nearest, len(known)), workers=-1)
        near = known[np.reshape(near, (len(rest), -1))]
        out[rest] = np.sign((np.einsum("rki,ri->rk", normals[near], normals[rest]) * out[near]).sum(axis=1))
    return np.asarray(np.where(out == 0, 1.0, out))

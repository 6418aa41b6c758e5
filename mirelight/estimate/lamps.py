"""Lamps between the surfaces: places from which light, less with the square of the distance, explains what is left."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from mirelight.base.colour import REC709_LUMINANCE
from mirelight.estimate.sun import Search
from mirelight.estimate.transport import Places
from mirelight.estimate.tuning import TUNING
from mirelight.model import F64

_AXES = np.concatenate([np.eye(3), -np.eye(3)])


@dataclass(frozen=True, slots=True, eq=False)
class Lamp:
    """A point that sends light to all sides."""

    position: F64  # (3,) world units
    loss: float  # of the search that found it


def lit(places: Places, positions: F64) -> F64:
    """(D, N) irradiance / pi at places by lamps of pi candela at positions (D, 3): the cosine over the square of the
    distance where nothing stands between."""
    away = positions[:, None] - places.points
    squared = np.maximum((away * away).sum(axis=2), (TUNING.lamp_nearest * extent_of(places)) ** 2)
    cosine = np.einsum("dnk,nk->dn", away, places.normals) / np.sqrt(squared)
    d, n = np.nonzero(cosine > 1e-3)
    out = np.zeros_like(cosine)
    _, reach = places.sight.first_hits(places.points[n], away[d, n])
    out[d, n] = np.where(reach >= 1, cosine[d, n] / squared[d, n], 0.0)
    return np.asarray(out)


def extent_of(places: Places) -> float:
    """World units: the diagonal of the box that holds the places."""
    return float(np.linalg.norm(np.ptp(places.points, axis=0)))


def search(of: Search, rng: np.random.Generator) -> Lamp | None:
    """The best place for one more lamp, where `of.sky` is the light that there is already; None where there is none."""
    places = of.places
    positions = _between(places, rng)
    if not len(positions):
        return None
    columns = lit(places, positions)
    promise = of.promise(columns)
    tried = np.argsort(-promise, kind="stable")[: TUNING.lamp_tried]
    losses = np.array([of.rough(columns[k]) for k in tried])
    found = [_refined(of, positions[tried[k]]) for k in _apart(places, positions[tried], losses)]
    return min(found, key=lambda lamp: lamp.loss)


def _between(places: Places, rng: np.random.Generator) -> F64:
    """(D, 3) points in the open, along rays from places to the surface that they face: half from anywhere, half close
    to the brightest places, which lamps are near to: within their shades light comes from hardly anywhere else."""
    bright = places.color.min(axis=1)
    brightest = np.argsort(-bright, kind="stable")[: max(round(TUNING.lamp_bright * len(places)), 1)]
    half = TUNING.lamp_candidates // 2
    rows = np.concatenate([rng.integers(0, len(places), half), brightest[rng.integers(0, len(brightest), half)]])
    way = rng.standard_normal((2 * half, 3))
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    way *= np.sign(np.einsum("nk,nk->n", way, places.normals[rows]))[:, None]
    _, clear = places.sight.first_hits(places.points[rows], way)
    size = extent_of(places)
    far = np.minimum(clear, 0.5 * size) * rng.uniform(0.1, 0.9, 2 * half)
    close = np.minimum(
        0.9 * clear, size * np.exp(rng.uniform(np.log(TUNING.lamp_close[0]), np.log(TUNING.lamp_close[1]), 2 * half))
    )
    distance = np.where(np.arange(2 * half) < half, far, close)
    return np.asarray(places.points[rows] + way * distance[:, None])


def _apart(places: Places, positions: F64, losses: F64) -> list[int]:
    out: list[int] = []
    least = TUNING.lamp_apart * extent_of(places)
    for k in np.argsort(losses, kind="stable"):
        if all(np.linalg.norm(positions[k] - positions[j]) > least for j in out):
            out.append(int(k))
        if len(out) == TUNING.lamp_refined:
            break
    return out


def _refined(of: Search, position: F64) -> Lamp:
    """Steps to the better of six neighbours, ever smaller."""
    loss = float(of.losses(lit(of.places, position[None])[0]).min())
    size = extent_of(of.places)
    for step in TUNING.lamp_steps:
        for _ in range(6):
            near = position + step * size * _AXES
            found = np.array([of.losses(column).min() for column in lit(of.places, near)])
            if found.min() >= loss:
                break
            position, loss = near[int(found.argmin())], float(found.min())
    return Lamp(position, loss)


def over(search: Search, light: F64) -> Search:
    """A search for what is to be added to light (N, 3): irradiance / pi that comes straight from its sources."""
    return replace(search, sky=light @ REC709_LUMINANCE.astype(np.float64))

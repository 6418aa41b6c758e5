"""The sky in patches: what the captured light is a sum of, beside the sun."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from mirelight.base import conventions
from mirelight.estimate.tuning import TUNING
from mirelight.model import F32, F64

Int: TypeAlias = NDArray[np.int64]

# Rings from the zenith to the nadir, 22.5 degrees high but for the ground's: patches in each. Narrow where they light
# walls, one where it is all the same.
RINGS = (1, 6, 8, 12, 8, 1)
_HEIGHTS = (22.5, 22.5, 22.5, 22.5, 22.5, 67.5)  # degrees
PATCHES = sum(RINGS)
# The glow around the sun: its peak, its fall per radian, and the share of light scattered forwards. Of sky 6 of
# CIE S 011, "partly cloudy, slight brightening towards the sun", its mildest: places hardly tell how strong it is.
GLOW = (2.0, -1.5, 0.15)
ROWS = 48  # of the map: rings and patches end where its pixels end
_EDGES = np.concatenate([[0.0], np.cumsum(_HEIGHTS)])  # degrees from the zenith
ABOVE = int((_EDGES[1:] <= 90).sum())  # rings above the horizon
_FIRST = np.concatenate([[0], np.cumsum(RINGS)])
RING_OF = np.repeat(np.arange(len(RINGS)), RINGS)  # (PATCHES,)


def patch_of(directions: F64) -> Int:
    """(...,) patch that each unit direction (..., 3) points into; conventions.py says where the azimuth starts."""
    theta = np.degrees(np.arccos(np.clip(directions[..., 1], -1, 1)))
    ring = np.clip(np.searchsorted(_EDGES, theta, side="right") - 1, 0, len(RINGS) - 1)
    u = (np.arctan2(directions[..., 2], directions[..., 0]) / (2 * np.pi) + 0.5) % 1.0
    count = np.asarray(RINGS)[ring]
    return np.asarray(_FIRST[ring] + np.minimum((u * count).astype(np.int64), count - 1), dtype=np.int64)


def as_map(radiance: F64, to_sun: F64 | None = None) -> F32:
    """(48, 96, 3) equirectangular map of radiances (PATCHES, 3); with a glow within patches around unit `to_sun`."""
    directions, _ = _pixels()
    patches = patch_of(directions)
    if to_sun is None:
        return np.asarray(radiance[patches], dtype=np.float32)
    plain = radiance / glow(to_sun)[:, None]
    return np.asarray(plain[patches] * _indicatrix(directions, to_sun)[..., None], dtype=np.float32)


def glow(to_sun: F64) -> F64:
    """(PATCHES,) by how much each patch is brighter than far from the sun, in the mean over it."""
    directions, area = _pixels()
    patches = patch_of(directions).ravel()
    shone = np.bincount(patches, (area * _indicatrix(directions, to_sun)).ravel(), PATCHES)
    return np.asarray(shone / np.bincount(patches, area.ravel(), PATCHES))


def ground_under(to_sun: F64 | None, shape: F64, beams: int) -> F64:
    """(PATCHES + beams,) the most that ground outside may reflect of each source at strength 1: all that comes down to
    it from the sky, and `TUNING.fit_ground_sun` times what comes from the sun.

    Args:
        to_sun: (3,) unit, of the first beam; None: there is no sun. Other beams are lamps of the captured place.
        shape: (PATCHES,) by how much each patch is brighter than its strength; the radiance is in that of the ground's.
        beams: how many.
    """
    directions, area = _pixels()
    cosine = np.maximum(directions[..., 1], 0) * area
    out = np.zeros(PATCHES + beams)
    out[:PATCHES] = shape * np.bincount(patch_of(directions).ravel(), cosine.ravel(), PATCHES) / cosine.sum()
    if to_sun is not None:
        out[PATCHES] = TUNING.fit_ground_sun * max(float(to_sun[1]), 0.0)
    return np.asarray(out / shape[-1])


def _indicatrix(directions: F64, to_sun: F64) -> F64:
    """(...,) radiance of the sky at unit directions (..., 3) over that at 90 degrees from the sun (CIE S 011, where it
    is 1 at 90 degrees, too); 1 below the horizon, whose light is the ground's."""
    peak, fall, forward = GLOW
    angle = np.arccos(np.clip(directions @ to_sun, -1, 1))
    shape = 1 + peak * (np.exp(fall * angle) - np.exp(fall * np.pi / 2)) + forward * np.cos(angle) ** 2
    return np.where(directions[..., 1] > 0, shape, 1.0)


def _pixels() -> tuple[F64, F64]:
    """(48, 96, 3) unit directions of the map's pixels, (48, 96) their areas, up to a factor."""
    area = np.sin(np.pi * ((np.arange(ROWS) + 0.5) / ROWS))
    return conventions.map_pixels(ROWS), np.broadcast_to(area[:, None], (ROWS, 2 * ROWS))


def sphere(count: int) -> F64:
    """(count, 3) unit directions, evenly spread (a spiral of the golden angle)."""
    y = 1 - (2 * np.arange(count) + 1) / count
    phi = np.arange(count) * np.pi * (3 - np.sqrt(5.0))
    s = np.sqrt(1 - y * y)
    return np.stack([s * np.cos(phi), y, s * np.sin(phi)], axis=-1)


def ring(way: F64, degrees: float) -> F64:
    """(8, 3) directions around one (3,), that far from it."""
    turn, s = np.arange(8) * np.pi / 4, np.sin(np.radians(degrees))
    local = np.stack([s * np.cos(turn), s * np.sin(turn), np.full(8, np.cos(np.radians(degrees)))], axis=-1)
    return np.asarray(np.einsum("dk,kj->dj", local, conventions.frame_around(way)))


def apart(directions: F64, losses: F64, most: int, cosine: float) -> Int:
    """Rows of at most so many of the best directions (D, 3), by their losses (D,), none as near to another as by that
    cosine; those of infinite loss are none."""
    out: list[int] = []
    for k in np.argsort(losses, kind="stable"):
        if len(out) == most or not np.isfinite(losses[k]):
            break
        if all(directions[k] @ directions[j] < cosine for j in out):
            out.append(int(k))
    return np.array(out, np.int64)


def refined(losses: Callable[[F64], F64], way: F64, steps: Sequence[float], most: int) -> tuple[F64, float]:
    """A direction (3,) in steps, in degrees, to the best of eight neighbours, each size `most` times at most; and its
    loss. `losses` gives (D,) of directions (D, 3)."""
    least = float(losses(way[None])[0])
    for step in steps:
        for _ in range(most):
            near = ring(way, step)
            found = losses(near)
            if found.min() >= least:
                break
            way, least = near[int(found.argmin())], float(found.min())
    return way, least

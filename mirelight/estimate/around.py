"""A place's colour as the mean of what is shown around it, so that single splats' errors do not pass for other albedos.

What a capture's splats show differs from one to the next, by texture and by how they were fitted, by more than most
light does. Logarithms of single splats' colours are compared, and such noise makes the light come out wrong.
"""

from __future__ import annotations

import numpy as np

from mirelight.estimate.tuning import TUNING
from mirelight.lighting.observed import Samples
from mirelight.model import F64


def evened(samples: Samples, color: F64, points: F64, normals: F64, spread: F64) -> F64:
    """(N, 3) linear colours of places, each the mean over those of the nearest samples that lie in its plane.

    Args:
        samples: of the capture.
        color: (N, 3) linear, the places' own: what stands where no such sample is near.
        points, normals: (N, 3) of the places.
        spread: (N, 2, 3) world units, of the places; the middle one of all is what distances are measured by.
    """
    from scipy.spatial import cKDTree

    extent = float(np.median(np.linalg.norm(spread, axis=2).max(axis=1)))
    count = min(TUNING.around_nearest, len(samples.points))
    _, near = cKDTree(samples.points).query(points, k=[*range(1, count + 1)], workers=-1)
    away = samples.points[near] - points[:, None]
    counted = np.abs(np.einsum("nkj,nj->nk", samples.planes[near], normals)) > TUNING.around_facing
    counted &= np.abs(np.einsum("nkj,nj->nk", away, normals)) <= TUNING.around_off * extent
    squared = (away * away).sum(axis=2) / max(TUNING.around_reach * extent, 1e-30) ** 2
    counted &= squared <= 1
    weight = counted * samples.weight[near] * np.exp(-0.5 * squared)
    whole = weight.sum(axis=1)
    mean = np.einsum("nk,nkj->nj", weight, samples.color[near]) / np.maximum(whole, 1e-30)[:, None]
    return np.where((whole > 1e-3)[:, None], mean, color)

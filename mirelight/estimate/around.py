"""A place's colour as the mean of the splats around it, so that single splats' errors do not pass for other albedos.

What a capture's splats show differs from one to the next, by texture and by how they were fitted, by more than most
light does. Logarithms of single splats' colours are compared, and such noise makes the light come out wrong.
"""

from __future__ import annotations

import numpy as np

from mirelight.base import colour, conventions, sh
from mirelight.model import F64, SplatCloud

NEAREST = 12  # splats that are looked at for each place
MOST = 1 << 18  # splats among which these are looked for, evenly taken where there are more
_REACH = 3.0  # of a splat's extent: the distance within which others count; as far as shadow edges are left out
_OFF = 0.5  # of a splat's extent: how far off the place's plane one may lie
_FACING = 0.95  # least cosine between both planes


def evened(splats: SplatCloud, color: F64, points: F64, normals: F64, spread: F64) -> F64:
    """(N, 3) linear colours of places, each the mean over those of the nearest splats that lie in its plane.

    Args:
        splats: world space.
        color: (N, 3) linear, the places' own: what stands where no such splat is near.
        points, normals: (N, 3) of the places.
        spread: (N, 2, 3) world units, of their splats; the middle one of all is what distances are measured by.
    """
    from scipy.spatial import cKDTree

    extent = float(np.median(np.linalg.norm(spread, axis=2).max(axis=1)))
    step = max(-(-len(splats) // MOST), 1)
    means, scales = (x[::step].astype(np.float64) for x in (splats.means, splats.scales))
    count = min(NEAREST, len(means))
    _, near = cKDTree(means).query(points, k=[*range(1, count + 1)], workers=-1)
    away = means[near] - points[:, None]
    axes = conventions.rotation_from_quaternion(splats.quats[::step][near.ravel()].astype(np.float64))
    thinnest = np.argsort(scales[near.ravel()], axis=1, kind="stable")[:, :1]
    planes = np.take_along_axis(axes, thinnest[:, None], axis=2)[..., 0].reshape(away.shape)
    counted = np.abs(np.einsum("nkj,nj->nk", planes, normals)) > _FACING
    counted &= np.abs(np.einsum("nkj,nj->nk", away, normals)) <= _OFF * extent
    squared = (away * away).sum(axis=2) / max(_REACH * extent, 1e-30) ** 2
    counted &= squared <= 1
    weight = counted * splats.opacities[::step][near].astype(np.float64) * np.exp(-0.5 * squared)
    display = sh.mean_display(splats.sh[::step][near.ravel()])
    shown = colour.srgb_decode(display).astype(np.float64).reshape(away.shape)
    whole = weight.sum(axis=1)
    mean = np.einsum("nk,nkj->nj", weight, shown) / np.maximum(whole, 1e-30)[:, None]
    return np.where((whole > 1e-3)[:, None], mean, color)

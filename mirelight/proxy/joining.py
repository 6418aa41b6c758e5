"""Fewer splats of the same look: neighbours in a voxel joined into one with their mean and covariance."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mirelight.model import F64, SplatCloud
from mirelight.proxy.axes import axes_of
from mirelight.proxy.types import Int

_TRIES = 12  # voxel sizes tried: a count of halvings alone; three or four as a rule


def joined(splats: SplatCloud, most: int) -> SplatCloud:
    """The cloud with close splats joined, until at most `most` are left.

    Each voxel's splats become one, with the weights opacity times the area of the two longer axes: its mean and its
    covariance are theirs, its opacity is their mean. The voxel is as small as that allows, within a few percent.
    """
    means = splats.means.astype(np.float64)
    group = _voxels(means, most)
    axes, scales = axes_of(splats)
    weight = splats.opacities.astype(np.float64) * np.maximum(scales[:, 1] * scales[:, 2], 1e-30)
    total = _sums(group, weight)
    mean = np.stack([_sums(group, weight * means[:, k]) for k in range(3)], axis=1) / total[:, None]
    off = means - mean[group]
    covariance = np.empty((len(total), 3, 3))
    for i in range(3):
        for j in range(i, 3):
            own = (axes[:, i] * axes[:, j] * scales**2).sum(axis=1) + off[:, i] * off[:, j]
            covariance[:, i, j] = covariance[:, j, i] = _sums(group, weight * own) / total
    values, vectors = np.linalg.eigh(covariance)
    vectors[:, :, 0] *= np.sign(np.linalg.det(vectors))[:, None]
    sh = np.stack([_sums(group, weight * splats.sh[:, 0, k]) for k in range(3)], axis=1) / total[:, None]
    opacity = _sums(group, weight * splats.opacities) / total
    return replace(
        splats,
        means=mean.astype(np.float32),
        quats=_quaternions(vectors).astype(np.float32),
        scales=np.sqrt(np.maximum(values, 0)).astype(np.float32),
        opacities=opacity.astype(np.float32),
        sh=sh[:, None].astype(np.float32),
    )


def _voxels(points: F64, most: int) -> Int:
    """(N,) which voxel points (N, 3) lie in, of at most so many that hold some.

    Of a surface voxels of half the size hold four times as many: the next size is told by that, as long as it lies
    between those known to be too fine and coarse enough.
    """
    offsets = points - points.min(axis=0)
    extent = float(offsets.max())
    fine, coarse = extent / (1 << 20), 2 * extent
    size = extent / float(np.sqrt(most))
    for _ in range(_TRIES):
        count = len(np.unique(_keys(offsets, size)))
        if count > most:
            fine = size
        else:
            coarse = size
            if count > 0.9 * most:
                break
        size *= float(np.sqrt(count / (0.95 * most)))
        if not fine < size < coarse:
            size = float(np.sqrt(fine * coarse))
    return np.asarray(np.unique(_keys(offsets, coarse), return_inverse=True)[1])


def _keys(points: F64, size: float) -> Int:
    i = np.floor(points / size).astype(np.int64)
    return np.asarray((i[:, 0] << 42) | (i[:, 1] << 21) | i[:, 2])


def _sums(group: Int, values: NDArray[Any]) -> F64:
    return np.bincount(group, values).astype(np.float64)


def _quaternions(rotations: F64) -> F64:
    """(N, 4) wxyz of rotation matrices (N, 3, 3): the largest of four formulas each (Shepperd)."""
    r = rotations
    trace = r[:, 0, 0] + r[:, 1, 1] + r[:, 2, 2]
    four = np.stack([trace, r[:, 0, 0], r[:, 1, 1], r[:, 2, 2]], axis=1)
    largest = four.argmax(axis=1)
    q = np.empty((len(r), 4))
    w = largest == 0
    q[w] = np.stack([1 + trace[w], r[w, 2, 1] - r[w, 1, 2], r[w, 0, 2] - r[w, 2, 0], r[w, 1, 0] - r[w, 0, 1]], axis=1)
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        of = largest == i + 1
        m = r[of]
        q[of, 0], q[of, 1 + i] = m[:, k, j] - m[:, j, k], 1 + m[:, i, i] - m[:, j, j] - m[:, k, k]
        q[of, 1 + j], q[of, 1 + k] = m[:, j, i] + m[:, i, j], m[:, k, i] + m[:, i, k]
    return np.asarray(q / np.linalg.norm(q, axis=1, keepdims=True))

"""Moving splats and putting clouds together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mirelight.base import sh
from mirelight.base.conventions import multiply_quaternions, quaternion_from_rotation
from mirelight.base.errors import InputError
from mirelight.model import F32, SplatCloud

_ROWS = 1 << 18  # splats moved at a time, so that float64 copies stay small


def transform(cloud: SplatCloud, matrix: ArrayLike) -> SplatCloud:
    """The cloud moved by a similarity: rotated (with its spherical harmonics), scaled evenly, translated.

    Args:
        cloud: the splats; unchanged, and shared where the matrix leaves a part as it is.
        matrix: (4, 4) world_from_cloud.

    Raises:
        ValueError: the matrix shears, mirrors, scales unevenly or to nothing, projects, or is not finite.
    """
    m = np.asarray(matrix, dtype=np.float64)
    scale, rotation = _similarity(m)
    turned = not np.allclose(rotation, np.eye(3), atol=1e-9)
    return replace(
        cloud,
        means=_moved(cloud.means, m),
        quats=_turned(cloud.quats, quaternion_from_rotation(rotation)) if turned else cloud.quats,
        scales=cloud.scales * np.float32(scale) if abs(scale - 1) > 1e-9 else cloud.scales,
        sh=sh.rotate(cloud.sh, rotation) if turned and cloud.sh_degree else cloud.sh,
    )


def merge(clouds: Sequence[SplatCloud]) -> SplatCloud:
    """All splats in one cloud, in the order given; lower SH degrees are padded with zeros to the highest.

    Raises:
        ValueError: no clouds.
        InputError: only some are `antialiased`, or in another colour space: both hold for a whole composite.
    """
    if not clouds:
        raise ValueError("no splat clouds to merge")
    if len(clouds) == 1:
        return clouds[0]
    if len({cloud.antialiased for cloud in clouds}) > 1:
        found = "some were trained with antialiasing and some without, which no single composite can show"
        raise InputError("splats", found, "leave one kind out, or mark the files alike")
    if len({cloud.color_space for cloud in clouds}) > 1:
        found = "some blend in linear light and some display-encoded, which no single composite can show"
        raise InputError("splats", found, "leave one kind out, or train them alike")
    coefficients = max(cloud.sh.shape[1] for cloud in clouds)
    sh_all = np.zeros((sum(len(cloud) for cloud in clouds), coefficients, 3), dtype=np.float32)
    start = 0
    for cloud in clouds:
        sh_all[start : start + len(cloud), : cloud.sh.shape[1]] = cloud.sh
        start += len(cloud)
    return SplatCloud(
        means=np.concatenate([cloud.means for cloud in clouds]),
        quats=np.concatenate([cloud.quats for cloud in clouds]),
        scales=np.concatenate([cloud.scales for cloud in clouds]),
        opacities=np.concatenate([cloud.opacities for cloud in clouds]),
        sh=sh_all,
        dropped=sum(cloud.dropped for cloud in clouds),
        antialiased=clouds[0].antialiased,
        color_space=clouds[0].color_space,
    )


def _similarity(m: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]:
    """Scale and rotation of a (4, 4) similarity."""
    if m.shape != (4, 4) or not np.all(np.isfinite(m)):
        raise ValueError("a splat transform must be a 4 x 4 matrix of finite numbers")
    if not np.allclose(m[3], (0, 0, 0, 1), atol=1e-6):
        raise ValueError("a splat transform must end in the row 0 0 0 1")
    linear = m[:3, :3]
    lengths = np.linalg.norm(linear, axis=0)
    scale = float(lengths.mean())
    if not scale > 0:
        raise ValueError("a splat transform must not scale to nothing")
    if not np.allclose(lengths, scale, rtol=1e-4):
        shown = ", ".join(f"{x:.6g}" for x in lengths)
        raise ValueError(f"splats can only be scaled evenly, this transform scales by {shown}")
    rotation = linear / scale
    if not np.allclose(rotation.T @ rotation, np.eye(3), atol=1e-4):
        raise ValueError("splats cannot be sheared; use rotation, even scale and translation")
    if np.linalg.det(rotation) < 0:
        raise ValueError("splats cannot be mirrored (negative scale); use a rotation")
    u, _, vt = np.linalg.svd(rotation)  # the nearest exact rotation
    return scale, np.asarray(u @ vt, dtype=np.float64)


def _moved(means: F32, m: NDArray[np.float64]) -> F32:
    out = np.empty_like(means)
    for first in range(0, len(means), _ROWS):
        rows = slice(first, first + _ROWS)
        out[rows] = means[rows].astype(np.float64) @ m[:3, :3].T + m[:3, 3]
    return out


def _turned(quats: F32, rotation: NDArray[np.float64]) -> F32:
    out = np.empty_like(quats)
    for first in range(0, len(quats), _ROWS):
        rows = slice(first, first + _ROWS)
        out[rows] = multiply_quaternions(rotation, quats[rows])
    return out

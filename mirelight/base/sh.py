"""Real spherical harmonics as 3D Gaussian splatting uses them: evaluation and rotation, degrees 0 to 3.

Basis and signs follow Kerbl et al. 2023 (INRIA's `sh_utils`): ``Y00 = C0``, ``Y1 = (-C1 y, C1 z, -C1 x)``, ...
A splat's colour is ``0.5 + sum_k sh[k] Y_k(d)``, ``d`` the unit vector from the eye to the splat in the splats' frame.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

_ROWS = 1 << 18  # splats turned at a time, so that products stay small

C0 = 0.28209479177387814  # 1 / (2 sqrt(pi))
C1 = 0.4886025119029199  # sqrt(3 / (4 pi))
C2 = (1.0925484305920792, -1.0925484305920792, 0.31539156525252005, -1.0925484305920792, 0.5462742152960396)
C3 = (
    -0.5900435899266435,
    2.890611442640554,
    -0.4570457994644658,
    0.3731763325901154,
    -0.4570457994644658,
    1.445305721320277,
    -0.5900435899266435,
)
COEFFICIENTS = {0: 1, 1: 4, 2: 9, 3: 16}  # degree -> (degree + 1)^2


def degree_of(coefficients: int) -> int:
    """SH degree of a coefficient count (1, 4, 9 or 16)."""
    for degree, count in COEFFICIENTS.items():
        if count == coefficients:
            return degree
    raise ValueError(f"{coefficients} SH coefficients; expected 1, 4, 9 or 16")


def mean_display(coefficients: NDArray[np.float32]) -> NDArray[np.float32]:
    """(..., 3) display colours, the means over directions, of coefficients (..., K, 3); none is below 0."""
    return np.asarray(np.maximum(0.5 + C0 * coefficients[..., 0, :], 0))


def basis(directions: ArrayLike, degree: int) -> NDArray[np.float64]:
    """Basis values.

    Args:
        directions: (..., 3) unit vectors.
        degree: 0 to 3.

    Returns:
        (..., (degree + 1)^2) float64.
    """
    d = np.asarray(directions, dtype=np.float64)
    return np.stack(terms([d[..., 0], d[..., 1], d[..., 2]], degree), axis=-1)


def terms(direction: Sequence[Any], degree: int) -> list[Any]:
    """The basis as (degree + 1)^2 polynomials of a unit vector [x, y, z], of any kind of arrays (NumPy, Dr.Jit)."""
    x, y, z = direction
    out = [x * 0 + C0]
    if degree >= 1:
        out += [-C1 * y, C1 * z, -C1 * x]
    if degree >= 2:
        xx, yy, zz = x * x, y * y, z * z
        out += [
            C2[0] * x * y,
            C2[1] * y * z,
            C2[2] * (2 * zz - xx - yy),
            C2[3] * x * z,
            C2[4] * (xx - yy),
        ]
    if degree >= 3:
        out += [
            C3[0] * y * (3 * xx - yy),
            C3[1] * x * y * z,
            C3[2] * y * (4 * zz - xx - yy),
            C3[3] * z * (2 * zz - 3 * xx - 3 * yy),
            C3[4] * x * (4 * zz - xx - yy),
            C3[5] * z * (xx - yy),
            C3[6] * x * (xx - 3 * yy),
        ]
    return out


def rotation_matrices(rotation: ArrayLike, degree: int) -> list[NDArray[np.float64]]:
    """Matrices that carry SH coefficients through a rotation, one per band above 0.

    With ``M = rotation_matrices(R, n)``, ``sh_rotated[band l] = M[l-1] @ sh[band l]`` gives the function
    ``f'(d) = f(R^T d)``. Solved by least squares on fixed directions, exact to rounding because every band is
    closed under rotation.

    Args:
        rotation: (3, 3) proper rotation.
        degree: 0 to 3.

    Returns:
        list of (2l+1, 2l+1) float64, l = 1 .. degree.
    """
    r = np.asarray(rotation, dtype=np.float64)
    i = np.arange(64) + 0.5
    polar, turn = np.arccos(1 - 2 * i / 64), np.pi * (1 + 5**0.5) * i  # a Fibonacci sphere
    d = np.stack([np.cos(turn) * np.sin(polar), np.sin(turn) * np.sin(polar), np.cos(polar)], axis=-1)
    here, before = basis(d, degree), basis(d @ r, degree)  # rows of d @ r are R^T d
    out: list[NDArray[np.float64]] = []
    for band in range(1, degree + 1):
        rows = slice(band * band, (band + 1) * (band + 1))
        out.append(np.asarray(np.linalg.lstsq(here[:, rows], before[:, rows], rcond=None)[0], dtype=np.float64))
    return out


def rotate(sh: NDArray[np.float32], rotation: ArrayLike) -> NDArray[np.float32]:
    """Rotate splat SH coefficients (see :func:`rotation_matrices`).

    Args:
        sh: (N, K, 3) float32, K in 1, 4, 9, 16.
        rotation: (3, 3) proper rotation.

    Returns:
        (N, K, 3) float32, a new array.
    """
    out = sh.copy()
    bands = [x.astype(np.float32) for x in rotation_matrices(rotation, degree_of(sh.shape[1]))]
    for first in range(0, len(sh), _ROWS):
        some, turned = sh[first : first + _ROWS], out[first : first + _ROWS]
        for band, matrix in enumerate(bands, start=1):
            rows = slice(band * band, (band + 1) * (band + 1))
            turned[:, rows] = np.einsum("ij,njc->nic", matrix, some[:, rows], optimize=True)
    return out

"""Synthetic splats known in full: the ground truth behind tests/data/splats and the oracle of the format tests."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mirelight.model import SplatCloud

DATA = Path(__file__).parents[3] / "data" / "splats"
C0 = 0.28209479177387814  # written out: the tests must not lean on the code that they check


def cloud(count: int = 300, degree: int = 3, *, antialiased: bool = False) -> SplatCloud:
    """Splats of every orientation in a box off the origin. Weyl sequences, so that every machine makes the same."""
    rest = (degree + 1) ** 2 - 1
    u = _weyl(count, 3 + 3 + 1 + 4 + 3 + 3 * rest)
    quats = np.sqrt(-2 * np.log(u[:, 7:11] + 1e-6)) * np.cos(2 * np.pi * u[:, [8, 9, 10, 7]])
    opacities = 0.02 + 0.96 * u[:, 6]
    opacities[:2] = (1, 1e-8)[:count]
    return SplatCloud(
        means=(np.array([0.5, -1.0, 2.0]) + np.array([4, 2, 3]) * (u[:, :3] - 0.5)).astype(np.float32),
        quats=quats / np.linalg.norm(quats, axis=1, keepdims=True),
        scales=np.exp(-5 + 4 * u[:, 3:6]),
        opacities=opacities.astype(np.float32),
        sh=np.concatenate([(u[:, None, 11:14] - 0.5) / C0, (u[:, 14:] - 0.5).reshape(count, rest, 3)], axis=1),
        antialiased=antialiased,
    )


def inria_rows(splats: SplatCloud) -> tuple[list[str], NDArray[np.float64]]:
    """Property names and float64 rows of an INRIA PLY, written out independently of the package's writer."""
    k = splats.sh.shape[1] - 1
    names = ["x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2"] + [f"f_rest_{i}" for i in range(3 * k)]
    names += ["opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"]
    o = splats.opacities.astype(np.float64)
    with np.errstate(divide="ignore"):
        columns = [*splats.means.T, *np.zeros((3, len(splats))), *splats.sh[:, 0].T]
        columns += [splats.sh[:, 1 + j, c] for c in range(3) for j in range(k)]
        columns += [np.log(o / (1 - o)), *np.log(splats.scales.astype(np.float64)).T, *splats.quats.T]
    return names, np.stack(columns, axis=1).astype(np.float64)


def ply_bytes(
    names: list[str], rows: NDArray[np.float64], kind: str = "float", order: str = "<", extra: str = ""
) -> bytes:
    """A PLY file with one element 'vertex' of one number type."""
    form = {"<": "binary_little_endian", ">": "binary_big_endian"}[order]
    code = {"float": "f4", "double": "f8", "float32": "f4", "float64": "f8"}[kind]
    head = f"ply\nformat {form} 1.0\n{extra}element vertex {len(rows)}\n"
    head += "".join(f"property {kind} {name}\n" for name in names) + "end_header\n"
    return head.encode() + rows.astype(order + code).tobytes()


def nearest(found: SplatCloud, wanted: SplatCloud) -> NDArray[np.intp]:
    """Index into `wanted` for every splat found, by position; each must be hit exactly once."""
    distance = np.linalg.norm(found.means[:, None].astype(np.float64) - wanted.means[None], axis=-1)
    match = np.argmin(distance, axis=1)
    assert sorted(match.tolist()) == list(range(len(wanted)))
    return np.asarray(match)


def rotation_angle(a: NDArray[np.float32], b: NDArray[np.float32]) -> NDArray[np.float64]:
    """Angle in radians between rotations (n, 4) wxyz; a quaternion and its negative are one rotation."""
    dot = np.abs(np.einsum("ij,ij->i", a.astype(np.float64), b.astype(np.float64)))
    return np.asarray(2 * np.arccos(np.clip(dot, 0, 1)))


def _weyl(count: int, columns: int) -> NDArray[np.float64]:
    """(count, columns) numbers in 0..1 from multiples of square roots of primes."""
    primes = [n for n in range(2, 400) if all(n % d for d in range(2, int(n**0.5) + 1))][:columns]
    return np.mod(np.arange(1, count + 1)[:, None] * np.sqrt(np.array(primes, dtype=np.float64)), 1.0)

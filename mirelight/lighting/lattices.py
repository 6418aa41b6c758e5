"""Colours on lattices of points of faces, without texture coordinates (Yuksel, Keyser and House, "Mesh colors", 2010).
NumPy only."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mirelight.model import F32, F64, I32

Int = NDArray[np.int64]


@dataclass(frozen=True, slots=True, eq=False)
class Detail:
    """Colours on lattices of F faces: j * n of their v and i * n of their u, i + j <= n, row after row of i."""

    steps: I32  # (F,) n of each; 0: there is none
    first: I32  # (F,) row of its first colour
    colors: F32  # (N, 3) linear albedo

    def packed(self) -> F32:
        """All of it as one array (1 + F + 3 N,) of floats, for files."""
        both = self.steps.astype(np.int32), self.colors.ravel()
        return np.concatenate([np.array([len(both[0])], np.float32), both[0].astype(np.float32), both[1]])

    @staticmethod
    def unpacked(values: F32) -> Detail:
        """From what `packed` gave, (1 + F + 3 N,)."""
        faces = int(values[0])
        steps = values[1 : 1 + faces].astype(np.int32)
        return Detail(steps, starts(steps), np.ascontiguousarray(values[1 + faces :].reshape(-1, 3)))


def points_of(steps: I32) -> Int:
    """(F,) points of lattices."""
    n = steps.astype(np.int64)
    return np.where(n > 0, (n + 1) * (n + 2) // 2, 0)


def starts(steps: I32) -> I32:
    """(F,) row of the first point of each lattice."""
    ends = np.cumsum(points_of(steps))
    return (ends - points_of(steps)).astype(np.int32)


def lattice(steps: I32) -> tuple[I32, F64]:
    """(N,) face and (N, 3) barycentric weights of the points of all lattices."""
    faces, corners = [], []
    for n in np.unique(steps[steps > 0]):
        j, i = (x.ravel() for x in np.mgrid[: n + 1, : n + 1])
        i, j = i[i + j <= n], j[i + j <= n]
        of = np.flatnonzero(steps == n)
        faces.append(np.repeat(of, len(i)))
        corners.append(np.tile(np.stack([n - i - j, i, j], axis=1) / n, (len(of), 1)))
    if not faces:
        return np.zeros(0, np.int32), np.zeros((0, 3))
    face = np.concatenate(faces)
    order = np.argsort(face, kind="stable")
    return face[order].astype(np.int32), np.concatenate(corners)[order]

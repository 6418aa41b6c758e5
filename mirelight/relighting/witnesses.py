"""Pixels asked about the albedo of others: which of several do they have, so that it is one that is seen around?"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mirelight.model import F32

_AROUND = 0.15  # of the picture's longer side: so far pixels are asked
_ASKED = 64  # pixels
_TURN = np.pi * (3 - np.sqrt(5))  # golden angle: on a spiral by it they lie evenly (Vogel 1979)
_NEARER = 0.3  # of that reach, at which a witness counts half
_ALIKE = 0.25  # how far the logarithms of albedos of one surface lie apart
_AT_DEPTH = 0.15  # how far those of depths do
_SAME_WAY = 8  # power of the cosine between normals

Bool = NDArray[np.bool_]
Int = NDArray[np.intp]


@dataclass(frozen=True, slots=True, eq=False)
class Witnesses:
    """The surface that the pixels of a picture show."""

    normal: F32  # (H, W, 3) unit
    depth: F32  # (H, W) world units

    def ask(self, who: Int, tried: F32, least: Bool, albedo: F32, trust: F32) -> tuple[F32, F32]:
        """What is said of each albedo that N pixels may have.

        Args:
            who: (N,) pixels, row by row.
            tried: (K, 3, N) logarithms of those albedos.
            least: (3, N) channels of which that is the least that they may be.
            albedo: (H, W, 3) logarithms of those of all pixels.
            trust: (H, W) how much each counts.

        Returns:
            (K, N) share of the witnesses that have such an albedo; (3, N) the mean logarithm of those that have the
            first.
        """
        height, width = trust.shape
        rows, columns = np.divmod(who, width)
        depth = np.log(np.maximum(self.depth, 1e-6)) / np.float32(_AT_DEPTH)
        table = np.concatenate([self.normal, albedo, depth[..., None], trust[..., None]], axis=-1, dtype=np.float32)
        table = np.ascontiguousarray(table.reshape(-1, 8).T)
        own = table[:, who]
        lowest = np.where(least, np.float32(0), np.float32(-np.inf))
        count, agreed = np.zeros(len(who), np.float32), np.zeros((len(tried), len(who)), np.float32)
        summed = np.zeros((3, len(who)), np.float32)
        for down, right, nearness in _spiral(_AROUND * max(height, width)):
            at = np.clip(rows + down, 0, height - 1) * width + np.clip(columns + right, 0, width - 1)
            theirs = table[:, at]
            alike = np.maximum((theirs[:3] * own[:3]).sum(axis=0), 0) ** _SAME_WAY
            weight = nearness * theirs[7] * alike * np.exp(-((theirs[6] - own[6]) ** 2))
            off = np.maximum(tried - theirs[3:6], lowest) ** 2
            share = weight * np.exp(off.sum(axis=1) * np.float32(-1 / (6 * _ALIKE**2)))
            count += weight
            agreed += share
            summed += share[0] * theirs[3:6]
        mean = np.where(agreed[0] > 0, summed / np.maximum(agreed[0], np.float32(1e-20)), tried[0])
        shares = agreed / np.maximum(count, np.float32(1e-6))
        return np.asarray(shares, np.float32), np.asarray(mean, np.float32)


def _spiral(reach: float) -> list[tuple[int, int, np.float32]]:
    """Offsets in rows and columns, each with what a pixel counts there."""
    out: dict[tuple[int, int], np.float32] = {}
    for k in range(1, _ASKED + 1):
        radius, angle = reach * k / _ASKED, k * _TURN
        step = round(radius * np.sin(angle)), round(radius * np.cos(angle))
        if step != (0, 0):
            out[step] = np.float32(1 / (1 + (radius / (_NEARER * reach)) ** 2))
    return [(down, right, worth) for (down, right), worth in out.items()]

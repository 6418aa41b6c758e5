"""An environment map prepared for importance sampling. NumPy only.

Light samples are drawn in proportion to the radiance above its mean over the sphere: what lies below is left to the
reflected ray, and multiple importance sampling joins both (Karlík et al., "MIS Compensation", SIGGRAPH Asia 2019).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mirelight.model import F32, Environment

SLOTS = 1 << 19  # a draw picks one of so many equal shares of the light; a cell's probability is a whole number of them
MAX_CELLS = 1 << 21  # larger maps share a cell between pixels


@dataclass(frozen=True, slots=True, eq=False)
class PreparedEnvironment:
    """A map and its sampling table."""

    texels: F32  # (h, w, 4) radiance times intensity, and 0
    rotation: float  # rad about +Y
    slots: NDArray[np.uint32]  # (SLOTS,) row << 16 | column of a cell; (2,) zeros where nothing is to be sampled
    density: F32  # (rows, columns) probability of a cell times the number of cells: density over the unit square


def _blur(weights: NDArray[np.float64]) -> NDArray[np.float64]:
    """Mean of the bilinear interpolation over each pixel: [1 6 1] / 8 along both axes, columns wrap, rows do not."""
    rows = np.pad(weights, ((1, 1), (0, 0)), mode="edge")
    weights = (rows[:-2] + 6 * weights + rows[2:]) / 8
    return np.asarray((np.roll(weights, 1, 1) + 6 * weights + np.roll(weights, -1, 1)) / 8)


def _cells(radiance: F32) -> NDArray[np.float64]:
    """Mean brightness per cell of the sampling grid, (rows, columns); a cell is a block of pixels of a large map."""
    brightness = _blur(np.maximum(radiance.mean(axis=2, dtype=np.float64), 0))
    h, w = brightness.shape
    block = 1
    while (h // block) * (w // block) > MAX_CELLS or max(h, w) // block > 65535:
        block += 1
    if block > 1:
        edges_y, edges_x = np.arange(0, h, block), np.arange(0, w, block)
        total = np.add.reduceat(np.add.reduceat(brightness, edges_y, 0), edges_x, 1)
        brightness = total / np.outer(np.diff(np.append(edges_y, h)), np.diff(np.append(edges_x, w)))
    return brightness


def _solid_angles(rows: int) -> NDArray[np.float64]:
    """Share of the sphere of each row of cells, (rows, 1), adding to 1."""
    edges = np.cos(np.pi * np.arange(rows + 1) / rows)
    return np.asarray((edges[:-1] - edges[1:])[:, None] / 2)


def prepare(environment: Environment | None) -> PreparedEnvironment:
    """The environment ready for the device; None gives a black one. A constant one is sampled by reflection alone."""
    none = np.zeros(2, np.uint32)
    if environment is None:
        return PreparedEnvironment(np.zeros((2, 2, 4), np.float32), 0.0, none, np.zeros((2, 2), np.float32))
    h, w = environment.radiance.shape[:2]
    texels = np.zeros((h, w, 4), np.float32)
    np.multiply(environment.radiance, np.float32(environment.intensity), out=texels[..., :3])
    if environment.is_constant:
        texels = np.tile(texels, (2, 2, 1))
    rotation = float(np.radians(environment.rotation))

    brightness = _cells(texels[..., :3])
    rows, columns = brightness.shape
    share = _solid_angles(rows)
    above = np.maximum(brightness - np.sum(brightness * share) / columns, 0) * share
    total = above.sum()
    if not total > 1e-6 * np.sum(brightness * share):
        return PreparedEnvironment(texels, rotation, none, np.zeros((2, 2), np.float32))
    ends = np.floor(np.cumsum(above.ravel()) / total * SLOTS + 0.5).astype(np.int64)
    ends[-1] = SLOTS
    counts = np.diff(ends, prepend=0)
    index = np.arange(rows * columns, dtype=np.uint32)
    place = (index // np.uint32(columns)) << np.uint32(16) | (index % np.uint32(columns))
    density = (counts * (rows * columns / SLOTS)).astype(np.float32).reshape(rows, columns)
    return PreparedEnvironment(texels, rotation, np.repeat(place, counts), density)

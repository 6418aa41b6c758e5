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
MAX_CELLS = 1 << 20  # larger maps share a cell between pixels


@dataclass(frozen=True, slots=True, eq=False)
class PreparedEnvironment:
    """A map and its sampling table."""

    texels: F32  # (h, w, 4) radiance times intensity, and 0
    rotation: float  # rad about +Y
    slots: NDArray[np.uint32]  # (SLOTS,) row << 16 | column of a cell; (2,) zeros where nothing is to be sampled
    density: F32  # (rows, columns) probability of a cell times the number of cells: density over the unit square


def _blur(weights: F32) -> F32:
    """Mean of the bilinear interpolation over each pixel: [1 6 1] / 8 along both axes, columns wrap, rows do not."""
    rows = np.pad(weights, ((1, 1), (0, 0)), mode="edge")
    out: F32 = np.float32(6) * rows[1:-1]
    out += rows[:-2]
    out += rows[2:]
    columns = np.pad(out, ((0, 0), (1, 1)), mode="wrap")
    out *= np.float32(6)
    out += columns[:, :-2]
    out += columns[:, 2:]
    out /= np.float32(64)
    return out


def _cells(radiance: F32) -> F32:
    """Mean brightness per cell of the sampling grid, (rows, columns); a cell is a block of pixels of a large map."""
    brightness: F32 = radiance[..., 0] + radiance[..., 1]
    brightness += radiance[..., 2]
    np.maximum(brightness, np.float32(0), out=brightness)
    h, w = brightness.shape
    block = 1
    while -(-h // block) * -(-w // block) > MAX_CELLS or max(h, w) // block > 65535:
        block += 1
    if block > 1:
        y, x = np.arange(0, h, block), np.arange(0, w, block)
        total = np.add.reduceat(np.add.reduceat(brightness, y, axis=0), x, axis=1)
        areas = np.outer(np.diff(np.append(y, h)), np.diff(np.append(x, w)))
        brightness = np.divide(total, areas, dtype=np.float32)
    return _blur(brightness)


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

    brightness = _cells(texels)
    rows, columns = brightness.shape
    share = _solid_angles(rows).astype(np.float32)
    everywhere = float(np.sum(brightness * share, dtype=np.float64))
    above: F32 = np.maximum(brightness - np.float32(everywhere / columns), np.float32(0)) * share
    ends = np.cumsum(above, dtype=np.float64)
    if not ends[-1] > 1e-6 * everywhere:
        return PreparedEnvironment(texels, rotation, none, np.zeros((2, 2), np.float32))
    ends *= SLOTS / ends[-1]
    whole = np.rint(ends).astype(np.int64)
    counts = np.append(whole[:1], whole[1:] - whole[:-1])
    index = np.repeat(np.arange(rows * columns), counts)
    slots = (index // columns << 16 | index % columns).astype(np.uint32)
    density = (counts * (rows * columns / SLOTS)).astype(np.float32).reshape(rows, columns)
    return PreparedEnvironment(texels, rotation, slots, density)

"""Which lights reach where: a grid of light lists, so that a thousand lamps cost little more than a dozen. NumPy only.

A light with a range is exactly dark beyond it (KHR_lights_punctual), so a list that leaves it out loses nothing.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from mirelight.lighting.lights import ALL_LIGHTS, Kind, brightness, pack
from mirelight.model import F64, Light, PointLight, SpotLight

FEWER = (ALL_LIGHTS, 4, 1)  # picks where all at every hit are too many: light that bounces often is faint
# Lights that are weighed against each other at a path's first hit and at later ones: all of a list no longer, else half
# of them the brightest and half drawn from the rest.
FIRST_WEIGHED, LATER_WEIGHED = 32, ALL_LIGHTS
CELLS_PER_LIGHT = 8  # finer costs more to build than it saves
MAX_ENTRIES = 1 << 21


@dataclass(frozen=True, slots=True, eq=False)
class LightGrid:
    """Lists of lights by cell, cells in x-major order."""

    low: F64  # (3,) lowest corner, world units
    cells_per_unit: F64  # (3,)
    resolution: tuple[int, int, int]
    starts: NDArray[np.uint32]  # (cells + 1,) into `lights`
    lights: NDArray[np.uint32]  # rows of the light table
    picks: tuple[int, int, int]  # most lights sampled at a path's first hit, its second, and each later one


def build(
    lights: tuple[Light, ...], bounds: tuple[NDArray[np.float32], NDArray[np.float32]], *, separate: bool
) -> LightGrid:
    """Lists for the surface points inside `bounds`, two corners (3,), brightest first; one list of all where every
    light is sampled.

    The last ones built are kept: frames of one lighting differ in their camera.
    """
    low, high = (tuple(float(x) for x in corner) for corner in bounds)
    return _build(lights, low, high, separate)


@lru_cache(maxsize=4)
def _build(
    lights: tuple[Light, ...], lowest: tuple[float, ...], highest: tuple[float, ...], separate: bool
) -> LightGrid:
    low, high = np.array(lowest), np.array(highest)
    size = np.maximum(high - low, 1e-6 * max(float(np.max(high - low)), 1e-30))
    few = len(lights) <= ALL_LIGHTS
    resolution = (1, 1, 1) if few else _resolution(lights, size)
    starts, items = _lists(lights, low, size, resolution)
    return LightGrid(
        low,
        np.asarray(resolution) / size,
        resolution,
        starts,
        items if few else _brightest_first(lights, low, size / resolution, resolution, starts, items),
        picks=(ALL_LIGHTS,) * 3 if separate and few else FEWER,
    )


def _resolution(lights: tuple[Light, ...], size: F64) -> tuple[int, int, int]:
    """Cells along each axis, near cubes: some for each light, as long as the lists stay within MAX_ENTRIES."""
    reaches = np.array([_reach(x) for x in lights])
    filled = np.minimum(2 * reaches[:, None] / size, 1).prod(axis=1).sum()  # entries per cell, at most
    wanted = min(CELLS_PER_LIGHT * len(lights), MAX_ENTRIES / max(filled, 1.0))
    steps, best = 1.0, (1, 1, 1)
    while True:
        x, y, z = (int(n) for n in np.ceil(steps * size / size.max()))
        if x * y * z > wanted:
            return best
        best, steps = (x, y, z), 1.2 * steps + 0.1


def _lists(
    lights: tuple[Light, ...], low: F64, size: F64, resolution: tuple[int, ...]
) -> tuple[NDArray[np.uint32], NDArray[np.uint32]]:
    """(starts, lights) of every cell's list, in the table's order."""
    edges = [low[k] + size[k] * np.arange(n + 1) / n for k, n in enumerate(resolution)]
    cells = [_reached(light, edges, resolution) for light in lights]
    where = np.concatenate(cells) if cells else np.zeros(0, np.int64)
    which = np.repeat(np.arange(len(lights), dtype=np.uint32), [len(c) for c in cells])
    order = np.argsort(where, kind="stable")
    starts = np.searchsorted(where[order], np.arange(int(np.prod(resolution)) + 1)).astype(np.uint32)
    return starts, which[order]


def _brightest_first(
    lights: tuple[Light, ...],
    low: F64,
    cell: F64,
    resolution: tuple[int, int, int],
    starts: NDArray[np.uint32],
    items: NDArray[np.uint32],
) -> NDArray[np.uint32]:
    """Each list by how bright its lights may be at about the middle of the cell; only noise depends on the order."""
    table = pack(lights)[: max(len(lights), 2)]
    strength = brightness(table)
    far = np.isin(table[:, 3], (Kind.DIRECTIONAL, Kind.SUN))[items]
    place = np.repeat(np.arange(len(starts) - 1), (starts[1:] - starts[:-1]).astype(np.int64))
    index = np.stack(np.unravel_index(place, resolution), axis=-1)
    apart = ((low + (index + 0.5) * cell).astype(np.float32) - table[items, :3]) ** 2
    d2 = np.maximum(apart.sum(axis=1), np.float32(np.sum(cell**2) / 4))
    window = np.clip(1 - (d2 * table[items, 11] ** 2) ** 2, np.float32(1e-3), 1)
    bright = np.where(far, strength[items], strength[items] * window / d2).astype(np.float32)
    dark = np.uint64(0xFFFFFFFF) - bright.view(np.uint32)  # the bits of floats above 0 are in order
    return items[np.argsort(place.astype(np.uint64) << np.uint64(32) | dark, kind="stable")]


def _reach(light: Light) -> float:
    return light.range * (1 + 1e-5) if isinstance(light, PointLight | SpotLight) else np.inf


def _reached(light: Light, edges: list[F64], resolution: tuple[int, ...]) -> NDArray[np.int64]:
    """Cells that a light can reach: those that its sphere touches."""
    reach = _reach(light)
    if not isinstance(light, PointLight | SpotLight) or np.isinf(reach):
        return np.arange(int(np.prod(resolution)))
    gaps, firsts = [], []
    for at, edge in zip(light.position, edges, strict=True):
        gap = np.maximum(np.maximum(edge[:-1] - at, at - edge[1:]), 0)
        near = np.flatnonzero(gap <= reach)
        first, last = (near[0], near[-1] + 1) if len(near) else (0, 0)
        gaps.append(gap[first:last] ** 2)
        firsts.append(first)
    distance2 = gaps[0][:, None, None] + gaps[1][None, :, None] + gaps[2][None, None, :]
    x, y, z = (index + first for index, first in zip(np.nonzero(distance2 <= reach**2), firsts, strict=True))
    return np.asarray((x * resolution[1] + y) * resolution[2] + z, dtype=np.int64)

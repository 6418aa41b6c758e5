"""Which lights can reach where: a grid of light lists, so that a thousand lamps cost little more than six. NumPy only.

A light with a range is exactly dark beyond it (KHR_lights_punctual), so a list that leaves it out loses nothing.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from mirelight.lighting.lights import ALL_LIGHTS
from mirelight.model import F64, Light, PointLight, SpotLight

FEW = 6  # lights a list to aim for: shorter lists no longer pay
FEWER = (ALL_LIGHTS, 4, 1)  # picks where all at every hit are too many: light that bounces often is faint
MAX_CELLS = 1 << 16
MAX_ENTRIES = 1 << 21
WORTH_IT = 0.85  # a grid twice as fine stays only if it shortens the lists by this factor


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
    """Lists for the surface points inside `bounds`; one list of all while every light is sampled anyway."""
    low, high = (x.astype(np.float64) for x in bounds)
    size = np.maximum(high - low, 1e-6 * max(float(np.max(high - low)), 1e-30))
    best = _lists(lights, low, size, (1, 1, 1))
    if len(lights) > ALL_LIGHTS:
        steps = 2
        while _mean_length(best) > FEW:
            resolution = tuple(int(n) for n in np.clip(np.ceil(steps * size / size.max()), 1, None))
            if np.prod(resolution) > MAX_CELLS:
                break
            finer = _lists(lights, low, size, resolution)
            if len(finer[2]) > MAX_ENTRIES or (steps > 2 and _mean_length(finer) > WORTH_IT * _mean_length(best)):
                break
            best = finer
            steps *= 2
    resolution, starts, items = best
    return LightGrid(
        low,
        np.asarray(resolution) / size,
        (resolution[0], resolution[1], resolution[2]),
        starts,
        items,
        picks=(ALL_LIGHTS,) * 3 if separate and len(lights) <= ALL_LIGHTS else FEWER,
    )


_Lists: TypeAlias = tuple[tuple[int, ...], NDArray[np.uint32], NDArray[np.uint32]]  # resolution, starts, lights


def _mean_length(lists: _Lists) -> float:
    return len(lists[2]) / (len(lists[1]) - 1)


def _lists(lights: tuple[Light, ...], low: F64, size: F64, resolution: tuple[int, ...]) -> _Lists:
    edges = [low[k] + size[k] * np.arange(n + 1) / n for k, n in enumerate(resolution)]
    cells = [_reached(light, edges, resolution) for light in lights]
    where = np.concatenate(cells) if cells else np.zeros(0, np.int64)
    which = np.repeat(np.arange(len(lights), dtype=np.uint32), [len(c) for c in cells])
    order = np.argsort(where, kind="stable")
    starts = np.searchsorted(where[order], np.arange(int(np.prod(resolution)) + 1)).astype(np.uint32)
    return resolution, starts, which[order]


def _reached(light: Light, edges: list[F64], resolution: tuple[int, ...]) -> NDArray[np.int64]:
    """Cells that a light can reach: those that its sphere touches."""
    if not isinstance(light, PointLight | SpotLight) or np.isinf(light.range):
        return np.arange(int(np.prod(resolution)))
    reach = light.range * (1 + 1e-5)
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

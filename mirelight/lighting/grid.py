"""Which lights can reach where: a grid of light lists, so that a thousand lamps cost little more than six. NumPy only.

A light with a range is exactly dark beyond it (KHR_lights_punctual), so a list that leaves it out loses nothing.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mirelight.lighting.lights import ALL_LIGHTS
from mirelight.model import F64, Light, PointLight, SpotLight

FEW = 6  # lights a list to aim for: shorter lists no longer pay
MAX_CELLS = 1 << 18
MAX_ENTRIES = 1 << 22


@dataclass(frozen=True, slots=True, eq=False)
class LightGrid:
    """Lists of lights by cell, cells in x-major order."""

    low: F64  # (3,) lowest corner, world units
    cells_per_unit: F64  # (3,)
    resolution: tuple[int, int, int]
    starts: NDArray[np.uint32]  # (cells + 1,) into `lights`
    lights: NDArray[np.uint32]  # rows of the light table
    first_picks: int  # most lights sampled at a path's first hit
    later_picks: int  # and at each later one


def build(lights: tuple[Light, ...], bounds: tuple[NDArray[np.float32], NDArray[np.float32]]) -> LightGrid:
    """Lists for the surface points inside `bounds`; one list of all while every light is sampled anyway."""
    low, high = (x.astype(np.float64) for x in bounds)
    size = np.maximum(high - low, 1e-6 * max(float(np.max(high - low)), 1e-30))
    best = _lists(lights, low, size, (1, 1, 1))
    if len(lights) > ALL_LIGHTS:
        steps = 2
        while np.mean(np.diff(best[1].astype(np.int64))) > FEW:
            resolution = tuple(int(n) for n in np.clip(np.ceil(steps * size / size.max()), 1, None))
            if np.prod(resolution) > MAX_CELLS:
                break
            finer = _lists(lights, low, size, resolution)
            if len(finer[2]) > MAX_ENTRIES:
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
        first_picks=ALL_LIGHTS,
        later_picks=ALL_LIGHTS if len(lights) <= ALL_LIGHTS else 1,
    )


def _lists(
    lights: tuple[Light, ...], low: F64, size: F64, resolution: tuple[int, ...]
) -> tuple[tuple[int, ...], NDArray[np.uint32], NDArray[np.uint32]]:
    """(resolution, starts, lights) of one grid."""
    shape = np.asarray(resolution)
    edges = [low[k] + size[k] * np.arange(shape[k] + 1) / shape[k] for k in range(3)]
    cells: list[NDArray[np.int64]] = []
    for light in lights:
        reached = np.ones(tuple(shape), bool)
        if isinstance(light, PointLight | SpotLight) and np.isfinite(light.range):
            gap = [
                np.maximum(np.maximum(e[:-1] - light.position[k], light.position[k] - e[1:]), 0) ** 2
                for k, e in enumerate(edges)
            ]
            distance2 = gap[0][:, None, None] + gap[1][None, :, None] + gap[2][None, None, :]
            reached = distance2 <= (light.range * (1 + 1e-5)) ** 2
        cells.append(np.flatnonzero(reached))
    where = np.concatenate(cells) if cells else np.zeros(0, np.int64)
    which = np.repeat(np.arange(len(lights), dtype=np.uint32), [len(c) for c in cells])
    order = np.argsort(where, kind="stable")
    starts = np.searchsorted(where[order], np.arange(int(np.prod(shape)) + 1)).astype(np.uint32)
    return tuple(int(n) for n in shape), starts, which[order]

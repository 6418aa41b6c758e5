"""Where many cameras stand: on circles, spheres and domes, at random, and around a capture. World: Y up.

Draws come from a generator that is seeded by the table's seed and the camera's number alone, and whose stream Python
promises to keep: a set that grows keeps its first cameras, on every machine.
"""

from __future__ import annotations

import math
import random
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from mirelight.base.conventions import Matrix, unit
from mirelight.model import Camera

_GOLDEN = math.pi * (3 - math.sqrt(5))  # rad between neighbours of a Fibonacci lattice
_NEIGHBOURS = 3  # of a captured camera, that a new one may stand towards
_PARALLEL = 1e-4  # view axes that leave less than this of a point's place open have no common one


@dataclass(frozen=True, slots=True, eq=False)
class Stand:
    """Where a camera stands, and what it looks at."""

    position: Matrix  # (3,)
    target: Matrix  # (3,)
    yfov: float | None = None  # degrees, of the captured camera that it is like


def direction(elevation: float, azimuth: float) -> Matrix:
    """Unit vector (3,) to a point seen `elevation` above the horizon, `azimuth` from +Z towards +X; both in radians."""
    flat = math.cos(elevation)
    return np.array([flat * math.sin(azimuth), math.sin(elevation), flat * math.cos(azimuth)])


def orbit(target: Matrix, radius: float, elevation: float, start: float, count: int) -> Iterator[Stand]:
    """Places on a circle at `elevation` and from `start` on, both in degrees, counter-clockwise seen from above."""
    for i in range(count):
        azimuth = math.radians(start) + 2 * math.pi * i / count
        yield Stand(target + radius * direction(math.radians(elevation), azimuth), target)


def band(target: Matrix, radius: float, low: float, high: float, seed: int, count: int) -> Iterator[Stand]:
    """Places spread evenly over the part of a sphere between two elevations in degrees: a Fibonacci lattice."""
    offset = 2 * math.pi * random.Random(f"lattice {seed}").random() if seed else 0.0
    bottom, top = math.sin(math.radians(low)), math.sin(math.radians(high))
    for i in range(count):
        height = bottom + (top - bottom) * (i + 0.5) / count
        yield Stand(target + radius * direction(math.asin(height), offset + _GOLDEN * i), target)


def scattered(bounds: ArrayLike, targets: ArrayLike, seed: int, number: int, again: int = 0) -> Stand:
    """A place at random in one box, that looks at a place at random in another; each box (2, 3), lowest corner first.

    Args:
        bounds, targets: the boxes.
        seed, number: same ones, same place.
        again: how often a place of this number was drawn and refused before.
    """
    (low, high), (near, far) = np.asarray(bounds, dtype=np.float64), np.asarray(targets, dtype=np.float64)
    draws = _draws(seed, number, 6, again)
    target = near + (far - near) * draws[3:]
    position = low + (high - low) * draws[:3]
    if np.linalg.norm(position - target) < 1e-9:
        position = position + np.array([0, 0, 1e-3])  # a box without size around the target
    return Stand(position, target)


def around(captured: Sequence[Camera], target: Matrix, seed: int, count: int) -> Iterator[Stand]:
    """Places between cameras of a capture and their nearest neighbours, seen from what they look at.

    Direction and distance from `target` go from the camera's to the neighbour's by one draw, so that a place is as far
    as the capture's own around it.
    """
    away = np.stack([camera.position for camera in captured]) - target
    distances = np.linalg.norm(away, axis=1)
    directions = away / distances[:, None]
    for i in range(count):
        which, towards, share = _draws(seed, i, 3)
        a = int(which * len(captured))
        cosines = directions @ directions[a]
        cosines[a] = -2
        near = np.argsort(-cosines, kind="stable")[: min(_NEIGHBOURS, len(captured) - 1)]
        b = int(near[int(towards * len(near))]) if len(near) else a
        between = (1 - share) * directions[a] + share * directions[b]
        if np.linalg.norm(between) < 1e-6:  # two cameras face to face
            between = directions[a]
        radius = (1 - share) * distances[a] + share * distances[b]
        half = captured[a].height / 2 / captured[a].fy
        yield Stand(target + radius * unit(between), target, 2 * math.degrees(math.atan(half)))


def focus(captured: Sequence[Camera]) -> Matrix | None:
    """The point (3,) nearest to all view axes (least squares).

    None where the axes are parallel, or most of the cameras look away from it.
    """
    axes = np.stack([-camera.world_from_camera[:3, 2] for camera in captured])
    positions = np.stack([camera.position for camera in captured])
    across = np.eye(3) - axes[:, :, None] * axes[:, None, :]  # (N, 3, 3) projections
    system = across.mean(axis=0)
    if np.linalg.eigvalsh(system)[0] < _PARALLEL:
        return None
    point = np.linalg.solve(system, np.einsum("nij,nj->i", across, positions) / len(axes))
    ahead = np.einsum("ni,ni->n", axes, point - positions)
    return np.asarray(point) if np.mean(ahead > 0) > 0.5 else None


def _draws(seed: int, number: int, count: int, again: int = 0) -> Matrix:
    """Numbers (count,) in [0, 1) of one camera."""
    generator = random.Random(f"camera {seed} {number} {again}" if again else f"camera {seed} {number}")
    return np.array([generator.random() for _ in range(count)])

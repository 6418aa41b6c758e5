"""Which way is up in a capture: from its cameras, from what of it faces up, or as its format usually has it.

Discs that lie on surfaces are a floor by themselves. Of splats that an optimiser made the surface that is seen is asked
(:mod:`mirelight.proxy.upright`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mirelight.base import conventions
from mirelight.base.errors import InputError
from mirelight.io.suffixes import SCENES
from mirelight.model import F64, Camera, SplatCloud
from mirelight.proxy import ProxySettings
from mirelight.proxy.capture import are_discs, look_at_capture
from mirelight.proxy.guessed import Guess
from mirelight.proxy.one_picture import without_far
from mirelight.proxy.upright import AGREE, seen_surface, upright
from mirelight.proxy.views import held_up, moved

LEAST_FLOOR = (
    0.06  # share of the splats' area that a floor has (shipped scenes 0.19 and 0.20, a thing without one 0.03)
)
_MOST_BELOW = 0.05  # share of the area that may lie below it
_ALIKE = 0.5  # of the floor's share: what a ceiling has at the least
_WALL = 0.2  # cosine between up and what is a wall at the most
_LEAST_INSIDE = 0.01  # share of the area between floor and ceiling by which they are told apart
_RIVAL = 0.7  # of the floor's share: a wall as large may be the floor (the courtyard's largest has 0.6)
_HELD = np.cos(np.radians(45.0))  # people hold a camera no steeper
_BOTH_ALIKE = "floor and ceiling look alike"
_LOOKS_DOWN = 0.1  # mean cosine between guessed views and an axis that tells which way is up along it
_LAYER = 1 / 50  # of the extent: how thick a floor is
_CELL = 1 / 25  # of the largest extent: the side of the cells in which splats cover each other
_LEVELLED = 2  # times that a plane is laid through a layer
_WIDE = 5.0  # times as wide as it is thick: a layer that tells how it lies
_ALONG = 0.9  # cosine between a splat's normal and the floor's
_DIRECTIONS = 100
_CLEAR = 0.1  # opacity, below which splats show nothing
_SAMPLE = 20_000  # splats that are looked at
_STRAIGHT = np.cos(np.radians(2.0))  # nearer to an axis counts as the axis: they are found to 1.5
_LIKELY = ((1.5, (0, 1, 0)), (1.2, (0, 0, 1)))  # worth of a floor across these axes, either sign


@dataclass(frozen=True, slots=True, eq=False)
class Up:
    """A direction, and how it was found."""

    way: F64  # (3,) unit, in the splats' own axes
    why: str  # in words
    guessed: bool  # nothing tells it, or what tells it does not agree

    @property
    def euler(self) -> tuple[float, float, float]:
        """Degrees about the fixed axes X, Y, Z that turn it to +Y, as a job's rotation_euler has them."""
        x, y, z = self.way
        if y < -_STRAIGHT:
            return 0.0, 0.0, 180.0
        # X first takes the direction into the plane of X and Y, with y >= 0; Z then takes it to +Y.
        about_x = float(np.degrees(np.arctan2(-z, y))) if abs(z) > 1e-9 or y < 0 else 0.0
        about_z = float(np.degrees(np.arctan2(x, np.hypot(y, z))))
        return round(about_x, 2) + 0.0, 0.0, round(about_z, 2) + 0.0


def find(cloud: SplatCloud, path: Path, cameras: Sequence[Camera] = (), guess: Guess | None = None) -> Up:
    """Up in the splats' own axes.

    Args:
        cloud: as its file has it.
        path: its file, whose format decides where nothing else does.
        cameras: that took it, in the same axes.
        guess: gives guessed ones, in the same axes; None: it is looked at from around.
    """
    stage = path.suffix.lower() in SCENES
    habit = np.array([0.0, 1.0 if stage else -1.0, 0.0])
    taken = _of_cameras(cameras, cloud)
    shown = (
        _of_floor(cloud, habit, stage)
        if are_discs(cloud)
        else _of_surface(cloud, cameras or (guess() if guess else ()), habit)
    )
    if taken is not None:
        why = f"from {len(cameras)} cameras of the capture"
        if shown is None or shown.guessed:
            return Up(_neat(taken), why, False)
        if float(shown.way @ taken) < AGREE:
            return Up(_neat(taken), f"a guess {why}: the floor tells another", True)
        return Up(shown.way, f"{why}, and what lies level in it", False)  # people roll their cameras by some degrees
    if len(cameras) == 1:
        return _of_picture(shown, cameras[0])
    if shown is not None:
        return shown
    ahead = -np.mean([x.world_from_camera[:3, 2] @ habit for x in (guess() if guess else ())] or [0.0])
    if abs(ahead) > _LOOKS_DOWN:
        way = habit if ahead < 0 else -habit
        return Up(way, "a guess: there is no floor, and most guessed views of it look down", True)
    return Up(habit, f"a guess: there is no floor, and {_usual(stage)}", True)


def _of_picture(shown: Up | None, camera: Camera) -> Up:
    """As the surface tells it, but for how it leans to a side: people hold a camera level, and a sky, which splats of
    one picture have as a wall across it, leans any way. What is far from how it was held is no floor, but a wall."""
    right, own = camera.world_from_camera[:3, 0], camera.world_from_camera[:3, 1]
    level = own if shown is None else shown.way - (shown.way @ right) * right
    if shown is None or level @ own < _HELD:
        return Up(_neat(own), "a guess: as its one picture was held", True)
    return replace(shown, way=_neat(conventions.unit(level)))


def _usual(stage: bool) -> str:
    return "+Y is up in glTF and as stages are read" if stage else "-Y is up in most captures"


def _of_floor(cloud: SplatCloud, habit: F64, stage: bool) -> Up | None:
    """By the layer of discs that all stands on; None: there is none."""
    floor = _floor(cloud)
    if floor is None:
        return None
    if not floor.told:
        if floor.doubt != _BOTH_ALIKE:  # nothing lies below it, whether it is a floor or a wall
            return Up(_neat(floor.way), f"a guess: {floor.doubt}", True)
        way = floor.way if floor.way @ habit >= 0 else -floor.way
        return Up(_neat(way), f"a guess: {floor.doubt}, and {_usual(stage)}", True)
    why = f"from the floor, in which {floor.share:.0%} of the splats' area lies"
    return Up(_neat(floor.way), why + (", and on which things stand" if floor.ceiling else ""), False)


def said(way: Sequence[float]) -> Up:
    """Up as somebody said it, (3,) of any length, in the splats' own axes."""
    return Up(conventions.unit(way), "as it was said", False)


def _of_surface(cloud: SplatCloud, cameras: Sequence[Camera], habit: F64) -> Up | None:
    """By what of the surface faces up and what stands upright; None: nothing tells."""
    try:
        capture = look_at_capture(without_far(cloud, cameras), "splats")
    except InputError:  # said where a surface is asked for
        return None
    there = [moved(x, -capture.middle) for x in cameras]
    found = upright(seen_surface(capture, there, ProxySettings()), habit)
    if found is None:
        return None
    if found.doubt:
        return Up(_neat(found.way), f"a guess: {found.doubt}", True)
    return Up(_neat(found.way), f"from the surface, {found.share:.0%} of which lies level or stands upright", False)


def some_discs(cloud: SplatCloud, wanted: NDArray[np.bool_]) -> tuple[NDArray[np.intp], F64, F64]:
    """Rows of some of the splats (N,) that are wanted; what each covers, by its opacity; its normal, of either sign."""
    rows = np.flatnonzero(wanted)
    rows = rows[:: max(1, len(rows) // _SAMPLE)]
    scales = np.sort(cloud.scales[rows].astype(np.float64), axis=1)
    turns = conventions.rotation_from_quaternion(cloud.quats[rows])
    normals = np.take_along_axis(turns, np.argmin(cloud.scales[rows], axis=1)[:, None, None], axis=2)[:, :, 0]
    return rows, scales[:, 1] * scales[:, 2] * cloud.opacities[rows], normals


def _of_cameras(cameras: Sequence[Camera], cloud: SplatCloud) -> F64 | None:
    """As cameras were held; None where they do not agree, as of a phone rolled about."""
    if len(cameras) < 3 or not np.ptp([x.position for x in cameras], axis=0).any():  # a panorama's sides were not held
        return None
    return held_up(cameras, cloud.means[cloud.opacities > _CLEAR])


@dataclass(frozen=True, slots=True, eq=False)
class Floor:
    """What a capture stands on."""

    way: F64  # (3,) unit, up
    share: float  # of the splats' area that lies in it
    ceiling: bool = False  # whether there is one like it on the other side
    doubt: str = ""  # why it may be no floor

    @property
    def told(self) -> bool:
        """Whether it is sure which side is the floor."""
        return not self.doubt


def _floor(cloud: SplatCloud) -> Floor | None:
    """The layer that holds most area with nearly nothing on its other side. A closed room has two: things stand on the
    floor, so what lies between both and is no wall lies nearer to it."""
    sound = np.isfinite(cloud.means).all(axis=1) & np.isfinite(cloud.scales).all(axis=1) & (cloud.opacities > _CLEAR)
    rows, area, normals = some_discs(cloud, sound)
    if len(rows) < 50:
        return None
    area = np.minimum(area, np.quantile(area, 0.99))  # a few huge splats of a sky do not make a floor
    if not area.sum() > 0:
        return None
    means = cloud.means[rows].astype(np.float64)
    area = _seen(means, area * np.count_nonzero(sound) / len(rows))
    found = []
    for way in _ways(normals):
        layer = _lowest(means, normals, area, way)
        if layer is not None:
            found.append((layer.share * max([1.0, *(by for by, axis in _LIKELY if abs(way @ axis) > 0.8)]), way, layer))
    if not found:
        return None
    _, way, floor = max(found, key=lambda x: x[0])
    if floor.share < LEAST_FLOOR:
        return None
    lean, ceiling = _lean(means, normals, area, floor, way)
    floor = replace(floor, way=_level(floor, means, area))
    ceiling = ceiling and replace(ceiling, way=_level(ceiling, means, area))
    if ceiling is not None and np.isnan(lean):
        return Floor(floor.way, floor.share, ceiling=True, doubt=_BOTH_ALIKE)
    walls = [x for x in found if abs(x[1] @ way) < 0.5 and x[2].share > _RIVAL * floor.share]
    _, across, wall = max(walls, key=lambda x: x[2].share, default=(0.0, way, floor))
    doubt = ""
    if wall is not floor and not abs(_lean(means, normals, area, wall, across)[0]) < abs(lean):
        doubt = "things stand on a wall as they do on the floor"
    if ceiling is None:
        return Floor(floor.way, floor.share, doubt=doubt)
    stood_on = floor if lean > 0 else ceiling
    return Floor(stood_on.way, stood_on.share, ceiling=True, doubt=doubt)


def _seen(means: F64, area: F64) -> F64:
    """Shares of the area (N,) that is left where a cell has no more of it than its side: splats that an optimiser made
    lie on each other many times over, the more the larger they are, as on plain walls."""
    low, high = np.quantile(means, [0.005, 0.995], axis=0)
    side = float(np.max(high - low)) * _CELL
    if not side > 0:
        return np.asarray(area / area.sum())
    # what bounds a scene runs through the middle of cells, not along their sides
    _, cell = np.unique(np.floor((means - low) / side + 0.5), axis=0, return_inverse=True)
    held = np.bincount(cell.ravel(), 2 * np.pi * area)  # the integral of a Gaussian print
    left = area * np.minimum(1, side**2 / np.maximum(held, 1e-300))[cell.ravel()]
    return np.asarray(left / left.sum())


def _level(layer: _Layer, means: F64, area: F64) -> F64:
    """Normal of the plane through a layer's splats, which lie in it better than each of them is turned; (3,) unit."""
    way = layer.way
    for _ in range(_LEVELLED):
        points, weights = means[layer.on], area[layer.on]
        height = points @ way
        middle, most = np.median(height), np.quantile(np.abs(height - np.median(height)), 0.9)
        near = np.abs(height - middle) <= most  # what stands on it a little does not tilt it
        about = points[near] - np.average(points[near], axis=0, weights=weights[near])
        values, vectors = np.linalg.eigh((about * weights[near, None]).T @ about)
        if not values[1] > _WIDE**2 * values[0]:  # a strip, or no plane
            return layer.way
        way = vectors[:, 0] * np.sign(vectors[:, 0] @ layer.way)
    return np.asarray(way) if way @ layer.way > _ALONG else layer.way


def _lean(means: F64, normals: F64, area: F64, floor: _Layer, way: F64) -> tuple[float, _Layer | None]:
    """How far towards a layer things lie from the middle, as a share of half the extent, walls along it left out; NaN:
    there are none. And the layer like it on the other side."""
    ceiling = _lowest(means, normals, area, -way)
    if ceiling is not None and ceiling.share < _ALIKE * floor.share:
        ceiling = None
    height = means @ way
    low, high = np.quantile(height, [0.005, 0.995])
    inside = ~floor.on & (np.abs(normals @ way) > _WALL)
    if ceiling is not None:
        inside &= ~ceiling.on
    if area[inside].sum() < _LEAST_INSIDE:
        return float("nan"), ceiling
    mean = float(np.average(height[inside], weights=area[inside]))
    return ((low + high) / 2 - mean) / ((high - low) / 2), ceiling


@dataclass(frozen=True, slots=True, eq=False)
class _Layer:
    """The layer along a direction that holds most area, with nearly nothing below it."""

    way: F64  # (3,) unit, its normal
    share: float  # of the area
    on: NDArray[np.bool_]  # (N,) which splats lie in it


def _lowest(means: F64, normals: F64, area: F64, way: F64) -> _Layer | None:
    height = means @ way
    low, high = np.quantile(height, [0.005, 0.995])
    if not high > low:
        return None
    flat = np.abs(normals @ way) > _ALONG
    layer = np.clip((height - low) / ((high - low) * _LAYER), 0, 1 / _LAYER).astype(int)
    every = np.bincount(layer, area)
    held = np.bincount(layer[flat], area[flat], minlength=len(every))
    held[np.cumsum(every) - every >= _MOST_BELOW] = 0
    lowest = int(np.argmax(held))
    share = float(held[lowest])
    if not share > 0:
        return None
    near = flat & (layer == lowest)
    signs = np.sign(normals[near] @ way)[:, None]
    return _Layer(conventions.unit((normals[near] * signs * area[near, None]).sum(axis=0)), share, near)


def _ways(normals: F64) -> F64:
    """Unit vectors to try, of either sign: the axes, and what a few of the splats face."""
    some = normals[:: max(1, len(normals) // _DIRECTIONS)]
    return np.concatenate([np.eye(3), -np.eye(3), some, -some])


def _neat(way: F64) -> F64:
    """The axis that a direction nearly is, else itself."""
    axis = int(np.argmax(np.abs(way)))
    if abs(way[axis]) < _STRAIGHT:
        return way
    out = np.zeros(3)
    out[axis] = np.sign(way[axis])
    return out

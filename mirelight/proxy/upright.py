"""Which way is up in what a capture shows: floors face it, walls stand along it, and little faces down.

Splats that an optimiser made lie on each other and are turned out of their surface, so that they tell no floor. The
surface that views of them see does.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from mirelight.base import conventions
from mirelight.base.together import each
from mirelight.model import F64, Camera
from mirelight.proxy.capture import Capture
from mirelight.proxy.depth import DepthMap, DepthMaps, footprint, points_of
from mirelight.proxy.guess_tuning import GUESS
from mirelight.proxy.slanted import slanted
from mirelight.proxy.types import ProxySettings
from mirelight.proxy.views import around, evenly, lattice

_FLAT, _STEEP = np.cos(np.radians(GUESS.upright_cone)), np.sin(np.radians(GUESS.upright_cone))
AGREE = np.cos(np.radians(GUESS.upright_leaning))  # cosine between ways up that agree


@dataclass(frozen=True, slots=True, eq=False)
class Upright:
    """A direction, and what speaks for it."""

    way: F64  # (3,) unit, up
    share: float  # of the surface, that faces it, faces away, or stands along it
    doubt: str = ""  # why it may be another


@dataclass(frozen=True, slots=True, eq=False)
class Seen:
    """The surface that views see."""

    at: F64  # (N, 3)
    normal: F64  # (N, 3) unit, to the side that was seen
    weight: F64  # (N,) of a sum of 1
    eyes: F64  # (E, 3) that it was seen from
    around: bool  # whether those are all around, and see a floor from beneath as from above

    @staticmethod
    def of(views: Sequence[DepthMap], *, around: bool) -> Seen:
        """What smoothed views see."""
        parts = [points_of(x, max(x.camera.width // GUESS.upright_pixels, 1)) for x in views]
        at, normal, trust = (np.concatenate(x) for x in zip(*parts, strict=True))
        step = max(len(at) // GUESS.upright_sample, 1)
        weight = trust[::step].astype(np.float64)
        eyes = np.array([x.camera.position for x in views])
        return Seen(at[::step], normal[::step], weight / max(float(weight.sum()), 1e-30), eyes, around)

    def facing(self, way: F64) -> tuple[NDArray[np.bool_], NDArray[np.bool_], NDArray[np.bool_]]:
        """(N,) what faces a direction (3,), what faces away, and what stands along it."""
        along = self.normal @ way
        return along > _FLAT, along < -_FLAT, np.abs(along) < _STEEP

    def share(self, part: NDArray[np.bool_]) -> float:
        """Of the surface, that a part (N,) of the points has."""
        return float(self.weight[part].sum())


def seen_surface(capture: Capture, cameras: Sequence[Camera], settings: ProxySettings) -> Seen:
    """What some of the cameras, in the capture's space, see of it; views from around where there are none."""
    maps, size = DepthMaps(capture, settings, middle=True), GUESS.upright_pixels
    chosen = [x.scaled(size / max(x.width, x.height)) for x in evenly(cameras, GUESS.upright_views)]
    views = chosen or around(capture.splats.means, capture.radius, GUESS.upright_views, size)
    grain = max(capture.spacing, GUESS.upright_grain * footprint(views, capture.splats.means))
    smooth = each(partial(slanted, noise=grain), [maps.of(x) for x in views])
    return Seen.of(smooth, around=not chosen)


def upright(seen: Seen, usual: F64 | None = None) -> Upright | None:
    """The direction that most of a surface speaks for; None where nothing speaks for one more than for others.

    Args:
        seen: the surface.
        usual: (3,) unit, up as a format mostly has it: of directions for which nearly as much speaks, one along it;
            None: any may be.
    """
    ways = lattice(GUESS.upright_ways)
    worth = np.array([_worth(seen, way) for way in ways])
    if not worth.max() > GUESS.upright_clear * np.median(worth):  # a ball, fog, or nothing is seen
        return None
    worth *= 1 + GUESS.upright_level * (1 - _spread(seen.eyes, ways))
    if usual is not None:
        worth *= _habit(ways, usual)
    best = int(np.argmax(worth))
    other = np.abs(ways @ ways[best]) < np.cos(np.radians(GUESS.upright_apart))
    way = _levelled(seen, ways[best])
    up, down, steep = seen.facing(way)
    side = _side(seen, way)
    doubt = ""
    if worth[other].max() * GUESS.upright_surer > worth[best]:
        doubt = "as much of the surface speaks for another way"
    elif side == 0:
        doubt = "nothing tells the floor from the ceiling"
    if side == 0:
        side = 1 if usual is None or way @ usual >= 0 else -1
    return Upright(side * way, seen.share(up | down | steep), doubt)


def levelled(seen: Seen, way: F64) -> F64:
    """The direction (3,) unit near one (3,) unit that floors face and walls stand along; that one where little of the
    surface does either, or another is far off.

    People roll their cameras by some degrees, and those that look down from one side lean all one way.
    """
    found = _levelled(seen, way)
    up, down, steep = seen.facing(found)
    sure = seen.share(up | down | steep) >= GUESS.upright_told and found @ way >= AGREE
    return found if sure else way


def _worth(seen: Seen, way: F64) -> float:
    """What speaks for a direction (3,)."""
    up, down, steep = map(seen.share, seen.facing(way))
    return 2 * (up + down if seen.around else up - down) + steep


def _habit(ways: F64, usual: F64) -> F64:
    """(M,) how likely directions (M, 3) are before anything is seen: most formats have one as up, some have Z."""
    near = np.cos(np.radians(GUESS.upright_usual))
    habit, other = GUESS.upright_habit
    return np.where(np.abs(ways @ usual) > near, habit, np.where(np.abs(ways[:, 2]) > near, other, 1.0))


def _spread(eyes: F64, ways: F64) -> F64:
    """(M,) how far eyes (E, 3) are apart along directions (M, 3), of the most: people hold a camera at one height."""
    apart = np.std(eyes @ ways.T, axis=0)
    return np.asarray(apart / max(float(apart.max()), 1e-30))


def _levelled(seen: Seen, way: F64) -> F64:
    """The direction (3,) near one that floors face and walls stand along best: least squares, again and again."""
    for _ in range(GUESS.upright_rounds):
        up, down, steep = seen.facing(way)
        flat, tall = ((seen.normal[x] * seen.weight[x, None]).T @ seen.normal[x] for x in (up | down, steep))
        _, vectors = np.linalg.eigh(tall - flat)
        way = vectors[:, 0] * np.sign(vectors[:, 0] @ way)
    return conventions.unit(way)


def _side(seen: Seen, way: F64) -> int:
    """1 where up is along a direction (3,), -1 where it is against it; 0: it is not told.

    As much may face down as up: a closed room's ceiling, or a floor that is seen from beneath, too. Things stand on a
    floor, and show their tops; ceilings may have steps and rims, which count as theirs.
    """
    up, down, _ = seen.facing(way)
    more, less = sorted((seen.share(up), seen.share(down)))[::-1]
    if more < GUESS.upright_floor:
        return 0
    if less < GUESS.upright_ceiling * more:
        return 1 if seen.share(up) > seen.share(down) else -1
    height = seen.at @ way
    floor, ceiling = float(np.median(height[up])), float(np.median(height[down]))
    tall = float(np.ptp(np.quantile(height, [0.01, 0.99])))
    if ceiling - floor < GUESS.upright_thin * tall:  # a sheet or a slab, from both sides
        higher = seen.share(height > floor + GUESS.upright_thin * tall)
        lower = seen.share(height < ceiling - GUESS.upright_thin * tall)
        return int(np.sign(higher - lower))
    between = np.abs(height - (floor + ceiling) / 2) < (0.5 - GUESS.upright_beside) * (ceiling - floor)
    along = seen.normal @ way
    tops, undersides = (seen.share(between & (x > GUESS.upright_wall)) for x in (along, -along))
    return int(np.sign(tops - undersides)) if tops + undersides >= GUESS.upright_things else 0

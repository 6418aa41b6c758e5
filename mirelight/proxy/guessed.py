"""Where a capture was taken from, guessed of its splats, where no one says it.

An optimiser begins with colours that do not depend on the view, and moves the view-dependent part of a splat by what
pictures show of it alone: so that part is largest in the directions that cameras saw it from, and small in all others.
Places that most splats are that large towards are where cameras stood: in the middle of a room, on a ring about a
thing, before a house, none beneath a floor. Where splats have one colour from all sides, or one that tells nothing,
places from which they look clear stand for them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from mirelight.base import colour, sh
from mirelight.base.errors import InputError
from mirelight.compositor import Compositor
from mirelight.model import F64, Camera, OwnSplats, SplatCloud
from mirelight.proxy.capture import Capture, look_at_capture
from mirelight.proxy.clear import ClearSplats
from mirelight.proxy.depth import DepthMap, DepthMaps
from mirelight.proxy.guess_tuning import GUESS
from mirelight.proxy.inside import hidden_share
from mirelight.proxy.one_picture import takers
from mirelight.proxy.sampling import far_apart
from mirelight.proxy.tuning import TUNING
from mirelight.proxy.types import ProxySettings
from mirelight.proxy.views import around, lattice, moved, placed

NAME = "guessed"  # of the cameras, before their number
Guess: TypeAlias = Callable[[], Sequence[Camera]]  # cameras in world space, when they are asked for


def guessed(splats: SplatCloud, capture: Capture, settings: ProxySettings) -> tuple[Camera, ...]:
    """Cameras in the capture's own space; none where nothing tells.

    Args:
        splats: world space, with their spherical harmonics.
        capture: what was seen in them.
        settings: of these the variant and its threads.
    """
    if pictures := takers(splats):
        return tuple(moved(picture, -capture.middle) for picture in pictures)
    if (colours := _by_colours(splats, capture)) and (cameras := _looking(colours, capture, settings)):
        return cameras
    return _clear(capture, settings)


def taken_from(splats: SplatCloud, settings: ProxySettings) -> tuple[Camera, ...]:
    """:func:`guessed`, in the splats' space; none of splats without a surface."""
    try:
        capture = look_at_capture(splats, "splats")
    except InputError:
        return ()
    return tuple(moved(camera, capture.middle) for camera in guessed(splats, capture, settings))


def taken_as_placed(own: OwnSplats, settings: ProxySettings) -> tuple[Camera, ...]:
    """:func:`taken_from`, found in the splats' own axes, in the world: the same ones wherever a job places them."""
    return tuple(placed(camera, own.world_from_own) for camera in taken_from(own.splats.value, settings))


class _Told(Protocol):
    """Splats that tell where they were seen from."""

    @property
    def means(self) -> F64:
        """(N, 3) in the capture's space."""

    @property
    def grid(self) -> int:
        """Places that are asked along the box's longest side."""

    @property
    def fewest(self) -> int:
        """Places that are asked in the box, flat as it may be; 0: however few."""

    @property
    def around(self) -> int:
        """Places around it, at each distance."""

    @property
    def share(self) -> float:
        """Of the best place's worth, that other places have."""

    def worth(self, place: F64) -> float:
        """How much speaks for a place (3,)."""

    def shown(self, place: F64) -> NDArray[np.bool_]:
        """(N,) which of them were seen from it."""


@dataclass(frozen=True, slots=True, eq=False)
class _Colours:
    """By colours that depend on the view."""

    means: F64
    rest: F64  # (N, K) their view-dependent part, of which the square's mean over all directions is 1
    degree: int
    grid: int
    fewest: int
    around: int
    share: float

    def worth(self, place: F64) -> float:
        return float(np.median(self._large(place)))

    def shown(self, place: F64) -> NDArray[np.bool_]:
        return self._large(place) > 1

    def _large(self, place: F64) -> F64:
        """(N,) how large that part is, squared, in the directions that they are seen along from a place."""
        basis = sh.basis(_ways(place, self.means), self.degree)[:, 1:]
        return np.asarray((basis * self.rest).sum(axis=1) ** 2)


@dataclass(frozen=True, slots=True, eq=False)
class _Layers:
    """By how clear they look."""

    means: F64
    clear: ClearSplats
    grid: int
    fewest: int
    around: int
    share: float

    def worth(self, place: F64) -> float:
        return self.clear.worth(place)

    def shown(self, place: F64) -> NDArray[np.bool_]:
        return self.clear.shown(place, self.means)


def _ways(place: F64, points: F64) -> F64:
    """(N, 3) unit directions from a place (3,) to points (N, 3)."""
    away = points - place
    return np.asarray(away / np.maximum(np.linalg.norm(away, axis=1, keepdims=True), 1e-30))


def _by_colours(splats: SplatCloud, capture: Capture) -> _Colours | None:
    degree = sh.degree_of(splats.sh.shape[1])
    if degree == 0:
        return None
    means = splats.means.astype(np.float64) - capture.middle
    rows = _asked(means, splats, capture, (splats.sh[:, 1:] != 0).any(axis=(1, 2)))
    if len(rows) < GUESS.guess_fewest:
        return None
    rest = (splats.sh[rows, 1:].astype(np.float64) * colour.REC709_LUMINANCE).sum(axis=2)
    size = np.sqrt((rest**2).sum(axis=1, keepdims=True) / (4 * np.pi))
    large = rest / np.maximum(size, 1e-30)
    return _Colours(means[rows], large, degree, GUESS.guess_grid, 0, GUESS.guess_around, GUESS.guess_worth)


def _by_layers(capture: Capture, settings: ProxySettings) -> _Layers | None:
    means = capture.splats.means.astype(np.float64)
    rows = _asked(means, capture.splats, capture, True)
    if len(rows) < GUESS.guess_fewest:
        return None
    clear = ClearSplats(capture, settings)
    return _Layers(means[rows], clear, GUESS.clear_grid, GUESS.clear_fewest, GUESS.clear_around, GUESS.clear_worth)


def _asked(means: F64, splats: SplatCloud, capture: Capture, part: NDArray[np.bool_] | bool) -> NDArray[np.int64]:
    """(M,) rows of some splats of a part (N,) that are opaque and not far off; means (N, 3) in the capture's space."""
    near = (np.abs(means) <= capture.half).all(axis=1) & (splats.opacities > GUESS.guess_opaque)
    rows = np.flatnonzero(near & part)
    return rows[:: max(len(rows) // GUESS.guess_sample, 1)]


def _looking(told: _Told, capture: Capture, settings: ProxySettings) -> tuple[Camera, ...]:
    views = _views(told, _places(told, capture, settings))
    return tuple(_camera(place, way, capture, f"{NAME}-{i}") for i, (place, way) in enumerate(views))


def _clear(capture: Capture, settings: ProxySettings) -> tuple[Camera, ...]:
    """Cameras where it looks clear; none where surfaces are as thin layers from around, or nearly, or are thin enough
    there and all seen; nor where those places hide more.

    From inside of a thing they are thicker, though it fills all directions: nothing told how it is in there. In a
    hollow one, as a plinth, they may be thin, but it hides all else.
    """
    if (layers := _by_layers(capture, settings)) is None:
        return ()
    maps = DepthMaps(capture, settings)
    outer = [maps.of(x) for x in around(capture.splats.means, capture.radius, GUESS.clear_judged, GUESS.clear_size)]
    sure = _trust(outer)
    hidden = hidden_share(capture, outer)
    amid, about = GUESS.clear_surer
    needed = sure * (amid if hidden > GUESS.clear_amid else about)
    enough, little = GUESS.clear_alone
    if needed > GUESS.clear_most or (sure > enough and hidden < little):
        return ()
    cameras = _looking(layers, capture, settings)
    views = [maps.of(x.scaled(GUESS.clear_size / x.width)) for x in cameras]
    clear = _trust(views[:: -(-len(views) // GUESS.clear_judged) or 1]) > needed
    return cameras if clear and hidden_share(capture, views) < hidden + GUESS.clear_hidden else ()


def _trust(views: Sequence[DepthMap]) -> float:
    """The median view's mean over its opaque pixels; 0 where there are none."""
    means = [float(x.mean()) if len(x := v.trust[v.alpha > TUNING.depth_opaque]) else 0.0 for v in views]
    return float(np.median(means or [0.0]))


def _places(told: _Told, capture: Capture, settings: ProxySettings) -> F64:
    """(P, 3) places, far from each other, none inside of a thing."""
    shells = list(_candidates(capture, told))
    worths = [np.array([told.worth(place) for place in shell]) for shell in shells]
    best = max(float(x.max()) for x in worths)
    if worths[-1].max() > GUESS.guess_alone * best:
        # a thing alone: directions tell all, and people stood as far off as shows all of it
        candidates, worth = shells[-1], worths[-1]
    else:
        # far off, a place is told by its direction alone: nearer ones that are as good show more
        farthest = next(k for k, x in enumerate(worths) if x.max() > GUESS.guess_near * best)
        candidates, worth = (np.concatenate(x[: farthest + 1]) for x in (shells, worths))
    if best < GUESS.guess_clear * float(np.median(worth)):
        return np.zeros((0, 3))
    left = _some(candidates[worth > told.share * best], GUESS.guess_tried)
    return _some(_with_room(left, capture, settings), GUESS.guess_places)


def _some(places: F64, most: int) -> F64:
    """Of places (P, 3) so many, far from each other."""
    if not len(places):
        return places
    middle = int(np.argmin(np.linalg.norm(places - places.mean(axis=0), axis=1)))
    return places[far_apart(places, middle, min(most, len(places)))]


def _camera(place: F64, way: F64, capture: Capture, name: str) -> Camera:
    size = GUESS.guess_pixels
    return Camera.look_at(place, place + way, size, size, yfov=GUESS.guess_yfov, near=1e-3 * capture.radius, name=name)


def _with_room(places: F64, capture: Capture, settings: ProxySettings) -> F64:
    """(Q, 3) of the places (P, 3) those not inside of things: there all that is seen is far nearer than elsewhere."""
    compositor = Compositor(capture.splats, variant=settings.variant, threads=settings.threads)
    nearest, middle = [], []
    for place in places:
        views = (_camera(place, way, capture, "") for way in lattice(GUESS.guess_sides))
        depth = np.concatenate([compositor.composite(x.scaled(GUESS.guess_small)).median_depth.ravel() for x in views])
        seen = depth[depth > 0]
        nearest.append(float(np.quantile(seen, 0.1)) if len(seen) else 0.0)
        middle.append(float(np.median(seen)) if len(seen) else 0.0)
    return places[np.array(nearest) > GUESS.guess_room * np.median(middle or [0.0])]


def _candidates(capture: Capture, told: _Told) -> Iterator[F64]:
    """(N, 3) of places in a box about the capture, no flatter than a person stands high, and around it.

    The box lies as the capture does, whose file may have any axes. Where few places are asked, and what is coarse, as
    what was seen far off, reaches far beyond the rest, a box about what people stood near comes first.
    """
    means = capture.splats.means.astype(np.float64)
    whole = _box(means, GUESS.guess_stray)
    if told.fewest:
        size = np.sort(capture.splats.scales, axis=1)[:, 1]
        near = _box(means[size <= np.median(size)], GUESS.clear_far)
        if near.half.max() < GUESS.clear_near * whole.half.max():
            yield near.places(told)
    yield whole.places(told)
    for away in GUESS.guess_away:
        yield away * capture.radius * lattice(told.around)


@dataclass(frozen=True, slots=True, eq=False)
class _Box:
    """Around most of some points, along their own axes."""

    axes: F64  # (3, 3) columns
    middle: F64  # (3,) along them
    half: F64  # (3,)

    def places(self, told: _Told) -> F64:
        """(N, 3) on a grid, in a box no flatter than a person stands high."""
        longest = float(self.half.max())
        wide = np.maximum(self.half, GUESS.guess_flat * longest)
        step = 2 * longest / told.grid
        if told.fewest:
            step = min(step, 2 * float(np.cbrt(wide.prod() / told.fewest)))
        lines = [m + np.arange(-h + step / 2, h, step) for m, h in zip(self.middle, wide, strict=True)]
        return np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1).reshape(-1, 3) @ self.axes.T


def _box(points: F64, stray: float) -> _Box:
    """Of points (N, 3) all but a share at either end."""
    _, axes = np.linalg.eigh(np.cov(points.T))
    low, high = np.quantile(points @ axes, [stray, 1 - stray], axis=0)
    return _Box(axes, (low + high) / 2, (high - low) / 2)


def _views(told: _Told, places: F64) -> Iterator[tuple[F64, F64]]:
    """Places (3,) and unit directions of views: each shows as much as it can of what those before it show least of."""
    ways = lattice(GUESS.guess_ways)
    narrow = np.cos(np.radians(GUESS.guess_yfov / 2))
    shown = []  # by view: the splats that it shows
    for place in places:
        away, there = _ways(place, told.means), told.shown(place)
        shown += [there & ((away * way).sum(axis=1) > narrow) for way in ways]
    seen, times = np.array(shown, np.float32).reshape(-1, len(told.means)), np.zeros(len(told.means), np.float32)
    for _ in range(min(GUESS.guess_views, len(seen))):
        worth = (seen / (1 + times)).sum(axis=1)
        k = int(np.argmax(worth))
        times += seen[k]
        seen[k] = 0
        yield places[k // len(ways)], ways[k % len(ways)]

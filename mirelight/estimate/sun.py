"""Where the sun stood: directions over the whole sphere, each with the sky's level and the sun's share free."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mirelight.base.colour import REC709_LUMINANCE
from mirelight.base.conventions import frame_around
from mirelight.estimate.edges import Spoken
from mirelight.estimate.fit import Fitted, Pairs, compared, light_of, surely
from mirelight.estimate.sky import apart, refined, sphere
from mirelight.estimate.transport import Places
from mirelight.estimate.tuning import TUNING
from mirelight.model import F64

_AT_ONCE = 250  # directions
_STRIDE = 5  # no divisor of either number of points: which point of the splat goes with which of the disc

_WAVELENGTHS = np.array([0.61, 0.55, 0.465])  # micrometres, that Rec.709 red, green and blue stand for


@dataclass(frozen=True, slots=True, eq=False)
class Search:
    """What the search compares: places in luminance."""

    places: Places
    pairs: Pairs
    weights: F64  # (P,)
    bound: NDArray[np.bool_]  # (2, P) where one or the other of a pair shows white: it may have been any brighter
    log_color: F64  # (N,)
    sky: F64  # (N,) open share of the view
    met: F64  # (N,)
    mean: float  # of the colour

    @staticmethod
    def of(places: Places, pairs: Pairs) -> Search:
        """Over all places that the pairs name."""
        color = places.color @ REC709_LUMINANCE.astype(np.float64)
        log = np.log(places.color)
        bound = np.asarray(pairs.clipped.any(axis=1))
        return Search(
            places=places,
            pairs=pairs,
            weights=pairs.weights(log),
            bound=np.stack([bound[pairs.a], bound[pairs.b]]),
            log_color=np.log(color),
            sky=places.open.sum(axis=1),
            met=places.met @ REC709_LUMINANCE.astype(np.float64),
            mean=float(color.mean()),
        )

    def apart(self, log_albedo: F64) -> F64:
        """(P,) how far albedos (N,) surely differ."""
        return surely(log_albedo[self.pairs.a] - log_albedo[self.pairs.b], *self.bound)

    def even(self) -> F64:
        """(N,) irradiance / pi without a sun, at a middle albedo."""
        level = self.mean / TUNING.sun_albedos[1]
        direct = max(level - self.met.mean(), 0.1 * level)
        return np.asarray(self.met + direct * self.sky / max(self.sky.mean(), 1e-9) + TUNING.fit_floor * level)

    def wanted(self) -> F64:
        """(N,) by how much more light at each place, in proportion to what there is, would make albedos more alike."""
        light, pairs = self.even(), self.pairs
        d = self.apart(self.log_color - np.log(light))
        pull = self.weights * d / (d * d + TUNING.sun_wide**2) ** 2
        n = len(light)
        return np.asarray(np.bincount(pairs.a, pull, n) - np.bincount(pairs.b, pull, n))

    def promise(self, seen: F64) -> F64:
        """(D,) how well the change that lights (D, N) bring, each as bright as all that there is, is what is wanted.
        Next to a lamp more light counts no more than twice the light that there is."""
        changed = seen / self.even()
        changed = np.log1p(changed / np.maximum(changed.mean(axis=1, keepdims=True), 1e-12))
        return np.asarray(changed @ self.wanted() / np.maximum(changed.std(axis=1), 1e-12))

    def rough(self, seen: F64) -> float:
        """The least of a few losses of :meth:`losses`, of a sun of these cosines (N,)."""
        return float(self.losses(seen, TUNING.sun_albedos[1:2], TUNING.sun_shares[1:4:2]).min())

    def losses(
        self, seen: F64, albedos: Sequence[float] = TUNING.sun_albedos, shares: Sequence[float] = TUNING.sun_shares
    ) -> F64:
        """(A, S) losses with a sun of these cosines (N,), by the mean albedo and the sun's share."""
        out = np.empty((len(albedos), len(shares)))
        sky, sun = self.sky / max(self.sky.mean(), 1e-9), seen / max(seen.mean(), 1e-9)
        for i, albedo in enumerate(albedos):
            level = self.mean / albedo
            direct = max(level - self.met.mean(), 0.1 * level)
            for k, share in enumerate(shares):
                light = self.met + direct * ((1 - share) * sky + share * sun) + TUNING.fit_floor * level
                d = self.apart(self.log_color - np.log(light))
                d *= d
                out[i, k] = (self.weights * (d / (d + TUNING.fit_robust**2))).sum()
        return out


@dataclass(frozen=True, slots=True, eq=False)
class Sun:
    """A direction, and what speaks for it."""

    to_sun: F64  # (3,) unit
    radius: float  # degrees
    seen: F64  # (N,) cosine times the visible share of the disc
    loss: float
    start: tuple[float, float]  # mean albedo and share of the sun that it was found with
    # degrees: none of these surely explains less, as far as was asked
    radii: tuple[float, float] = (0.0, TUNING.sun_radii[-1])
    least_said: float = -np.inf  # where it may be moved to: what shadows' edges say there at least
    sure: bool = False  # they tell this one and no other

    @property
    def begin(self) -> tuple[float, float]:
        """Mean albedo and share that a fit begins with: one that is surely there fades away if it begins weakly."""
        return TUNING.even if self.sure and self.start[1] < TUNING.even[1] else self.start

    @property
    def by_edges(self) -> bool:
        """Whether shadows' edges tell where it is."""
        return bool(np.isfinite(self.least_said))


def search(of: Search) -> tuple[Sun, ...]:
    """Suns that may have shone: the best of all directions, refined, each with the disc that suits it; none where no
    sun reaches places.

    Through windows, and through the leaks of a proxy, a sun a few degrees off lights the wrong places, so directions
    are close; those are tried whose light lies where a little more of it would make albedos more alike.
    """
    directions = sphere(TUNING.sun_directions)
    promise = np.full(TUNING.sun_directions, -np.inf)
    for first in range(0, TUNING.sun_directions, _AT_ONCE):
        rows = slice(first, first + _AT_ONCE)
        seen = of.places.facing(directions[rows])
        promise[rows] = np.where(reaches(seen), of.promise(seen), -np.inf)
    tried = np.argsort(-promise, kind="stable")[: TUNING.sun_tried]
    tried = tried[np.isfinite(promise[tried])]
    if not len(tried):
        return ()

    def losses(near: F64) -> F64:
        return np.array([of.losses(one).min() if reaches(one) else np.inf for one in of.places.facing(near)])

    rough = np.array([of.rough(one) for one in of.places.facing(directions[tried])])
    starts = apart(directions[tried], rough, TUNING.sun_starts, TUNING.sun_starts_apart)
    return tuple(_with_disc(of, refined(losses, directions[tried[k]], TUNING.sun_steps, 4)[0]) for k in starts)


def reaches(seen: F64) -> NDArray[np.bool_]:
    """(...,) whether a sun of cosines (..., N) lights enough of the places to be told by them."""
    return np.asarray((seen > 0).mean(axis=-1) >= TUNING.sun_least_lit)


def voted(of: Search, edges: Spoken, most: int) -> tuple[Sun, ...]:
    """The suns for which shadows' edges speak most, with a disc to start from: on a proxy that hides a sun from the
    search its edges tell none."""
    return tuple(
        replace(_with_disc(of, way, (TUNING.sun_voted_radius,)), least_said=score - TUNING.sun_said, sure=edges.sure)
        for way, score in zip(edges.ways[:most], edges.scores[:most], strict=True)
    )


def _with_disc(of: Search, way: F64, tried: Sequence[float] = TUNING.sun_radii) -> Sun:
    best: Sun | None = None
    for radius in tried:
        seen = disc(of.places, way, radius)
        losses = of.losses(seen)
        i, k = np.unravel_index(int(losses.argmin()), losses.shape)
        if best is None or losses[i, k] < best.loss:
            best = Sun(way, radius, seen, float(losses[i, k]), (TUNING.sun_albedos[i], TUNING.sun_shares[k]))
    assert best is not None
    return best


def disc(
    places: Places, way: F64, radius: float, points: int = TUNING.sun_disc, across: float = TUNING.sun_across
) -> F64:
    """(N,) the mean of cosine where it is seen, over a disc around a direction and over each splat: at a shadow's edge
    a splat shows a mean of light and shadow, and taken for either it makes the sun too weak."""
    k = np.arange(points)
    s = np.sin(np.radians(radius)) * np.sqrt((k + 0.5) / points)
    phi = k * np.pi * (3 - np.sqrt(5.0))
    local = np.stack([s * np.cos(phi), s * np.sin(phi), np.sqrt(1 - s * s)], axis=-1)
    r = across * np.sqrt((k * _STRIDE % points + 0.5) / points)
    aside = np.stack([r * np.cos(-2 * phi), r * np.sin(-2 * phi)], axis=-1)
    return np.asarray(places.facing(np.einsum("dk,kj->dj", local, frame_around(way)), aside).mean(axis=0))


def lit(places: Places, seen: F64, way: F64) -> NDArray[np.bool_]:
    """(N,) places that see most of a sun in a direction: of their cosine, what :func:`disc` has."""
    return np.asarray(seen > TUNING.sun_mostly * np.maximum(places.normals @ way, TUNING.sun_changed))


def agreeing(places: Places, pairs: Pairs, found: Sun, seen: F64, light: F64, beam: F64) -> NDArray[np.bool_]:
    """(N,) places at which the picture has sun and shadow where the proxy has them: what they show is no more like
    what others show if the one is taken for the other.

    Args:
        places, pairs: which others.
        found: the sun.
        seen: (N,) its :func:`disc`.
        light: (N, 3) irradiance / pi with it.
        beam: (3,) that of it on a facing surface.
    """
    cosine = np.maximum(places.normals @ found.to_sun, 0)
    other = np.where(lit(places, seen, found.to_sun), 0.0, cosine)
    floor = TUNING.fit_floor * light.mean()
    own = np.log(places.color) - np.log(light + floor)
    turned = np.log(places.color) - np.log(np.maximum(light + (other - seen)[:, None] * beam, 0) + floor)
    agree = pairs.alike(own, own) >= pairs.alike(turned, own)
    return np.asarray(agree | (cosine < TUNING.sun_changed))


def firm(places: Places, found: Sun) -> NDArray[np.bool_]:
    """(N,) places whose share of the sun does not change around them. On a shadow's edge a proxy that is a little wrong
    has light where the picture has shadow, and the other way round, and that makes the sun too weak. All places where
    those in the sun mostly show white, as then its edges alone tell how strong it is; or where few are left."""
    inside, around = (disc(places, found.to_sun, found.radius, across=across) for across in (0.0, TUNING.sun_around))
    cosine = np.abs(places.normals @ found.to_sun)
    rows = np.abs(inside - around) <= TUNING.sun_changed * cosine
    second = np.sort(places.color, axis=1)[:, 1]  # two channels that are whole tell chroma and strength
    white = second[rows & (inside > 0.5 * cosine)] >= TUNING.fit_white_out
    if rows.mean() < TUNING.sun_fewest or not len(white) or white.mean() > TUNING.sun_white:
        return np.ones(len(places), bool)
    return np.asarray(rows)


def moved(places: Places, pairs: Pairs, found: Sun, light: Fitted, edges: Spoken) -> Sun:
    """The sun at the direction, and with the disc, that explain the colours best with the radiances held.

    One that edges tell stays where they say about as much: bumps of a proxy pull it to where they are lit more alike.

    The disc is the median of those tried, each as likely as by how many standard errors it explains less than the best:
    where the proxy misfits, shadows' edges tell little, and the least loss is by chance that of a far too sharp one.
    """
    others = light.beams[1 : 1 + places.named.shape[1]]
    sky = light_of(places.open, places.met, places.named, light.sky, others)

    def losses(seen: F64) -> F64:
        return compared(places.color, sky + seen[:, None] * light.beams[0], pairs)

    def all_losses(near: F64) -> F64:
        seen = (disc(places, one, found.radius, TUNING.sun_few) for one in near)
        out = np.array([losses(one).sum() if reaches(one) else np.inf for one in seen])
        if found.by_edges:
            out[edges.score(near) < found.least_said] = np.inf
        return out

    way, _ = refined(all_losses, found.to_sun, TUNING.sun_steps[1:], 3)
    middle = TUNING.sun_radii.index(found.radius)
    radii = np.array(TUNING.sun_radii[max(middle - TUNING.sun_near, 0) : middle + TUNING.sun_near + 1])
    if found.by_edges:  # there is a sun
        radii = radii[radii <= TUNING.widest_sun]
    more, error = _compared_to_best(
        np.stack([losses(disc(places, way, r)) for r in radii]), _blocks(places.points)[pairs.a]
    )
    off = more / np.maximum(error, 1e-12)
    likely, maybe = np.cumsum(np.exp(-0.5 * off**2)), radii[off <= TUNING.sun_surely]
    radius = float(radii[np.searchsorted(likely, 0.5 * likely[-1])])
    return replace(found, to_sun=way, radius=radius, radii=(float(maybe.min()), float(maybe.max())))


def _compared_to_best(losses: F64, block: NDArray[np.int64]) -> tuple[F64, F64]:
    """Of losses (R, P) in R ways, by how much each sum exceeds the least, and that difference's standard error.

    As of blocks of pairs (P,), which differ as places elsewhere would (the grouped jackknife of a sum): pairs that
    share a place or a surface err alike.
    """
    more = losses - losses[int(losses.sum(axis=1).argmin())]
    count = int(block.max()) + 1
    parts = np.stack([np.bincount(block, one, count) for one in more])
    error = np.sqrt(count / max(count - 1, 1) * ((parts - parts.mean(axis=1, keepdims=True)) ** 2).sum(axis=1))
    return np.asarray(parts.sum(axis=1)), np.asarray(error)


def _blocks(points: F64) -> NDArray[np.int64]:
    """(N,) which of 32 blocks of about as many points each of points (N, 3) is in: halves across the longest side,
    halved again."""
    parts = [np.arange(len(points))]
    for _ in range(TUNING.sun_blocks):
        parts = [half for rows in parts for half in _halves(points, rows)]
    out = np.zeros(len(points), np.int64)
    for k, rows in enumerate(parts):
        out[rows] = k
    return out


def _halves(points: F64, rows: NDArray[np.int64]) -> list[NDArray[np.int64]]:
    if len(rows) < 2:
        return [rows]
    axis = int(np.argmax(np.ptp(points[rows], axis=0)))
    return np.array_split(rows[np.argsort(points[rows, axis], kind="stable")], 2)


def most(places: Places, seen: F64, to_sun: F64) -> float:
    """The strongest that a sun may be, by what the places show that it lights: under more, half of them would be darker
    than anything. Where these are few, hardly anything else bounds it.

    Args:
        places: all of them.
        seen: (N,) the sun's :func:`disc`.
        to_sun: (3,) unit.

    Returns:
        Irradiance / pi of a facing surface; infinite where none is lit.
    """
    rows = lit(places, seen, to_sun)
    if not rows.any():
        return np.inf
    return float(np.median(places.color[rows].max(axis=1) / seen[rows])) / TUNING.fit_dark


def sunlight(places: Places, pairs: Pairs, seen: F64, to_sun: F64) -> F64 | None:
    """(3,) the colour that a sun is taken to have, where it brings places `seen` (N,); None: most of them show white,
    which hides it."""
    white = pairs.clipped[np.flatnonzero(lit(places, seen, to_sun))]
    return color_of(to_sun) if len(white) and white.any(axis=1).mean() < TUNING.sun_white else None


def color_of(to_sun: F64) -> F64:
    """(3,) linear Rec.709 up to a factor: sunlight from that direction (3,), +Y up, as cameras show it.

    Less blue comes through the air the lower the sun stands: Rayleigh scattering (Leckner, The spectral distribution of
    solar radiation at the earth's surface, 1978) and haze (Ångström's law), by the air mass of Kasten and Young (1989).
    """
    elevation = float(np.degrees(np.arcsin(np.clip(to_sun[1], 0, 1))))
    mass = 1 / (np.sin(np.radians(elevation)) + 0.50572 * (elevation + 6.07995) ** -1.6364)
    depth = 0.008735 * _WAVELENGTHS**-4.08 + TUNING.sun_haze * _WAVELENGTHS**-1.3
    return np.asarray(np.exp(-depth * (min(mass, TUNING.sun_most_air) - TUNING.sun_white_air)))

"""What each place on the proxy gets of the sky's patches, of other surfaces as they were captured, and of a sun.

Captured radiance is the indirect light: what a ray meets on another surface is the splats' own colour there. So light
is linear in the sky and the sun, in absolute units, whatever the albedo.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mirelight.base.conventions import frame_around
from mirelight.base.errors import RenderError
from mirelight.estimate.around import evened
from mirelight.estimate.shade import Shade
from mirelight.estimate.sky import PATCHES, patch_of
from mirelight.estimate.tuning import TUNING
from mirelight.lighting import Tracer
from mirelight.lighting.albedo import face_normals
from mirelight.lighting.observed import Deposits, observed
from mirelight.lighting.sight import Sight
from mirelight.model import F64, Light, Lighting, ProxyMesh, RenderSettings, SplatCloud, SplatLayer
from mirelight.model.scene import SOLID

_CHUNK = 1 << 20  # rays at once


@dataclass(frozen=True, slots=True, eq=False)
class Close:
    """Places, N of them and as close as the capture shows them, that nothing but their colour is known of."""

    color: F64  # (N, 3) linear
    points: F64  # (N, 3) world units, just off the surface
    normals: F64  # (N, 3) unit, towards the side that was seen
    sight: Sight  # for shadow rays

    def __len__(self) -> int:
        return len(self.color)

    def taken(self, rows: NDArray[np.int64]) -> Close:
        """The places of some rows (M,) alone."""
        return replace(self, color=self.color[rows], points=self.points[rows], normals=self.normals[rows])


@dataclass(frozen=True, slots=True, eq=False)
class Places:
    """Splats where they lie on the proxy, N of them, and what light reaches them from where.

    Irradiance / pi at place n is `open[n] @ radiance + met[n] + sun.shadows(...) @ sun`.
    """

    color: F64  # (N, 3) linear, the splats' own
    even: F64  # (N, 3) linear, the mean of the splats around: less of texture and noise, but no sharp shadows
    points: F64  # (N, 3) world units, just off the surface
    normals: F64  # (N, 3) unit, towards the side that was seen
    spread: F64  # (N, 2, 3) world units: a standard deviation of the splat along the surface, both ways
    open: F64  # (N, PATCHES) share of the cosine-weighted hemisphere that sees each patch of the sky
    met: F64  # (N, 3) linear: what the hemisphere's other part shows
    guessed: F64  # (N,) share of that part that no splat shows, so that its colour is of what lies beside it, 0..1
    named: F64  # (N, L) irradiance / pi that comes straight from each light that is known to have been there, at 1
    close: Close  # more places, as a whole even where these are some of them

    @property
    def sight(self) -> Sight:
        """For shadow rays."""
        return self.close.sight

    def __len__(self) -> int:
        return len(self.color)

    @property
    def blocked(self) -> float:
        """Share of the view that other surfaces take, 0..1."""
        return float(1 - self.open.sum(axis=1).mean())

    def taken(self, rows: NDArray[np.int64]) -> Places:
        """The places of some rows (N,) alone."""
        return replace(
            self,
            color=self.color[rows],
            even=self.even[rows],
            points=self.points[rows],
            normals=self.normals[rows],
            spread=self.spread[rows],
            open=self.open[rows],
            met=self.met[rows],
            guessed=self.guessed[rows],
            named=self.named[rows],
        )

    def facing(self, to_sun: F64, aside: F64 | None = None) -> F64:
        """(D, N) cosine towards each of D unit directions where nothing stands between, else 0.

        Args:
            to_sun: (D, 3).
            aside: (D, 2) where on the splats, in standard deviations; None: in their middle.
        """
        cosine = np.einsum("dk,nk->dn", to_sun, self.normals)
        out = np.zeros_like(cosine)
        d, n = np.nonzero(cosine > 1e-3)
        for first in range(0, len(d), _CHUNK):
            a, b = d[first : first + _CHUNK], n[first : first + _CHUNK]
            origins = self.points[b]
            if aside is not None:
                origins = origins + np.einsum("rj,rjk->rk", aside[a], self.spread[b])
            out[a, b] = np.where(self.sight.blocked(origins, to_sun[a]), 0.0, cosine[a, b])
        return np.asarray(out)


@dataclass(frozen=True, slots=True, eq=False)
class _Shown:
    """What colour the surface was captured with, anywhere on it: that of the nearest splat on the same side.

    A splat's colour is the median of those around it. In dark places single splats show many times what their light
    allows, bled from what is bright beside them: as they were, they made what rays meet too bright by a tenth, and with
    it all of the light.

    Nor does a splat show what lies in a corner beside it, or on the back of what it shows. So a colour is darker where
    an even sky would bring less light than to the splats that it is taken from; but not in rooms, whose light is no
    sky's.
    """

    tree: Any  # of places lifted off the surface, so that the sides of a thin wall are told apart
    normals: F64  # (M, 3) unit, towards the side that was seen
    color: F64  # (M, 3) linear
    lift: float
    even: F64  # (M,) irradiance / pi that an even sky of radiance 1 brings
    shade: Shade | None  # None: a room, seen from inside

    @staticmethod
    def of(
        deposits: Deposits, mesh: ProxyMesh, tracer: Tracer, sight: Sight, lift: float, rng: np.random.Generator
    ) -> _Shown:
        """Of splats on the mesh."""
        from scipy.spatial import cKDTree

        points, normals = deposits.on(mesh)
        whole = _whole(deposits, normals)  # black ones too: without them what rays meet would be too bright
        points, normals = points[whole], normals[whole]
        normals = _seen_side(points, normals, face_normals(mesh), sight, lift, rng)
        apart = 10 * lift
        tree = cKDTree(points + apart * normals)
        _, near = tree.query(tree.data, k=[*range(1, min(TUNING.place_agree, len(points)) + 1)], workers=-1)
        shade = Shade.of(tracer, mesh)
        even = shade.at(points, normals)
        is_room = even.mean() < TUNING.doubt_open
        color = np.median(deposits.color[whole][near], axis=1)
        return _Shown(tree, normals, color, apart, even[near].mean(axis=1), None if is_room else shade)

    def at(self, points: F64, normals: F64, way: F64) -> tuple[F64, NDArray[np.bool_]]:
        """(N, 3) at points of faces with those normals, met along directions; (N,) where no splat shows the face."""
        toward = -np.sign(np.einsum("nk,nk->n", normals, way))[:, None] * normals
        _, nearest = self.tree.query(points + self.lift * toward, workers=-1)
        color = self.color[nearest]
        if self.shade is not None:
            less = (self.shade.of_cells(points, toward) + TUNING.shade_floor) / (
                self.even[nearest] + TUNING.shade_floor
            )
            color = color * np.minimum(less / TUNING.shade_surely, 1)[:, None]
        return color, np.einsum("nk,nk->n", self.normals[nearest], toward) < TUNING.place_facing


def _whole(deposits: Deposits, normals: F64) -> NDArray[np.bool_]:
    return np.asarray((deposits.weight > 0) & (np.linalg.norm(normals, axis=1) > 0.5))


def _sound(deposits: Deposits, normals: F64) -> NDArray[np.bool_]:
    return np.asarray(_whole(deposits, normals) & (deposits.color.min(axis=1) > TUNING.place_darkest))


def places_of(
    splats: SplatCloud,
    proxy: ProxyMesh,
    settings: RenderSettings,
    lights: Sequence[Light] = (),
    views: Sequence[SplatLayer] = (),
) -> Places:
    """Rays from splats through the proxy.

    Args:
        splats: world space.
        proxy: world space; its own colours count for nothing.
        settings: seed, variant and threads.
        lights: that are known to have been there.
        views: as for :func:`mirelight.lighting.colored_by`.

    Raises:
        RenderError: fewer than `TUNING.place_fewest` splats show, lie on the proxy and have a colour.
        BackendError: the variant cannot be used on this machine.
    """
    _refuse_few(splats)
    mesh = replace(proxy, vertex_colors=None, albedo=np.full(3, TUNING.mean_albedo))
    tracer = Tracer(mesh, replace(settings, max_depth=TUNING.shade_depth), layers=False, aovs=False)
    seen = observed(splats, views, mesh, tracer)
    few = seen.deposits(TUNING.place_count)
    points, normals = few.on(mesh)
    sound = _sound(few, normals)
    if sound.sum() < TUNING.place_fewest:
        raise RenderError(
            f"{int(sound.sum())} splats lie on the proxy and show a colour, too few to tell the captured light from; "
            "check that both are of one scene, or describe the light in the job"
        )
    color, points, normals = few.color[sound], points[sound], normals[sound]
    low, high = mesh.bounds
    lift = TUNING.place_lift * float(np.linalg.norm(high.astype(np.float64) - low))
    sight = tracer.sight()
    rng = np.random.default_rng(settings.seed)
    facing = face_normals(mesh)
    shown = _Shown.of(seen.deposits(TUNING.place_shown), mesh, tracer, sight, lift, rng)
    normals = _seen_side(points, normals, facing, sight, lift, rng)
    close = _close(seen.deposits(TUNING.edge_places), mesh, sight, lift, rng)
    spread = _along(few.spread[sound], normals, TUNING.place_most_spread / TUNING.place_lift * lift)
    # single splats are uneven; colours of pictures are medians of many pixels
    even = color if views else np.maximum(evened(seen.samples, color, points, normals, spread), TUNING.place_darkest)
    start = points + lift * normals
    around, met, guessed = np.zeros((len(start), PATCHES)), np.zeros((len(start), 3)), np.zeros(len(start))
    step = max(_CHUNK // TUNING.place_rays, 1)
    for first in range(0, len(start), step):
        rows = slice(first, first + step)
        directions = cosine_directions(normals[rows], TUNING.place_rays, rng)
        origins = np.repeat(start[rows], TUNING.place_rays, axis=0)
        face, distance = sight.first_hits(origins, directions.reshape(-1, 3))
        hit = (face >= 0).reshape(directions.shape[:2])
        row, ray = np.nonzero(~hit)
        np.add.at(around[rows], (row, patch_of(directions[row, ray])), 1 / TUNING.place_rays)
        flat = np.flatnonzero(hit.ravel())
        way = directions.reshape(-1, 3)[flat]
        met_color, unseen = shown.at(origins[flat] + way * distance[flat, None], facing[face[flat]], way)
        place = flat // TUNING.place_rays
        for k in range(3):
            met[rows, k] = np.bincount(place, met_color[:, k], minlength=len(hit)) / TUNING.place_rays
        guessed[rows] = np.bincount(place, unseen, minlength=len(hit)) / np.maximum(hit.sum(axis=1), 1)
    # the noise of few rays through windows is worth as much as the light: less of it would look better explained
    rays = min(int(TUNING.place_going_out / max(float(around.sum(axis=1).mean()), 1e-9)), TUNING.place_most_rays)
    if rays > 1.5 * TUNING.place_rays:
        around = _open(start, normals, sight, rays, rng)
    named = _from_lights(replace(mesh, albedo=np.zeros(3)), lights, points, normals, settings)
    return Places(
        color=color,
        even=even,
        points=start,
        normals=normals,
        spread=spread,
        open=around,
        met=met,
        guessed=guessed,
        named=named,
        close=close,
    )


def _close(deposits: Deposits, mesh: ProxyMesh, sight: Sight, lift: float, rng: np.random.Generator) -> Close:
    """What a capture shows of the mesh, as it is."""
    points, normals = deposits.on(mesh)
    sound = _sound(deposits, normals)
    points, normals = points[sound], normals[sound]
    normals = _seen_side(points, normals, face_normals(mesh), sight, lift, rng)
    return Close(deposits.color[sound], points + lift * normals, normals, sight)


def _refuse_few(splats: SplatCloud) -> None:
    if int((splats.opacities >= SOLID).sum()) < TUNING.place_fewest:
        few = f"fewer than {TUNING.place_fewest} splats show (opacity {SOLID} and more)"
        what = "too few to tell the captured light from; check the capture, or describe the light in the job"
        raise RenderError(f"{few}, {what}")


def _from_lights(mesh: ProxyMesh, lights: Sequence[Light], points: F64, normals: F64, settings: RenderSettings) -> F64:
    """(N, L) irradiance / pi at points of a black mesh by each of the lights, white and of intensity 1."""
    if not lights:
        return np.zeros((len(points), 0))
    tracer = Tracer(mesh, replace(settings, max_depth=1), aovs=False)
    columns = np.zeros((len(points), len(lights)))
    for k, light in enumerate(lights):
        alone = Lighting(lights=(replace(light, name="light", color=np.ones(3), intensity=1.0, group=None),))
        columns[:, k] = tracer.point_layers(alone, points, normals, TUNING.place_light_spp).total[:, 0] / np.pi
    return columns


def _along(spread: F64, normals: F64, most: float) -> F64:
    """(N, 2, 3) spreads, each at most `most` units long, laid on surfaces with those normals."""
    length = np.linalg.norm(spread, axis=2, keepdims=True)
    own = spread * np.minimum(1, most / np.maximum(length, 1e-300))
    return np.asarray(own - np.einsum("njk,nk->nj", own, normals)[:, :, None] * normals[:, None])


def _open(start: F64, normals: F64, sight: Sight, rays: int, rng: np.random.Generator) -> F64:
    """(N, PATCHES) as in `Places`, by so many rays from each."""
    out = np.zeros((len(start), PATCHES))
    step = max(_CHUNK // rays, 1)
    for first in range(0, len(start), step):
        rows = slice(first, first + step)
        directions = cosine_directions(normals[rows], rays, rng)
        blocked = sight.blocked(np.repeat(start[rows], rays, axis=0), directions.reshape(-1, 3))
        row, ray = np.nonzero(~blocked.reshape(directions.shape[:2]))
        np.add.at(out[rows], (row, patch_of(directions[row, ray])), 1 / rays)
    return out


def cosine_directions(normals: F64, count: int, rng: np.random.Generator) -> F64:
    """(N, count, 3) directions over each hemisphere by cosine: one spiral, turned and shifted anew for each place."""
    shift, turn = rng.random((2, len(normals), 1))
    k = np.arange(count)
    s2 = (k + shift) / count
    phi = 2 * np.pi * turn + k * np.pi * (3 - np.sqrt(5.0))
    s = np.sqrt(s2)
    local = np.stack([s * np.cos(phi), s * np.sin(phi), np.sqrt(1 - s2)], axis=-1)
    return np.asarray(np.einsum("nrk,nkj->nrj", local, frame_around(normals)))


def _seen_side(points: F64, normals: F64, facing: F64, sight: Sight, lift: float, rng: np.random.Generator) -> F64:
    """The normals, turned where their side is the inside of something: where rays meet the backs of faces."""
    backs = []
    for side in (1.0, -1.0):
        n = side * normals
        directions = cosine_directions(n, 16, rng)
        face, _ = sight.first_hits(np.repeat(points + lift * n, 16, axis=0), directions.reshape(-1, 3))
        back = (face >= 0) & (np.einsum("nk,nk->n", facing[face], directions.reshape(-1, 3)) > 0)
        backs.append(back.reshape(-1, 16).mean(axis=1))
    turned = backs[0] > backs[1] + 0.25
    return np.where(turned[:, None], -normals, normals)

"""What nearly all pictures show, in finer cells: a thing amid its surroundings.

Who walks round a bicycle in a park has splats a centimetre apart on it and half a metre apart on the trees behind. The
median of all, which lengths of a proxy are measured in, leaves a blob of the bicycle. So what most cameras have in
their pictures is looked at again in its own spacing, and takes the place of what was found of it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mirelight.model import F64, Camera
from mirelight.proxy.capture import Capture, spacing_of
from mirelight.proxy.depth import DepthMap, footprint, shows, sure_points
from mirelight.proxy.detail_tuning import DETAIL
from mirelight.proxy.flats import Flat, votes
from mirelight.proxy.ground import lift_of
from mirelight.proxy.tidy import compact, parts_of
from mirelight.proxy.tuning import TUNING
from mirelight.proxy.types import Soup, corners_of
from mirelight.proxy.views import close_ups, rays


@dataclass(frozen=True, slots=True, eq=False)
class Core:
    """The box that most cameras have in their pictures."""

    low: F64  # (3,)
    high: F64  # (3,)
    cameras: tuple[Camera, ...]  # of the capture, which show little else
    spacing: float  # that lengths in it are measured in, world units

    @property
    def middle(self) -> F64:
        """(3,) of the box."""
        return (self.low + self.high) / 2

    @property
    def half(self) -> F64:
        """(3,) half its extent."""
        return (self.high - self.low) / 2

    def holds(self, points: F64, margin: float) -> NDArray[np.bool_]:
        """(...,) whether points (..., 3) lie in it, grown by a margin to all sides."""
        return np.asarray(((points > self.low - margin) & (points < self.high + margin)).all(axis=-1))

    def alone(self, view: DepthMap, margin: float) -> DepthMap:
        """A view without what lies farther than a margin from it."""
        origins, directions = rays(view.camera)
        here = self.holds(origins + directions * view.depth[..., None], margin) & (view.depth > 0)
        return replace(view, depth=np.where(here, view.depth, np.float32(0)))

    def beside(self, flat: Flat) -> Flat:
        """What of a plane is outside of it: fog that looks like that is before it, and no thing."""
        return replace(flat, there=flat.there & ~self.holds(flat.middles, 0.0).reshape(flat.there.shape))

    def amid(self, view: DepthMap, whole: DepthMap) -> DepthMap:
        """A view of it alone with what the whole one shows beside it: past a table's rim is the floor."""
        return replace(view, depth=np.where(view.depth > 0, view.depth, whole.depth))


def core_of(capture: Capture, cameras: Sequence[Camera], coarse: float) -> Core | None:
    """What most of the cameras show, where its splats lie much closer than others, or than cells that hold all strays
    can tell; None: nothing, or no closer.

    Cameras that stand on one side of a thing all show what lies behind it, too: then what they are turned to, and all
    that is about as near, is asked for itself. Of a room, which is looked at from its midst, no place is in most
    pictures.

    Args:
        capture: the splats.
        cameras: those of its pictures, around the origin as the capture is.
        coarse: spacing that the whole surface was found in, world units.
    """
    away = _turned_to(cameras)
    limits = (np.inf,) if away is None else (np.inf, DETAIL.detail_near * away)
    found = list[Core]()
    for inside in _shown_by_most(capture, cameras, limits):
        if inside.sum() < DETAIL.detail_fewest:
            continue
        core = _about(capture, cameras, inside)
        if core.spacing <= DETAIL.detail_finer * capture.spacing:
            return replace(core, spacing=DETAIL.detail_share * core.spacing)
        found.append(core)
    # its splats are no closer than others: then in the cells that the whole would have without its strays
    finer = (x for x in found if x.spacing <= DETAIL.detail_finer * coarse)
    return next((replace(x, spacing=capture.spacing) for x in finer), None)


def _shown_by_most(capture: Capture, cameras: Sequence[Camera], limits: Sequence[float]) -> Iterator[NDArray[np.bool_]]:
    """For each limit (N,) which splats most of the cameras show no farther ahead than that."""
    means = capture.splats.means
    shown = np.zeros((len(limits), len(means)), np.int64)
    for camera in cameras:
        ahead = (camera.position - means) @ camera.world_from_camera[:3, 2]
        seen = shows(camera, means)
        for count, far in zip(shown, limits, strict=True):
            count += seen & (ahead < far)
    yield from shown >= DETAIL.detail_seen * len(cameras)


def _about(capture: Capture, cameras: Sequence[Camera], inside: NDArray[np.bool_]) -> Core:
    """The box about splats (N,), and how far they, or the pixels that show them closer, are apart."""
    means = capture.splats.means
    at = means[inside].astype(np.float64)
    low, high = np.quantile(at, [DETAIL.detail_rim, 1 - DETAIL.detail_rim], axis=0)
    apart = spacing_of(means.astype(np.float64), at)
    low, high = low - DETAIL.detail_lid * apart, high + DETAIL.detail_lid * apart
    closer = close_ups(cameras, low - capture.spacing, high + capture.spacing)
    spacing = max(apart, TUNING.make_grain * footprint(closer, means[inside]))
    return Core(low, high, closer, spacing)


def _turned_to(cameras: Sequence[Camera]) -> float | None:
    """How far ahead of cameras, in the median, the point lies that is nearest to the lines along which they look; None
    where they do not look at one."""
    eyes = np.stack([x.position for x in cameras])
    ways = np.stack([-x.world_from_camera[:3, 2] for x in cameras])
    across = np.eye(3) - ways[:, :, None] * ways[:, None, :]
    total = across.sum(axis=0)
    if np.linalg.eigvalsh(total)[0] < DETAIL.detail_turned * len(cameras):
        return None
    middle = np.linalg.solve(total, np.einsum("nij,nj->i", across, eyes))
    ahead = np.einsum("ni,ni->n", middle - eyes, ways)
    aside = np.linalg.norm(middle - eyes - ahead[:, None] * ways, axis=1)
    return float(np.median(ahead)) if np.median(aside / np.maximum(ahead, 1e-9)) < DETAIL.detail_aside else None


def others(fine: Sequence[Flat], flats: Sequence[Flat], tolerance: float) -> list[Flat]:
    """The planes of a core that are none of the whole surface's."""

    def same(one: Flat, other: Flat) -> bool:
        at = one.middles[one.there.ravel()]
        near = np.abs(other.off(at)) < tolerance
        return bool(near.mean() > 0.5 and abs(float(one.normal @ other.normal)) > TUNING.plane_cosine)

    return [one for one in fine if not any(same(one, other) for other in flats)]


def closer(flat: Flat, low: F64, high: F64, cell: float, views: Sequence[DepthMap], tolerance: float) -> Flat:
    """A plane in a box and in finer cells, as views of that tell: where it ends, or, of a ground that rises and falls,
    how high it is; at the box's sides that is as before.

    Args:
        flat: a plane; one of which views tell nothing stays as it is.
        low, high: (3,) corners of the box.
        cell: side of its cells, world units.
        views: maps of what is in the box.
        tolerance: as for :func:`carried_on`.
    """
    if not flat.told:
        return flat
    corners = corners_of(low, high)
    ends = np.einsum("ni,ki->nk", corners, flat.axes) / cell
    first = np.floor(ends.min(axis=0)).astype(np.int64)
    size = np.ceil(ends.max(axis=0)).astype(np.int64) - first + 1
    bare = Flat(flat.normal, flat.offset, flat.axes, cell, first, np.ones(tuple(size), bool))
    at = bare.middles
    own = replace(bare, there=flat.inside(at).reshape(tuple(size)))
    if flat.lift is None:
        return replace(own, there=_not_seen_past(own, views, tolerance))
    before = flat.lifted(at).reshape(tuple(size))
    own = replace(own, lift=before)
    across = np.abs(flat.normal) < TUNING.ground_facing  # sides that stand on it
    away = np.minimum(at - low, high - at)[:, across].min(axis=1).reshape(tuple(size))
    share = np.clip(away / (TUNING.ground_fades * tolerance), 0, 1)
    return replace(own, lift=before + share * lift_of(own, views, tolerance))


def _not_seen_past(flat: Flat, views: Sequence[DepthMap], tolerance: float) -> NDArray[np.bool_]:
    """(I, J) its cells without those around it that views look through rather than see; amid others things stand."""
    from scipy.ndimage import binary_fill_holes, gaussian_filter

    held, through, _ = votes(flat, views, tolerance)
    past = gaussian_filter(through - held, DETAIL.detail_past) > 0
    return np.asarray(binary_fill_holes(flat.there & ~past) & flat.there)


def without_fog(fine: Soup, views: Sequence[DepthMap], spacing: float) -> Soup:
    """A core's surface without parts by themselves of which hardly anything is sure: things stand on something, and
    smooth plastic, of which nothing is, has rims that are; what hangs in the air and has none is fog.

    Args:
        fine: the surface.
        views: the maps that it was made of.
        spacing: what counts is as near to a point that views are sure of as twice that, world units.
    """
    from scipy.spatial import cKDTree

    sure = np.concatenate([sure_points(view, TUNING.fog) for view in views])
    if not len(fine.faces) or not len(sure):
        return fine
    part, some = parts_of(fine.faces), slice(None, None, DETAIL.detail_looked)
    away, _ = cKDTree(sure).query(fine.vertices[fine.faces[some]].mean(axis=1), distance_upper_bound=2 * spacing)
    count, known = (np.bincount(part[some], x, part.max() + 1) for x in (None, np.isfinite(away)))
    kept = known >= DETAIL.detail_sure * count
    return compact(Soup(fine.vertices, fine.faces[kept[part]]))


def with_core(whole: Soup, fine: Soup, core: Core, cell: float) -> Soup:
    """The surface with a core in place of what it had there; one reaches a cell of the other's, `cell`, under it."""
    outer, inner = (soup.vertices[soup.faces].mean(axis=1) for soup in (whole, fine))
    outside = Soup(whole.vertices, whole.faces[~core.holds(outer, -cell)])
    return compact(outside).beside(compact(Soup(fine.vertices, fine.faces[core.holds(inner, 0.0)])))

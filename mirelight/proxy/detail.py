"""What nearly all pictures show, in finer cells: a thing amid its surroundings.

Who walks round a bicycle in a park has splats a centimetre apart on it and half a metre apart on the trees behind. The
median of all, which lengths of a proxy are measured in, leaves a blob of the bicycle. So what most cameras have in
their pictures is looked at again in its own spacing, and takes the place of what was found of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mirelight.model import F64, Camera
from mirelight.proxy.capture import Capture, spacing_of
from mirelight.proxy.depth import DepthMap, footprint, shows
from mirelight.proxy.flats import Flat
from mirelight.proxy.tidy import compact
from mirelight.proxy.tuning import TUNING
from mirelight.proxy.types import Soup
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


def core_of(capture: Capture, cameras: Sequence[Camera], coarse: float) -> Core | None:
    """What most of the cameras show, where its splats lie much closer than others, or than cells that hold all strays
    can tell; None: nothing, or no closer.

    Of a room, which is looked at from its midst, no place is in most pictures.

    Args:
        capture: the splats.
        cameras: those of its pictures, around the origin as the capture is.
        coarse: spacing that the whole surface was found in, world units.
    """
    means = capture.splats.means
    shown = np.zeros(len(means), np.int64)
    for camera in cameras:
        shown += shows(camera, means)
    inside = shown >= TUNING.detail_seen * len(cameras)
    if inside.sum() < TUNING.detail_fewest:
        return None
    at = means[inside].astype(np.float64)
    low, high = np.quantile(at, [TUNING.detail_rim, 1 - TUNING.detail_rim], axis=0)
    closer = close_ups(cameras, low - capture.spacing, high + capture.spacing)
    spacing = max(spacing_of(means.astype(np.float64), at), TUNING.make_grain * footprint(closer, means[inside]))
    if spacing <= TUNING.detail_finer * capture.spacing:
        return Core(low, high, closer, TUNING.detail_share * spacing)
    # its splats are no closer than others: then in the cells that the whole would have without its strays
    return Core(low, high, closer, capture.spacing) if spacing <= TUNING.detail_finer * coarse else None


def others(fine: Sequence[Flat], flats: Sequence[Flat], tolerance: float) -> list[Flat]:
    """The planes of a core that are none of the whole surface's."""

    def same(one: Flat, other: Flat) -> bool:
        at = one.middles[one.there.ravel()]
        near = np.abs(other.off(at)) < tolerance
        return bool(near.mean() > 0.5 and abs(float(one.normal @ other.normal)) > TUNING.plane_cosine)

    return [one for one in fine if not any(same(one, other) for other in flats)]


def with_core(whole: Soup, fine: Soup, core: Core, cell: float) -> Soup:
    """The surface with a core in place of what it had there; one reaches a cell of the other's, `cell`, under it."""
    outer, inner = (soup.vertices[soup.faces].mean(axis=1) for soup in (whole, fine))
    outside = Soup(whole.vertices, whole.faces[~core.holds(outer, -cell)])
    return compact(outside).beside(compact(Soup(fine.vertices, fine.faces[core.holds(inner, 0.0)])))

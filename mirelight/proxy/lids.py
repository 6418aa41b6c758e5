"""Lids: where a wall of a room opens on what is dark, and no splats stand for that, no light comes in.

What is dark needs few splats before black: a doorway into a dark room is as transparent as the open, and so are the
dark room's walls. The sky would come in there. But a room's windows are bright in its pictures; what is dark in them is
hidden from the sky. So such an opening is closed in the plane of its wall. In the open, what is dark and
transparent may be a shadow on the ground.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from mirelight.base.together import each
from mirelight.model import F32
from mirelight.proxy.depth import DepthMap
from mirelight.proxy.flats import Flat
from mirelight.proxy.openings import looked_at, met
from mirelight.proxy.tuning import TUNING
from mirelight.proxy.types import Int
from mirelight.proxy.views import length, rays

Bool = NDArray[np.bool_]


def lids_of(views: Sequence[DepthMap], flats: Sequence[Flat], spacing: float) -> dict[int, Flat]:
    """Lids of the openings in planes, by the plane's place among them: its cells `there` are those that are closed.

    None where much of the pictures is dark and transparent: outside of masks they are black, whatever is there.

    Args:
        views: maps of a room with windows, all that is seen through these far away.
        flats: the planes that they show.
        spacing: of the splats, world units.
    """
    dark = [_dark(view) for view in views]
    empty = [float((own & (view.alpha <= TUNING.depth_opaque)).mean()) for view, own in zip(views, dark, strict=True)]
    if not views or np.mean(empty) > TUNING.lid_masked:
        return {}

    def looked(k: int) -> list[Int]:  # at all planes: the view's rays are made once
        return [_shown(views[k], dark[k], flat, spacing) for flat in flats]

    shown = each(looked, range(len(views)))
    eyes = np.stack([view.camera.position for view in views])
    lids = dict[int, Flat]()
    for k, flat in enumerate(flats):
        if (flat.off(eyes) > 0).all() or (flat.off(eyes) < 0).all():  # nobody has been behind it
            closed = _dark_openings(np.sum([of[k] for of in shown], axis=0))
            if closed.any():
                lids[k] = replace(flat, there=closed)
    return lids


def closed_by(flats: Sequence[Flat], lids: Mapping[int, Flat]) -> list[Flat]:
    """Planes with the cells of their lids."""
    return [replace(x, there=x.there | lids[k].there) if k in lids else x for k, x in enumerate(flats)]


def covered(view: DepthMap, lids: Iterable[Flat], spacing: float) -> DepthMap:
    """The view with lids before all that is seen through them."""
    origins, directions = rays(view.camera)
    depth, normal, alpha = view.depth.copy(), view.normal.copy(), view.alpha.copy()
    spread, trust = view.spread.copy(), view.trust.copy()
    for lid in lids:
        at, facing = met(lid, origins, directions)
        slack = TUNING.plane_tolerance * spacing / (length(directions) * np.maximum(facing, 0.1))
        through = (at > view.camera.near) & ((depth == 0) | (depth > at + slack))
        through &= lid.inside(origins + directions * at[..., None])
        side = 1.0 if float(lid.off(view.camera.position)) > 0 else -1.0
        depth[through], normal[through] = at[through], side * lid.normal
        alpha[through], spread[through], trust[through] = 1, 0, 1
    return replace(view, depth=depth, normal=normal, alpha=alpha, spread=spread, trust=trust)


def _dark(view: DepthMap) -> Bool:
    """(H, W) pixels that are dark in the picture, which shows what is left of their colours before black."""
    red, green, blue = (view.color[..., k] for k in range(3))  # numpy's maxima along an axis of three are slow
    shown: F32 = np.maximum(np.maximum(red, green), blue) * view.alpha
    return np.asarray(shown < TUNING.lid_dark)


def _shown(view: DepthMap, dark: Bool, flat: Flat, spacing: float) -> Int:
    """(5, I, J) of a plane's cells: 1 where a view sees one at all; the plane; what lies behind; what is dark there;
    what is transparent. `dark` (H, W): its pixels that are."""
    at = flat.middles
    rows, pixel, off = looked_at(view, flat, at, spacing)
    off = np.where(view.depth.ravel()[pixel] > 0, off, TUNING.opening_far)  # nothing is there
    there, behind = off > -TUNING.opening_before, off > TUNING.opening_before
    clear = view.alpha.ravel()[pixel] <= TUNING.depth_opaque
    out = np.zeros((5, len(at)), np.int64)
    out[:, rows] = there, there & ~behind, behind, behind & dark.ravel()[pixel], behind & clear
    return out.reshape(5, *flat.there.shape)


def _dark_openings(shown: Int) -> Bool:
    """(I, J) cells of openings, most of which show nothing, with a rim that reaches under the wall around them; `shown`
    (5, I, J) by how many views."""
    from scipy.ndimage import binary_dilation, binary_fill_holes, label

    seen, on, behind, dark, clear = shown
    many = seen >= TUNING.opening_seen
    wall, hollow = many & (2 * on > seen), many & (2 * behind > seen) & (2 * dark > seen)
    part, count = label(binary_fill_holes(hollow) & ~wall)
    out = np.zeros(seen.shape, bool)
    for own in (part == k for k in range(1, count + 1)):
        rim = binary_dilation(own, np.ones((3, 3), bool)) & ~own
        empty = own & (2 * clear > seen)
        if own.sum() >= TUNING.window_cells and 2 * empty.sum() > own.sum() and wall[rim].mean() > TUNING.lid_held:
            out |= own | rim
    return out

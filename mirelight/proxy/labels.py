"""Which pixels of a depth map lie on which plane: costs smoothed by the picture's colours, the least one wins.

(Rhemann et al., "Fast cost-volume filtering", 2011, with adaptive support weights.)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from mirelight.model import F32
from mirelight.proxy.depth import DepthMap
from mirelight.proxy.flats import Bool, Flat, depth_of
from mirelight.proxy.looks import Look
from mirelight.proxy.skies import Sky, large
from mirelight.proxy.tuning import TUNING
from mirelight.proxy.types import Int
from mirelight.proxy.views import dot, length, rays


@dataclass(frozen=True, slots=True, eq=False)
class Labels:
    """Which plane each pixel of a view lies on."""

    plane: Int  # (H, W) its place among the planes; their number: on none; -1: on one, past its end, where nothing is
    sure: F32  # (H, W) how sure that is, 0..1


def labelled(view: DepthMap, flats: Sequence[Flat], tolerance: float, looks: Sequence[Look] = ()) -> Labels:
    """The planes that a view's pixels lie on, for all that it shows itself; `looks`: of each plane, or none."""
    origins, directions = rays(view.camera)
    depths = [depth_of(view, flat, directions) for flat in flats]
    unlike = [np.zeros_like(view.depth)] * len(flats)
    if looks:
        met = (origins + directions * depth[..., None] for depth in depths)
        unlike = [look.other(view.color, at) for look, at in zip(looks, met, strict=True)]
    return Labels(*_labels(view, flats, depths, tolerance, unlike))


def flattened(
    view: DepthMap, flats: Sequence[Flat], tolerance: float, sky: Sky, labels: Labels | None = None
) -> DepthMap:
    """The view with the pixels that lie on planes moved onto them; they count in full. Others show no surface where
    there is less trust in them than in a sky's fog. `labels`: None: those of the view itself."""
    from scipy.ndimage import binary_fill_holes

    labels = labels or labelled(view, flats, tolerance)
    label, sure = labels.plane, labels.sure
    _, directions = rays(view.camera)
    depths = [depth_of(view, flat, directions) for flat in flats]
    solid = binary_fill_holes(view.alpha > TUNING.depth_opaque)  # what is black needs no splats before black
    depth, normal, trust = view.depth.copy(), view.normal.copy(), view.trust.copy()
    least = sky.least(view, directions)
    shown = (trust >= least) & (label >= 0)
    solid &= ~_rim_of((label < 0) | (label == len(flats)), (least > sky.fog) & (trust < least))
    for k, flat in enumerate(flats):
        on = (label == k) & (depths[k] > 0) & solid
        step = depths[k][on] - view.depth[on]
        apart = np.abs(step * dot(directions[on], flat.normal)) > TUNING.label_apart * tolerance
        share = np.where(apart | (view.depth[on] == 0), 1, sure[on])
        depth[on] += share * step
        facing = -np.sign(dot(directions[on], flat.normal))[:, None] * flat.normal
        between = normal[on] + share[:, None] * (facing - normal[on])
        normal[on] = between / np.maximum(length(between), 1e-12)[:, None]
        trust[on], shown[on] = 1, True
    return replace(view, depth=np.where(shown, depth, np.float32(0)), normal=normal, trust=trust)


def _rim_of(off: Bool, sky: Bool) -> Bool:
    """(H, W) the pixels of a sky beside what lies `off` all planes: costs smoothed so far lend them to planes' ends."""
    from scipy.ndimage import binary_dilation

    beside = large(off & sky)
    return np.asarray(binary_dilation(beside, iterations=2 * TUNING.label_window, mask=sky)) if beside.any() else beside


def _labels(
    view: DepthMap, flats: Sequence[Flat], depths: Sequence[F32], tolerance: float, unlike: Sequence[F32]
) -> tuple[Int, F32]:
    """(H, W) the plane that each pixel lies on, the number of planes: none, -1: on one, past its end, where nothing is.
    And how sure that is, 0..1. `unlike`: (H, W) 0..1 of each plane, whether pixels look otherwise than it."""
    origins, directions = rays(view.camera)
    there, trust = view.depth > 0, view.trust
    reach = np.float32(2 * tolerance) + view.spread
    offs = [
        (depth - view.depth) * np.abs(dot(directions, flat.normal)).astype(np.float32) / reach
        for flat, depth in zip(flats, depths, strict=True)
    ]
    # fog hangs beneath a ground that is guessed, too, and is no pit of it
    offs = [before if flat.told else np.maximum(before, 0) for flat, before in zip(flats, offs, strict=True)]
    costs = []
    for k, (flat, depth, before) in enumerate(zip(flats, depths, offs, strict=True)):
        aside = 1 - np.abs(dot(view.normal, flat.normal.astype(np.float32)))
        turned = np.minimum(aside / np.float32(TUNING.label_turned), 1)
        for other in _across(flats, k):  # in a corner normals are between those of both
            turned *= np.where(depths[other] > 0, np.minimum(offs[other] ** 2, 1), 1)
        cost = np.minimum(before**2, 1) + np.float32(0.6) * turned
        unsure = np.float32(0.15) + np.float32(0.5) * np.minimum(cost, 1)
        # things do not blend with what lies behind them; of fog, nobody knows how far before a plane it hangs
        thing = np.minimum(trust / np.float32(TUNING.fog), 1)
        unsure += thing * np.clip(before - np.float32(TUNING.label_before), 0, 1)
        unsure += np.float32(TUNING.label_out) * unlike[k]
        cost = np.where(there, trust * cost + (1 - trust) * unsure, np.float32(0.5))
        costs.append(np.where(depth > 0, cost, np.float32(TUNING.label_out)))
    free = np.where(there, TUNING.label_free * trust + (1 - trust) * np.float32(0.8), 1.0)
    volume = np.stack([*costs, free], axis=0).astype(np.float32)
    smooth = _smoothed(volume, view.color)
    first = np.argmin(smooth, axis=0)
    for k, (flat, depth) in enumerate(zip(flats, depths, strict=True)):
        if flat.bound is not None:  # the other plane has what is past it
            past = (depth > 0) & ~flat.within(origins + directions * depth[..., None])
            smooth[k][past] = np.inf
    sure = (smooth[-1] - smooth.min(axis=0)) / np.float32(TUNING.label_sure)
    label = np.argmin(smooth, axis=0)
    label[(label == len(flats)) & (first < len(flats))] = -1
    return label, np.minimum(sure, 1)


def _across(flats: Sequence[Flat], k: int) -> list[int]:
    """Planes that stand across one of them."""
    return [j for j, other in enumerate(flats) if abs(float(other.normal @ flats[k].normal)) < 0.5]


def _smoothed(volume: F32, color: F32) -> F32:
    """Costs (K, H, W), each the mean over pixels around that look alike."""
    radius, step = TUNING.label_window, TUNING.label_step
    height, width = color.shape[:2]
    costs = np.pad(volume, ((0, 0), (radius, radius), (radius, radius)), mode="edge")
    own = [np.ascontiguousarray(color[..., k]) for k in range(3)]  # sums over a last axis of three are slow
    red, green, blue = (np.pad(x, radius, mode="edge") for x in own)
    out, total = np.zeros_like(volume), np.zeros((height, width), np.float32)
    for y in range(-radius, radius + 1, step):
        for x in range(-radius, radius + 1, step):
            window = (slice(radius + y, radius + y + height), slice(radius + x, radius + x + width))
            r, g, b = (np.abs(wide[window] - x) for wide, x in zip((red, green, blue), own, strict=True))
            other = (r + g + b) / np.float32(TUNING.label_color)
            weight = np.exp(-other - np.float32((x * x + y * y) / (0.5 * radius * radius)))
            out += weight * costs[(slice(None), *window)]
            total += weight
    return out / total

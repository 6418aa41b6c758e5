"""Windows: where pictures are clipped to white and what shines lies behind the wall around it, light comes in.

Splats of a sky that a picture shows as white lie anywhere behind a window's frame, as nothing tells their distance;
taken for a surface they would shut the window. A patch of sun on a wall is as bright, but lies on it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from mirelight.model import F64
from mirelight.proxy.depth import DepthMap, pixels_of
from mirelight.proxy.flats import Flat
from mirelight.proxy.tuning import TUNING
from mirelight.proxy.views import rays, turned

Bool = NDArray[np.bool_]

AWAY = 4.0  # of the capture's radius: where a sky is put
_BEFORE = 2.0  # spacings: what lies farther before a plane hides it
_FAR = 6.0  # spacings: what lies farther off counts as this far


def looked_through(
    views: Sequence[DepthMap], flats: Sequence[Flat], spacing: float, radius: float
) -> list[DepthMap] | None:
    """The views with the sky in windows far away; None: there are no windows.

    Args:
        views: maps.
        flats: the planes that they show.
        spacing: of the splats, world units.
        radius: of the capture.
    """
    windows = [(flat, window) for flat in flats if (window := _windows(flat, views, spacing)).any()]
    if not windows:
        return None
    return [_opened(view, windows, spacing, AWAY * radius) for view in views]


def is_clipped(view: DepthMap) -> Bool:
    """(H, W) pixels that are white."""
    return np.asarray(view.color.min(axis=-1) > TUNING.clipped)


def _windows(flat: Flat, views: Sequence[DepthMap], spacing: float) -> Bool:
    """(I, J) cells of a plane that light comes through."""
    from scipy.ndimage import binary_opening, label
    from scipy.ndimage import median as median_of
    from scipy.ndimage import sum as sum_of

    at = flat.middles
    seen, white, behind = np.zeros(len(at)), np.zeros(len(at)), np.zeros(len(at))
    for view in views:
        own = turned(at - view.camera.position, view.camera.camera_from_world[:3, :3])
        pixel = pixels_of(view.camera, own.astype(np.float32))
        rows = np.flatnonzero((pixel >= 0) & (view.depth.ravel()[np.maximum(pixel, 0)] > 0))
        pixel = pixel[rows]
        ray = rays(view.camera)[1].reshape(-1, 3)[pixel]
        aslant = np.abs((ray * flat.normal).sum(axis=1)) / np.linalg.norm(ray, axis=1)
        off = (view.depth.ravel()[pixel] + own[rows, 2]) * aslant / spacing
        there = off > -_BEFORE
        seen[rows] += there
        white[rows] += there & is_clipped(view).ravel()[pixel]
        behind[rows] += there * np.clip(off, -_FAR, _FAR)
    shape = flat.there.shape
    part, count = label(binary_opening(((white > 0.5 * seen) & (seen > 2)).reshape(shape)))
    if not count:
        return np.zeros(shape, bool)
    index = np.arange(1, count + 1)
    depth = np.asarray(median_of((behind / np.maximum(seen, 1)).reshape(shape), part, index))
    size, inside = np.asarray(sum_of(part > 0, part, index)), np.asarray(sum_of(flat.there, part, index))
    kept = (depth > TUNING.window_depth) & (size >= TUNING.window_cells) & (inside > 0.5 * size)
    return np.asarray(np.concatenate([[False], kept])[part])


def _opened(view: DepthMap, windows: Sequence[tuple[Flat, Bool]], spacing: float, away: float) -> DepthMap:
    """The view with white pixels that are seen through windows far away."""
    from scipy.ndimage import binary_dilation

    origins, directions = rays(view.camera)
    white, sky = is_clipped(view), np.zeros(view.depth.shape, bool)
    for flat, window in windows:
        facing = (directions * flat.normal).sum(axis=-1)
        facing = np.where(np.abs(facing) > 1e-9, facing, 1e-9)
        depth: F64 = (flat.offset - (origins * flat.normal).sum(axis=-1)) / facing
        through = replace(flat, there=binary_dilation(window)).inside(origins + directions * depth[..., None])
        slack = _BEFORE * spacing * np.linalg.norm(directions, axis=-1) / np.maximum(np.abs(facing), 0.1)
        sky |= white & through & (depth > 0) & ((view.depth == 0) | (view.depth > depth - slack))
    facing = -directions / np.linalg.norm(directions, axis=-1, keepdims=True)
    return replace(
        view,
        depth=np.where(sky, np.float32(away), view.depth),
        normal=np.where(sky[..., None], facing, view.normal).astype(np.float32),
        spread=np.where(sky, np.float32(0), view.spread),
        trust=np.where(sky, np.float32(1), view.trust),
    )

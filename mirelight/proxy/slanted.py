"""Depth maps made smooth: through each pixel the plane that depths around it agree on, led by the picture's colours.

What an optimiser leaves is a surface that waves by some splats. Planes are functions a x + b y + c of the pixel in
inverse depth, so that windows are fitted by least squares, again and again with less weight on what lies off (Geman and
McClure's), as adaptive support weights (Yoon and Kweon, 2006) do in stereo: pixels of another colour count less, so a
surface ends where the picture shows that it does.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from mirelight.model import F32, F64
from mirelight.proxy.depth import DepthMap
from mirelight.proxy.tuning import TUNING
from mirelight.proxy.views import dot, rays

Bool = NDArray[np.bool_]

LEAST_WINDOW, MOST_WINDOW = 2, 8  # px, radius


def slanted(view: DepthMap, noise: float) -> DepthMap:
    """The view with depth and normal of the planes that its pixels' windows agree on.

    Args:
        view: a map as `DepthMaps` makes it.
        noise: by how far depths of one surface differ, world units: the splats' spacing.
    """
    there = view.depth > 0
    if not there.any():
        return view
    footprint = float(np.median(view.depth[there])) / view.camera.fx
    radius = int(np.clip(TUNING.window * noise / footprint, LEAST_WINDOW, MOST_WINDOW))
    step = TUNING.window_step if radius > 2 * LEAST_WINDOW else 1
    height, width = view.depth.shape
    inverse = np.where(there, 1 / np.maximum(view.depth, np.float32(1e-12)), 0).astype(np.float32)
    trust = np.where(there, 0.05 + view.trust, 0).astype(np.float32)
    colors = [np.ascontiguousarray(view.color[..., k]) for k in range(3)]
    inverses, trusts, *others = (np.pad(x, radius) for x in (inverse, trust, *colors))
    line = range(-radius, radius + 1, step)
    offsets = [(y, x) for y in line for x in line if y * y + x * x <= radius * radius]
    windows = [(slice(radius + y, radius + y + height), slice(radius + x, radius + x + width)) for y, x in offsets]
    weights = []
    for (y, x), window in zip(offsets, windows, strict=True):
        red, green, blue = (np.abs(wide[window] - own) for wide, own in zip(others, colors, strict=True))
        other = red + green + blue
        near = np.float32((x * x + y * y) / (2 * (radius / 2) ** 2))
        weights.append(trusts[window] * np.exp(-other / np.float32(TUNING.window_color) - near))
    plane = _plane_of(view)
    found: Bool = np.zeros((height, width), bool)
    for wide in TUNING.window_rounds:
        scale = 1 / (np.float32(wide * noise) * np.maximum(plane[..., 2], np.float32(1e-12)) ** 2)
        sums = np.zeros((9, height, width), np.float32)
        for (y, x), window, base in zip(offsets, windows, weights, strict=True):
            value = inverses[window]
            off = (value - (plane[..., 2] + plane[..., 0] * np.float32(x) + plane[..., 1] * np.float32(y))) * scale
            with np.errstate(over="ignore"):  # by 1e19 and more: it counts nothing
                w = base / (1 + off * off) ** 2
            _add(sums[:6], w, (1, x, y, x * x, x * y, y * y))
            _add(sums[6:], w * value, (1, x, y))
        plane, found = _solved(sums, plane)
    return _with_planes(view, plane, found)


def _add(sums: F32, weight: F32, parts: Sequence[int]) -> None:
    for to, part in zip(sums, parts, strict=True):
        if part:
            to += weight if part == 1 else weight * np.float32(part)


def _solved(sums: F32, before: F32) -> tuple[F32, Bool]:
    """Planes (H, W, 3) of least squares, and where they are sound; elsewhere those of before."""
    one, x, y, xx, xy, yy, v, vx, vy = sums.astype(np.float64)
    rows = [[xx + 1e-6, xy, x], [xy, yy + 1e-6, y], [x, y, one + 1e-9]]
    matrix = np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)
    found = np.linalg.solve(matrix, np.stack([vx, vy, v], axis=-1)[..., None])[..., 0]
    sound = (one > TUNING.window_least) & (found[..., 2] > 0)
    return np.where(sound[..., None], found, before).astype(np.float32), sound


def _plane_of(view: DepthMap) -> F32:
    """(H, W, 3) the plane of a pixel's own depth and normal, in inverse depth by pixels."""
    camera, turn = view.camera, view.camera.world_from_camera[:3, :3]
    _, directions = rays(camera)
    normal = view.normal.astype(np.float64)
    facing = np.minimum(dot(normal, directions), -0.1)
    depth = np.maximum(view.depth.astype(np.float64), 1e-12)
    across = dot(normal, turn[:, 0]) / camera.fx, -dot(normal, turn[:, 1]) / camera.fy
    parts = [x / (depth * facing) for x in across]
    return np.stack([*parts, 1 / depth], axis=-1).astype(np.float32)


def _with_planes(view: DepthMap, plane: F32, found: Bool) -> DepthMap:
    """The view with these planes in inverse depth."""
    camera, turn = view.camera, view.camera.world_from_camera[:3, :3]
    _, directions = rays(camera)
    slope: F64 = plane.astype(np.float64)
    away = slope[..., :1] * camera.fx * turn[:, 0] - slope[..., 1:2] * camera.fy * turn[:, 1]
    rest = slope[..., 2] - dot(away, directions)
    away = away - rest[..., None] * turn[:, 2]
    normal = -away / np.maximum(np.linalg.norm(away, axis=-1, keepdims=True), 1e-30)
    there = found & (view.alpha > TUNING.depth_opaque)
    depth = np.where(there, 1 / np.maximum(slope[..., 2], 1e-12), view.depth)
    normal = np.where(there[..., None], normal, view.normal)
    return replace(view, depth=depth.astype(np.float32), normal=normal.astype(np.float32))

"""Whether a capture's pictures agree on a mesh: what tells its errors where splats are off as well."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mirelight.compositor import Compositor
from mirelight.lighting.sight import Sight
from mirelight.model import F64, Camera
from mirelight.proxy.mesh_tuning import MESH
from mirelight.proxy.tuning import TUNING
from mirelight.proxy.types import Agreement
from mirelight.proxy.views import rays, turned

Bool = NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class _View:
    """What a camera sees of splats and mesh."""

    camera: Camera
    gray: F64  # (H, W) display values
    shows: Bool  # (H, W) splats that are opaque
    depth: F64  # (H, W) of the surface along the view axis, infinite where it is not


def agreement(compositor: Compositor, cameras: Sequence[Camera], sight: Sight, size: float) -> Agreement:
    """How well neighbouring pictures agree on a mesh, and how far from it they agree best.

    Pixels of a picture are sought in the nearest others, by way of the mesh and of surfaces up to 2 % of the size
    before and behind it, and windows around them compared (normalized cross-correlation). Those pixels tell something
    that agree well somewhere along their way, and not everywhere. How sharply pictures tell a place is the capture's:
    so the splats' own depth is tried, too.

    Args:
        compositor: of the splats.
        cameras: of the capture's pictures, where splats look as these do; in the space of splats and mesh.
        sight: into the mesh.
        size: of the capture, world units.
    """
    some = [_small(x) for x in cameras if x.projection == "perspective"]
    if len(some) <= MESH.agree_beside:
        return Agreement()
    known = dict[int, tuple[_View, _View]]()

    def views(k: int) -> tuple[_View, _View]:
        if k not in known:
            known[k] = _seen(compositor, some[k], sight)
        return known[k]

    pairs = [(views(i), [views(j) for j in near]) for i, near in _neighbours(some)]
    told = []
    for which in (0, 1):
        found = [_compared(one[which], [x[which] for x in others], size) for one, others in pairs]
        here, best, away = (np.concatenate(x) for x in zip(*found, strict=True))
        if len(best) < MESH.agree_fewest:
            return Agreement()
        told.append((float(here.sum() / best.sum()), float(away.mean()) * size))
    return Agreement(*told[0], told[1][1])


def _neighbours(cameras: Sequence[Camera]) -> list[tuple[int, list[int]]]:
    """Some cameras, and the nearest others that look the same way."""
    at = np.stack([x.position for x in cameras])
    ahead = np.stack([-x.world_from_camera[:3, 2] for x in cameras])
    out = []
    for i in range(0, len(cameras), -(-len(cameras) // MESH.agree_views)):
        apart = np.linalg.norm(at - at[i], axis=1) * (
            1 + MESH.agree_ahead * (1 - turned(ahead, ahead[i : i + 1])[:, 0])
        )
        apart[apart == 0] = np.inf  # itself, and others in its place: these see no depth
        out.append((i, [int(j) for j in np.argsort(apart, kind="stable")[: MESH.agree_beside]]))
    return out


def _seen(compositor: Compositor, camera: Camera, sight: Sight) -> tuple[_View, _View]:
    """With the mesh's depth, and with the splats' own."""
    layer = compositor.composite(camera, depth=True)
    alpha = 1 - layer.transmittance.astype(np.float64)
    gray, shows = layer.color.mean(axis=-1) / np.maximum(alpha, 1e-3), alpha > TUNING.depth_opaque
    origins, directions = rays(camera)
    starts = np.broadcast_to(origins, directions.shape).reshape(-1, 3)
    face, depth = sight.first_hits(starts, directions.reshape(-1, 3))
    depth = np.where(face >= 0, depth, np.inf).reshape(alpha.shape)
    own = np.where(layer.median_depth > 0, layer.median_depth, np.inf).astype(np.float64)
    return _View(camera, gray, shows, depth), _View(camera, gray, shows, own)


def _compared(view: _View, others: Sequence[_View], size: float) -> tuple[F64, F64, F64]:
    """(P,) how well others agree with the pixels that tell: on the mesh, and where they do best, so far off, of the
    size."""
    origins, directions = rays(view.camera)
    there = view.shows & np.isfinite(view.depth)
    reach = np.where(there, view.depth, 0.0)
    along = 1 / np.linalg.norm(directions, axis=-1)
    total, weight = np.zeros((2, len(MESH.agree_steps), *reach.shape))
    for k, step in enumerate(MESH.agree_steps):
        points = origins + directions * (reach + step * size * along)[..., None]
        for other in others:
            value, seen = _taken(other, points, (MESH.agree_hidden + abs(step)) * size)
            alike, tells = _correlation(view.gray, value, there & seen)
            total[k] += np.where(tells, alike, 0)
            weight[k] += tells
    mean = total / np.maximum(weight, 1)
    best, worst = mean.max(axis=0), mean.min(axis=0)
    told = (weight > 0).all(axis=0) & (best > MESH.agree_clear) & (best - worst > MESH.agree_peak)
    away = np.abs(np.array(MESH.agree_steps))[mean.argmax(axis=0)]
    return mean[MESH.agree_steps.index(0.0)][told], best[told], away[told]


def _taken(view: _View, points: F64, slack: float) -> tuple[F64, Bool]:
    """What a view shows of points (H, W, 3), and whether it does: the mesh hides none that lies less behind it."""
    from scipy.ndimage import map_coordinates

    camera = view.camera
    own = turned(points - camera.position, camera.camera_from_world[:3, :3])
    z = -own[..., 2]
    ahead = np.maximum(z, 1e-12)
    x = camera.cx + camera.fx * own[..., 0] / ahead - 0.5
    y = camera.cy - camera.fy * own[..., 1] / ahead - 0.5
    inside = (z > 0) & (x >= 0) & (x <= camera.width - 1) & (y >= 0) & (y <= camera.height - 1)
    column, row = (np.rint(np.where(inside, v, 0)).astype(np.int64) for v in (x, y))
    seen = inside & view.shows[row, column] & (z < view.depth[row, column] + slack)
    value = map_coordinates(view.gray, [np.where(inside, y, 0), np.where(inside, x, 0)], order=1)
    return value, seen


def _correlation(a: F64, b: F64, there: Bool) -> tuple[F64, Bool]:
    """(H, W) normalized cross-correlation of windows, of what is there; and where it tells something."""
    from scipy.ndimage import uniform_filter

    count = uniform_filter(there.astype(np.float64), MESH.agree_window, mode="constant")

    def mean(x: F64) -> F64:
        return np.asarray(
            uniform_filter(np.where(there, x, 0.0), MESH.agree_window, mode="constant") / np.maximum(count, 1e-6)
        )

    mean_a, mean_b = mean(a), mean(b)
    spread_a, spread_b = mean(a * a) - mean_a**2, mean(b * b) - mean_b**2
    least = MESH.agree_contrast**2
    alike = (mean(a * b) - mean_a * mean_b) / np.sqrt(np.maximum(spread_a, least) * np.maximum(spread_b, least))
    return np.clip(alike, -1, 1), there & (count > MESH.agree_whole) & (spread_a > least)


def _small(camera: Camera) -> Camera:
    return camera.scaled(min(MESH.agree_pixels / max(camera.width, camera.height), 1.0))

"""Places inside a capture to look from, where a look from around does not see what there is: rooms, courtyards."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mirelight.model import F64
from mirelight.proxy.capture import Capture
from mirelight.proxy.depth import DepthMap, points_of
from mirelight.proxy.sampling import far_apart
from mirelight.proxy.tuning import TUNING


def hidden_share(capture: Capture, views: Sequence[DepthMap]) -> float:
    """Share of the splats, by opacity, that lie far from every point that the views see."""
    from scipy.spatial import cKDTree

    seen = np.concatenate([points_of(view, 4)[0] for view in views])
    if not len(seen):
        return 1.0
    splats = capture.splats
    step = max(len(splats) // TUNING.inside_sample, 1)
    weight = splats.opacities[::step].astype(np.float64)
    distance, _ = cKDTree(seen).query(splats.means[::step], workers=-1)
    far = distance > max(0.03 * capture.radius, 2 * capture.spacing)
    return float(weight[far].sum() / weight.sum())


def places(capture: Capture, count: int = TUNING.inside_places) -> F64:
    """(count, 3) points with room around them, far from each other."""
    from scipy.spatial import cKDTree

    line = np.linspace(-TUNING.inside_inner, TUNING.inside_inner, TUNING.inside_grid)
    grid = np.stack(np.meshgrid(line, line, line, indexing="ij"), axis=-1).reshape(-1, 3) * capture.half
    room, _ = cKDTree(capture.splats.means).query(grid, workers=-1)
    first = int(np.argmax(np.minimum(room, 0.5 * capture.half.min())))
    worth = np.where(room >= 0.25 * room[first], TUNING.inside_apart * room, -np.inf)
    return grid[far_apart(grid, first, count, worth)]

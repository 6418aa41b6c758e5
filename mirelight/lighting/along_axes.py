"""Where splats lie on a proxy: the nearest point along their own axes, the flattest first."""

from __future__ import annotations

import numpy as np

from mirelight.lighting.trace import Tracer
from mirelight.model import F32, F64, I32


def nearest(tracer: Tracer, means: F64, axes: F64, scales: F32 | F64, reach: float) -> tuple[I32, F32, F64]:
    """For each of N splats (N,) the face, -1 where there is none; (N, 3) weights of its corners; (N,) the distance.

    Args:
        tracer: of the proxy.
        means: (N, 3) world space.
        axes: (N, 3, 3), its columns.
        scales: (N, 3) along them.
        reach: farthest distance, world units.
    """
    by_size = np.argsort(scales, axis=1, kind="stable")
    face = np.full(len(means), -1, np.int32)
    corners, distance = np.zeros((len(means), 3), np.float32), np.zeros(len(means))
    for k in range(3):
        todo = np.flatnonzero(face < 0)
        if len(todo):
            directions = np.take_along_axis(axes[todo], by_size[todo, k][:, None, None], axis=2)[..., 0]
            face[todo], corners[todo], distance[todo] = tracer.nearest_along(means[todo], directions, reach)
    return face, corners, distance

"""Light that falls on points of the proxy, layer by layer: on splats, on vertices, on samples of a surface."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING

import numpy as np

from mirelight.lighting.layers import Layers
from mirelight.model import F32, F64, Camera, LightingBuffer, PointLayers

if TYPE_CHECKING:
    from mirelight.lighting.frame import FrameInProgress
    from mirelight.lighting.kernel.probes import PointRays

CHUNK_BYTES = 1 << 28  # of film: what the points of one go may take, whatever the machine has, as it decides the bits


def chunks(count: int, layers: Layers) -> Iterator[tuple[int, int]]:
    """(first, end) of the points that are sampled together."""
    step = max(CHUNK_BYTES // (4 * (9 * max(len(layers.names), 1) + 48)), 1)
    return ((first, min(first + step, count)) for first in range(0, count, step))


def gathered(
    points: F64,
    normals: F64,
    layers: Layers,
    seed: int,
    frame: Callable[[PointRays, Camera, int], FrameInProgress],
    sample: Callable[[FrameInProgress, int], None],
) -> PointLayers:
    """The light at all points, chunk after chunk.

    Args:
        points, normals: (N, 3) on the proxy, and unit normals of the faces, on the side that is lit.
        layers: the film's.
        seed: of the first chunk; each has its own.
        frame: opens a film for points (with the row of pixels that they are) and a seed.
        sample: fills it; its second argument is how many points were done before.
    """
    from mirelight.lighting.kernel.probes import PointRays

    light, variance = [], []
    for number, (first, end) in enumerate(chunks(len(points), layers)):
        row = Camera.perspective(np.eye(4), end - first, 1, yfov=45, name="points")
        view = PointRays(points[first:end], normals[first:end])
        opened = frame(view, row, (seed + 0x9E3779B9 * number) & 0xFFFFFFFF)
        sample(opened, first)
        made = opened.develop()
        light.append(_stacked(made))
        if made.variance is not None:
            variance.append(np.stack([np.asarray(x.variance)[0] for x in made.layers]) * np.float32(np.pi**2))
    names = layers.names
    nothing = np.zeros((2, len(names), 0, 3), np.float32)
    direct, indirect = np.concatenate([nothing, *light], axis=2)
    whole = len(variance) == len(light) and len(light) > 0
    return PointLayers(
        names=names, direct=direct, indirect=indirect, variance=np.concatenate(variance, axis=1) if whole else None
    )


def _stacked(made: LightingBuffer) -> F32:
    """(2, K, N, 3) irradiance, direct and indirect."""
    parts = [[x.direct[0] for x in made.layers], [x.indirect[0] for x in made.layers]]
    return np.asarray(np.stack([np.stack(x) for x in parts]) * np.float32(np.pi))

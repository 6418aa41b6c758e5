"""How clear a capture looks from a place.

An optimiser makes what pictures show. Seen from where they were taken, a surface is a thin layer that hides what lies
behind it. From behind a wall, from inside a thing or from beneath a floor a ray blends what lies far apart, and from
afar a capture fills few directions.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from mirelight.base.machine import free_memory
from mirelight.compositor import Compositor
from mirelight.model import F32, F64, Camera, CompositorSettings
from mirelight.proxy.capture import Capture
from mirelight.proxy.depth import layered, pixels_of
from mirelight.proxy.guess_tuning import GUESS
from mirelight.proxy.joining import joined
from mirelight.proxy.tuning import TUNING
from mirelight.proxy.types import ProxySettings
from mirelight.proxy.views import from_points, moved, turned


class ClearSplats:
    """A capture's splats as they are looked at from places.

    Of many splats neighbours are joined. Some of them that stand for all, as much larger as covers as much, fill the
    rooms of a flat.
    """

    def __init__(self, capture: Capture, settings: ProxySettings) -> None:
        many = len(capture.splats) > GUESS.clear_splats
        few = joined(capture.splats, GUESS.clear_splats) if many else capture.splats
        few = layered(few, TUNING.depth_sharper)
        self._means, self._near = few.means, 1e-3 * capture.radius
        self._sides = from_points(np.zeros((1, 3)), GUESS.clear_pixels, self._near)
        once = CompositorSettings(max_memory=free_memory())  # asked at each of thousands of looks, it takes a tenth
        self._compositor = Compositor(few, once, variant=settings.variant, threads=settings.threads)

    def worth(self, place: F64) -> float:
        """Share of the directions from a place (3,) in which a clear layer lies, 0..1."""
        return float(np.mean([clear.mean() for _, _, clear in self._looks(place)]))

    def shown(self, place: F64, points: F64) -> NDArray[np.bool_]:
        """(N,) which of points (N, 3) lie in a layer that is clear from a place (3,)."""
        offsets = (points - place).astype(np.float32)
        away = _logarithm(offsets, self._near)
        seen = np.zeros(len(points), bool)
        for camera, layer, clear in self._looks(place):
            pixel = pixels_of(camera, turned(offsets, camera.camera_from_world[:3, :3].astype(np.float32)))
            at = np.maximum(pixel, 0)
            there = np.abs(away - layer.ravel()[at]) < GUESS.clear_noise
            seen |= (pixel >= 0) & there & (clear.ravel()[at] > GUESS.clear_least)
        return seen

    def _looks(self, place: F64) -> Iterator[tuple[Camera, F32, F32]]:
        """To six sides: logarithms of distances (H, W), and how clear pixels (H, W) are, 0..1; 0 where not opaque."""
        away = _logarithm(self._means - place.astype(np.float32), self._near)
        values = np.stack([away, away * away], axis=1)
        for camera in (moved(side, place) for side in self._sides):
            layer, sums = self._compositor.composite_with(camera, values, depth=False)
            alpha = 1 - layer.transmittance
            mean, square = (sums[..., k] / np.maximum(alpha, np.float32(1e-6)) for k in (0, 1))
            blended = np.maximum(square - mean * mean, 0) / np.float32(GUESS.clear_noise**2)
            yield (
                camera,
                mean.astype(np.float32),
                np.where(alpha > TUNING.depth_opaque, 1 / (1 + blended), 0).astype(np.float32),
            )


def _logarithm(offsets: F32, least: float) -> F32:
    """(N,) of the lengths of offsets (N, 3)."""
    return np.asarray(np.log(np.maximum(np.linalg.norm(offsets, axis=1), np.float32(least))), np.float32)

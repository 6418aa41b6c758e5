"""How the cost of a noise target is shared out between light on the surface and the samples of pictures. NumPy only.

A picture's relative variance is f / n + p / s: of n fills of the cells that it reads, which are averaged, and of s
samples of each of its pixels. With the cost F of a fill and P of a sample of every pixel, n F + s P is least for a sum
of target² where n = sqrt(f / F) (sqrt(f F) + sqrt(p P)) / target² (Lagrange). Costs are counted in samples of a pixel
by a fixed price, never by the clock, so the same job always comes to the same number.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from mirelight.lighting.frame import PASS, FrameInProgress, Passes
from mirelight.model import F32, Camera, CellLight, SurfaceCache

if TYPE_CHECKING:
    from mirelight.lighting.kernel.rays import SomePixels

RAY_PRICE = 0.4  # of a ray of a cell, found, lit and summed up, in samples of a pixel (0.5 of 1.1 us, 0.7 of 1.8 us)
MOST_FILLS = 64
MOST_OF_TARGET = 0.85  # of the deviation that is wanted, by fills: the rest must be within reach of samples
VIEWS, PIXELS, SAMPLES = 4, 1024, 4 * PASS  # that are looked at: cameras, pixels of each, samples of a pixel


@dataclass(frozen=True, slots=True)
class Noise:
    """Relative variances (as the square of `LightingBuffer.relative_noise`) of pictures."""

    of_fill: float  # of light on the surface from one fill
    of_sample: float  # of one sample of each pixel

    def fills(self, target: float, rays: int, pixels: int) -> int:
        """How many fills to average for a target at least cost.

        Args:
            target: relative deviation, above 0.
            rays: of all cells in one fill.
            pixels: of all pictures that read it.

        Returns:
            1 to MOST_FILLS.
        """
        fill, sample = RAY_PRICE * rays, float(pixels)
        best = math.sqrt(self.of_fill / fill) / target**2
        best *= math.sqrt(self.of_fill * fill) + math.sqrt(self.of_sample * sample)

        def cost(n: int) -> float:
            return n * fill + sample * self.of_sample / (target**2 - self.of_fill / n)

        fewest = max(math.ceil(self.of_fill / (MOST_OF_TARGET * target) ** 2), 1)
        low = max(math.floor(best), fewest)
        return min(low if cost(low) <= cost(low + 1) else low + 1, MOST_FILLS)


def looked_at(cameras: Sequence[Camera], frame: Callable[[SomePixels, Camera], FrameInProgress]) -> Noise:
    """The noise of pictures that read light from one fill, from some pixels of some cameras.

    Args:
        cameras: one or more.
        frame: opens a film for some pixels, with the row that they are.
    """
    from mirelight.lighting.kernel.rays import SomePixels

    found = []
    for camera in some_of(cameras):
        pixels = even(camera.width * camera.height)
        opened = frame(SomePixels(camera, pixels), Camera.perspective(np.eye(4), len(pixels), 1, yfov=45, name="some"))
        for _ in opened.add_passes(Passes(PASS, SAMPLES // PASS)):
            pass
        estimate = opened.estimate()
        if estimate.covered.any():
            found.append((estimate.of_surface**2, estimate.relative_noise**2 * SAMPLES))
    return Noise(*np.mean(found, axis=0).tolist()) if found else Noise(0.0, 0.0)


def some_of(cameras: Sequence[Camera]) -> list[Camera]:
    """VIEWS of them at most, evenly taken."""
    count = min(VIEWS, len(cameras))
    return [cameras[k * len(cameras) // count] for k in range(count)]


def even(count: int) -> NDArray[np.int64]:
    """(N,) numbers of pixels, PIXELS of so many at most, spread evenly, but not on a grid."""
    few = min(PIXELS, count)
    return np.arange(few) * count // few + np.random.default_rng(0).integers(0, max(count // few, 1), few)


def averaged(caches: Sequence[SurfaceCache]) -> SurfaceCache:
    """The mean of independent fills of the same cells by the same lights: halves stay independent of each other."""

    def mean(values: list[F32]) -> F32:
        return np.asarray(sum(values[1:], values[0]) / np.float32(len(values)), np.float32)

    def light(same: Sequence[CellLight]) -> CellLight:
        first_bounce = [x.first_bounce for x in same if x.first_bounce is not None]
        return replace(
            same[0],
            direct=mean([x.direct for x in same]),
            first_bounce=mean(first_bounce) if first_bounce else None,
            indirect=mean([x.indirect for x in same]),
            rays=sum(x.rays for x in same),
        )

    return replace(caches[0], lights=tuple(map(light, zip(*(x.lights for x in caches), strict=True))))

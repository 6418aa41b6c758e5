"""One frame while it is traced: the film on the device, and how many samples each pixel has."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mirelight.base.machine import uninterrupted
from mirelight.lighting import error_estimate, grid
from mirelight.lighting import lights as table
from mirelight.lighting.adaptive import Estimate, both_halves
from mirelight.lighting.develop import Sums, develop
from mirelight.lighting.layers import Layers, sun_shares
from mirelight.model import Camera, Lighting, LightingBuffer, RenderSettings

if TYPE_CHECKING:
    from mirelight.lighting.kernel.cell_points import CellPoints
    from mirelight.lighting.kernel.cells import DeviceCells
    from mirelight.lighting.kernel.paths import Pass
    from mirelight.lighting.kernel.probes import PointRays
    from mirelight.lighting.kernel.proxy import DeviceProxy
    from mirelight.lighting.kernel.rays import CameraRays, SomePixels
    from mirelight.lighting.kernel.sky import Sky
    from mirelight.lighting.kernel.types import UInt32

LANES = 1 << 21  # paths a launch: larger is no faster, smaller starts to cost (0.13 M: 1.4 times)
FEW_LANES = 1 << 18  # of few pixels, whose passes share launches up to so many: progress is seen still
PASS = 16  # samples a pixel and launch, a power of two: one packet of the widest vector unit
LAUNCH_BYTES = 1 << 29  # most that the film's buffer of one launch may take
TILE = 6  # log2 of the side of a tile of pixels that share a sequence
FIRST_RAYS = 8  # a power of two: from a camera's hit where light is read, to each source that needs many
INDEX_BITS = 32 - 3  # of a sample's number in its sequence, times those rays
AGAIN = 0x6A09E667  # between the seeds of first and second samples
OBJECTS = 2  # times the samples, of pixels that show inserted objects: few, and filters clean some of them alone
EDGES = 8  # the same of those that show them in part: there a few samples have to tell the light on both
ROUND = 0x3C6EF35F  # between the seeds of their rounds


@dataclass(frozen=True, slots=True, eq=False)
class LitProxy:
    """A proxy under a lighting, on the device."""

    surface: DeviceProxy
    sky: Sky  # of the lighting's environment
    lighting: Lighting  # with its sky model resolved
    emission: bool  # surfaces that glow do
    cells: DeviceCells | None = None  # light that is read in place of being traced


class Passes(NamedTuple):
    """So many samples of each pixel at once, so many times.

    `samples` is a power of two from the batch size up to PASS, so that a pixel's lanes lie in one packet or in
    neighbouring ones.
    """

    samples: int
    times: int = 1


class FrameInProgress:
    """Samples are added pass by pass, of all pixels or some; `develop` ends it."""

    def __init__(
        self,
        lit: LitProxy,
        camera: Camera,
        layers: Layers,
        settings: RenderSettings,
        *,
        aovs: bool,
        view: CameraRays | PointRays | CellPoints | SomePixels | None = None,  # None: the camera's
        irradiance: bool = False,  # of first hits, over pi, instead of their radiance
    ) -> None:
        import drjit as dr
        import mitsuba as mi

        from mirelight.lighting.kernel.film import Film
        from mirelight.lighting.kernel.lights import LightSet
        from mirelight.lighting.kernel.paths import World
        from mirelight.lighting.kernel.rays import CameraRays, SomePixels
        from mirelight.lighting.kernel.samples import Tiles

        surface, lighting, cells = lit.surface, lit.lighting, lit.cells
        self.camera, self.layers = camera, layers
        self.samples = np.zeros(camera.width * camera.height, np.int64)
        self._view = view or CameraRays(camera)
        self._film = Film(
            len(self.samples),
            layers,
            aovs=aovs,
            parts=settings.denoise,
            doubt=cells is not None and cells.doubtful,
            objects=surface.has_objects,
        )
        self._irradiance = irradiance
        lists, shares = grid.build(lighting.lights, surface.bounds, separate=layers.separate), sun_shares(lighting)
        packed, seeds = table.pack(lighting.lights), table.seeds(lighting.lights)
        self._world = World(surface, LightSet(packed, seeds, lists, layers.of_light, shares), lit.sky, cells)
        self._sun = bool(shares.any())
        self._emission = lit.emission and surface.emissive
        self._batch = PASS if settings.noise is not None else batch_size(settings.spp)
        self._seed_number = settings.seed & 0xFFFFFFFF
        self._again = 0  # samples of each pixel that is sampled twice
        self._seed = dr.opaque(mi.UInt32, self._seed_number)
        side, most = tile_size(settings)
        self._tiles = Tiles(dr.opaque(mi.UInt32, side), dr.opaque(mi.UInt32, most))
        seen = view is None or isinstance(view, SomePixels)
        self._first_rays = dr.opaque(mi.UInt32, FIRST_RAYS if seen else 1)
        self._max_depth = dr.opaque(mi.UInt32, settings.max_depth)
        low, high = surface.bounds
        diagonal = float(np.linalg.norm(high.astype(np.float64) - low))
        self._ao_distance = dr.opaque(mi.Float, settings.ao_distance or 0.1 * diagonal)

    def add_passes(
        self, passes: Passes, pixels: NDArray[np.int64] | None = None, seed: int | None = None, since: int = 0
    ) -> Iterator[int]:
        """Take more samples of each of some pixels (None: all); yields how many there are by now, by launch.

        `pixels` (N,) are different and in order. `seed`: of another sequence than the frame's, that has been gone along
        since the pixels had `since` samples, which are whole batches.
        """
        import drjit as dr
        import mitsuba as mi

        from mirelight.lighting.kernel.memory import integers
        from mirelight.lighting.kernel.paths import trace_pass

        chosen = np.arange(len(self.samples)) if pixels is None else pixels
        sequence = self._seed if seed is None else dr.opaque(mi.UInt32, seed)
        for first, end, times in self._launches(len(chosen), passes):
            some = chosen[first:end]
            job = self._job(some, self.samples[some] - since, passes.samples, times, sequence)
            before = integers((self.samples[some] - since) // self._batch)
            batches = times * (passes.samples // self._batch)
            with uninterrupted():  # samples in the film that are not counted would be light twice
                self._film.open(len(some), batches, times)
                trace_pass(self._world, self._view, self._film, job)
                self._film.close(job.pixels, before, len(some), batches, times)
                self.samples[some] += times * passes.samples
            yield int(self.samples.sum())

    def add_rounds(self, spp: int, passes: Callable[[int], Sequence[Passes]]) -> Iterator[int]:
        """More samples of the pixels that show inserted objects, `OBJECTS` times as many in all as the `spp` that they
        have, and `EDGES` times where they show them in part; yields as `add_passes`. Each round goes along a sequence
        of its own, in whole quarters of batches.

        `passes`: cuts samples into passes.
        """
        if not self._world.surface.has_objects:
            return
        hits = self._film.on_objects()
        shown, edges = np.flatnonzero(hits > 0), np.flatnonzero((hits > 0) & (hits < self.samples - 0.5))
        for k in range(1, EDGES):
            pixels = shown if k < OBJECTS else edges
            if not len(pixels):
                break
            since, seed = int(self.samples[pixels[0]]), (self._seed_number + k * ROUND) & 0xFFFFFFFF
            for some in passes(spp // (4 * self._batch) * 4 * self._batch):
                yield from self.add_passes(some, pixels, seed, since)

    def sample_again(self, passes: Sequence[Passes]) -> None:
        """Sample some pixels a second time, in such passes as they had, to tell how noisy all are."""
        import drjit as dr
        import mitsuba as mi

        from mirelight.lighting.kernel.paths import trace_pass

        chosen = error_estimate.chosen(len(self.samples))
        seed = dr.opaque(mi.UInt32, (self._seed_number + AGAIN) & 0xFFFFFFFF)
        done = np.zeros(len(chosen), np.int64)
        self._again = sum(x.samples * x.times for x in passes)
        for of in passes:
            for first, end, times in self._launches(len(chosen), of):
                some, batches = chosen[first:end], times * (of.samples // self._batch)
                job = self._job(some, done[first:end], of.samples, times, seed)
                self._film.open(len(some), batches, times, counted=False)
                trace_pass(self._world, self._view, self._film, job)
                self._film.keep(first, len(some), batches, len(chosen))
                done[first:end] += times * of.samples

    def _launches(self, pixels: int, passes: Passes) -> Iterator[tuple[int, int, int]]:
        """(first and end of the pixels, how many passes) of every launch."""
        row = 24 * max(len(self.layers.names), 1) * (passes.samples // self._batch)
        row *= 2 if self._world.surface.has_objects else 1
        step = min(LANES // passes.samples, max(LAUNCH_BYTES // row, 1))
        most = max(min(FEW_LANES // passes.samples, step) // max(pixels, 1), 1)
        for done in range(0, passes.times, most):
            for first in range(0, pixels, step):
                yield first, min(first + step, pixels), min(most, passes.times - done)

    def _job(self, pixels: NDArray[np.int64], before: NDArray[np.int64], count: int, passes: int, seed: UInt32) -> Pass:
        """Passes of `count` more samples of each of some pixels, which have so many."""
        import drjit as dr
        import mitsuba as mi

        from mirelight.lighting.kernel.memory import integers
        from mirelight.lighting.kernel.paths import Pass

        return Pass(
            lanes=passes * len(pixels) * count,
            count=dr.opaque(mi.UInt32, len(pixels)),
            pixels=integers(pixels),
            first_samples=integers(before),
            log2_samples=dr.opaque(mi.UInt32, count.bit_length() - 1),
            log2_batch=dr.opaque(mi.UInt32, self._batch.bit_length() - 1),
            tiles=self._tiles,
            first_rays=self._first_rays,
            seed=seed,
            max_depth=self._max_depth,
            ao_distance=self._ao_distance,
            emission=self._emission,
            irradiance=self._irradiance,
        )

    def estimate(self) -> Estimate:
        """How noisy each pixel is so far; every pixel has at least two batches."""
        sums, squares, hits, doubt = self._film.beauty()
        if self._world.surface.has_objects:
            sums, squares, hits = both_halves(sums, squares, hits, self.samples / self._batch)
        shape = self.camera.height, self.camera.width
        return Estimate.of(sums, squares, hits, self.samples, self._batch, shape, doubt)

    def so_far(self) -> LightingBuffer:
        """The means of the samples so far, of a copy: more may be added after it."""
        return self._developed(self._film.sums().copied())

    def develop(self) -> LightingBuffer:
        """The means. The film is used up; ask once, at the end."""
        return self._developed(self._film.sums())

    def _developed(self, sums: Sums) -> LightingBuffer:
        aovs = self._film.aovs

        def made(of: Sums) -> LightingBuffer:
            sun = aovs and self._sun
            count, batch = self.samples, self._batch
            return develop(self.camera, self.layers, of, count, batch, sun=sun, occlusion=aovs, again=self._again)

        if not self._world.surface.has_objects:
            return made(sums)
        proxy, objects = (made(x) for x in sums.halves())
        return replace(proxy, objects=objects)


def tile_size(settings: RenderSettings) -> tuple[int, int]:
    """(log2 of the side of a tile of pixels that share a sequence, log2 of the samples that each may get).

    Under a noise target each pixel has a sequence of its own: its neighbours' samples say how many it gets, and must
    know nothing of its own.
    """
    if settings.noise is not None:
        return 0, 0
    most = (settings.spp - 1).bit_length()
    return max(min(TILE, (INDEX_BITS - most) // 2), 0), most


def batch_size(spp: int) -> int:
    """Samples that the variance takes as one: a power of two that divides `spp`, and leaves at least four batches.

    The points of one batch are spread over the pixel as those of the whole are, so larger batches overstate less.
    """
    size = 1
    while size < PASS and spp % (2 * size) == 0 and spp >= 8 * size:
        size *= 2
    return size

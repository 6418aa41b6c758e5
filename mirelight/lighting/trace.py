"""Lights a proxy: the tracer that holds a mesh and its acceleration structure, and the passes that fill a film."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from mirelight import backend
from mirelight.errors import BackendError
from mirelight.lighting import environment as maps
from mirelight.lighting import grid
from mirelight.lighting import lights as table
from mirelight.lighting.develop import dark, develop, refuse_if_too_large, relative_noise
from mirelight.lighting.layers import Layers
from mirelight.lighting.materials import is_emissive
from mirelight.lighting.sunsky import resolved
from mirelight.model import F32, F64, Camera, Environment, Lighting, LightingBuffer, ProxyMesh, RenderSettings

if TYPE_CHECKING:
    from mirelight.lighting.kernel.probes import Probes
    from mirelight.lighting.kernel.sky import Sky
    from mirelight.lighting.kernel.surface import Surface
    from mirelight.lighting.kernel.view import View

Progress: TypeAlias = Callable[[int, int], None]

LANES = 1 << 21  # paths a launch: larger is no faster, smaller starts to cost (0.13 M: 1.4 times)
PASS = 16  # samples a pixel and launch, a power of two: one packet of the widest vector unit
MOST_SAMPLES = 1 << 16  # where a noise target gives up


class Interrupted(KeyboardInterrupt):
    """The user stopped a trace; `buffer` is what there was, None where some pixel had no sample yet."""

    def __init__(self, buffer: LightingBuffer | None) -> None:
        self.buffer = buffer
        super().__init__("interrupted")


def trace(proxy: ProxyMesh, lighting: Lighting, camera: Camera, settings: RenderSettings) -> LightingBuffer:
    """Light a proxy once; :class:`Tracer` does the same for many frames of one proxy.

    Raises:
        BackendError: the variant cannot be used on this machine.
        RenderError: the frame's film does not fit in memory.
    """
    return Tracer(proxy, settings).trace(lighting, camera)


class Tracer:
    """A proxy made ready for tracing. Later frames compile nothing, whatever lights, environment and camera do.

    Without `layers` a frame has a single one, "beauty", and lights are sampled for the sum alone.
    """

    def __init__(self, proxy: ProxyMesh, settings: RenderSettings, *, layers: bool = True) -> None:
        self.settings = settings
        self._layers = layers
        self._proxy = proxy
        self._emissive = is_emissive(proxy)
        self._surface: Surface | None = None
        self._sky: tuple[Environment | None, Sky] | None = None  # the last frame's, as many frames share one
        backend.mitsuba(settings.variant, settings.threads)
        if settings.variant != "scalar_rgb" and len(proxy.faces):
            from mirelight.lighting.kernel.surface import Surface

            self._surface = Surface(proxy)

    def trace(self, lighting: Lighting, camera: Camera, *, progress: Progress | None = None) -> LightingBuffer:
        """Trace one frame.

        Args:
            lighting: lights, environment, sky model.
            camera: the splat camera; pixels coincide with its own.
            progress: called with (paths done, paths in all) after every launch; under a noise target the second number
                is a forecast.

        Returns:
            A layer for each light, the environment, and emission where the proxy glows; their sum is the beauty. More
            than `layers.MAX_LAYERS` lights share one layer named "lights".

        Raises:
            Interrupted: Ctrl-C; holds what there was.
            RenderError: the frame's film does not fit in memory.
        """
        lighting = resolved(lighting, self.settings.variant)
        layers = Layers.of(lighting, emissive=self._emissive, separate=self._layers)
        refuse_if_too_large(camera, layers)
        if not len(self._proxy.faces):
            return dark(camera, layers, self.settings.spp)
        if self._surface is None:
            from mirelight.lighting.scalar import trace_scalar

            return trace_scalar(self._proxy, lighting, camera, self.settings, layers)
        frame = _Frame(self._surface, self._sky_of(lighting.environment), lighting, camera, layers, self.settings)
        try:
            _sample(frame, self.settings, progress or _ignore)
        except KeyboardInterrupt:
            raise Interrupted(frame.develop() if frame.samples.min() else None) from None
        buffer = frame.develop()
        if self.settings.denoise:
            from mirelight.lighting.denoise import denoise

            return denoise(buffer)
        return buffer

    def irradiance(self, lighting: Lighting, points: F64, normals: F64, spp: int) -> F32:
        """Light that falls on points of the proxy from the side that their normals point to, direct and indirect.

        Args:
            lighting: lights and environment.
            points: (N, 3) on the proxy, world space.
            normals: (N, 3) unit, of the face that each lies on; either sign.
            spp: samples per point, instead of the settings' own.

        Returns:
            (N, 3) linear irradiance. What a proxy that glows sends out itself at the point counts as reflected.

        Raises:
            BackendError: the variant `scalar_rgb`, which has no arrays to trace.
        """
        if self._surface is None:
            raise BackendError("irradiance at points needs the variant llvm_ad_rgb or cuda_ad_rgb")
        from mirelight.lighting.kernel.probes import Probes

        lighting = resolved(lighting, self.settings.variant)
        row = Camera.perspective(np.eye(4), len(points), 1, yfov=45, name="points")
        settings = replace(self.settings, spp=spp, noise=None)
        sky, view = self._sky_of(lighting.environment), Probes(points, normals)
        frame = _Frame(self._surface, sky, lighting, row, Layers.single(lighting), settings, view)
        _sample(frame, settings, _ignore)
        buffer = frame.develop()
        return np.asarray(np.pi * buffer.beauty[0] / np.maximum(buffer.albedo[0], np.float32(1e-4)), dtype=np.float32)

    def _sky_of(self, environment: Environment | None) -> Sky:
        """The environment on the device, prepared when it changes."""
        from mirelight.lighting.kernel.sky import Sky

        if self._sky is None or self._sky[0] is not environment:
            self._sky = environment, Sky(maps.prepare(environment), present=environment is not None)
        return self._sky[1]


def _ignore(done: int, total: int) -> None:
    """No progress wanted."""


def _sample(frame: _Frame, settings: RenderSettings, progress: Progress) -> None:
    """Passes until the samples asked for are in, then more while the noise is above its target."""
    finished, wanted = 0, settings.spp
    while finished < wanted:
        count = min(PASS, 1 << ((wanted - finished).bit_length() - 1))
        for done in frame.add_pass(finished, count):
            progress(done, wanted * len(frame.samples))
        finished += count
        if settings.noise is not None and finished >= wanted:
            wanted = _forecast(finished, relative_noise(frame.develop()), settings.noise)


def _forecast(finished: int, noise: float, target: float) -> int:
    """Samples after which to look again: error falls with their root, and one look at most quadruples them."""
    if noise <= target or finished >= MOST_SAMPLES:
        return finished
    needed = finished * min((noise / target) ** 2, 4.0)
    return min(max(-(-int(needed) // 16) * 16, finished + 16), MOST_SAMPLES)


def _batch_size(spp: int) -> int:
    """Samples that the variance takes as one: a power of two that divides `spp`, and leaves at least eight batches.

    The points of one batch are spread over the pixel as those of the whole are, so larger batches overstate less.
    """
    size = 1
    while size < PASS and spp % (2 * size) == 0 and spp >= 16 * size:
        size *= 2
    return size


class _Frame:
    """One frame on the device, and how many samples each pixel has."""

    def __init__(
        self,
        surface: Surface,
        sky: Sky,
        lighting: Lighting,
        camera: Camera,
        layers: Layers,
        settings: RenderSettings,
        view: View | Probes | None = None,  # None: the camera's
    ) -> None:
        import drjit as dr
        import mitsuba as mi

        from mirelight.lighting.kernel.film import Film
        from mirelight.lighting.kernel.paths import LightSet
        from mirelight.lighting.kernel.view import View

        self.camera, self.layers = camera, layers
        self.samples = np.zeros(camera.width * camera.height, np.int64)
        self._surface, self._sky, self._view = surface, sky, view or View(camera)
        self._film = Film(len(self.samples), layers)
        lists = grid.build(lighting.lights, surface.bounds)
        self._lights = LightSet(table.pack(lighting.lights), lists, layers.of_light)
        self._seed = dr.opaque(mi.UInt32, settings.seed & 0xFFFFFFFF)
        self._batch = _batch_size(settings.spp)
        self._max_depth = dr.opaque(mi.UInt32, settings.max_depth)

    def add_pass(self, first_sample: int, count: int) -> Iterator[int]:
        """Take `count` more samples of every pixel; yields the paths done so far, launch by launch.

        `count` is a power of two up to PASS, so that a pixel's lanes lie in one packet or in neighbouring ones.
        """
        import drjit as dr
        import mitsuba as mi

        from mirelight.lighting.kernel.paths import Pass, trace_pass

        step = LANES // count
        for first in range(0, len(self.samples), step):
            here = min(step, len(self.samples) - first)
            batches = max(count // self._batch, 1)
            self._film.open_batches(here, batches)
            job = Pass(
                lanes=here * count,
                pixels=dr.opaque(mi.UInt32, here),
                first_pixel=dr.opaque(mi.UInt32, first),
                first_sample=dr.opaque(mi.UInt32, first_sample),
                log2_samples=dr.opaque(mi.UInt32, count.bit_length() - 1),
                log2_batch=dr.opaque(mi.UInt32, self._batch.bit_length() - 1),
                seed=self._seed,
                max_depth=self._max_depth,
            )
            trace_pass(self._surface, self._view, self._lights, self._sky, self._film, job)
            self._film.close_batches(job.first_pixel, here, batches)
            self.samples[first : first + here] += count
            yield int(self.samples.sum())

    def develop(self) -> LightingBuffer:
        """The means so far."""
        film = self._film
        sums = film.layers.numpy(), film.surface.numpy(), film.squares.numpy()
        return develop(self.camera, self.layers, *sums, samples=self.samples, batch=self._batch)

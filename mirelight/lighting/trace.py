"""Lights a proxy: the tracer that holds a mesh and its acceleration structure, and the passes that fill a film."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from mirelight import backend
from mirelight.lighting import environment as maps
from mirelight.lighting import lights as table
from mirelight.model import F32, Camera, Lighting, LightingBuffer, LightLayer, ProxyMesh, RenderSettings

if TYPE_CHECKING:
    from mirelight.lighting.kernel.film import Film

Progress: TypeAlias = Callable[[int, int], None]

LANES = 1 << 21  # paths a launch: larger is no faster, smaller starts to cost (0.13 M: 1.4 times)
PASS = 64  # samples a pixel and pass, a power of two


def trace(proxy: ProxyMesh, lighting: Lighting, camera: Camera, settings: RenderSettings) -> LightingBuffer:
    """Light a proxy once; :class:`Tracer` does the same for many frames of one proxy."""
    return Tracer(proxy, settings).trace(lighting, camera)


class Tracer:
    """A proxy made ready for tracing. Frames after the first compile nothing new, whatever lights and cameras change."""

    def __init__(self, proxy: ProxyMesh, settings: RenderSettings) -> None:
        backend.mitsuba(settings.variant, settings.threads)
        from mirelight.lighting.kernel.surface import Surface

        self.settings = settings
        self._surface = Surface(proxy)

    def trace(self, lighting: Lighting, camera: Camera, *, progress: Progress | None = None) -> LightingBuffer:
        """Trace one frame.

        Args:
            lighting: lights and environment.
            camera: the splat camera; pixels coincide with its own.
            progress: called with (paths done, paths in all) after every launch.
        """
        import drjit as dr
        import mitsuba as mi

        from mirelight.lighting.kernel.film import Film
        from mirelight.lighting.kernel.paths import Pass, trace_pass
        from mirelight.lighting.kernel.view import View

        settings = self.settings
        lights, sky = _light_set(lighting), _sky(lighting)
        names = _layer_names(lighting)
        pixels = camera.width * camera.height
        film, view = Film(pixels, len(names), len(names) - 1), View(camera)
        done, total = 0, pixels * settings.spp
        for first_sample, count in _passes(settings.spp):
            step = max(LANES // count, 1)
            for first_pixel in range(0, pixels, step):
                here = min(step, pixels - first_pixel)
                job = Pass(
                    here * count,
                    dr.opaque(mi.UInt32, first_pixel),
                    dr.opaque(mi.UInt32, count.bit_length() - 1),
                    dr.opaque(mi.UInt32, first_sample),
                    dr.opaque(mi.UInt32, settings.seed & 0xFFFFFFFF),
                    dr.opaque(mi.UInt32, settings.max_depth),
                )
                trace_pass(self._surface, view, lights, sky, film, job)
                film.eval()
                done += here * count
                if progress is not None:
                    progress(done, total)
        return _develop(film, names, camera, settings.spp)


def _passes(spp: int) -> Iterator[tuple[int, int]]:
    """(first sample, count) of each pass; counts are powers of two, so that a pixel's lanes never straddle threads."""
    first = 0
    while first < spp:
        count = min(PASS, 1 << ((spp - first).bit_length() - 1))
        yield first, count
        first += count


def _layer_names(lighting: Lighting) -> tuple[str, ...]:
    return lighting.layer_names


def _light_set(lighting: Lighting) -> object:
    from mirelight.lighting.kernel.paths import LightSet

    n = len(lighting.lights)
    first = table.strata(n, min(n, table.ALL_LIGHTS))
    later = table.strata(n, n if n <= table.ALL_LIGHTS else 1)
    layers = np.arange(max(n, 2), dtype=np.uint32)
    return LightSet(table.pack(lighting.lights), first, later, layers)


def _sky(lighting: Lighting) -> object:
    from mirelight.lighting.kernel.sky import Sky

    return Sky(maps.prepare(lighting.environment), present=lighting.environment is not None)


def _develop(film: Film, names: tuple[str, ...], camera: Camera, spp: int) -> LightingBuffer:
    """Sums to means."""
    h, w = camera.height, camera.width
    surface = film.surface.numpy().reshape(h, w, -1)
    hits = surface[..., 0]
    mean: F32 = surface[..., 1:14] / np.maximum(hits, 1)[..., None]
    layers = film.layers.numpy().reshape(-1, 2, h, w, 3) / np.float32(spp)
    made = tuple(LightLayer(name=n, direct=x[0], indirect=x[1]) for n, x in zip(names, layers, strict=False))
    beauty = sum((x.total for x in made), np.zeros((h, w, 3), np.float32))
    squares = film.squares.numpy().reshape(h, w, 3) / spp
    variance = np.maximum(squares - beauty * beauty, 0) / max(spp - 1, 1)
    return LightingBuffer(
        camera=camera,
        coverage=hits / spp,
        layers=made,
        depth=mean[..., 0],
        position=mean[..., 1:4],
        normal=mean[..., 4:7],
        geometric_normal=mean[..., 7:10],
        albedo=mean[..., 10:13],
        variance=variance,
        spp=spp,
    )

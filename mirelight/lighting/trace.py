"""Lights a proxy: the tracer that holds a mesh and its acceleration structure, and the passes that fill a film."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING, TypeAlias

from mirelight.base import backend
from mirelight.base.errors import RenderError
from mirelight.base.progress import CountProgress
from mirelight.lighting.develop import dark, refuse_if_too_large
from mirelight.lighting.frame import FrameInProgress, LitProxy
from mirelight.lighting.layers import Layers
from mirelight.lighting.materials import is_emissive
from mirelight.lighting.sampling import for_camera, sample_all, with_pilot
from mirelight.lighting.sight import Sight
from mirelight.lighting.sunsky import plain
from mirelight.model import (
    F32,
    F64,
    I32,
    Camera,
    Environment,
    Lighting,
    LightingBuffer,
    PointLayers,
    ProxyMesh,
    RenderSettings,
    SurfaceCache,
    SurfaceCells,
    SurfaceTransport,
    digest,
)

if TYPE_CHECKING:
    from mirelight.lighting.budget import Noise
    from mirelight.lighting.kernel.cells import DeviceCells
    from mirelight.lighting.kernel.probes import PointRays
    from mirelight.lighting.kernel.proxy import DeviceProxy
    from mirelight.lighting.kernel.rays import SomePixels
    from mirelight.lighting.kernel.sky import Sky
    from mirelight.lighting.lattices import Detail

ROOM = 0.1  # of the sky, that the surface of a room sees at most
CELL_SAMPLES = 256  # of each cell of a surface cache
LOOK = 0x3C6EF372  # between the seeds of frames and of a first look at how noisy they are

Look: TypeAlias = Callable[[Callable[[], LightingBuffer]], None]  # may ask for the light so far


class Interrupted(KeyboardInterrupt):
    """The user stopped a trace; `buffer` is what there was, pixels without a sample black. None: nothing yet."""

    def __init__(self, buffer: LightingBuffer | None) -> None:
        self.buffer = buffer
        super().__init__("interrupted")


class Tracer:
    """A proxy made ready for tracing. Later frames compile nothing, whatever lights, environment and camera do.

    Args:
        proxy: the mesh.
        settings: how to trace.
        layers: False gives a single one, "beauty", and lights are sampled for the sum alone.
        aovs: False leaves sun visibility and ambient occlusion out.
        first_inserted: faces of the mesh from there on are inserted objects'; their light is traced and kept apart, in
            `LightingBuffer.objects`. None: there are none. With some, light is read from no cache.
        lobes: light is what the lobes of the materials reflect to the camera, of glTF's metallic-roughness model, and
            the albedo the metal's share of the surface; all else of the mesh is matt. Read from no cache, as above.
        detail: finer colours of the mesh's first faces, which mirrors show; with inserted objects or lobes.
    """

    def __init__(
        self,
        proxy: ProxyMesh,
        settings: RenderSettings,
        *,
        layers: bool = True,
        aovs: bool = True,
        first_inserted: int | None = None,
        lobes: bool = False,
        detail: Detail | None = None,
    ) -> None:
        self.settings = settings
        self._layers, self._aovs = layers, aovs
        self._proxy = proxy
        self.emissive = is_emissive(proxy)
        self._surface: DeviceProxy | None = None
        self._sky: tuple[Environment | None, Sky] | None = None  # the last frame's, as many frames share one
        backend.mitsuba(settings.variant, settings.threads)
        if len(proxy.faces):
            from mirelight.lighting.kernel.proxy import DeviceProxy

            self._surface = DeviceProxy(proxy, first_inserted, lobes=lobes, detail=detail)

    def trace(
        self,
        lighting: Lighting,
        camera: Camera,
        *,
        emission: bool = True,
        cache: SurfaceCache | None = None,
        progress: CountProgress | None = None,
        look: Look | None = None,
    ) -> LightingBuffer:
        """Trace one frame. What a pixel's samples see of the surface does not depend on the lights.

        Light is additive: frames of one camera under parts of a lighting, put together, are a frame under all of it but
        for noise.

        Args:
            lighting: lights, environment, sky model.
            camera: the splat camera; pixels coincide with its own.
            emission: False: surfaces that glow do not, for a part of a lighting; another part brings it.
            cache: light on the surface from `fill`, of the same lights and emission, read as `settings.indirect` says
                unless that is "traced" or paths end at their first hit. None: everything is traced.
            progress: called with (paths done, paths in all) after every launch; under a noise target the second number
                is a forecast.
            look: called after every launch, too, once each pixel has a sample; what it is given makes the light so far.

        Returns:
            A layer for each group of lights and each light without one, the environment, and emission where the proxy
            glows; their sum is the beauty. Where those of lights are more than `layers.MAX_LAYERS`, they share one
            named "lights". Noisy: with `settings.denoise` layers hold what `mirelight.lighting.denoise` needs.

        Raises:
            Interrupted: Ctrl-C; holds what there was.
            RenderError: the frame's film does not fit in memory.
            ValueError: it lacks a light.
        """
        lighting = plain(lighting)
        emission = emission and self.emissive
        layers = Layers.of(lighting, emissive=emission, separate=self._layers)
        objects = self._surface is not None and self._surface.has_objects
        refuse_if_too_large(camera, layers, parts=self.settings.denoise, objects=objects, most=self.settings.max_memory)
        if not len(self._proxy.faces):
            return dark(camera, layers, self.settings.spp)
        own = for_camera(self.settings, camera)
        settings, lit = with_pilot(own), self._lit(lighting, layers, emission, cache)
        frame = FrameInProgress(lit, camera, layers, settings, aovs=self._aovs)
        read = cache is not None and lit.cells is not None
        rays = min((x.rays for x in cache.lights), default=0) if cache is not None and read else 0
        try:
            sample_all(frame, settings, _looking(frame, progress or _ignore, look))
        except KeyboardInterrupt:
            raise Interrupted(frame.develop() if frame.samples.any() else None) from None
        return replace(frame.develop(), cell_rays=rays)

    def cells(self, size: float | None = None) -> SurfaceCells:
        """The pieces of the proxy that light is kept on, for any camera and any light.

        Args:
            size: edge of a cell, world units; None: from the proxy (`mirelight.lighting.thickness`).

        Raises:
            RenderError: the proxy has no faces, or finding them does not fit in memory.
        """
        from mirelight.lighting import cells, thickness

        surface = self._on_device()
        size = thickness.cell_size(surface, self._proxy) if size is None else size
        return cells.make(surface, self._proxy, size, self.settings.max_memory)

    @property
    def reads_surface(self) -> bool:
        """Whether by the settings a frame's reflected light is to be read from a cache: with "auto" in rooms alone."""
        return self.settings.indirect == "surface" or (self.settings.indirect == "auto" and self.openness < ROOM)

    @cached_property
    def openness(self) -> float:
        """Share of the sky that the surface sees: near 0 in a room, 1 where nothing stands before anything."""
        from mirelight.lighting import cells

        return 1.0 if self._surface is None else cells.openness(self._surface, self._proxy)

    def transport(
        self, cells: SurfaceCells, rays: int = CELL_SAMPLES, progress: CountProgress | None = None
    ) -> SurfaceTransport:
        """How light goes between cells: along at least `rays` of each, a power of two (fewer of very many cells).

        With it, `fill` traces no rays between surfaces. Progress is called with rays done and in all.

        Raises:
            RenderError: as `fill`.
        """
        from mirelight.lighting.transport import trace_links

        return trace_links(
            self._on_device(), cells, self.settings, 1 << max(rays - 1, 15).bit_length(), progress or _ignore
        )

    def fill(
        self,
        cells: SurfaceCells,
        lighting: Lighting,
        *,
        samples: int = CELL_SAMPLES,
        transport: SurfaceTransport | None = None,
        emission: bool = True,
        progress: CountProgress | None = None,
    ) -> SurfaceCache:
        """Light of a lighting on the surface, for every camera; light is additive, so parts may be filled apart.

        Args:
            cells: from `cells`.
            lighting: lights, environment, sky model.
            samples: of each cell; four times as many halve the cache's error.
            transport: between these cells, in place of one of `samples` rays.
            emission: False: surfaces that glow do not.
            progress: called with samples done and in all after every launch.

        Raises:
            RenderError: the proxy has no faces; the light of so many cells does not fit in memory.
        """
        from mirelight.lighting.transport import gather

        lighting, glow, report = plain(lighting), emission and self.emissive, progress or _ignore
        lit = LitProxy(self._on_device(), self._sky_of(lighting.environment), lighting, glow)
        return gather(lit, cells, transport or self.transport(cells, samples), self.settings, report)

    def _lit(self, lighting: Lighting, layers: Layers, emission: bool, cache: SurfaceCache | None) -> LitProxy:
        """The proxy under a lighting without a sky model, whose light is read from a cache."""
        cells = self._cells(cache, lighting, layers, emission)
        return LitProxy(self._on_device(), self._sky_of(lighting.environment), lighting, emission, cells)

    def _cells(
        self, cache: SurfaceCache | None, lighting: Lighting, layers: Layers, emission: bool
    ) -> DeviceCells | None:
        """The cache as this frame reads it; None where it is traced."""
        if cache is None or self.settings.indirect == "traced" or self.settings.max_depth == 1:
            return None
        from mirelight.lighting.cell_reading import bound

        names = Layers.of(lighting, emissive=emission).names
        return bound(cache, layers, names, self.settings.max_memory)

    def noise_of(
        self, lighting: Lighting, cameras: Sequence[Camera], cache: SurfaceCache, *, emission: bool = True
    ) -> Noise:
        """How noisy frames of some of the cameras are that read a cache: of its own fill, and of a sample.

        Arguments as for `trace`.
        """
        from mirelight.lighting.budget import looked_at

        lighting, emission = plain(lighting), emission and self.emissive
        layers = Layers.of(lighting, emissive=emission, separate=self._layers)
        lit = self._lit(lighting, layers, emission, cache)
        own = replace(self.settings, noise=1.0, denoise=False, seed=(self.settings.seed + LOOK) & 0xFFFFFFFF)

        def frame(view: SomePixels, row: Camera) -> FrameInProgress:
            return FrameInProgress(lit, row, layers, own, aovs=False, view=view)

        return looked_at(cameras, frame)

    def point_layers(
        self,
        lighting: Lighting,
        points: F64,
        normals: F64,
        spp: int,
        *,
        emission: bool = True,
        cache: SurfaceCache | None = None,
        progress: CountProgress | None = None,
    ) -> PointLayers:
        """Light that falls on points of the proxy from the side that their normals point to, layer by layer.

        Memory does not grow with the number of points, but for the result. Same points and seed, same bits.

        Args:
            lighting: lights and environment.
            points: (N, 3) on the proxy, world space.
            normals: (N, 3) unit, of the face that each lies on; either sign.
            spp: samples per point, instead of the settings' own.
            emission: as for `trace`.
            cache: as for `trace`.
            progress: called with samples done and in all after every launch.

        Raises:
            RenderError: the proxy has no faces.
            ValueError: the cache lacks a light.
        """
        from mirelight.lighting.points import gathered

        lighting, glow = plain(lighting), emission and self.emissive
        layers = Layers.of(lighting, emissive=glow, separate=self._layers)
        settings = replace(self.settings, spp=spp, noise=None, denoise=False)
        lit = self._lit(lighting, layers, glow, cache)

        def frame(view: PointRays, row: Camera, seed: int) -> FrameInProgress:
            own = replace(settings, seed=seed)
            return FrameInProgress(lit, row, layers, own, aovs=False, view=view, irradiance=True)

        def sample(opened: FrameInProgress, before: int) -> None:
            report = progress or _ignore
            sample_all(opened, settings, lambda done, total: report(before * spp + done, len(points) * spp))

        return gathered(points, normals, layers, settings.seed, frame, sample)

    def materials_at(self, points: F64, normals: F64) -> tuple[F32, F32]:
        """Points of the proxy themselves, as seen from where their normals point to.

        Args:
            points: as for `point_layers`.
            normals: as for `point_layers`.

        Returns:
            (N, 3) albedo; (N, 3) radiance that they send out.

        Raises:
            RenderError: the proxy has no faces.
        """
        from mirelight.lighting.kernel.probes import materials_at

        return materials_at(self._on_device(), points, normals)

    def nearest_along(self, origins: F64, directions: F64, reach: float) -> tuple[I32, F32, F64]:
        """The nearest point of the proxy on each line, both ways.

        Args:
            origins: (N, 3) world space.
            directions: (N, 3) unit directions.
            reach: farthest distance, world units.

        Returns:
            (N,) face, -1 where there is none; (N, 3) barycentric weights of its corners; (N,) distance.

        Raises:
            RenderError: the proxy has no faces.
        """
        from mirelight.lighting.kernel.probes import nearest_along

        return nearest_along(self._on_device(), origins, directions, reach)

    def sight(self) -> Sight:
        """The same mesh for rays without light; RenderError where it has no faces."""
        return Sight.over(self._on_device())

    def tuned(self, settings: RenderSettings, *, layers: bool, aovs: bool) -> Tracer:
        """A tracer of the same proxy by other settings, variant and threads alike; both share what is on the device."""
        out = copy(self)
        out.settings, out._layers, out._aovs = settings, layers, aovs
        return out

    def recolor(self, vertex_colors: F32) -> None:
        """Other vertex colours (V, 3) for a proxy that had some when it was made ready.

        Raises:
            RenderError: the proxy has no faces.
        """
        self._on_device().recolor(vertex_colors)

    def _on_device(self) -> DeviceProxy:
        if self._surface is None:
            raise RenderError("a proxy without faces has no points that light falls on")
        return self._surface

    def _sky_of(self, environment: Environment | None) -> Sky:
        """The environment on the device, prepared when it changes."""
        from mirelight.lighting.kernel.sky import Sky

        if self._sky is None or not (self._sky[0] is environment or _digest(self._sky[0]) == _digest(environment)):
            self._sky = environment, Sky(environment)
        return self._sky[1]


def _digest(environment: Environment | None) -> str:
    return "" if environment is None else digest(replace(environment, name=""))


def _ignore(done: int, total: int) -> None:
    """Stands for progress where nobody waits."""


def _looking(frame: FrameInProgress, progress: CountProgress, look: Look | None) -> CountProgress:
    """Progress that offers the light so far, once each pixel has a sample."""

    def report(done: int, total: int) -> None:
        progress(done, total)
        if look is not None and done < total and frame.samples.all():
            look(frame.so_far)

    return report

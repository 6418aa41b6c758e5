"""What is made once a scene, each part when it is first needed: splats, proxy, captured light, tracer, compositor.

Parts that take long are artefacts with a key of their own (`mirelight.pipeline.keys`), kept where the caller has a
place for them.
"""

from __future__ import annotations

import shlex
import time
from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import cached_property, partial
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from mirelight.base import backend
from mirelight.base.progress import CountProgress, ShareProgress, quiet
from mirelight.model import (
    F32,
    F64,
    Camera,
    EstimatedSky,
    Job,
    Lighting,
    OwnSplats,
    ProxyMesh,
    SplatCloud,
    SplatLayer,
    SurfaceCache,
    camera_checks,
    digest,
)
from mirelight.model.unit_lights import LightSet, Mixture, Unit
from mirelight.pipeline import beyond, frame_diagnostics, keys, requirements
from mirelight.pipeline.artefact_cache import ArtefactCache, made_once
from mirelight.pipeline.backdrops import around_unit
from mirelight.pipeline.cache import UserCache
from mirelight.pipeline.codecs import ARRAY, MESH, Codec, array_of, estimate_of
from mirelight.pipeline.frame_clock import FrameClock, for_all_frames
from mirelight.pipeline.surface_light import SurfaceLight
from mirelight.relighting import FarMaps

if TYPE_CHECKING:
    from mirelight.compositor import Compositor
    from mirelight.estimate import Estimate
    from mirelight.lighting import EngineTracer, Tracer

T = TypeVar("T")


class Prepared:
    """The parts of a job that light of views, of the surface and of splats is made from."""

    def __init__(
        self,
        job: Job,
        kept: ArtefactCache,
        report: Callable[[str], None] | None = None,
        progress: ShareProgress = quiet,
    ) -> None:
        self.job = job
        self.keys = keys.Keys(job)
        self.kept = kept
        self.clock = FrameClock()
        self._of_user = UserCache()
        self._report = report
        self.progress = progress
        self._estimates: dict[str, Lighting] = {}  # by key; as one object each, for their maps are known by identity

    @cached_property
    @for_all_frames
    def splats(self) -> SplatCloud | None:
        """The splats in world space."""
        if self.job.splats is not None:
            self.progress("reading the splats", 0.0)
        cloud = None if self.job.splats is None else self.job.splats.value
        if cloud is not None and cloud.dropped:
            self._tell(f"{cloud.dropped:,} splats with NaN, infinite or absurd values are left out")
        if cloud is not None and (line := camera_checks.too_far(cloud)):
            self._tell(line)
        return cloud

    @cached_property
    @for_all_frames
    def mesh(self) -> ProxyMesh | None:
        """The proxy as the job names it: read, or made from the splats unless it was kept from an earlier time."""
        job = self.job
        if job.proxy is None:
            return None
        if job.made_proxy is None:
            if line := camera_checks.too_far(job.proxy.value):
                self._tell(line)
            return self._painted(job.proxy.value)
        from mirelight.proxy.recipe import made_by

        key = self.keys.made_proxy
        found = self._shared(key, MESH)
        if found is not None:
            job.made_proxy.mesh.supply(found)
        else:
            self._tell("making the proxy mesh from the splats; it is kept for the next time")
            began = time.monotonic()
            made = made_by(job.made_proxy, lambda: self._guess, self.progress)
            backend.give_back()
            self._share(key, made, MESH)
            self._tell(f"the proxy mesh has {len(made.faces):,} triangles; made in {time.monotonic() - began:.0f} s")
        return self._painted(job.proxy.value)

    def _painted(self, mesh: ProxyMesh) -> ProxyMesh:
        """The mesh with what is painted to glow."""
        from mirelight.pipeline.painted import dressed_by

        glow = requirements.painted_glow(self.job)
        return dressed_by(mesh, glow, str(self.job.source), self.job.render) if glow else mesh

    @cached_property
    def views(self) -> tuple[SplatLayer, ...]:
        """What the capture's cameras see, where colours are taken from that and not from single splats: of splats that
        are no discs, where the cameras are known or can be guessed."""
        from mirelight.proxy.capture_views import capture_views

        job = self.job
        if self.splats is None:
            return ()
        views = capture_views(
            self.splats,
            job.capture_cameras,
            job.capture_pictures,
            variant=job.render.variant,
            threads=job.render.threads,
            report=self._tell,
            progress=self.progress,
            guess=lambda: self._guess,
        )
        backend.give_back()
        if views and not job.capture_pictures:
            self._tell(
                "colours are those of the capture's splats, too bright in the dark: none of its pictures is there"
            )
        return views

    @cached_property
    def _guess(self) -> tuple[Camera, ...]:
        """Where the capture was taken from, for one whose cameras are not known."""
        from mirelight.pipeline.guesses import guessed
        from mirelight.proxy import ProxySettings

        job = self.job
        assert job.splats is not None
        own = job.own_splats or OwnSplats.of_world(job.splats)
        settings = ProxySettings(variant=job.render.variant, threads=job.render.threads)
        return guessed(own, settings, self._shared, self._share)

    def _tell(self, line: str) -> None:
        if self._report is not None:
            self._report(line)

    @cached_property
    @for_all_frames
    def proxy(self) -> ProxyMesh | None:
        """The proxy as light falls on it: with the splats' colours where the job asks for them and they are of use."""
        job = self.job
        mesh = self.mesh
        if mesh is None or self.splats is None or job.captured is None or not requirements.colors_proxy(job):
            return mesh
        from mirelight.lighting import albedo

        colors = self.kept.get(self.keys.proxy, ARRAY)
        if colors is None:
            self.progress("finding the proxy's colours", 0.0)
            found = albedo.vertex_colors(self.splats, mesh, self.resolved(job.captured), job.render, self.views)
            finding = frame_diagnostics.of_colors(found.met, found.lit, own=job.made_proxy is not None)
            if finding is not None:
                self._tell(str(finding))
            colors = found.values
            self.kept.put(self.keys.proxy, colors, ARRAY)
        return albedo.with_vertex_colors(mesh, colors)

    @cached_property
    def glows(self) -> bool:
        """True where the proxy's own surfaces send out light that is traced."""
        from mirelight.lighting.materials import is_emissive

        return self.proxy is not None and not requirements.follows_engine(self.job) and is_emissive(self.proxy)

    @cached_property
    @for_all_frames
    def captured_level(self) -> float | None:
        """Mean luminance of the captured light over the scene, irradiance / pi; None where no mode asks for it."""
        job = self.job
        if self.proxy is None or job.captured is None or not requirements.compares(job):
            return None
        from mirelight.lighting.level import captured_level

        found = self.kept.get(self.keys.captured_level, ARRAY)
        if found is None:
            self.progress("measuring the captured light", 0.0)
            level = captured_level(self.splats, self.proxy, self.resolved(job.captured), job.render, self.views)
            found = np.array([level], np.float64)
            self.kept.put(self.keys.captured_level, found, ARRAY)
        return float(found[0])

    @for_all_frames
    def resolved(self, lighting: Lighting) -> Lighting:
        """The lighting with a sun and a map in place of its sky model, or of captured light that is to be estimated."""
        from mirelight.lighting.sunsky import resolved

        sky = lighting.sky
        if isinstance(sky, EstimatedSky):
            found = self._estimated(sky)
            around = found.environment
            assert around is not None
            suns = tuple(replace(x, intensity=x.intensity * sky.intensity) for x in found.lights)
            around = replace(around, intensity=around.intensity * sky.intensity)
            lighting = replace(lighting, lights=(*lighting.lights, *suns), environment=around, sky=None)
        return resolved(lighting, self.job.render.variant)

    def _estimated(self, sky: EstimatedSky) -> Lighting:
        """The light that the splats were captured under: found where it was kept, or estimated; even light in place of
        an estimate that is doubted."""
        from mirelight.estimate import lighting_of
        from mirelight.estimate.describe import doubts
        from mirelight.estimate.even import is_even

        key = self.keys.estimate(sky)
        known = self._estimates.get(key)
        if known is None:
            packed = self._shared(key, ARRAY)
            if packed is None:
                self._tell("estimating the captured light from the splats; it is kept for the next time")
                found = self.estimate(sky)
                for doubt in doubts(found):
                    self._tell(f'the captured light is not known: {doubt}; relight.mode = "tint" needs none')
                packed = self.keep_estimate(sky, found)
            known = self._estimates[key] = lighting_of(packed.astype(np.float64), sky.lights)
            if is_even(known):
                self._tell(
                    "the captured light's estimate is doubted, so even light, as strong, takes its place; to name what "
                    f"was found instead: mirelight estimate {shlex.quote(self.job.source.name)} -o captured.toml"
                )
        return known

    def estimate(self, sky: EstimatedSky) -> Estimate:
        """What the splats tell of the captured light, doubted or not: found where the user's cache has it, or made."""
        from mirelight.estimate import estimate

        key, codec = digest("estimate in full", self.keys.estimate(sky)), estimate_of(sky.lights)
        found = self._of_user.get(key, codec)
        if found is None:
            splats, mesh = self.splats, self.mesh
            assert splats is not None and mesh is not None
            settings = replace(self.job.render, seed=sky.seed)
            found = estimate(splats, mesh, settings, sky.exposure, sky.lights, self.views, self.progress)
            backend.give_back()
            self._of_user.put(key, found, codec)
        return found

    def keep_estimate(self, sky: EstimatedSky, found: Estimate) -> F32:
        """Keep what was found, or even light where that is doubted, as numbers (N,), for every job that asks for the
        same; says what is kept."""
        from mirelight.estimate.even import or_even

        kept = self._shared(self.keys.estimate(sky), ARRAY)
        if kept is not None:
            return kept
        splats, mesh = self.splats, self.mesh
        assert splats is not None and mesh is not None
        taken = or_even(found, splats, mesh, replace(self.job.render, seed=sky.seed), self.views)
        key, packed = self.keys.estimate(sky), taken.packed().astype(np.float32)
        self._share(key, packed, ARRAY)
        return packed

    def _shared(self, key: str, codec: Codec[T]) -> T | None:
        """What is kept for this job, or else for all of the user's; from then on for this job, too."""
        found = self.kept.get(key, codec)
        if found is None:
            found = self._of_user.get(key, codec)
            if found is not None:
                self.kept.put(key, found, codec)
        return found

    def _share(self, key: str, value: T, codec: Codec[T]) -> None:
        """Keep what takes long for this job, and for all of the user's."""
        self.kept.put(key, value, codec)
        self._of_user.put(key, value, codec)

    def light_key(self, light_set: LightSet, seen: Camera) -> str:
        """The key of a set's traced buffer; `seen` is the lighting's camera."""
        return self.keys.light(light_set, seen)

    def mixture(self, lighting: Lighting) -> Mixture:
        """How a lighting is made of sets of unit lights."""
        return self.keys.mixture(lighting)

    def lighting_of(self, light_set: LightSet) -> Lighting:
        """What to trace for a set: its lights, each with the name of its unit's layer."""
        return light_set.as_lighting(self.resolved)

    @for_all_frames
    def surface_cache(self, light_set: LightSet, *, progress: CountProgress | None = None) -> SurfaceCache | None:
        """A set's light on the surface; None where the job traces it."""
        return None if self.surface_light is None else self.surface_light.cache(light_set, progress)

    @cached_property
    def surface_light(self) -> SurfaceLight | None:
        """Light on the surface, for any camera; None where the job traces it."""
        from mirelight.lighting import Tracer

        tracer = self.tracer if requirements.reads_surface(self.job) else None
        if not isinstance(tracer, Tracer) or not tracer.reads_surface:
            return None
        return SurfaceLight(self.job, self.keys, self.kept, tracer, self.lighting_of, self._tell)

    @cached_property
    @for_all_frames
    def compositor(self) -> Compositor:
        """The splats on the compute device."""
        from mirelight.compositor import Compositor

        render = self.job.render
        assert self.splats is not None
        self.progress("handing the splats to the compositor", 0.0)
        return Compositor(self.splats, self.job.compositor, variant=render.variant, threads=render.threads)

    @cached_property
    @for_all_frames
    def splat_distances(self) -> F32:
        """(N,) how far each splat lies from the proxy, world units."""
        splats, mesh = self.splats, self.mesh
        assert splats is not None and mesh is not None
        key, threads = self.keys.splat_distances, self.job.render.threads

        def make() -> F32:
            return beyond.distances(splats.means, mesh, threads, self.progress)

        return made_once(self.kept, f"distances {key[:24]}", key, array_of((len(splats),)), make)

    def far_map(self, units: Iterable[tuple[Unit, F64]]) -> F32:
        """(128, 256, 3) what unit lights times factors (3,) have far away."""
        around = partial(around_unit, resolved=self.resolved, with_ground=False)
        return self._far_maps.of((unit.digest, factor, partial(around, unit)) for unit, factor in units)

    @cached_property
    def _far_maps(self) -> FarMaps:
        return FarMaps()

    @cached_property
    @for_all_frames
    def tracer(self) -> Tracer | EngineTracer:
        """The proxy on the compute device, and what lights it."""
        from mirelight.lighting import tracer

        assert self.proxy is not None
        job = self.job
        self.progress("handing the proxy to the path tracer", 0.0)
        return tracer(
            self.proxy, job.render, layers=requirements.keeps_lights_apart(job), aovs=requirements.wants_aovs(job)
        )

"""A job made ready: everything that is made once a scene, each part when it is first needed.

Parts that take long are artefacts with a key of their own (`mirelight.pipeline.keys`), kept where the caller has a
place for them.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from mirelight import relighting
from mirelight.model import (
    F32,
    Camera,
    Deferred,
    EstimatedSky,
    Job,
    Lighting,
    LightingBuffer,
    Matte,
    ProxyMesh,
    SplatCloud,
    SplatLayer,
    SurfaceCache,
    camera_checks,
)
from mirelight.model.unit_lights import LightSet, Mixture
from mirelight.pipeline import frame_diagnostics, keys, requirements
from mirelight.pipeline.artefact_cache import ArtefactCache, NullCache
from mirelight.pipeline.cache import UserCache
from mirelight.pipeline.codecs import ARRAY, MESH, Codec
from mirelight.pipeline.completeness import check
from mirelight.pipeline.splat_light import SplatLight
from mirelight.pipeline.surface_light import SurfaceLight
from mirelight.pipeline.view_light import ViewLight

if TYPE_CHECKING:
    from mirelight.compositor import Compositor
    from mirelight.estimate import Estimate
    from mirelight.lighting import EngineTracer, Tracer
    from mirelight.lighting.mattes import Mattes

T = TypeVar("T")


def prepare(
    job: Job, kept: ArtefactCache | None = None, report: Callable[[str], None] | None = None, like: Scene | None = None
) -> Scene:
    """The job made ready for its frames. Returns at once: files are read, and artefacts made, when they are needed.

    Args:
        job: from `mirelight.load`.
        kept: where artefacts are found and kept; None: nowhere.
        report: called with a line before and after something that takes long is made.
        like: a scene whose parts are taken over where this job would make the same, as of the job before an edit.

    Raises:
        InputError: the job cannot be rendered: nothing in it, lights without a proxy, a mode without what it needs.
    """
    if not isinstance(job, Job):
        raise TypeError(f"prepare() takes a job as mirelight.load gives it, not {type(job).__name__}")
    check(job)
    made = Scene(job, kept or NullCache(), report)
    if like is not None:
        made.take_over(like)
    return made


def _digest(part: Deferred[Any] | None) -> str:
    return "" if part is None else part.digest


class Scene:
    """What all frames of a job share. Made by :func:`prepare`; not to be sent to another process (send the job)."""

    def __init__(self, job: Job, kept: ArtefactCache, report: Callable[[str], None] | None = None) -> None:
        self.job = job
        self.keys = keys.Keys(job)
        self.kept = kept
        self._of_user = UserCache()
        self._report = report
        self._estimates: dict[str, Lighting] = {}  # by key; as one object each, for their maps are known by identity
        self._view: ViewLight | None = None
        self._softened: tuple[LightingBuffer, LightingBuffer] | None = None  # as it was traced, and as it became
        self._mattes: tuple[Camera, tuple[Matte, ...]] | None = None

    def __repr__(self) -> str:
        ready = [name for name in ("splats", "proxy", "captured_level", "compositor", "tracer") if name in vars(self)]
        return f"Scene({self.job.source.name}; ready: {', '.join(ready) or 'nothing yet'})"

    def take_over(self, other: Scene) -> None:
        """Whatever another scene has ready and this one would make the same: told by keys, nothing is compared."""
        job, theirs, ready, mine = self.job, other.job, vars(other), vars(self)
        self._estimates |= other._estimates
        same_splats = _digest(job.splats) == _digest(theirs.splats)
        if same_splats:
            mine.update({name: ready[name] for name in ("splats",) if name in ready})
        same_machine = (job.render.variant, job.render.threads) == (theirs.render.variant, theirs.render.threads)
        if same_splats and same_machine and job.compositor == theirs.compositor:
            mine.update({name: ready[name] for name in ("compositor",) if name in ready})
        if job.proxy is None or theirs.proxy is None or self.keys.proxy != other.keys.proxy:
            return
        if job.render.profile == theirs.render.profile:
            mine.update({name: ready[name] for name in ("mesh", "proxy", "glows") if name in ready})
        if (
            requirements.compares(job)
            and requirements.compares(theirs)
            and self.keys.captured_level == other.keys.captured_level
        ):
            mine.update({name: ready[name] for name in ("captured_level",) if name in ready})
        if same_machine and "tracer" in ready:
            self._take_tracer(other)

    def _take_tracer(self, other: Scene) -> None:
        from mirelight.lighting import Tracer

        job, theirs, tracer = self.job, other.job, other.tracer
        apart, aovs = requirements.keeps_lights_apart(job), requirements.wants_aovs(job)
        if (job.render, apart, aovs) == (
            theirs.render,
            requirements.keeps_lights_apart(theirs),
            requirements.wants_aovs(theirs),
        ):
            vars(self)["tracer"] = tracer
        elif isinstance(tracer, Tracer) and not requirements.follows_engine(job):
            vars(self)["tracer"] = tracer.tuned(job.render, layers=apart, aovs=aovs)

    def read(self) -> None:
        """Read the splats, and read or make the proxy where light falls on it. Otherwise that comes when it is needed.

        Raises:
            InputError: one of them cannot be used.
        """
        _ = self.splats
        if self.job.lightings:
            _ = self.mesh

    @cached_property
    def splats(self) -> SplatCloud | None:
        """The splats in world space."""
        cloud = None if self.job.splats is None else self.job.splats.value
        if cloud is not None and cloud.dropped:
            self._tell(f"{cloud.dropped:,} splats with NaN, infinite or absurd values are left out")
        if cloud is not None and (line := camera_checks.too_far(cloud)):
            self._tell(line)
        return cloud

    @cached_property
    def mesh(self) -> ProxyMesh | None:
        """The proxy as the job names it: read, or made from the splats unless it was kept from an earlier time."""
        job = self.job
        if job.proxy is None:
            return None
        if job.made_proxy is None:
            if line := camera_checks.too_far(job.proxy.value):
                self._tell(line)
            return job.proxy.value
        from mirelight.proxy.recipe import made_by

        key = self.keys.made_proxy
        found = self._shared(key, MESH)
        if found is not None:
            job.made_proxy.mesh.supply(found)
        else:
            self._tell("making the proxy mesh from the splats; it is kept for the next time")
            began = time.monotonic()
            made = made_by(job.made_proxy)
            self._share(key, made, MESH)
            self._tell(f"the proxy mesh has {len(made.faces):,} triangles; made in {time.monotonic() - began:.0f} s")
        return job.proxy.value

    @cached_property
    def views(self) -> tuple[SplatLayer, ...]:
        """The splats as the capture's cameras see them, where colours are taken from that and not from single splats:
        of splats that are no discs, where the cameras are known."""
        from mirelight.proxy.capture_views import capture_views

        job = self.job
        if self.splats is None:
            return ()
        return capture_views(self.splats, job.capture_cameras, job.render.variant, job.render.threads)

    def _tell(self, line: str) -> None:
        if self._report is not None:
            self._report(line)

    @cached_property
    def proxy(self) -> ProxyMesh | None:
        """The proxy as light falls on it: with the splats' colours where the job asks for them and they are of use."""
        job = self.job
        mesh = self.mesh
        if mesh is None or self.splats is None or job.captured is None or not requirements.colors_proxy(job):
            return mesh
        from mirelight.lighting import albedo

        colors = self.kept.get(self.keys.proxy, ARRAY)
        if colors is None:
            found = albedo.vertex_colors(self.splats, mesh, self.resolved(job.captured), job.render, self.views)
            finding = frame_diagnostics.of_colors(found.met, found.lit)
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
    def captured_level(self) -> float | None:
        """Mean luminance of the captured light over the scene, irradiance / pi; None where no mode asks for it."""
        job = self.job
        if self.proxy is None or job.captured is None or not requirements.compares(job):
            return None
        from mirelight.lighting.level import captured_level

        found = self.kept.get(self.keys.captured_level, ARRAY)
        if found is None:
            level = captured_level(self.splats, self.proxy, self.resolved(job.captured), job.render, self.views)
            found = np.array([level], np.float64)
            self.kept.put(self.keys.captured_level, found, ARRAY)
        return float(found[0])

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
        """The light that the splats were captured under: found where it was kept, or estimated."""
        from mirelight.estimate import estimate, lighting_of

        key = self.keys.estimate(sky)
        known = self._estimates.get(key)
        if known is None:
            packed = self._shared(key, ARRAY)
            if packed is None:
                splats, mesh = self.splats, self.mesh
                assert splats is not None and mesh is not None
                self._tell("estimating the captured light from the splats; it is kept for the next time")
                settings = replace(self.job.render, seed=sky.seed)
                found = estimate(splats, mesh, settings, sky.exposure, sky.lights, self.views)
                packed = self.keep_estimate(sky, found)
            known = self._estimates[key] = lighting_of(packed.astype(np.float64), sky.lights)
        return known

    def keep_estimate(self, sky: EstimatedSky, found: Estimate) -> F32:
        """Keep what was found for every job that asks for the same; says what is kept."""
        key, packed = self.keys.estimate(sky), found.packed().astype(np.float32)
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

    def mixture(self, lighting: Lighting) -> Mixture:
        """How a lighting is made of sets of unit lights."""
        return self.keys.mixture(lighting)

    def view_light(self, seen: Camera) -> ViewLight:
        """The light of a view, `seen` the lighting's camera; that of the last view is kept."""
        if self._view is None or self._view.is_broken or keys.view(self._view.camera) != keys.view(seen):
            self._view = ViewLight(self, seen)
        return self._view

    def lighting_of(self, light_set: LightSet) -> Lighting:
        """What to trace for a set: its lights, each with the name of its unit's layer."""
        return light_set.as_lighting(self.resolved)

    def surface_cache(
        self, light_set: LightSet, *, progress: Callable[[int, int], None] | None = None
    ) -> SurfaceCache | None:
        """A set's light on the surface; None where the job traces it."""
        return None if self.surface_light is None else self.surface_light.cache(light_set, progress)

    @cached_property
    def surface_light(self) -> SurfaceLight | None:
        """Light on the surface, for all of the job's cameras; None where the job traces it."""
        from mirelight.lighting import Tracer

        if not requirements.reads_surface(self.job) or not isinstance(self.tracer, Tracer):
            return None
        return SurfaceLight(self, self.tracer, self._tell)

    @cached_property
    def splat_light(self) -> SplatLight:
        """Light on the splats, for all of the job's cameras."""
        said: set[str] = set()

        def say(what: str, done: int, total: int) -> None:
            if what not in said:
                said.add(what)
                self._tell(f"light on {len(self.splats or ()):,} splats: {what}; it is kept for the next time")

        return SplatLight(self, self.job.render.spp, say)

    def softened(self, captured: LightingBuffer) -> LightingBuffer:
        """A view's captured light with shadows as soft as the splats show them; that of the last view is kept."""
        if self._softened is not None and self._softened[0] is captured:
            return self._softened[1]
        from mirelight.lighting import Tracer
        from mirelight.lighting.splat_light import lamps_in_view

        job, tracer = self.job, self.tracer
        assert job.captured is not None and isinstance(tracer, Tracer)
        known = self.resolved(job.captured)
        made = captured
        if known.lights:
            lamps = lamps_in_view(tracer, known, captured.camera)
            if job.render.denoise:
                from mirelight.lighting.denoise import denoise

                lamps = denoise(lamps, layers=False)
            values = self.splat_light.captured_lamps
            seen, on_splats = self.compositor.composite_with(captured.camera, values, depth=False)
            made = relighting.softened(captured, lamps, on_splats, 1 - seen.transmittance)
        self._softened = captured, made
        return made

    @cached_property
    def compositor(self) -> Compositor:
        """The splats on the compute device."""
        from mirelight.compositor import Compositor

        render = self.job.render
        assert self.splats is not None
        return Compositor(self.splats, self.job.compositor, variant=render.variant, threads=render.threads)

    def mattes(self, camera: Camera) -> tuple[Matte, ...]:
        """The cryptomattes that the job's files hold, of one camera; those of the last camera are kept."""
        wanted = requirements.mattes(self.job)
        if not wanted:
            return ()
        if self._mattes is None or keys.view(self._mattes[0]) != keys.view(camera):
            self._mattes = (camera, tuple(self._matte_rays.of(camera, name) for name in wanted))
        return self._mattes[1]

    @cached_property
    def _matte_rays(self) -> Mattes:
        from mirelight.lighting.mattes import Mattes

        assert self.mesh is not None
        return Mattes(self.mesh, self.job.render.variant, self.job.render.threads)

    @cached_property
    def tracer(self) -> Tracer | EngineTracer:
        """The proxy on the compute device, and what lights it."""
        from mirelight.lighting import tracer

        assert self.proxy is not None
        job = self.job
        return tracer(
            self.proxy, job.render, layers=requirements.keeps_lights_apart(job), aovs=requirements.wants_aovs(job)
        )

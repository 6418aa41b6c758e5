"""Keys of what is made once a scene, whoever looks at it: the base of `mirelight.pipeline.keys`."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property

from mirelight.model import Environment, EstimatedSky, Job, SkyModel, Variant, digest
from mirelight.pipeline import provenance, reads, requirements


def device(variant: Variant) -> str:
    """What decides the bits of all that is traced or searched, whatever is traced: the variant, and the versions of
    what computes it."""
    return digest("device", variant, _versions(provenance.versions(), "mitsuba", "drjit", "llvm", "numpy", "scipy"))


def _versions(known: dict[str, str], *packages: str) -> dict[str, str]:
    return {k: v for k, v in known.items() if k in ("mirelight", *packages)}


class SceneKeys:
    """The keys of a job's mesh, captured light, surface, and places of splats."""

    def __init__(self, job: Job) -> None:
        self.job = job

    @cached_property
    def made_proxy(self) -> str:
        """The bare mesh that is made from the splats."""
        job = self.job
        assert job.made_proxy is not None
        return digest("mesh", job.made_proxy.digest, self._device)

    @cached_property
    def proxy(self) -> str:
        """The proxy as light falls on it: with the splats' colours where they are wanted."""
        job = self.job
        assert job.proxy is not None
        if not requirements.colors_proxy(job):
            return self._mesh
        assert job.splats is not None and job.captured is not None
        parts = self._mesh, *self._shown, reads.light(job.captured), job.render.seed, job.render.max_depth
        return digest("colours", *parts, self._device)

    @cached_property
    def _mesh(self) -> str:
        """The proxy with what glows of it."""
        job, glow = self.job, requirements.painted_glow(self.job)
        assert job.proxy is not None
        return digest("painted", job.proxy.digest, glow, self._device) if glow else job.proxy.digest

    @cached_property
    def captured_level(self) -> str:
        """How bright the captured light is over the scene, one number."""
        job = self.job
        assert job.captured is not None
        parts = *self._shown, self.proxy, reads.light(job.captured), job.render.seed
        return digest("level", *parts, job.render.max_depth, job.render.profile, self._device)

    def estimate(self, sky: EstimatedSky) -> str:
        """The light that the splats were captured under, found from splats and proxy."""
        glow = [self._mesh] if requirements.painted_glow(self.job) else []
        return digest("estimate", replace(sky, intensity=1.0), *self._looked_at, *glow, self._device)

    @cached_property
    def views(self) -> str:
        """What the capture's cameras see, known or guessed."""
        own = self.job.own_splats
        guessed_in = own and (own.splats.digest, own.world_from_own)
        return digest("views", *self._shown, guessed_in, self._device)

    @property
    def _shown(self) -> tuple[object, ...]:
        """What tells the captured colours: splats, the cameras that they are looked at from, their pictures."""
        job = self.job
        return job.splats and job.splats.digest, *self._looked_at

    @property
    def _looked_at(self) -> tuple[object, ...]:
        """The cameras of the capture, and what they took."""
        job = self.job
        return job.capture_cameras, *([job.capture_pictures] if job.capture_pictures else [])

    def map_of(self, environment: Environment) -> str:
        """An environment's picture, made as small as data sets keep it; its turn and strength are no part of it."""
        return digest("map", environment.radiance, self._versions("numpy"))

    def sky_of(self, sky: SkyModel | EstimatedSky, part: str) -> str:
        """The sun or the sky of a model, kept with data sets."""
        return digest("sky", self.estimate(sky) if isinstance(sky, EstimatedSky) else "", sky, part, self._device)

    @cached_property
    def splat_places(self) -> str:
        """Where each splat lies on the proxy, and on which side."""
        job = self.job
        assert job.splats is not None
        parts = job.splats.digest, self.proxy, job.captured and reads.light(job.captured), job.render.seed
        return digest("places", *parts, job.render.max_depth, self._device)

    @cached_property
    def splat_distances(self) -> str:
        """How far each splat lies from the proxy."""
        job = self.job
        assert job.splats is not None and job.proxy is not None
        return digest("distances", job.splats.digest, job.proxy.digest, self._versions("numpy", "scipy"))

    @cached_property
    def splat_sky(self) -> str:
        """Which splats are of the sky, and in which direction from where the capture was taken."""
        return digest("sky of splats", self.splat_distances, self.job.capture_cameras)

    @cached_property
    def surface_cells(self) -> str:
        """The pieces of the proxy that light is kept on, whatever looks at it."""
        return digest("cells", self.proxy, self._device)

    @cached_property
    def surface_transport(self) -> str:
        """How light goes between those pieces, whatever the light."""
        return digest("surface transport", self.surface_cells, self.job.render.seed)

    @cached_property
    def _device(self) -> str:
        return device(self.job.render.variant)

    def _versions(self, *packages: str) -> dict[str, str]:
        return _versions(self._all_versions, *packages)

    @cached_property
    def _all_versions(self) -> dict[str, str]:
        return provenance.versions()

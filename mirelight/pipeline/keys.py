"""Keys of finished work: the digest of exactly what each product is made from.

docs/reference/made-again.md says for every setting what is made again when it changes; a test holds that table against
this module.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Iterator
from dataclasses import replace
from functools import cached_property

from mirelight import relighting
from mirelight.model import Camera, Job, Lighting, RelightSettings, digest
from mirelight.model.inserted import standing
from mirelight.model.unit_lights import ALIKE, GLOW, LightSet, LightSets, Mixture, terms
from mirelight.pipeline import reads, requirements
from mirelight.pipeline.requirements import Arrangement
from mirelight.pipeline.scene_keys import SceneKeys

FILE_SUFFIXES = (".exr", ".png")


class Keys(SceneKeys):
    """The keys of one job. What frames share is taken once, so that a plan of ten thousand costs little."""

    def __init__(self, job: Job) -> None:
        super().__init__(job)
        self._eyes: dict[int, tuple[Camera, str, str]] = {}
        self._seen: dict[tuple[str, ...], str] = {}
        self._arranged: dict[int, tuple[Arrangement, str]] = {}  # digests of objects in their places
        self._composites: dict[str, str] = {}  # by view
        self._old: dict[str, list[str]] = {}  # what a frame reads of the captured light, by view
        self._relights: dict[RelightSettings, str] = {}
        self._moments: dict[int, Mixture] = {}  # of lightings for single cameras
        self._named: dict[int, tuple[Lighting, str]] = {}

    # --- light, whoever looks at it ---

    @cached_property
    def splat_sets(self) -> LightSets:
        """The sets of unit lights whose light on splats makes the job's lightings, then the captured one."""
        job = self.job
        return LightSets(tuple(requirements.with_compared(job, job.lightings)), ALIKE)

    def splat_light(self, light_set: LightSet, spp: int) -> str:
        """The light of a set on each splat."""
        return digest("light on splats", self.splat_places, light_set.digest, spp)

    @cached_property
    def sets(self) -> LightSets:
        """The sets of unit lights that the job's lightings are made of; those of the captured light come last."""
        job = self.job
        shared = tuple(x for x in job.lightings if x.time is None)
        return LightSets(
            tuple(requirements.with_compared(job, shared)), requirements.rules(job), shared if job.pooled else ()
        )

    def _moment(self, lighting: Lighting) -> Mixture:
        """Lights for one camera alone: traced together, for no other frame has a use for a part of them."""
        known = self._moments.get(id(lighting))
        if known is None:
            known = self._moments[id(lighting)] = LightSets((lighting,), requirements.rules(self.job)).mixture(lighting)
        return known

    # --- made once a camera ---

    def composite(self, camera: Camera) -> str:
        """The splats as a camera sees them; kept, since all its frames ask for it."""
        seen = self._eye(camera)[0]
        if seen not in self._composites:
            self._composites[seen] = _joined(self._composite, seen)
        return self._composites[seen]

    @cached_property
    def _composite(self) -> str:
        job = self.job
        if job.splats is None:
            return "no splats"
        wanted = requirements.wants_depth(job), requirements.wants_diffuse(job)
        settings = reads.read(job.compositor, reads.compositor_reads(job.compositor)), *wanted
        beyond = (
            ["off the proxy", self.splat_distances, requirements.follows_engine(job)]
            if requirements.wants_beyond(job)
            else []
        )
        versions = self._versions("drjit", "llvm")
        return digest("composite", job.splats.digest, settings, versions, job.render.variant, *beyond)

    def light(self, light_set: LightSet, camera: Camera) -> str:
        """The traced buffer of a set of unit lights; `camera` is the lighting's."""
        return self._light(light_set, reads.view(camera))

    def light_with_objects(self, light_set: LightSet, camera: Camera, objects: Arrangement) -> str:
        """The same with inserted objects in the scene."""
        return self._light(light_set, reads.view(camera), self._objects(objects))

    def light_of_lobes(self, light_set: LightSet, camera: Camera) -> str:
        """Key of what the proxy's materials mirror of it."""
        return self._light(light_set, reads.view(camera), self._lobes)

    @cached_property
    def _lobes(self) -> str:
        """Materials as the job has them; those of the proxy's file are in its digest."""
        return digest("lobes", self.job.materials)

    def _light(self, light_set: LightSet, seen: str, objects: str = "") -> str:
        """The same by the camera's view; kept, since many lightings are made of one set."""
        place = light_set.digest, seen, *([objects] if objects else [])
        found = self._seen.get(place)
        if found is None:
            found = self._seen[place] = _joined(self._traced, *place)
        return found

    def in_front(self, camera: Camera, objects: Arrangement) -> str:
        """The splats in front of objects, as a camera sees them."""
        return _joined("in front", self.composite(camera), self._traced, self._objects(objects), *self._eye(camera))

    def object_matte(self, camera: Camera, objects: Arrangement) -> str:
        """Which of the objects a camera sees where."""
        return _joined("object matte", self._traced, self._objects(objects), self._eye(camera)[0])

    def mirrored(self, objects: Arrangement) -> str:
        """What mirrors among objects show of the capture."""
        return digest("mirrored", self.proxy, self._objects(tuple(x.resting or x for x in objects)), self._device)

    def object_boxes(self, objects: Arrangement) -> str:
        """Where objects stand."""
        return digest("boxes round objects", self.proxy, self._objects(objects))

    def _objects(self, objects: Arrangement) -> str:
        """What is put into the scene; empty where nothing is."""
        if not objects:
            return ""
        if any(x.resting is not None or x.motion is not None for x in objects):  # new ones for every frame
            return digest("objects", [(x.mesh.digest, x.drop, x.scatter, x.motion) for x in objects])
        found = self._arranged.get(id(objects))
        if found is None:
            made = digest("objects", [(x.mesh.digest, x.drop, x.scatter) for x in objects])
            found = self._arranged[id(objects)] = objects, made
        return found[1]

    @cached_property
    def _traced(self) -> str:
        job = self.job
        settings = (
            reads.read(job.render, reads.light_reads(job)),
            requirements.keeps_lights_apart(job),
            requirements.wants_aovs(job),
        )
        surface = digest(self.surface_cells, self._of_noise_target) if requirements.reads_surface(job) else ""
        return digest("light", self.proxy, settings, surface, self._device)

    def surface_light(self, part: LightSet) -> str:
        """Light on the surface: of a unit light, of what glows, or of a lighting that is traced as it is."""
        depth = self.job.render.max_depth
        return digest("light on the surface", self.surface_transport, part.digest, depth, *self._of_noise_target)

    @cached_property
    def _of_noise_target(self) -> tuple[object, ...]:
        """How many fills are averaged for a noise target depends on the target and on what frames look like."""
        job = self.job
        if job.render.noise is None:
            return ()
        views = [reads.view(x) for x in requirements.lighting_cameras(job)]
        return job.render.noise, requirements.keeps_lights_apart(job), views

    def _on_surface(self, every: Iterable[LightSet]) -> Iterator[str]:
        yield from (self.surface_cells, self.surface_transport)
        yield from (self.surface_light(part) for one in every for part in one.parts())

    def lights(self) -> Iterator[str]:
        """All light of the job that is kept: each camera's sets, and what lies on the surface."""
        job = self.job
        lightings = requirements.with_compared(job, job.lightings)
        every = {s.digest: s for x in lightings for s in self.mixture(x).sets}
        for camera in job.cameras:
            needs = self.needs(camera, (x for x in job.lightings if x.lights_up(camera)))
            seen = relighting.lighting_camera(camera, job.relight)
            if any(relighting.adds_lobes(job.relight_of(x)) for x in job.lightings):
                yield from (self.light_of_lobes(s, seen) for s in (*every.values(), GLOW))
            yield from (*needs.lights, *needs.veiled, self.light(GLOW, seen))
            there = (standing(x, camera.frame) for x in requirements.arrangements(job))
            yield from (self.light_with_objects(GLOW, seen, x) for x in there)
        if requirements.reads_surface(job):
            yield from self._on_surface((*every.values(), GLOW))

    def needs(self, camera: Camera, lightings: Iterable[Lighting | None]) -> requirements.FrameNeeds:
        """What the frames of a camera under some lightings are made from; what glows is known when it is lit."""
        job = self.job
        seen = relighting.lighting_camera(camera, job.relight)
        own = [x for x in lightings if x is not None]
        compared = requirements.with_compared(job, own)[len(own) :]
        there = [job.objects_of(x, camera) for x in own]
        both = zip(own, there, strict=True)
        lights = {self.light_with_objects(s, seen, objects): s for x, objects in both for s in self.mixture(x).sets}
        alone = own if requirements.wants_shadow(job) else []
        lights |= {self.light(s, seen): s for x in (*alone, *compared) for s in self.mixture(x).sets}
        shiny = requirements.with_compared(job, [x for x in own if relighting.adds_lobes(job.relight_of(x))])
        if len(shiny) > (requirements.compared(job) is not None):
            lights |= {self.light_of_lobes(s, seen): s for x in shiny for s in self.mixture(x).sets}
        composite = None if job.splats is None else self.composite(camera)
        veiled: list[str] = []
        for objects in {id(x): x for x in there}.values() if job.objects else ():
            veiled += [self.object_matte(camera, objects)]
            veiled += [] if composite is None else [self.in_front(camera, objects)]
        return requirements.FrameNeeds(composite, tuple(lights.values()), tuple(lights), tuple(veiled))

    # --- frames ---

    def frame(self, camera: Camera, lighting: Lighting | None) -> str:
        """Key of a frame's linear pixels."""
        job = self.job
        composite = self.composite(camera)
        if camera.exposure is not None:
            composite = _joined("exposure", composite, str(job.render.lens_samples))
        if lighting is None:
            return _joined("unlit", composite)
        seen = self._eye(camera)[1]
        objects = self._objects(job.objects_of(lighting, camera))
        parts = [composite, *self._lit(lighting, seen, objects), self._relit(job.relight_of(lighting))]
        if camera.exposure is not None and camera.exposure.frames is not None:
            parts.append(digest("moving", camera.frame, [x.motion for x in job.objects_of(lighting)]))
        if requirements.wants_shadow(job):
            parts += ["shadow", *self._lit(lighting, seen)]
        if relighting.adds_lobes(job.relight_of(lighting)):
            for one in requirements.with_compared(job, [lighting]):
                parts += self._lit(one, seen, self._lobes)
        captured = requirements.compared_in(job, lighting)
        if captured is not None:
            if seen not in self._old:
                self._old[seen] = [*self._lit(captured, seen), self.captured_level]
            parts += self._old[seen]
        if job.splats is not None and relighting.per_splat(job.relight_of(lighting)):
            parts += self._on_splats(lighting)
        if job.masks:
            parts.append(self._paint)
        return _joined("frame", *parts)

    @cached_property
    def _paint(self) -> str:
        """Where factors are taken from the surface around."""
        return digest("paint", self.job.masks, self._device)

    def _on_splats(self, lighting: Lighting) -> Iterator[str]:
        """What a frame reads of the light on splats."""
        if self.job.relight_of(lighting).follows_sky:
            yield self.splat_sky
        for one in (lighting, requirements.compared_in(self.job, lighting)):
            if one is not None:
                mixture = self.splat_sets.mixture(one)
                yield from (self.splat_light(s, self.job.render.spp) for s in mixture.sets)
                yield mixture.digest

    def _lit(self, lighting: Lighting, seen: str, objects: str = "") -> Iterable[str]:
        """`seen`: the view of the lighting's camera."""
        mixture = self.mixture(lighting)
        return [self._light(one, seen, objects) for one in mixture.sets] + [mixture.digest]

    def _eye(self, camera: Camera) -> tuple[str, str]:
        """The view of a camera, and that of the camera which its light is traced for; those of one camera are kept."""
        found = self._eyes.get(id(camera))
        if found is None or found[0] is not camera:
            seen = relighting.lighting_camera(camera, self.job.relight)
            found = self._eyes[id(camera)] = (camera, reads.view(camera), reads.view(seen))
        return found[1:]

    def mixture(self, lighting: Lighting) -> Mixture:
        """How a lighting is made of sets."""
        return self.sets.mixture(lighting) if lighting.time is None else self._moment(lighting)

    def _relit(self, settings: RelightSettings) -> str:
        """How light meets splats; that of one kind of settings is kept."""
        found = self._relights.get(settings)
        if found is None:
            job = self.job
            denoised = (True, "captured: the sum", self._versions("pyoidn")) if job.render.denoise else (False,)
            found = self._relights[settings] = digest(
                "relit",
                reads.read(settings, relighting.reads(settings)),
                denoised,
                self._versions("numpy", *(("scipy",) if relighting.repairs(settings) else ())),
                job.splats is None,
                requirements.wants_noise(job),
                job.output.wants_layers,  # layers are added up one by one, else before they are mixed: other roundings
            )
        return found

    # --- files ---

    def file(self, frame: str, camera: Camera, lighting: Lighting | None, suffix: str) -> str:
        """A file of a frame, whose own key is `frame`: what is in it, and how it is written."""
        shows = suffix == ".png" or self.job.output.wants("background")
        behind = self._behind(requirements.shown_around(self.job, lighting)) if shows else []
        return _joined(self._writing[suffix], frame, json.dumps(camera.name), self._names(lighting), *behind)

    def _behind(self, around: Lighting | None) -> list[str]:
        """What stands behind frames that show a lighting's surroundings, or a picture; empty: a plain colour."""
        how = self.job.display.backdrop
        if how is None:
            return []
        settings = replace(how, picture=None), how.picture is not None
        if how.picture is not None or around is None:
            return [digest("backdrop", settings, self._versions("numpy"))]
        return [digest("backdrop", settings, reads.light(around), self._device)]

    @cached_property
    def _writing(self) -> dict[str, str]:
        """By suffix, how a file is written."""
        job = self.job
        exr = digest(".exr", reads.exr_settings(job.output), self._mattes, self._versions("OpenEXR"))
        return {".exr": exr, ".png": digest(".png", reads.display_reads(job.display), self._versions("numpy"))}

    @cached_property
    def _mattes(self) -> str:
        """The names of the proxy's things in a file, whatever lights it; what a camera sees is in its frames' keys."""
        wanted, proxy = requirements.mattes(self.job), self.job.proxy
        return "" if proxy is None or not wanted else digest("mattes", wanted, proxy.digest, self._device)

    def _names(self, lighting: Lighting | None) -> str:
        """What a lighting, its layers and the objects in it are called; those of one lighting are kept."""
        if lighting is None:
            return ""
        found = self._named.get(id(lighting))
        if found is None or found[0] is not lighting:
            objects = [x.name for x in self.job.objects_of(lighting)]
            named = digest(lighting.name, [x.layer for x in terms(lighting)], objects)
            found = self._named[id(lighting)] = (lighting, named)
        return found[1]

    @cached_property
    def files(self) -> tuple[str, ...]:
        """Suffixes of the files that each frame has."""
        output = self.job.output
        frames = output.store != "layers" or not self.job.lightings  # nothing to mix
        wanted = {".exr": frames and output.exr, ".png": frames and output.png}
        return tuple(suffix for suffix in FILE_SUFFIXES if wanted[suffix])


def _joined(*parts: str) -> str:
    """SHA-256 (hex) over keys and words, none of which holds a line's end."""
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()

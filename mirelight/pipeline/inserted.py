"""The scene with objects in it, and that of what the proxy's materials mirror, as the light of a view asks for them."""

from __future__ import annotations

import weakref
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from mirelight.base.errors import InputError, RenderError
from mirelight.base.progress import CountProgress
from mirelight.model import F64, Camera, Inserted, Lighting, ProxyMesh, SurfaceCache
from mirelight.model.unit_lights import LightSet
from mirelight.pipeline import requirements
from mirelight.pipeline.codecs import ARRAY
from mirelight.pipeline.frame_clock import for_all_frames
from mirelight.pipeline.painted import dressed_by
from mirelight.pipeline.prepared import Prepared
from mirelight.pipeline.requirements import Arrangement

if TYPE_CHECKING:
    from mirelight.lighting import Tracer
    from mirelight.lighting.lattices import Detail
    from mirelight.lighting.objects import Placed

_PLACES = 16  # of a mirror that moves: those that it shows the capture from


class SceneWithObjects(Prepared):
    """New light falls on proxy and objects, while captured light knows the proxy alone."""

    def __init__(self, bare: Prepared, objects: Arrangement) -> None:
        super().__init__(bare.job, bare.kept, bare._report, bare.progress)
        self.objects = objects
        self.keys, self.clock = bare.keys, bare.clock
        self._bare: Prepared = weakref.proxy(bare)  # the scene holds this: a cycle would outlive both

    @cached_property
    @for_all_frames
    def placed(self) -> Placed:
        """What is traced, and which faces are whose."""
        from mirelight.lighting.objects import inserted

        proxy = self._bare.proxy
        assert proxy is not None
        for one in self.objects:
            ignored = dict.fromkeys(x for material in one.mesh.value.materials for x in material.ignored)
            if ignored:
                self._tell(f"{one.name}: its file's {', '.join(ignored)} is not followed")
        try:
            return inserted(self.objects, proxy)
        except InputError as refused:
            if all(x.objects is None for x in self.job.lightings):
                raise
            raise RenderError(str(refused)) from None  # of one draw of a sweep: others may fit

    @cached_property
    @for_all_frames
    def proxy(self) -> ProxyMesh | None:
        """The proxy with the objects."""
        return self.placed.mesh

    @cached_property
    @for_all_frames
    def tracer(self) -> Tracer:
        """The tracer of the scene with its objects."""
        from mirelight.lighting import Tracer

        placed = self.placed
        apart, aovs = requirements.keeps_lights_apart(self.job), requirements.wants_aovs(self.job)
        settings, first = self.job.render, placed.first
        return Tracer(placed.mesh, settings, layers=apart, aovs=aovs, first_inserted=first, detail=self._mirrored)

    @cached_property
    def _mirrored(self) -> Detail | None:
        """What smooth objects show of the capture; None where there are none, or the proxy has colours of its own."""
        from mirelight.lighting import detail, lattices
        from mirelight.proxy.capture import are_discs

        job, proxy = self.job, self._bare.proxy
        placed = zip(self.objects, self.placed.boxes, strict=True)
        boxes = [there for one, box in placed if _mirrors(one) for there in _along(one, box)]
        if not boxes or not requirements.colors_proxy(job) or proxy is None or job.captured is None:
            return None
        key = self.keys.mirrored(self.objects)
        found = self._shared(key, ARRAY)
        if found is None:
            self._tell("finding what mirrors show of the capture; it is kept for the next time")
            near = [(box[:3, 3], float(np.linalg.norm(box[:3, :3], axis=0).max()) / 2) for box in boxes]
            splats = self._bare.splats
            assert splats is not None
            captured, discs = self.resolved(job.captured), are_discs(splats)
            made = detail.told(proxy, near, splats, self._bare.views, captured, job.render, discs=discs)
            found = made.packed()
            self._share(key, found, ARRAY)
        return lattices.Detail.unpacked(found)

    def light_key(self, light_set: LightSet, seen: Camera) -> str:
        """The key of a set's traced buffer; `seen` is the lighting's camera."""
        return self.keys.light_with_objects(light_set, seen, self.objects)

    def resolved(self, lighting: Lighting) -> Lighting:
        """As the scene has it, whose estimate is made once."""
        return self._bare.resolved(lighting)

    def surface_cache(self, light_set: LightSet, *, progress: CountProgress | None = None) -> SurfaceCache | None:
        """None: light on the surface is kept without objects, so all is traced."""
        return None


def _along(one: Inserted, box: F64) -> list[F64]:
    """(4, 4) box of an object, and where it is at other times."""
    if one.resting is None or one.resting.motion is None:
        return [box]
    rest = np.linalg.inv(one.world_from_object) @ box  # in the object itself
    return [pose @ one.resting.world_from_object @ rest for pose in one.resting.motion.along(_PLACES)]


def _mirrors(one: Inserted) -> bool:
    """Whether something of an object is smooth."""
    from mirelight.lighting.detail import MIRRORS

    return any(
        x.roughness < MIRRORS or x.finish_texture is not None or x.clearcoat > 0 for x in one.mesh.value.materials
    )


class SceneOfLobes(SceneWithObjects):
    """The proxy with its materials; light is what their lobes reflect to the camera."""

    @cached_property
    @for_all_frames
    def proxy(self) -> ProxyMesh | None:
        """The proxy, as the job's materials dress it."""
        bare = self._bare.proxy
        return bare if bare is None else dressed_by(bare, self.job.materials, str(self.job.source), self.job.render)

    @cached_property
    @for_all_frames
    def tracer(self) -> Tracer:
        """The tracer of the lobes."""
        from mirelight.lighting import Tracer

        assert self.proxy is not None
        settings = replace(self.job.render, noise=None, indirect="traced")
        return Tracer(self.proxy, settings, layers=requirements.keeps_lights_apart(self.job), aovs=False, lobes=True)

    def light_key(self, light_set: LightSet, seen: Camera) -> str:
        """The key of a set's traced buffer; `seen` is the lighting's camera."""
        return self.keys.light_of_lobes(light_set, seen)

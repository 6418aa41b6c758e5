"""The scene with objects in it, and that of what the proxy's materials mirror, as the light of a view asks for them."""

from __future__ import annotations

import weakref
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING

from mirelight.model import Camera, Lighting, ProxyMesh, SurfaceCache
from mirelight.model.dressing import dressed
from mirelight.model.unit_lights import LightSet
from mirelight.pipeline import requirements
from mirelight.pipeline.prepared import Prepared
from mirelight.pipeline.view_light import Progress

if TYPE_CHECKING:
    from mirelight.lighting import Tracer
    from mirelight.lighting.objects import Placed


class SceneWithObjects(Prepared):
    """New light falls on proxy and objects, while captured light knows the proxy alone."""

    def __init__(self, bare: Prepared) -> None:
        super().__init__(bare.job, bare.kept, bare._report)
        self.keys = bare.keys
        self._bare: Prepared = weakref.proxy(bare)  # the scene holds this: a cycle would outlive both

    @cached_property
    def placed(self) -> Placed:
        """What is traced, and which faces are whose."""
        from mirelight.lighting.objects import inserted

        proxy = self._bare.proxy
        assert proxy is not None
        for one in self.job.objects:
            ignored = dict.fromkeys(x for material in one.mesh.value.materials for x in material.ignored)
            if ignored:
                self._tell(f"{one.name}: its file's {', '.join(ignored)} is not followed")
        return inserted(self.job.objects, proxy)

    @cached_property
    def proxy(self) -> ProxyMesh | None:
        """The proxy with the objects."""
        return self.placed.mesh

    @cached_property
    def tracer(self) -> Tracer:
        """The tracer of the scene with its objects."""
        from mirelight.lighting import Tracer

        placed = self.placed
        apart, aovs = requirements.keeps_lights_apart(self.job), requirements.wants_aovs(self.job)
        return Tracer(placed.mesh, self.job.render, layers=apart, aovs=aovs, first_inserted=placed.first)

    def light_key(self, light_set: LightSet, seen: Camera) -> str:
        """The key of a set's traced buffer; `seen` is the lighting's camera."""
        return self.keys.light_with_objects(light_set, seen)

    def resolved(self, lighting: Lighting) -> Lighting:
        """As the scene has it, whose estimate is made once."""
        return self._bare.resolved(lighting)

    def surface_cache(self, light_set: LightSet, *, progress: Progress | None = None) -> SurfaceCache | None:
        """None: light on the surface is kept without objects, so all is traced."""
        return None


class SceneOfLobes(SceneWithObjects):
    """The proxy with its materials; light is what their lobes reflect to the camera."""

    @cached_property
    def proxy(self) -> ProxyMesh | None:
        """The proxy, as the job's materials dress it."""
        bare = self._bare.proxy
        return bare if bare is None else dressed(bare, self.job.materials)

    @cached_property
    def tracer(self) -> Tracer:
        """The tracer of the lobes."""
        from mirelight.lighting import Tracer

        assert self.proxy is not None
        settings = replace(self.job.render, noise=None, indirect="traced")
        return Tracer(self.proxy, settings, layers=requirements.keeps_lights_apart(self.job), aovs=False, lobes=True)

    def light_key(self, light_set: LightSet, seen: Camera) -> str:
        """The key of a set's traced buffer; `seen` is the lighting's camera."""
        return self.keys.light_of_lobes(light_set, seen)

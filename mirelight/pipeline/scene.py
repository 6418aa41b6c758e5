"""A job made ready for its frames: what `mirelight.pipeline.prepared` has, and the light of its views and splats."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import TYPE_CHECKING, Any

from mirelight import relighting
from mirelight.base.progress import ShareProgress, quiet
from mirelight.model import (
    F32,
    Camera,
    Deferred,
    Job,
    Lighting,
    LightingBuffer,
    Matte,
    ProxyMesh,
    SplatLayer,
)
from mirelight.model.planes import OBJECT_MATTE
from mirelight.model.unit_lights import terms
from mirelight.pipeline import beyond, reads, requirements
from mirelight.pipeline.artefact_cache import ArtefactCache, MemoryCache, NullCache
from mirelight.pipeline.backdrops import Backdrops
from mirelight.pipeline.codecs import ARRAY, composite_of, matte_of
from mirelight.pipeline.completeness import check
from mirelight.pipeline.inserted import SceneOfLobes, SceneWithObjects
from mirelight.pipeline.painted import paint_of
from mirelight.pipeline.prepared import Prepared
from mirelight.pipeline.requirements import Arrangement
from mirelight.pipeline.splat_light import SplatLight
from mirelight.pipeline.view_light import ViewLight
from mirelight.relighting.inpainting import Inpainted, inpainted

if TYPE_CHECKING:
    from mirelight.lighting.mattes import Mattes
    from mirelight.lighting.sight import Sight


def prepare(
    job: Job,
    kept: ArtefactCache | None = None,
    report: Callable[[str], None] | None = None,
    like: Scene | None = None,
    *,
    progress: ShareProgress = quiet,
) -> Scene:
    """The job made ready for its frames. Returns at once: files are read, and artefacts made, when they are needed.

    Args:
        job: from `mirelight.load`.
        kept: where artefacts are found and kept; None: nowhere.
        report: called with a line before and after something that takes long is made.
        like: a scene whose parts are taken over where this job would make the same, as of the job before an edit.
        progress: hears how far such a thing is: the proxy, the capture's views, its light.

    Raises:
        InputError: the job cannot be rendered: nothing in it, lights without a proxy, a mode without what it needs.
    """
    if not isinstance(job, Job):
        raise TypeError(f"prepare() takes a job as mirelight.load gives it, not {type(job).__name__}")
    check(job)
    made = Scene(job, kept or NullCache(), report, progress)
    if like is not None:
        made.take_over(like)
    return made


def _digest(part: Deferred[Any] | None) -> str:
    return "" if part is None else part.digest


class Scene(Prepared):
    """What all frames of a job share. Made by :func:`prepare`; not to be sent to another process (send the job)."""

    def __init__(
        self,
        job: Job,
        kept: ArtefactCache,
        report: Callable[[str], None] | None = None,
        progress: ShareProgress = quiet,
    ) -> None:
        super().__init__(job, kept, report, progress)
        self._view: ViewLight | None = None
        self._view_with_objects: ViewLight | None = None
        self._view_of_lobes: ViewLight | None = None
        self._repaired: tuple[LightingBuffer, SplatLayer, LightingBuffer] | None = None  # was, seen in, is
        self._inpainted: tuple[LightingBuffer, SplatLayer, Inpainted] | None = None  # captured or new, seen in, found
        self._arranged: SceneWithObjects | None = None
        self._object_rays: Mattes | None = None  # of that
        self._mattes: tuple[Camera, dict[str, Matte]] | None = None
        self._front: tuple[str, SplatLayer] | None = None  # its key
        self._object_matte: tuple[str, Matte] | None = None  # its key

    def __repr__(self) -> str:
        ready = [name for name in ("splats", "proxy", "captured_level", "compositor", "tracer") if name in vars(self)]
        return f"Scene({self.job.source.name}; ready: {', '.join(ready) or 'nothing yet'})"

    def take_over(self, other: Scene) -> None:
        """Whatever another scene has ready and this one would make the same: told by keys, nothing is compared."""
        job, theirs, ready, mine = self.job, other.job, vars(other), vars(self)
        self._estimates |= other._estimates
        self.clock = other.clock
        same_splats = _digest(job.splats) == _digest(theirs.splats)
        if same_splats:
            mine.update({name: ready[name] for name in ("splats",) if name in ready})
        same_machine = (job.render.variant, job.render.threads) == (theirs.render.variant, theirs.render.threads)
        if same_machine and self.keys.views == other.keys.views:
            mine.update({name: ready[name] for name in ("views",) if name in ready})
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

    def ready(self, *, lit: bool) -> Scene:
        """Itself, for others to be like: what they take over is made now. `lit`: what light takes, too."""
        if self.job.splats is not None:
            _ = self.compositor
        if lit:
            _ = self.tracer, self.captured_level
        return self

    @cached_property
    def for_pinholes(self) -> Scene:
        """The same for the pinholes of a lens or an open shutter: what each sees is kept in memory alone."""
        like = self.ready(lit=bool(self.job.lightings))
        return prepare(self.job, MemoryCache(self.kept), self._report, like, progress=self.progress)

    def read(self) -> None:
        """Read the splats, and read or make the proxy where light falls on it. Otherwise that comes when it is needed.

        Raises:
            InputError: one of them cannot be used.
        """
        _ = self.splats
        if self.job.lightings:
            _ = self.mesh

    def view_light(self, seen: Camera) -> ViewLight:
        """The light of a view, `seen` the lighting's camera; that of the last view is kept."""
        if self._view is None or self._view.is_broken or reads.view(self._view.camera) != reads.view(seen):
            self._view = ViewLight(self, seen)
        return self._view

    def new_light(self, seen: Camera, objects: Arrangement) -> ViewLight:
        """The light of a view with objects in the scene; without any, `view_light`."""
        if not objects:
            return self.view_light(seen)
        scene, view = self._with(objects), self._view_with_objects
        if view is None or view.is_broken or reads.view(view.camera) != reads.view(seen):
            self._view_with_objects = view = ViewLight(scene, seen)
        return view

    def lobes(self, seen: Camera) -> ViewLight:
        """What the proxy's materials mirror to a view; that of the last one is kept."""
        view = self._view_of_lobes
        if view is None or view.is_broken or reads.view(view.camera) != reads.view(seen):
            self._view_of_lobes = view = ViewLight(self._of_lobes, seen)
        return view

    @cached_property
    def _of_lobes(self) -> SceneOfLobes:
        return SceneOfLobes(self, ())

    def _with(self, objects: Arrangement) -> SceneWithObjects:
        """The scene with objects in it; that of the last ones is kept."""
        if self._arranged is None or self._arranged.objects is not objects:
            self._arranged = SceneWithObjects(self, objects)
            self._view_with_objects = self._object_rays = None
        return self._arranged

    def make_ready(self, objects: Arrangement) -> None:
        """Find now what light on objects needs beside a view; it is found by itself otherwise."""
        if objects:
            _ = self._with(objects).tracer

    @cached_property
    def splat_light(self) -> SplatLight:
        """Light on the splats, for all of the job's cameras."""
        said: set[str] = set()

        def say(what: str, done: float) -> None:
            if what not in said:
                said.add(what)
                self._tell(f"light on {len(self.splats or ()):,} splats: {what}; it is kept for the next time")

        return SplatLight(self, self.job.render.spp, say)

    def repaired(self, captured: LightingBuffer, sun: relighting.Sun | None, splats: SplatLayer) -> LightingBuffer:
        """A view's captured light as its splats show it; that of the last view is kept."""
        if self._repaired is None or self._repaired[0] is not captured or self._repaired[1] is not splats:
            made = relighting.repaired(captured, sun, relighting.unlit_rgba(splats))
            self._repaired = captured, splats, made
        return self._repaired[2]

    def inpainted(self, new: LightingBuffer, captured: LightingBuffer | None, splats: SplatLayer) -> Inpainted:
        """A view's light where the job's masks are painted; that of the last view is kept."""
        surface = new if captured is None else captured
        if self._inpainted is None or self._inpainted[0] is not surface or self._inpainted[1] is not splats:
            paint = paint_of(self.job.masks, surface, self._sight)
            found = inpainted(surface, paint, captured, relighting.unlit_rgba(splats))
            self._inpainted = surface, splats, found
        return self._inpainted[2]

    @cached_property
    def _sight(self) -> Sight:
        from mirelight.lighting.sight import Sight

        assert self.mesh is not None
        return Sight(self.mesh, self.job.render.variant, self.job.render.threads)

    def in_front(self, camera: Camera, objects: Arrangement, seen: LightingBuffer) -> SplatLayer:
        """The splats in front of objects, which are seen in a buffer; those of the last camera are kept."""
        key, settings = self.keys.in_front(camera, objects), self.job.compositor
        if self._front is None or self._front[0] != key:
            codec = composite_of(camera, settings.profile, settings.holds_light)
            found = self.kept.get(key, codec)
            if found is None:
                found = self.compositor.in_front(camera, relighting.upsample(seen, camera).depth)
                self.kept.put(key, found, codec)
            self._front = key, found
        return self._front[1]

    def object_matte(self, camera: Camera, objects: Arrangement) -> Matte:
        """Which of the objects a camera sees where; that of the last camera is kept."""
        key, names = self.keys.object_matte(camera, objects), tuple(x.name for x in objects)
        if self._object_matte is None or self._object_matte[0] != key:
            found = self.kept.get(key, matte_of(names))
            if found is None:
                placed = self._with(objects).placed
                self._object_rays = self._object_rays or self._rays_on(placed.mesh)
                found = self._object_rays.of(camera, OBJECT_MATTE, (names, placed.owners))
                self.kept.put(key, found, matte_of(names))
            self._object_matte = key, found
        return self._object_matte[1]

    def keep_objects(self, camera: Camera, objects: Arrangement) -> None:
        """Keep what data sets say of objects besides their light: which are seen, behind what, and where they stand;
        light of the view is there."""
        if not objects:
            return
        self.object_matte(camera, objects)
        seen = self.new_light(relighting.lighting_camera(camera, self.job.relight), objects).objects()
        if self.job.splats is not None and seen is not None:
            self.in_front(camera, objects, seen)
        if not self.kept.has(self.keys.object_boxes(objects), ARRAY):
            self.kept.put(self.keys.object_boxes(objects), self._with(objects).placed.boxes, ARRAY)

    def mattes(self, camera: Camera, objects: Arrangement) -> tuple[Matte, ...]:
        """The cryptomattes that the job's files hold, of one camera; those of the last camera are kept."""
        wanted = requirements.mattes(self.job)
        if not wanted:
            return ()
        if self._mattes is None or reads.view(self._mattes[0]) != reads.view(camera):
            own = self._matte_rays.of
            self._mattes = (camera, {name: own(camera, name) for name in wanted if name != OBJECT_MATTE})
        known = self._mattes[1]
        return tuple(self.object_matte(camera, objects) if x == OBJECT_MATTE else known[x] for x in wanted)

    def backdrop(self, camera: Camera, lighting: Lighting | None) -> F32 | None:
        """(H, W, 3) what stands behind a frame, see :meth:`mirelight.pipeline.backdrops.Backdrops.of`."""
        return self._backdrops.of(camera, lighting)

    @cached_property
    def _backdrops(self) -> Backdrops:
        return Backdrops(self.job, self.resolved)

    def composite(self, camera: Camera) -> SplatLayer:
        """The splats as a pinhole sees them, with all that frames of the job are made from."""
        compositor, depth = self.compositor, requirements.wants_depth(self.job)
        diffuse = requirements.wants_diffuse(self.job)
        if not requirements.wants_beyond(self.job):
            return compositor.composite(camera, depth=depth, diffuse=diffuse)
        away, room = self.splat_distances, beyond.is_room(self.tracer)
        return beyond.composite(compositor, camera, away, depth=depth, diffuse=diffuse, room=room)

    def far(self, lighting: Lighting) -> relighting.Far | None:
        """What a lighting and the captured light have far away, for splats there; None where frames do not ask."""
        captured = requirements.compared_in(self.job, lighting)
        asks = self.job.relight_of(lighting).follows_sky
        if not asks or captured is None:
            return None
        return relighting.Far(*(self.far_map((x.unit, x.weight) for x in terms(one)) for one in (lighting, captured)))

    @cached_property
    def _matte_rays(self) -> Mattes:
        assert self.mesh is not None
        return self._rays_on(self.mesh)

    def _rays_on(self, mesh: ProxyMesh) -> Mattes:
        from mirelight.lighting.mattes import Mattes

        return Mattes(mesh, self.job.render.variant, self.job.render.threads)

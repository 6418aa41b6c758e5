"""The light of one view: sets of unit lights found or traced once, and mixed for every lighting that asks."""

from __future__ import annotations

import weakref
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, cast

from mirelight import relighting
from mirelight.base import backend
from mirelight.base.progress import CountProgress
from mirelight.model import Camera, Lighting, LightingBuffer, ParallelLight
from mirelight.model.unit_lights import GLOW, LightSet, Mixture
from mirelight.pipeline import requirements
from mirelight.pipeline.captured_sun import seen_sun
from mirelight.pipeline.codecs import light_of
from mirelight.pipeline.mix import Wanted, mix
from mirelight.pipeline.prepared import Prepared

if TYPE_CHECKING:
    from mirelight.lighting import Tracer

Look = Callable[[Callable[[], LightingBuffer]], None]  # may ask for a lighting as far as it is traced


_MOST_BYTES = 2**30  # of buffers that one view keeps in memory


class ViewStopped(KeyboardInterrupt):
    """The user stopped a trace; what there is can be mixed."""


class ViewLight:
    """What is known of the light of one view. Kept as long as frames of the same view are made.

    Args:
        scene: a prepared job.
        seen: the lighting's camera.
    """

    def __init__(self, scene: Prepared, seen: Camera) -> None:
        self._scene: Prepared = weakref.proxy(scene)  # the scene holds this: a cycle would outlive both
        self._seen = seen
        self._there: dict[str, LightingBuffer] = {}  # by the digests of sets
        self._due: list[str] = []  # digests of sets that must be traced, in order
        self._progress: CountProgress | None = None
        self.is_broken = False  # a trace was interrupted: what it left is no whole set
        self._captured: LightingBuffer | None = None  # the captured light, which every frame of a ratio asks for
        self._sun: tuple[relighting.Sun | None] | None = None  # of the captured light, once it was looked for

    @property
    def camera(self) -> Camera:
        """The camera that light is traced for."""
        return self._seen

    def expect(self, lightings: Sequence[Lighting], progress: CountProgress | None) -> None:
        """Find what is kept already, so that progress knows how much there is to do."""
        self._progress, self._due = progress, []
        for one in {s.digest: s for x in lightings for s in self._sets(self._scene.mixture(x))}.values():
            if one.digest in self._there:
                continue
            found = self._scene.kept.get(self._scene.light_key(one, self._seen), light_of(self._seen))
            if found is not None:
                self._there[one.digest] = found
            else:
                self._due.append(one.digest)
        self._make_room({s.digest for x in lightings for s in self._sets(self._scene.mixture(x))})

    def _make_room(self, needed: set[str]) -> None:
        """Let go of sets that are not needed now, where there are many."""
        if sum(x.nbytes for x in self._there.values()) > _MOST_BYTES:
            self._there = {name: x for name, x in self._there.items() if name in needed}

    def mixed(self, lighting: Lighting, look: Look | None = None) -> LightingBuffer:
        """A lighting of the view, whatever must be traced for it traced; `look` sees it now and then on the way.

        Raises:
            ViewStopped: Ctrl-C.
        """
        is_captured = lighting is self._scene.job.captured
        if is_captured and self._captured is not None:
            return self._captured
        mixture = self._scene.mixture(lighting)
        for one in self._sets(mixture):
            if one.digest not in self._there:
                self._there[one.digest] = self._traced(one, look and partial(self._looked, look, mixture, one))
        finished = self._finished(mixture, layers=self._scene.job.output.wants_layers and not is_captured)
        if is_captured:
            self._captured = finished
        return finished

    def sun(self, captured: Lighting) -> relighting.Sun | None:
        """The strongest distant lamp of the captured light, which has been mixed before; that of one view is kept."""
        scene = self._scene
        if self._sun is None and not requirements.follows_engine(scene.job):
            found = seen_sun(
                scene.mixture(captured),
                self._there,
                self._seen,
                cast("Tracer", scene.tracer),
                resolved=scene.resolved,
                denoised=scene.job.render.denoise,
                apart=requirements.keeps_lights_apart(scene.job),
            )
            self._sun = (found,)
        return None if self._sun is None else self._sun[0]

    def trace(self, lightings: Sequence[Lighting], progress: CountProgress | None) -> None:
        """Trace what is not kept yet, and keep it. What glows comes first: with all the rest there, it is, too.

        Raises:
            ViewStopped: Ctrl-C.
        """
        self.expect(lightings, progress)
        sets = {s.digest: s for x in lightings for s in self._sets(self._scene.mixture(x))}
        for one in sorted(sets.values(), key=lambda s: not s.glow):
            if one.digest not in self._there:
                self._traced(one)

    def objects(self) -> LightingBuffer | None:
        """What is seen of inserted objects, in whatever has been traced; None: nothing has, or there are none."""
        return next((x.objects for x in self._there.values() if x.objects is not None), None)

    def mixed_so_far(self, lighting: Lighting) -> LightingBuffer | None:
        """Of an interrupted trace, what there is; None: nothing."""
        mixture = self._scene.mixture(lighting)
        traced = any(s.digest in self._there for s in mixture.sets)
        return self._finished(mixture, layers=self._scene.job.output.wants_layers) if traced else None

    def _looked(self, look: Look, mixture: Mixture, one: LightSet, so_far: Callable[[], LightingBuffer]) -> None:
        """Offer a mixture with a set that is being traced; sets that come after it are dark; nothing is denoised."""
        look(lambda: self._mixed(mixture, {**self._there, one.digest: so_far()}))

    def _sets(self, mixture: Mixture) -> list[LightSet]:
        """The mixture's sets; surfaces that glow are one more, unless a set is traced as a whole."""
        mixed = all(s.whole is None for s in mixture.sets)
        return [*mixture.sets, *([GLOW] if mixed and self._scene.glows else [])]

    def _traced(self, one: LightSet, look: Look | None = None) -> LightingBuffer:
        from mirelight.lighting import Interrupted

        scene = self._scene
        report = partial(self._report, self._due.index(one.digest)) if self._progress else None
        try:
            buffer = self._buffer(one, report, look)
        except Interrupted as stopped:
            if stopped.buffer is not None:
                self._there[one.digest] = stopped.buffer
            self.is_broken = True
            raise ViewStopped from None
        scene.kept.put(scene.light_key(one, self._seen), buffer, light_of(self._seen))
        return buffer

    def _buffer(self, one: LightSet, report: CountProgress | None, look: Look | None) -> LightingBuffer:
        """A set traced for this view; where the job keeps reflected light on the surface, gathered there first."""
        from mirelight.lighting import Tracer

        scene, lighting, emission = self._scene, self._scene.lighting_of(one), one.glow or one.whole is not None
        if not isinstance(scene.tracer, Tracer):
            return scene.tracer.trace(lighting, self._seen, emission=emission, progress=report)
        waiting = partial(_waiting, report) if report else None
        try:
            cache = scene.surface_cache(one, progress=waiting)
        except KeyboardInterrupt:
            self.is_broken = True
            raise ViewStopped from None
        return scene.tracer.trace(lighting, self._seen, emission=emission, cache=cache, progress=report, look=look)

    def _report(self, index: int, done: int, total: int) -> None:
        assert self._progress is not None
        self._progress(index * total + done, len(self._due) * total)

    def _mixed(self, mixture: Mixture, traced: Mapping[str, LightingBuffer]) -> LightingBuffer:
        job = self._scene.job
        variance = job.render.denoise or job.output.wants("variance", "noise")
        wanted = Wanted(layers=job.output.wants_layers, variance=variance)
        return mix(mixture, traced, self._seen, _sun_strengths(self._scene, mixture), wanted)

    def _finished(self, mixture: Mixture, *, layers: bool) -> LightingBuffer:
        """Denoised where the job asks for it; `layers`: each of them, or their sum alone."""
        job = self._scene.job
        buffer = self._mixed(mixture, self._there)
        if not job.render.denoise or requirements.follows_engine(job):
            return buffer
        from mirelight.lighting.denoise import denoise

        backend.give_back()  # the denoiser takes as much as a trace
        return denoise(buffer, layers=layers, progress=self._scene.progress)


def _waiting(report: CountProgress, done: int, total: int) -> None:
    """No sample of the picture yet: light is being gathered on the surface."""
    report(0, 1)


def _sun_strengths(scene: Prepared, mixture: Mixture) -> Mapping[str, float]:
    """By the digest of a set, the illuminance of the suns that the lighting takes from it."""
    strengths: dict[str, float] = {}
    for term in mixture.terms:
        if not term.unit.has_sun:
            continue
        home = mixture.home(term.unit)
        lights = LightSet((term.unit,)).as_lighting(scene.resolved).lights
        suns = [x for x in lights if isinstance(x, ParallelLight)]
        own = sum(x.intensity * float(x.color.mean()) for x in suns) * float(term.weight.mean())
        strengths[home.digest] = strengths.get(home.digest, 0.0) + own
    return strengths

"""The stages of a frame, pure functions of a prepared scene: composite, light, relight, write.

These are mirelight's public calls, and the body of every render::

    job    = mirelight.load("room.toml")
    scene  = mirelight.prepare(job)
    splats = mirelight.composite(scene, camera)
    light  = mirelight.light(scene, camera, lighting)
    frame  = mirelight.relight(scene, splats, light)
    mirelight.write(frame, "frame.exr", job)
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING

from mirelight import keys, provenance, relighting
from mirelight.mix import mix
from mirelight.model import Camera, Frame, Lighting, LightingBuffer, SplatLayer
from mirelight.model.lights import DirectionalLight, SunLight
from mirelight.scene import Scene
from mirelight.units import GLOW, LightSet, Mixture

if TYPE_CHECKING:
    pass

Progress = Callable[[int, int], None]  # (samples done, samples in all)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Lit:
    """A view's light: what it is to be lit by, and what it was captured under where the mode compares both."""

    camera: Camera  # of the splats; the buffers may have fewer pixels
    lighting: Lighting
    new: LightingBuffer
    captured: LightingBuffer | None = None

    def __repr__(self) -> str:
        return f"Lit({self.camera.name} under {self.lighting.name}: {self.new!r})"


class Stopped(KeyboardInterrupt):
    """The user stopped a trace; `lit` is the light so far. None: nothing to show yet."""

    def __init__(self, lit: Lit | None) -> None:
        self.lit = lit
        super().__init__("interrupted")


# --- composite -------------------------------------------------------------------------------------------------------


def composite(scene: Scene, camera: Camera) -> SplatLayer | None:
    """The splats as a camera sees them, before any lighting; None where the job has none.

    Raises:
        BackendError: the job's variant cannot be used on this machine.
        RenderError: the frame does not fit in memory.
    """
    _require("composite", scene=(scene, Scene), camera=(camera, Camera))
    if scene.job.splats is None:
        return None
    return scene.compositor.composite(camera, depth=keys.wants_depth(scene.job))


# --- light -----------------------------------------------------------------------------------------------------------


def light(scene: Scene, camera: Camera, lighting: Lighting, *, progress: Progress | None = None) -> Lit:
    """The light of a view: unit lights are traced, or found where they were kept, and mixed.

    Args:
        scene: a prepared job.
        camera: one of the job's, or any other.
        lighting: one of the job's, or any other.
        progress: called with (samples done, samples in all) while something is traced.

    Raises:
        Stopped: Ctrl-C; holds what there was.
        BackendError: the job's variant cannot be used on this machine.
        RenderError: the film does not fit in memory.
    """
    _require("light", scene=(scene, Scene), camera=(camera, Camera), lighting=(lighting, Lighting))
    job, seen = scene.job, relighting.lighting_camera(camera, scene.job.relight)
    wanted = [lighting]
    if job.splats is not None and keys.compares(job) and job.captured is not None:
        wanted.insert(0, job.captured)
    tracing = _Tracing(scene, seen, progress)
    tracing.expect([scene.mixture(x) for x in wanted])
    mixed: list[LightingBuffer] = []
    try:
        mixed += [tracing.mixed(x) for x in wanted]
    except Stopped:
        so_far = tracing.mixed_so_far(lighting) if len(mixed) == len(wanted) - 1 else None
        if so_far is None:
            raise
        captured = mixed[0] if mixed else None
        raise Stopped(Lit(camera=camera, lighting=lighting, new=so_far, captured=captured)) from None
    captured = mixed[0] if len(mixed) > 1 else None
    return Lit(camera=camera, lighting=lighting, new=mixed[-1], captured=captured)


class _Tracing:
    """The sets of one view: found, traced, kept."""

    def __init__(self, scene: Scene, seen: Camera, progress: Progress | None) -> None:
        self._scene, self._seen, self._progress = scene, seen, progress
        self._there: dict[str, LightingBuffer] = {}
        self._due: list[str] = []  # keys of sets that must be traced, in order

    def expect(self, mixtures: list[Mixture]) -> None:
        """Find what is kept already, so that progress knows how much there is to do."""
        for one in {s.digest: s for mixture in mixtures for s in self._sets(mixture)}.values():
            key = self._scene.keys.light(one, self._seen)
            found = self._scene.kept.light(key, self._seen)
            if found is not None:
                self._there[one.digest] = found
            else:
                self._due.append(one.digest)

    def mixed(self, lighting: Lighting) -> LightingBuffer:
        """A lighting of the view, whatever must be traced for it traced."""
        mixture = self._scene.mixture(lighting)
        for one in self._sets(mixture):
            if one.digest not in self._there:
                self._there[one.digest] = self._traced(one)
        return self._finished(mixture)

    def mixed_so_far(self, lighting: Lighting) -> LightingBuffer | None:
        """Of an interrupted trace, what there is."""
        mixture = self._scene.mixture(lighting)
        return self._finished(mixture) if any(s.digest in self._there for s in mixture.sets) else None

    def _sets(self, mixture: Mixture) -> list[LightSet]:
        """The mixture's sets; surfaces that glow are one more, unless a set is traced as a whole."""
        mixed = all(s.whole is None for s in mixture.sets)
        return [*mixture.sets, *([GLOW] if mixed and self._scene.glows else [])]

    def _traced(self, one: LightSet) -> LightingBuffer:
        from mirelight.lighting import Interrupted

        scene = self._scene
        report = partial(self._report, self._due.index(one.digest)) if self._progress else None
        emission = one.glow or one.whole is not None
        try:
            buffer = self._buffer(one, emission, report)
        except Interrupted as stopped:
            if stopped.buffer is not None:
                self._there[one.digest] = stopped.buffer
            raise Stopped(None) from None
        scene.kept.keep_light(scene.keys.light(one, self._seen), buffer)
        return buffer

    def _buffer(self, one: LightSet, emission: bool, report: Progress | None) -> LightingBuffer:
        from mirelight.lighting import Tracer

        scene, lighting = self._scene, self._scene.lighting_of(one)
        if not isinstance(scene.tracer, Tracer):
            return scene.tracer.trace(lighting, self._seen, emission=emission, progress=report)
        waiting = partial(_waiting, report) if report else None
        try:
            cache = scene.surface_cache(one, emission=emission, progress=waiting)
        except KeyboardInterrupt:
            raise Stopped(None) from None
        return scene.tracer.trace(lighting, self._seen, emission=emission, cache=cache, progress=report)

    def _report(self, index: int, done: int, total: int) -> None:
        assert self._progress is not None
        self._progress(index * total + done, len(self._due) * total)

    def _finished(self, mixture: Mixture) -> LightingBuffer:
        buffer = mix(mixture, self._there, self._seen, _sun_strengths(self._scene, mixture))
        if not self._scene.job.render.denoise:
            return buffer
        from mirelight.lighting.denoise import denoise

        return denoise(buffer, layers=self._scene.job.output.layers)


def _sun_strengths(scene: Scene, mixture: Mixture) -> Mapping[str, float]:
    """By the digest of a set, the illuminance of the suns that the lighting takes from it."""
    strengths: dict[str, float] = {}
    for term in mixture.terms:
        if not term.unit.has_sun:
            continue
        home = next(s for s in mixture.sets if s.layer_of(term.unit) is not None)
        lights = LightSet((term.unit,)).as_lighting(scene.resolved).lights
        suns = [x for x in lights if isinstance(x, DirectionalLight | SunLight)]
        own = sum(x.intensity * float(x.color.mean()) for x in suns) * float(term.weight.mean())
        strengths[home.digest] = strengths.get(home.digest, 0.0) + own
    return strengths


def _waiting(report: Progress, done: int, total: int) -> None:
    """No sample of the picture yet: light is being gathered on the surface."""
    report(0, 1)


# --- relight ---------------------------------------------------------------------------------------------------------


def relight(scene: Scene, splats: SplatLayer | None, lit: Lit | None) -> Frame:
    """One frame, as the job's relight settings say.

    Args:
        scene: a prepared job.
        splats: from :func:`composite`; None: the lit proxy itself.
        lit: from :func:`light`, of the same camera; None: the splats as captured.

    Raises:
        ValueError: neither splats nor light; both of different cameras.
    """
    _require("relight", scene=(scene, Scene), splats=(splats, SplatLayer | None), lit=(lit, Lit | None))
    return relit(scene, splats, lit, unfinished=False)


def relit(scene: Scene, splats: SplatLayer | None, lit: Lit | None, *, unfinished: bool) -> Frame:
    """:func:`relight`; `unfinished`: of light that was interrupted, which the frame then says."""
    job = scene.job
    if splats is None and lit is None:
        raise ValueError("a frame needs splats, light, or both")
    camera = lit.camera if lit is not None else splats.camera if splats is not None else None
    assert camera is not None
    key = "" if unfinished else scene.keys.frame(camera, lit.lighting if lit else None)
    made_by = provenance.of_frame(job, lit.lighting.name if lit else "", key)
    return relighting.apply(
        splats,
        lit.new if lit else None,
        job.relight,
        captured=lit.captured if lit else None,
        captured_level=scene.captured_level if lit and lit.captured else None,
        made_by=replace(made_by, partial=unfinished),
        noise=keys.wants_noise(job),
    )


def frame(scene: Scene, camera: Camera, lighting: Lighting | None) -> Frame:
    """The stages one after the other: one whole frame, as `mirelight render` makes it."""
    splats = composite(scene, camera)
    return relight(scene, splats, None if lighting is None else light(scene, camera, lighting))


# --- types -----------------------------------------------------------------------------------------------------------


def _require(call: str, **arguments: tuple[object, object]) -> None:
    """Raises TypeError, in one line, where an argument is not what the call takes."""
    for name, (value, kind) in arguments.items():
        if not isinstance(value, kind):  # type: ignore[arg-type]
            wanted = getattr(kind, "__name__", str(kind)).removeprefix("mirelight.model.")
            raise TypeError(f"{call}(): {name} is a {type(value).__name__}, expected {wanted}")

"""The stages of a frame, pure functions of a prepared scene: composite, light, relight, write.

A camera with a lens or an open shutter is taken for the pinhole in its middle; `mirelight.pipeline.frames` puts the
pinholes of one together. These are mirelight's public calls, and the body of every render::

    job    = mirelight.load("room.toml")
    scene  = mirelight.prepare(job)
    splats = mirelight.composite(scene, camera)
    light  = mirelight.light(scene, camera, lighting)
    frame  = mirelight.relight(scene, splats, light)
    mirelight.write(frame, "frame.exr", job)
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

from mirelight import relighting
from mirelight.base.progress import CountProgress
from mirelight.model import F32, Camera, Frame, Lighting, LightingBuffer, RelightSettings, SplatLayer
from mirelight.model.planes import OBJECT_MATTE
from mirelight.model.scene import is_log
from mirelight.pipeline import provenance, requirements
from mirelight.pipeline.scene import Scene
from mirelight.pipeline.view_light import ViewStopped


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Lit:
    """A view's light: what it is to be lit by, and what it was captured under where the mode compares both."""

    camera: Camera  # of the splats; the buffers may have fewer pixels
    lighting: Lighting
    new: LightingBuffer
    captured: LightingBuffer | None = None
    sun: relighting.Sun | None = None  # of the captured light, where its shadows take their places from the picture
    lobes: LightingBuffer | None = None  # what the proxy's materials mirror of the new light, where that is wanted
    captured_lobes: LightingBuffer | None = None  # the same of the captured one, where both are compared
    bare: LightingBuffer | None = None  # the new light without inserted objects, where their shadow is wanted
    factor: F32 | None = None  # (N, 3) of each splat, linear, where splats are relit one by one

    def __repr__(self) -> str:
        return f"Lit({self.camera.name} under {self.lighting.name}: {self.new!r})"


Look = Callable[[Callable[[], Lit]], None]  # may ask for the light of a view as far as it is traced


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
    return scene.composite(camera.pinhole)


# --- light -----------------------------------------------------------------------------------------------------------


def light(
    scene: Scene, camera: Camera, lighting: Lighting, *, progress: CountProgress | None = None, look: Look | None = None
) -> Lit:
    """The light of a view: unit lights are traced, or found where they were kept, and mixed.

    Args:
        scene: a prepared job.
        camera: one of the job's, or any other.
        lighting: one of the job's, or any other.
        progress: called with (samples done, samples in all) while something is traced.
        look: called while the lighting is traced, with what gives its light so far (noisy, and not denoised).

    Raises:
        Stopped: Ctrl-C; holds what there was.
        BackendError: the job's variant cannot be used on this machine.
        RenderError: the film does not fit in memory.
    """
    _require("light", scene=(scene, Scene), camera=(camera, Camera), lighting=(lighting, Lighting))
    camera, job = camera.pinhole, scene.job
    seen = relighting.lighting_camera(camera, job.relight)
    compared = requirements.compared_in(job, lighting)
    view, new = scene.view_light(seen), scene.new_light(seen, job.objects_of(lighting, camera))
    if new is view:
        view.expect([lighting] if compared is None else [compared, lighting], progress)
    else:  # objects are in the new light alone
        alone = [lighting] if requirements.wants_shadow(job) else []
        view.expect([*(() if compared is None else (compared,)), *alone], progress)
        new.expect([lighting], progress)
    captured: LightingBuffer | None = None
    lobes: LightingBuffer | None = None
    captured_lobes: LightingBuffer | None = None
    bare: LightingBuffer | None = None
    sun: relighting.Sun | None = None
    settings = job.relight_of(lighting)
    try:
        factor = _factor(scene, lighting)
    except KeyboardInterrupt:
        raise Stopped(None) from None

    def lit(buffer: LightingBuffer) -> Lit:
        beside = {"captured": captured, "lobes": lobes, "captured_lobes": captured_lobes, "bare": bare}
        return Lit(camera=camera, lighting=lighting, new=buffer, sun=sun, factor=factor, **beside)

    def offer(so_far: Callable[[], LightingBuffer]) -> None:
        assert look is not None
        look(lambda: lit(so_far()))

    try:
        captured = None if compared is None else view.mixed(compared)
        bare = view.mixed(lighting) if new is not view and requirements.wants_shadow(job) else None
        if compared is not None and relighting.repairs(settings):
            sun = view.sun(compared)
        if relighting.adds_lobes(settings):
            mirrored = scene.lobes(seen)
            mirrored.expect(requirements.with_compared(job, [lighting]), None)
            captured_lobes = None if compared is None else mirrored.mixed(compared)
            lobes = mirrored.mixed(lighting)
        return lit(new.mixed(lighting, None if look is None else offer))
    except ViewStopped:
        so_far = new.mixed_so_far(lighting) if compared is None or captured is not None else None
        raise Stopped(None if so_far is None else lit(so_far)) from None
    except KeyboardInterrupt:
        raise Stopped(None) from None


def _factor(scene: Scene, lighting: Lighting) -> F32 | None:
    """What each splat is multiplied by; None where pixels are."""
    job = scene.job
    if job.splats is None or not relighting.per_splat(job.relight_of(lighting)):
        return None
    with scene.clock.standing():
        return scene.splat_light.factor(lighting)


def trace(
    scene: Scene, camera: Camera, lightings: Iterable[Lighting], *, progress: CountProgress | None = None
) -> None:
    """Trace the unit lights of a view that are not kept yet, and what frames are compared with; nothing is mixed.

    Raises:
        Stopped, BackendError, RenderError: as :func:`light`.
    """
    job, seen = scene.job, relighting.lighting_camera(camera, scene.job.relight)
    if requirements.compared(job) is not None:
        _ = scene.captured_level
    new = list(lightings)
    every = requirements.with_compared(job, new)
    view = scene.view_light(seen)
    shiny = [x for x in new if relighting.adds_lobes(job.relight_of(x))]
    try:
        if shiny:
            scene.lobes(seen).trace(requirements.with_compared(job, shiny), progress)
        if not job.objects:
            view.trace(every, progress)
            return
        view.trace(every if requirements.wants_shadow(job) else every[len(new) :], progress)
        there = [job.objects_of(x, camera) for x in new]
        for objects in {id(x): x for x in there}.values():  # which are in the new light alone
            own = [x for x, one in zip(new, there, strict=True) if one is objects]
            scene.new_light(seen, objects).trace(own, progress)
            scene.keep_objects(camera, objects)
    except ViewStopped:
        raise Stopped(None) from None


# --- relight ---------------------------------------------------------------------------------------------------------


def relight(scene: Scene, splats: SplatLayer | None, lit: Lit | None) -> Frame:
    """One frame, as the relight settings of the job, or of its lighting, say.

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
    settings = job.relight_of(lit.lighting if lit else None)
    made_by = provenance.of_frame(replace(job, relight=settings), lit.lighting.name if lit else "", key)
    made_by = replace(made_by, partial=unfinished)
    captured = lit.captured if lit else None
    if splats is not None and lit is not None and lit.factor is not None:
        made = relighting.frame_of_splats(splats, _blended(scene, splats, lit.factor, settings), lit.new, made_by)
    else:
        if splats is not None and lit is not None and captured is not None and relighting.repairs(settings):
            captured = scene.repaired(captured, lit.sun, splats)
        new = lit.new if lit else None
        if job.masks and splats is not None and new is not None and settings.blend > 0:
            found = scene.inpainted(new, captured, splats)
            captured, new = found.captured, found.new(new)
        made = relighting.apply(
            splats,
            new,
            settings,
            captured=captured,
            captured_level=scene.captured_level if lit and lit.captured else None,
            far=scene.far(lit.lighting) if lit else None,
            made_by=made_by,
            noise=requirements.wants_noise(job),
        )
    if lit is not None and lit.lobes is not None:
        made = relighting.with_lobes(made, lit.lobes, settings, lit.captured_lobes, captured)
    front: SplatLayer | None = None
    objects = job.objects if lit is None else job.objects_of(lit.lighting, camera)
    if objects and lit is not None:
        if splats is not None and lit.new.objects is not None:
            front = scene.in_front(camera, objects, lit.new.objects)
        made = relighting.with_objects(made, front, settings)
        if lit.bare is not None:
            made = replace(made, shadow=relighting.shadow(lit.new, lit.bare, camera))
        if job.output.store != "frames":
            scene.keep_objects(camera, objects)
    mattes = scene.mattes(camera, objects)
    if front is not None:
        mattes = tuple(x.behind(front.transmittance) if x.name == OBJECT_MATTE else x for x in mattes)
    behind = scene.backdrop(camera, lit.lighting if lit else None)
    if behind is not None and splats is not None:
        behind = relighting.without_leaks(behind, made.rgba[..., 3])
    return made if not mattes and behind is None else replace(made, mattes=mattes, background=behind)


def _blended(scene: Scene, splats: SplatLayer, factor: F32, settings: RelightSettings) -> F32:
    """(H, W, 3) the composite of relit splats."""
    if settings.blend == 0:
        return splats.color
    compositor, camera = scene.compositor, splats.camera
    cloud, seen, plain = compositor.splats, compositor.colors(camera), compositor.plain_colors
    if is_log(cloud.color_space):
        new = cloud.colors_of(relighting.relit_colors(splats, cloud.light(seen), cloud.light(plain), factor, settings))
    else:
        new = relighting.relit_colors(splats, seen, plain, factor, settings)
    return compositor.composite_colors(camera, new)


def frame(scene: Scene, camera: Camera, lighting: Lighting | None, *, progress: CountProgress | None = None) -> Frame:
    """The stages one after the other: one whole frame of a pinhole, as `mirelight render` makes it."""
    splats = composite(scene, camera)
    return relight(scene, splats, None if lighting is None else light(scene, camera, lighting, progress=progress))


# --- types -----------------------------------------------------------------------------------------------------------


def _require(call: str, **arguments: tuple[object, object]) -> None:
    """Raises TypeError, in one line, where an argument is not what the call takes."""
    for name, (value, kind) in arguments.items():
        if not isinstance(value, kind):  # type: ignore[arg-type]
            wanted = getattr(kind, "__name__", str(kind)).removeprefix("mirelight.model.")
            raise TypeError(f"{call}(): {name} is a {type(value).__name__}, expected {wanted}")

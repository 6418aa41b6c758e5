"""What the frames of a job need, told from its settings alone; nothing here is made or read."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TypeAlias

from mirelight import relighting
from mirelight.base.errors import InputError
from mirelight.model import Camera, Inserted, Job, Lighting
from mirelight.model.dressing import Dress
from mirelight.model.planes import MATTES, OBJECT_MATTE
from mirelight.model.profiles import rules_of
from mirelight.model.unit_lights import LightSet, Rules

Arrangement: TypeAlias = tuple[Inserted, ...]  # objects, each in its place; the same one is the same tuple


@dataclass(frozen=True, slots=True, eq=False)
class FrameNeeds:
    """What frames of one camera are made from."""

    composite: str | None  # its key; None: there are no splats
    sets: tuple[LightSet, ...]  # of unit lights, each once; those of the captured light come last
    lights: tuple[str, ...]  # keys of their traced buffers, in the same order
    veiled: tuple[str, ...] = ()  # keys of which inserted objects are seen, and of the splats in front of them

    @property
    def keys(self) -> tuple[str, ...]:
        """Of all that frames are mixed from."""
        own = (*self.lights, *self.veiled)
        return own if self.composite is None else (self.composite, *own)


def compares(job: Job) -> bool:
    """True where the relight mode of the job, or of any of its lightings, divides by the light that the capture was
    made under."""
    return any(compares_in(job, x) for x in (None, *(x for x in job.lightings if x.relight is not None)))


def compares_in(job: Job, lighting: Lighting | None) -> bool:
    """The same of one lighting; None: of lightings that say nothing of it."""
    return relighting.mode_of(job.relight_of(lighting)).needs_captured


def compared(job: Job) -> Lighting | None:
    """The captured light, where frames of the job are compared with it."""
    return job.captured if job.splats is not None and compares(job) else None


def compared_in(job: Job, lighting: Lighting) -> Lighting | None:
    """The captured light, where frames of this lighting are compared with it."""
    return job.captured if job.splats is not None and compares_in(job, lighting) else None


def with_compared(job: Job, lightings: Iterable[Lighting]) -> list[Lighting]:
    """Lightings, and after them the captured light where frames of the job are compared with it."""
    captured = compared(job)
    return [*lightings, *(() if captured is None else (captured,))]


def wants_backdrop(job: Job) -> bool:
    """Whether files of frames hold light that stands behind the splats."""
    return job.display.backdrop is not None and (job.output.png or job.output.wants("background"))


def shown_around(job: Job, lighting: Lighting | None) -> Lighting | None:
    """The lighting whose surroundings stand behind a frame: its own, or the captured one where it has none."""
    return job.captured if lighting is None else lighting


def follows_engine(job: Job) -> bool:
    """True where light is the real-time engine's."""
    return not rules_of(job.render.profile).path_traced


def check_lit_splats(job: Job) -> None:
    """Raises InputError, in one line, where a job has no traced light on splats: for bakes and the mixer."""
    if job.splats is None:
        raise InputError(job.source, "no splats", "name a capture: its splats take the light", field="splats")
    if job.proxy is None:
        found = "no proxy mesh for light to fall on"
        raise InputError(job.source, found, 'add the line proxy = "splats"', field="proxy")
    if not job.lightings:
        raise InputError(job.source, "no light", "name lights or an environment", field="lights")
    if job.objects:
        raise InputError(job.source, "inserted objects, which only frames show", "leave them out", field="objects")
    if follows_engine(job):
        found = "the profile playcanvas, whose light is not traced"
        remedy = "use profile physical; mirelight realtime has the engine's own light"
        raise InputError(job.source, found, remedy, field="profile")


def lighting_cameras(job: Job) -> list[Camera]:
    """Every camera of the job as light is traced for it, and of one that is more than a pinhole all its own."""
    count = job.render.lens_samples
    every = (x for camera in job.cameras for x in dict.fromkeys((camera.pinhole, *camera.pinholes(count))))
    return [relighting.lighting_camera(x, job.relight) for x in every]


def reads_surface(job: Job) -> bool:
    """True where light that has been reflected may be kept on the surface and read there ("auto": if the proxy is a
    room); beside inserted objects, which change it, all is traced."""
    return job.render.indirect != "traced" and not follows_engine(job) and not job.objects


def arrangements(job: Job) -> tuple[Arrangement, ...]:
    """The different ways in which objects stand in the capture, in the order of the lightings; one where it is one."""
    return tuple({id(x): x for x in map(job.objects_of, job.lightings)}.values()) or (job.objects,)


def mattes(job: Job) -> tuple[str, ...]:
    """Names of the cryptomattes that a file holds."""
    there = [name for name in MATTES if name != OBJECT_MATTE or job.objects]
    return tuple(name for name in there if job.output.wants(name)) if job.proxy is not None else ()


def painted_glow(job: Job) -> tuple[Dress, ...]:
    """What materials send out, where some of it is painted: the proxy's digest does not know it then."""
    glowing = tuple(x for x in job.materials if x.emission is not None)
    return glowing if any(x.mask is not None for x in glowing) else ()


def wants_noise(job: Job) -> bool:
    """True where a file holds the frame's own noise."""
    return job.output.wants("noise")


def wants_shadow(job: Job) -> bool:
    """True where a file says what inserted objects do to the light beside them, so that it is traced without, too: by
    name alone, for that is a second trace."""
    return bool(job.objects) and job.output.aovs is not True and job.output.wants("shadow")


def colors_proxy(job: Job) -> bool:
    """True where frames are lit on a proxy with the splats' colours: asked for, and of use.

    It is of use to a ratio alone. The tint multiplies splats that have their own albedo by a gray proxy's light, as the
    real-time engine does, and that engine's light model reflects nothing from surface to surface.
    """
    there = job.splats is not None and job.proxy is not None and job.captured is not None
    useful = relighting.mode_of(job.relight).uses_proxy_colours and not follows_engine(job)
    return job.albedo_from_splats and there and useful


def rules(job: Job) -> Rules:
    """Which of the job's lightings are mixed from unit lights."""
    from mirelight.lighting.layers import MAX_LAYERS
    from mirelight.lighting.lights import ALL_LIGHTS

    return Rules(
        linear=not follows_engine(job) and job.render.noise is None and keeps_lights_apart(job),
        most_lights=ALL_LIGHTS,
        most_layers=MAX_LAYERS,
        suns_apart=wants_aovs(job),
    )


def keeps_lights_apart(job: Job) -> bool:
    """True where lights are traced in layers of their own: files hold them, or they are kept to be mixed anew."""
    return job.output.layers or job.output.store != "frames"


def wants_aovs(job: Job) -> bool:
    """True where a file holds what is traced beside light."""
    return job.output.wants("sun_visibility", "ambient_occlusion")


def wants_depth(job: Job) -> bool:
    """True where a file holds the splats' depth."""
    return job.output.wants("splat_depth", "splat_median_depth")


def wants_beyond(job: Job) -> bool:
    """True where splats off the proxy are told from those on it: frames of the job follow the sky past the proxy."""
    follows = any(job.relight_of(x).follows_sky for x in job.lightings)
    return follows and job.splats is not None and job.proxy is not None


def wants_diffuse(job: Job) -> bool:
    """True where a frame treats colour that changes with the view apart."""
    own = [job.relight, *(x.relight for x in job.lightings if x.relight is not None)]
    return any(relighting.gloss_of(x) != "keep" for x in own)

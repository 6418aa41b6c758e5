"""A commented job for a capture, that renders well as it stands."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache, partial
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from mirelight.apps.first_job import beside, captured, lighting, objects, own_cameras, stage_text, up, view
from mirelight.apps.first_job.toml_text import Names, position, quoted, vector
from mirelight.base import conventions
from mirelight.base.errors import InputError, printable
from mirelight.base.pages import page
from mirelight.base.progress import ShareProgress, part, quiet
from mirelight.estimate.tuning import TUNING
from mirelight.io.cameras import Panorama
from mirelight.model import Camera, SplatCloud, SplatWorld
from mirelight.pipeline.guesses import guessed_of_file
from mirelight.proxy import views
from mirelight.proxy.one_picture import takers

_DEEP = 0.01  # depth of what pixels blend (surfaces up to 0.003, fog from 0.017 on): beyond, a closer look is taken
_MOST_CAMERAS = 3  # of the capture, that a first job renders
_SMALLER = 1.4  # times as many pixels to an angle, from which pictures are finer than frames: half way to twice


@dataclass(frozen=True, slots=True)
class Wish:
    """What a person asks of a first job."""

    light: str = ""  # "sun", "point", a panorama or a glTF file; "": a sun, and what lies beside the capture
    resolution: tuple[int, int] = (960, 540)  # of the first picture, or on end where the capture's are upright
    up: tuple[float, float, float] | None = None  # in the splats' own axes; None: it is looked for
    # meshes that are put into the capture, or one node of each; without a light they are lit by its own
    objects: tuple[tuple[Path, str | None], ...] = ()
    estimated: bool = False  # its own light is, where its cameras are known; else an even one is assumed
    directory: str = "out"  # of the frames
    cameras: Path | None = None  # those of the capture's pictures; None: they are looked for

    @property
    def as_captured(self) -> bool:
        """Whether the capture is seen in its own light."""
        return bool(self.objects) and not self.light


@dataclass(frozen=True, slots=True)
class FirstJob:
    """A job, and lines of it for people."""

    text: str
    up: str  # how many splats, and which way is up in them
    as_captured: str  # how bright they are
    notes: tuple[str, ...]  # what beside the capture is of no use, and why; what objects' files hold


def job_for(capture: Path, folder: Path, wish: Wish = Wish(), progress: ShareProgress = quiet) -> FirstJob:
    """The text of a first job for a capture.

    Args:
        capture: a splat file.
        folder: where the job will be, which its paths are relative to.
        wish: what is asked of it.
        progress: hears what is being done.

    Raises:
        InputError: the capture, or the light that was asked for, cannot be used.
        BackendError: this machine cannot composite.
    """
    from mirelight.io import splats

    lighting.check(wish.light)  # before the capture is looked at, which takes longer
    text = None if wish.light or wish.objects else stage_text.of_stage(capture, folder, wish.resolution, wish.directory)
    if text is not None:
        return FirstJob(text, stage_text.said(capture), "Its own lights light it as they stand.", ())
    progress("reading the splats", 0.0)
    cloud = splats.read(capture)
    if cloud.too_far:
        raise InputError(capture, f"it {cloud.too_far}", "move it to the origin before it is saved")
    cameras, unread = own_cameras.find(capture, cloud, wish.cameras)
    own_guess = cache(partial(_guessed, capture, progress))
    progress("looking at the splats", 0.1)
    taken = _taken(cameras, cloud)
    found = up.find(cloud, capture, taken, own_guess) if wish.up is None else up.said(wish.up)
    turn = conventions.rotation_from_euler(found.euler)
    m = conventions.compose(rotation=turn)
    world = cloud if found.euler == (0, 0, 0) else splats.transform(cloud, m)
    meshes = [objects.MeshFile.read(*x) for x in wish.objects]
    proxy, misfit = beside.proxy(capture, cloud, turn)
    looking = cameras if cameras is not None and own_cameras.look_at(cameras, cloud) else None
    outside = cameras is not None and own_cameras.around(cameras, cloud)
    del cloud  # it may take as much memory as the world does

    def guess() -> list[Camera]:
        return [views.placed(x, m) for x in own_guess()]

    placed = [views.placed(x, m) for x in taken] if cameras is None or looking is not None else []
    seen = view.best(world, str(capture), placed, guess=guess, outside=outside, progress=part(progress, 0.3, 0.8))
    known = None if proxy is None else captured.find(world, proxy, looking, turn, guess)
    named = Names(folder)
    asked = known is None and (bool(wish.objects) or (wish.estimated and proxy is None and looking is not None))
    assumed = seen.luminance / TUNING.mean_albedo if asked and not wish.objects else 1.0
    level = assumed if known is None else known.level
    if proxy is None:
        _refuse_no_surface(capture, world, seen, misfit, part(progress, 0.8, 1.0))
    lit, dark = lighting.files(capture, seen.target, wish.light, proxy)
    which_way = _up(world, found)
    lines = [
        f"# {printable(capture.name)}: written by `mirelight new`. Every key: {page('job file')}",
        *_splats(capture, which_way, found, "capture" if cameras is None else cameras.world, named),
        *(
            _made(cameras, looking, asked, misfit, named)
            if proxy is None
            else _given(proxy, looking, found, known, named, colored=bool(wish.objects))
        ),
        *_own_light(wish, asked),
        *_cameras(cameras, unread, wish, named),
        *_camera(seen, wish),
        "",
        f"# {seen.brightness}",
        *(() if known is not None or asked else _assumed(seen, proxy)),
        *(() if wish.as_captured else lighting.lightings(world, seen, wish.light, lit, dark, level, named)),
        *objects.objects(meshes, seen, named),
        *_sky(known=(known is not None or asked) and not wish.as_captured),
        *_rest(wish.directory, finer=cameras is not None and _finer(cameras, seen, wish)),
    ]
    notes = (*(str(x) for x in (misfit, unread, *dark) if x is not None), *(x.said for x in meshes if x.said))
    return FirstJob("\n".join(lines) + "\n", which_way, seen.brightness, notes)


def _taken(cameras: own_cameras.Cameras | None, cloud: SplatCloud) -> tuple[Camera, ...]:
    """Cameras that are known, or those of the one picture that splats were made of, in their axes."""
    return takers(cloud) if cameras is None else cameras.placed(np.eye(3))


def _guessed(capture: Path, progress: ShareProgress) -> tuple[Camera, ...]:
    from mirelight.io import splats

    progress("guessing where it was taken from", 0.15)
    return guessed_of_file(capture, partial(splats.read, capture))


def _refuse_no_surface(
    capture: Path, world: SplatCloud, seen: view.FirstView, misfit: beside.Misfit | None, progress: ShareProgress
) -> None:
    """A job without a mesh renders nothing, and of some splats none can be made."""
    from mirelight.proxy.capture import solid_part
    from mirelight.proxy.make import refuse_fog

    try:
        solid_part(world, capture)
        if seen.depth > _DEEP:
            refuse_fog(world, capture, progress)
    except InputError as refused:
        other = (
            "put a mesh beside it: proxy.glb"
            if misfit is None
            else f"{printable(misfit.path.name)} beside it {misfit.why}"
        )
        raise InputError(capture, refused.found, f"{refused.remedy}; {other}") from None


def _up(cloud: SplatCloud, found: up.Up) -> str:
    lost = f" ({cloud.dropped:,} more with NaN, infinite or absurd values are left out)" if cloud.dropped else ""
    return f"{len(cloud):,} splats{lost}. Up, which is +Y in a job: {found.why}."


def _splats(capture: Path, which_way: str, found: up.Up, world: SplatWorld, named: Names) -> Iterator[str]:
    yield ""
    yield f"# {which_way}"
    if found.guessed:
        yield "# Upside down, or on its side? Change rotation_euler: [0, 0, 0], [90, 0, 0], …"
    place = _placed(found)
    if world != "capture":
        yield f"# They lie in the world that {world} trained in; its cameras are brought there."
        place += f', world = "{world}"'
    yield f"splats = {{ path = {named(capture)}{place} }}" if place else f"splats = {named(capture)}"


def _placed(found: up.Up) -> str:
    turned = found.euler != (0, 0, 0)
    return f", transform = {{ rotation_euler = {vector(found.euler)} }}" if turned else ""


def _given(
    proxy: beside.Proxy,
    cameras: own_cameras.Cameras | None,
    found: up.Up,
    known: captured.Known | None,
    named: Names,
    *,
    colored: bool,
) -> Iterator[str]:
    """A mesh beside the capture, the cameras that colours are looked at from, and the light that is known by it."""
    yield ""
    yield "# The mesh that light falls on, found beside the capture."
    colours = f", cameras = {named(cameras.path)}" if cameras is not None else ""
    colours += ', albedo = "splats"' if known is not None or colored else ""
    yield f"proxy = {{ path = {named(proxy.path)}{_placed(found) if proxy.turned else ''}{colours} }}"
    if known is not None:
        yield ""
        yield f"# The capture's own light, estimated: {known.said}."
        yield 'captured = "estimate"'


def _own_light(wish: Wish, asked: bool) -> Iterator[str]:
    """The light that is there, by which objects are lit, or which new light is compared with."""
    if asked:
        yield ""
        yield "# The capture's own light, which is estimated once; `mirelight estimate` says what is not known of it."
        yield 'captured = "estimate"'
    if wish.as_captured:
        yield ""
        yield "# Seen in that light: nothing but the objects changes the picture. Or name lightings of your own."
        yield 'lightings = "captured"'


def _made(
    cameras: own_cameras.Cameras | None,
    looking: own_cameras.Cameras | None,
    colored: bool,
    misfit: beside.Misfit | None,
    named: Names,
) -> Iterator[str]:
    """A mesh made from the splats, with the capture's cameras where they help: `looking`, where they see splats."""
    yield ""
    if misfit is not None:
        yield f"# {misfit}"
    yield "# The mesh that light falls on, made from the splats once; or name a mesh file."
    colours = ', albedo = "splats"' if colored else ""
    if looking is not None:
        yield "# The pictures' cameras tell where surfaces lie; walls that none shows are closed against light."
        yield f'proxy = {{ path = "splats", cameras = {named(looking.path)}{colours} }}'
        return
    if cameras is not None:
        yield f"# {printable(cameras.path.name)} is left out: few of its cameras see splats."
    yield f'proxy = {{ path = "splats"{colours} }}' if colored else 'proxy = "splats"'


def _cameras(
    found: own_cameras.Cameras | None, unread: beside.Misfit | None, wish: Wish, named: Names
) -> Iterator[str]:
    """A few of the capture's own cameras, as large as the first picture."""
    if unread is not None:
        yield ""
        yield f"# {unread}"
    if found is None:
        return
    fronts = [x for x in found.cameras if isinstance(x.distortion, Panorama) and x.distortion.side == "front"]
    shown = fronts or found.cameras
    count = len(shown)
    every = -(-count // _MOST_CAMERAS)
    longer, most = max(max(x.size(wish.resolution)) for x in shown), max(wish.resolution)
    keys = ', names = ["*_front"]' if fronts else ""
    keys += f", every = {every}" if every > 1 else ""
    if longer > most:
        keys += f", resolution_scale = {most / longer:.3g}"
    bent = max(x.shift() for x in shown) > 0
    if bent:
        keys += ', distortion = "ignore"'
    yield ""
    what = f"{count} panoramas" if fronts else f"{count}"
    some = f"one in {every} of the capture's {what}" if every > 1 else f"the capture's {what}"
    ahead = ", ahead" if fronts else ", as pinholes" if bent else ""
    yield f"# Cameras: {some}{ahead}, beside the one below."
    yield f"cameras_from = {{ path = {named(found.path)}{keys} }}"


def _camera(seen: view.FirstView, wish: Wish) -> Iterator[str]:
    width, height = _size(seen, wish)
    yield ""
    yield f"resolution = [{width}, {height}]"
    yield ""
    yield "[[cameras]]"
    yield 'name = "first"'
    yield f"position = {position(seen.camera.position, seen)}"
    ahead = -seen.camera.world_from_camera[:3, 2]
    away = float(np.linalg.norm(seen.target - seen.camera.position))
    yield f"target = {position(seen.camera.position + ahead * away, seen)}"
    yfov = 2 * np.degrees(np.arctan(seen.camera.height / 2 / seen.camera.fy))
    if view.is_steep(seen.camera):
        yield f"up = {vector(seen.camera.world_from_camera[:3, 1])} # it looks straight up or down, and was held so"
    yield f"yfov = {yfov:.4g} # degrees"
    yield f"near = {away / 1000:.3g}"


def _size(seen: view.FirstView, wish: Wish) -> tuple[int, int]:
    """Pixels of the first picture, width and height: upright where its camera was held so."""
    width, height = wish.resolution
    return (height, width) if seen.camera.height > seen.camera.width else (width, height)


def _assumed(seen: view.FirstView, proxy: beside.Proxy | None) -> Iterator[str]:
    """The capture's own light, where it is not known."""
    if seen.room:
        yield "# A room, whose own light is not known: new light multiplies its colours (mode tint)."
        yield f"# Where you know its lamps, name them in [captured]: {page('captured light')}"
        return
    yield "# Its own light is not known: an even one is assumed, so that a mean of 1 cd/m² keeps the exposure."
    if proxy is None:
        yield "# `mirelight estimate` can find it."
    else:
        yield "# `mirelight estimate` says why it cannot be found."
    yield "[captured]"
    yield "environment = { radiance = 1.0 }"


def _finer(found: own_cameras.Cameras, seen: view.FirstView, wish: Wish) -> bool:
    """Whether the capture's pictures, as wide as its cameras say, have more pixels to an angle than frames."""
    frames = seen.camera.fy * _size(seen, wish)[1] / seen.camera.height
    cameras = [x.to_camera(x.size(wish.resolution)) for x in found.cameras]
    return float(np.median([x.fy for x in cameras])) > _SMALLER * frames


def _sky(*, known: bool) -> Iterator[str]:
    if known:
        yield ""
        yield "[relight]"
        yield 'background = "environment" # splats of the sky follow the new light; a number leaves them as they are'


def _rest(directory: str, *, finer: bool) -> Iterator[str]:
    if finer:
        yield ""
        yield "[compositor]"
        yield "supersampling = 2 # frames are smaller than the pictures that the splats were made of"
    yield ""
    yield "[render]"
    yield "spp = 64 # samples a pixel; more is cleaner and slower"
    if find_spec("pyoidn") is not None:
        yield "denoise = true"
    yield ""
    yield "[output]"
    yield f"directory = {quoted(Path(directory))}"

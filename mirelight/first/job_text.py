"""A commented job for a capture, that renders well as it stands.

Light is chosen so that its ratio to a captured light of 1 cd/m² all around is about 1: the picture is as bright as the
capture, whatever its scale.
"""

from __future__ import annotations

import json
import math
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from mirelight import colour, conventions
from mirelight.errors import InputError, printable
from mirelight.first import beside, captured, up, view
from mirelight.model import F64, Camera, SplatCloud
from mirelight.sh import C0

if TYPE_CHECKING:
    from mirelight.io.job.lighting import FreeNames

LIGHTS = ("sun", "point")
_FILL = 0.35  # cd/m² all around, under the sun
_SUN = 3.2  # lux: a surface that faces it is lit 1.4 times as brightly as it was captured
_GAIN = 0.9  # a lamp's light over the captured one, median of the surface
_MET = 0.6  # of a room's light, that comes straight from a lamp
_BRIGHT = 0.05  # share of the surface that a lamp may make white
_FROM_LEFT = (-0.75, 0.8, 0.45)  # towards the light: along the picture's right, up, towards the camera
_DIGITS = 4
_SAMPLE = 20_000  # splats that are looked at
_DEEP = 0.01  # of what pixels blend: beyond, it may be fog, and a closer look takes some seconds
_MOST_CAMERAS = 3  # of the capture, that a first job renders


@dataclass(frozen=True, slots=True)
class Wish:
    """What a person asks of a first job."""

    light: str = ""  # "sun", "point", a panorama or a glTF file; "": a sun, and what lies beside the capture
    resolution: tuple[int, int] = (960, 540)

    @property
    def file(self) -> Path | None:
        """The file of lights that it names."""
        return Path(self.light) if self.light and self.light not in LIGHTS else None


@dataclass(frozen=True, slots=True)
class FirstJob:
    """A job, and lines of it for people."""

    text: str
    up: str  # how many splats, and which way is up in them
    as_captured: str  # how bright they are
    not_taken: tuple[str, ...]  # what beside the capture is of no use, and why


def job_for(capture: Path, folder: Path, wish: Wish = Wish()) -> FirstJob:
    """The job.

    Args:
        capture: a splat file.
        folder: where the job will be, which its paths are relative to.
        wish: what is asked of it.

    Raises:
        InputError: the capture, or the light that was asked for, cannot be used.
        BackendError: this machine cannot composite.
    """
    from mirelight.io import splats

    if wish.file is not None:
        _asked(wish.file, np.zeros(3))  # refused before the capture is looked at, which takes longer
    cloud = splats.read(capture)
    if cloud.too_far:
        raise InputError(capture, f"it {cloud.too_far}", "move it to the origin before it is saved")
    cameras, unread = beside.cameras(capture)
    found = up.find(cloud, capture, [] if cameras is None else [x.world_from_camera for x in cameras.cameras])
    turn = conventions.rotation_from_euler(found.euler)
    m = np.eye(4)
    m[:3, :3] = turn
    world = cloud if found.euler == (0, 0, 0) else splats.transform(cloud, m)
    proxy, misfit = beside.proxy(capture, cloud, turn)
    seen = view.best(world, str(capture), outside=cameras is not None and beside.around(cameras, cloud))
    known = None if proxy is None else captured.find(world, proxy, turn)
    named = _Names(folder)
    if proxy is None:
        _refuse_no_surface(capture, world, seen, misfit)
    lit, dark = _files(capture, seen.target, wish, proxy)
    which_way = _up(cloud, found)
    lines = [
        f"# {printable(capture.name)}: a first job, written by `mirelight new`. docs/job-file.md has every key.",
        *_splats(capture, which_way, found, named),
        *(_made(cameras, cloud, seen.room, misfit, named) if proxy is None else _given(proxy, found, known, named)),
        *_cameras(cameras, unread, wish, named),
        *_camera(seen, wish),
        *_captured(seen, proxy, known),
        *_lightings(world, seen, wish, lit, dark, 1.0 if known is None else known.level, named),
        *_rest(),
    ]
    not_taken = tuple(str(x) for x in (misfit, unread, *dark) if x is not None)
    return FirstJob("\n".join(lines) + "\n", which_way, seen.brightness, not_taken)


class _Names:
    """Paths as a job in a folder has them."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder.resolve()

    def __call__(self, path: Path) -> str:
        return json.dumps(Path(os.path.relpath(path.resolve(), self._folder)).as_posix(), ensure_ascii=False)


def _refuse_no_surface(capture: Path, world: SplatCloud, seen: view.FirstView, misfit: beside.Misfit | None) -> None:
    """A job without a mesh renders nothing, and of some splats none can be made."""
    from mirelight.proxy.capture import solid_part
    from mirelight.proxy.make import refuse_fog

    try:
        solid_part(world, capture)
        if seen.depth > _DEEP:
            refuse_fog(world, capture)
    except InputError as refused:
        other = "put a mesh beside it: proxy.glb" if misfit is None else f"{misfit.path.name} beside it {misfit.why}"
        raise InputError(capture, refused.found, f"{refused.remedy}; {other}") from None


def _up(cloud: SplatCloud, found: up.Up) -> str:
    lost = f" ({cloud.dropped:,} more with NaN, infinite or absurd values are left out)" if cloud.dropped else ""
    return f"{len(cloud):,} splats{lost}. Up, which is +Y in a job: {found.why}."


def _splats(capture: Path, which_way: str, found: up.Up, named: _Names) -> Iterator[str]:
    yield ""
    yield f"# {which_way}"
    if found.guessed:
        yield "# If the picture stands on its head or lies on its side, change rotation_euler: [0, 0, 0], [90, 0, 0], …"
    place = _placed(found)
    yield f"splats = {{ path = {named(capture)}{place} }}" if place else f"splats = {named(capture)}"


def _placed(found: up.Up) -> str:
    turned = found.euler != (0, 0, 0)
    return f", transform = {{ rotation_euler = {_vector(found.euler)} }}" if turned else ""


def _given(proxy: beside.Proxy, found: up.Up, known: captured.Known | None, named: _Names) -> Iterator[str]:
    """A mesh beside the capture, and the light that is known by it."""
    yield ""
    yield "# The mesh that light falls on. This one was beside the capture, and fits it."
    colours = ', albedo = "splats"' if known is not None else ""
    yield f"proxy = {{ path = {named(proxy.path)}{_placed(found) if proxy.turned else ''}{colours} }}"
    if known is not None:
        yield ""
        yield f"# The light of the capture is estimated from its shading and shadows: {known.said}."
        yield "# `mirelight estimate` writes it out with a picture to judge it by (docs/captured-light.md)."
        yield 'captured = "estimate"'


def _made(
    cameras: beside.Cameras | None, cloud: SplatCloud, room: bool, misfit: beside.Misfit | None, named: _Names
) -> Iterator[str]:
    """A mesh made from the splats, with the capture's cameras where they help."""
    yield ""
    if misfit is not None:
        yield f"# {misfit}"
    yield "# The mesh that light falls on, made from the splats once (docs/proxy.md). A mesh file may stand here."
    if cameras is None:
        yield 'proxy = "splats"'
        return
    with_them = f'proxy = {{ path = "splats", cameras = {named(cameras.path)} }}'
    if not beside.look_at(cameras, cloud):
        yield f"# {cameras.path.name}: few of its cameras have splats before them, so they are left out of it."
        yield 'proxy = "splats"'
    elif room:
        yield "# In a room whose walls the pictures show, its cameras gain nothing. Where they leave walls out:"
        yield f"# {with_them}"
        yield 'proxy = "splats"'
    else:
        yield "# The capture's cameras tell what no picture shows: walls there are closed against light."
        yield with_them


def _cameras(found: beside.Cameras | None, unread: beside.Misfit | None, wish: Wish, named: _Names) -> Iterator[str]:
    """A few of the capture's own cameras, as large as the first picture."""
    if unread is not None:
        yield ""
        yield f"# {unread}"
    if found is None:
        return
    count = len(found.cameras)
    every = -(-count // _MOST_CAMERAS)
    width = max(x.size(wish.resolution)[0] for x in found.cameras)
    keys = f", every = {every}" if every > 1 else ""
    if width > wish.resolution[0]:
        keys += f", resolution_scale = {wish.resolution[0] / width:.3g}"
    bent = max(x.shift() for x in found.cameras) > 0
    if bent:
        keys += ', distortion = "ignore"'
    yield ""
    some = f"one in {every} of the capture's {count}" if every > 1 else f"the capture's {count}"
    yield f"# Cameras: {some}{', as pinholes' if bent else ''}, beside the one below."
    yield f"cameras_from = {{ path = {named(found.path)}{keys} }}"


def _camera(seen: view.FirstView, wish: Wish) -> Iterator[str]:
    width, height = wish.resolution
    yield ""
    yield f"resolution = [{width}, {height}]"
    yield ""
    yield "[[cameras]]"
    yield 'name = "first"'
    yield f"position = {_place(seen.camera.position, seen)}"
    ahead = -seen.camera.world_from_camera[:3, 2]
    away = float(np.linalg.norm(seen.target - seen.camera.position))
    yield f"target = {_place(seen.camera.position + ahead * away, seen)}"
    yfov = 2 * np.degrees(np.arctan(seen.camera.height / 2 / seen.camera.fy))
    yield f"yfov = {yfov:.4g} # degrees"
    yield f"near = {away / 1000:.3g}"


def _captured(seen: view.FirstView, proxy: beside.Proxy | None, known: captured.Known | None) -> Iterator[str]:
    yield ""
    yield f"# {seen.brightness}"
    if known is not None:
        return
    if seen.room:
        yield "# The light they were captured under is not known, and within walls none comes from all around. It is"
        yield "# taken as even on every surface: new light multiplies their colours (mode tint)."
        yield "# Where you know it, or which lamps there were, say it in [captured] (docs/captured-light.md)."
        return
    yield "# The light they were captured under is not known, so an even one all around is assumed. New light is"
    yield "# divided by it: a mean of 1 cd/m² keeps the capture's exposure. Where you know better, say it here."
    if proxy is None:
        yield "# `mirelight estimate` finds it from shading and shadows, and says how well (docs/captured-light.md)."
    else:
        yield "# Shading and shadows tell too little of it to estimate it from them: `mirelight estimate` says why."
    yield "[captured]"
    yield "environment = { radiance = 1.0 }"


def _lightings(
    world: SplatCloud,
    seen: view.FirstView,
    wish: Wish,
    lit: Sequence[beside.Lights],
    dark: Sequence[beside.Misfit],
    level: float,
    named: _Names,
) -> Iterator[str]:
    """`level`: of the captured light, cd/m²; new light is as bright."""
    from mirelight.io.job.lighting import FreeNames

    names = FreeNames()
    if wish.file is None:
        kind = wish.light or ("point" if seen.room else "sun")
        names.take("lamp" if kind == "point" else "sun")
        yield from (_point(seen, world, level) if kind == "point" else _sun(seen, level))
    if dark:
        yield ""
        yield from (f"# {one}" for one in dark)
    for one in lit:
        yield from _file(one, level, named, names)


def _files(
    capture: Path, middle: F64, wish: Wish, proxy: beside.Proxy | None
) -> tuple[tuple[beside.Lights, ...], tuple[beside.Misfit, ...]]:
    """Files of lights that are wished for, and those beside the capture that cannot be used."""
    if wish.file is not None:
        return (_asked(wish.file, middle),), ()
    if wish.light:
        return (), ()
    return beside.lights(capture, middle, None if proxy is None else proxy.path)


def _asked(path: Path, middle: F64) -> beside.Lights:
    """The light of the file that was named. Raises InputError."""
    one = beside.of_file(path, middle) if path.exists() else None
    if one is None:
        found = "no light in it" if path.exists() else "no such file"
        raise InputError(path, found, beside.NO_LIGHT)
    return one


def _towards_light(camera: Camera) -> F64:
    right = camera.world_from_camera[:3, 0]
    back = np.cross(right, (0.0, 1.0, 0.0))
    back = back if np.linalg.norm(back) > 1e-6 else np.array([0.0, 0.0, 1.0])
    x, y, z = _FROM_LEFT
    return conventions.unit(x * right + y * np.array([0.0, 1.0, 0.0]) + z * conventions.unit(back))


def _sun(seen: view.FirstView, level: float) -> Iterator[str]:
    fill = _FILL * level
    yield ""
    yield "# A sun from the left, and the sky's light all around."
    yield "[[lightings]]"
    yield 'name = "sun"'
    yield f"environment = {{ radiance = [{0.8 * fill:.3g}, {fill:.3g}, {1.35 * fill:.3g}] }} # cd/m²"
    yield ""
    yield "[[lightings.lights]]"
    yield 'type = "sun"'
    yield f"direction = {_vector(-_towards_light(seen.camera))} # the way the light travels"
    yield "color = [1, 0.9, 0.74]"
    yield f"intensity = {_SUN * level:.3g} # lux"
    yield "angular_diameter = 1.5 # degrees; more gives softer shadows"


def _point(seen: view.FirstView, cloud: SplatCloud, level: float) -> Iterator[str]:
    away = float(np.linalg.norm(seen.target - seen.camera.position))
    if seen.room:
        place, reach = seen.target + np.array([0.0, 0.25 * away, 0.0]), away
    else:
        reach = 0.7 * away
        place = seen.target + reach * _towards_light(seen.camera)
    yield ""
    yield "# A warm lamp, and a little light all around."
    yield "[[lightings]]"
    yield 'name = "lamp"'
    yield f"environment = {{ radiance = [{0.1 * level:.3g}, {0.12 * level:.3g}, {0.16 * level:.3g}] }} # cd/m²"
    yield ""
    yield "[[lightings.lights]]"
    yield 'type = "point"'
    yield f"position = {_place(place, seen)}"
    yield "color = [1, 0.85, 0.62]"
    straight = _MET if seen.room else 1.0
    yield f"intensity = {level * straight * _candela(cloud, place):.3g} # candela"
    yield f"radius = {0.03 * reach:.2g}"


def _candela(cloud: SplatCloud, place: F64) -> float:
    """What a lamp needs to light a capture as brightly as it was captured under 1 cd/m² all around: the median of what
    faces it, unless that makes more than a few of the splats white. Shadows are not looked at.

    Args:
        cloud: in the world.
        place: (3,) of the lamp.
    """
    rows = np.flatnonzero(cloud.opacities > 0.1)
    rows = rows[:: max(1, len(rows) // _SAMPLE)]
    scales = np.sort(cloud.scales[rows].astype(np.float64), axis=1)
    area = scales[:, 1] * scales[:, 2] * cloud.opacities[rows]
    turns = conventions.rotation_from_quaternion(cloud.quats[rows])
    normals = np.take_along_axis(turns, np.argmin(cloud.scales[rows], axis=1)[:, None, None], axis=2)[:, :, 0]
    way = place - cloud.means[rows].astype(np.float64)
    squared = np.maximum((way**2).sum(axis=1), 1e-12)
    factor = np.abs((way * normals).sum(axis=1)) / squared**1.5 / np.pi  # of one candela, over a captured 1 cd/m²
    shown = colour.srgb_decode(np.clip(cloud.sh[rows, 0] * C0 + 0.5, 0, 1)).max(axis=1)
    usual = _quantile(factor, area, 0.5)
    return _GAIN / max(usual, _GAIN * _quantile(factor * shown, area, 1 - _BRIGHT), 1e-12)


def _quantile(values: F64, weights: F64, share: float) -> float:
    """The value that so much of the weight lies below."""
    order = np.argsort(values, kind="stable")
    up_to = np.cumsum(weights[order])
    return float(values[order][min(int(np.searchsorted(up_to, share * up_to[-1])), len(order) - 1)])


def _file(one: beside.Lights, level: float, named: _Names, names: FreeNames) -> Iterator[str]:
    yield ""
    yield "[[lightings]]"
    yield f"name = {json.dumps(names.take(one.path.stem))}"
    if one.kind == "panorama":
        yield "# The intensity brings its mean to that of the captured light."
        yield f"environment = {{ path = {named(one.path)}, intensity = {one.intensity * level:.3g} }}"
    else:
        yield "# The intensity brings its lights to the capture's exposure."
        yield f'lights_from = {{ path = {named(one.path)}, unit = "khr", intensity = {one.intensity * level:.3g} }}'
        yield f"environment = {{ radiance = {0.08 * level:.3g} }} # cd/m²"


def _rest() -> Iterator[str]:
    yield ""
    yield "[render]"
    yield "spp = 64 # samples per pixel; more is cleaner and slower"
    if find_spec("pyoidn") is not None:
        yield "denoise = true"
    yield ""
    yield "[output]"
    yield 'directory = "out"'


def _place(values: F64, seen: view.FirstView) -> str:
    """To a hundred-thousandth of what the camera is away, be it in millimetres or in kilometres."""
    away = float(np.linalg.norm(seen.target - seen.camera.position))
    return _vector(values, max(_DIGITS - math.floor(math.log10(away)), 0))


def _vector(values: Sequence[float] | F64, digits: int = _DIGITS) -> str:
    return "[" + ", ".join(f"{round(float(v), digits) + 0.0:.12g}" for v in values) + "]"

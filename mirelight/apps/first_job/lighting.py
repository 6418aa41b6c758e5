"""The light of a first job: a sun or a lamp, and what lies beside the capture.

It is chosen so that its ratio to a captured light of 1 cd/m² all around is about 1: the picture is as bright as the
capture, whatever its scale.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from mirelight.apps.first_job import beside, view
from mirelight.apps.first_job.toml_text import Names, position
from mirelight.apps.first_job.up import some_discs
from mirelight.base import conventions
from mirelight.base.errors import InputError
from mirelight.base.names import FreeNames
from mirelight.base.sh import C0
from mirelight.model import F64, SplatCloud

_LIGHTS = ("sun", "point")
_FILL = 0.35  # cd/m² all around, under the sun
_SUN = 3.2  # lux: a surface that faces it is lit 1.4 times as brightly as it was captured
_GAIN = 0.9  # a lamp's light over the captured one, median of the surface
_MET = 0.6  # of a room's light, that comes straight from a lamp
_BRIGHT = 0.05  # share of the surface that a lamp may make white
_ASIDE = (0.75, 0.8, 0.45)  # towards the light: along the picture's right or left, up, towards the camera
_MORE = 1.5  # times the light that what is seen gets from the right, if it comes from there


def lightings(
    world: SplatCloud,
    seen: view.FirstView,
    light: str,
    lit: Sequence[beside.Lights],
    dark: Sequence[beside.Misfit],
    level: float,
    named: Names,
) -> Iterator[str]:
    """The lightings of a first job.

    Args:
        world: the splats, in world space.
        seen: the first view.
        light: that is wished for, see :class:`mirelight.apps.first_job.Wish`.
        lit, dark: see :func:`files`.
        level: of the captured light, cd/m²; new light is as bright.
        named: paths as the job has them.
    """
    names = FreeNames()
    if _file_of(light) is None:
        kind = light or ("point" if seen.room else "sun")
        names.take("lamp" if kind == "point" else "sun")
        yield from (_point(seen, world, level) if kind == "point" else _sun(seen, level))
    if dark:
        yield ""
        yield from (f"# {one}" for one in dark)
    for one in lit:
        yield from _file(one, level, named, names)


def files(
    capture: Path, middle: F64, light: str, proxy: beside.Proxy | None
) -> tuple[tuple[beside.Lights, ...], tuple[beside.Misfit, ...]]:
    """Files of lights that are wished for, and those beside the capture that cannot be used, placed about
    `middle` (3,). Raises InputError."""
    file = _file_of(light)
    if file is not None:
        return (_asked(file, middle),), ()
    if light:
        return (), ()
    return beside.lights(capture, middle, None if proxy is None else proxy.path)


def check(light: str) -> None:
    """Refuse a wish for a file that has no light. Raises InputError."""
    file = _file_of(light)
    if file is not None:
        _asked(file, np.zeros(3))


def _file_of(light: str) -> Path | None:
    return Path(light) if light and light not in _LIGHTS else None


def _asked(path: Path, middle: F64) -> beside.Lights:
    """The light of the file that was named. Raises InputError."""
    one = beside.of_file(path, middle) if path.exists() else None
    if one is None:
        found = "no light in it" if path.exists() else "no such file"
        raise InputError(path, found, beside.NO_LIGHT)
    return one


def _towards_light(seen: view.FirstView) -> tuple[str, F64]:
    """From which side new light comes, and (3,) unit towards it: from the left, unless a wall that is looked along
    faces the right."""
    right = seen.camera.world_from_camera[:3, 0]
    back = np.cross(right, (0.0, 1.0, 0.0))
    back = back if np.linalg.norm(back) > 1e-6 else np.array([0.0, 0.0, 1.0])
    x, y, z = _ASIDE
    rest = y * np.array([0.0, 1.0, 0.0]) + z * conventions.unit(back)
    ways = {"left": conventions.unit(rest - x * right), "right": conventions.unit(rest + x * right)}
    facing = _facing(seen)
    left, other = (float(np.maximum(facing @ way, 0).sum()) for way in ways.values())
    side = "right" if other > _MORE * left else "left"
    return side, ways[side]


def _facing(seen: view.FirstView) -> F64:
    """(N, 3) unit, towards the camera: normals of what the picture shows, by its depth in neighbouring pixels."""
    depth = seen.picture.median_depth
    start, way = seen.camera.rays()
    at = start + way * depth[..., None]
    normal = np.cross(at[1:-1, 2:] - at[1:-1, :-2], at[2:, 1:-1] - at[:-2, 1:-1])
    around = [depth[1:-1, 2:], depth[1:-1, :-2], depth[2:, 1:-1], depth[:-2, 1:-1]]
    there = (np.min(around, axis=0) > 0) & normal.any(axis=-1)
    normal = conventions.unit(normal[there])
    return np.asarray(normal * -np.sign((normal * way[1:-1, 1:-1][there]).sum(axis=1))[:, None])


def _sun(seen: view.FirstView, level: float) -> Iterator[str]:
    from mirelight.io.job.sun_position import of_direction

    fill = _FILL * level
    side, towards = _towards_light(seen)
    yield ""
    yield f"# A sun from the {side}, and the sky's light all around."
    yield "[[lightings]]"
    yield 'name = "sun"'
    yield f"environment = {{ radiance = [{0.8 * fill:.3g}, {fill:.3g}, {1.35 * fill:.3g}] }} # cd/m²"
    yield ""
    yield "[[lightings.lights]]"
    yield 'type = "sun"'
    elevation, azimuth = of_direction(towards)
    yield f"elevation = {elevation:.0f} # degrees above the horizon"
    yield f"azimuth = {azimuth:.0f} # degrees clockwise from north, which is -Z"
    yield "color = [1, 0.9, 0.74]"
    yield f"intensity = {_SUN * level:.3g} # lux"
    yield "angular_diameter = 1.5 # degrees; more gives softer shadows"


def _point(seen: view.FirstView, cloud: SplatCloud, level: float) -> Iterator[str]:
    away = float(np.linalg.norm(seen.target - seen.camera.position))
    if seen.room:
        place, reach = seen.target + np.array([0.0, 0.25 * away, 0.0]), away
    else:
        reach = 0.7 * away
        place = seen.target + reach * _towards_light(seen)[1]
    yield ""
    yield "# A warm lamp, and a little light all around."
    yield "[[lightings]]"
    yield 'name = "lamp"'
    yield f"environment = {{ radiance = [{0.1 * level:.3g}, {0.12 * level:.3g}, {0.16 * level:.3g}] }} # cd/m²"
    yield ""
    yield "[[lightings.lights]]"
    yield 'type = "point"'
    yield f"position = {position(place, seen)}"
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
    rows, area, normals = some_discs(cloud, cloud.opacities > 0.1)
    way = place - cloud.means[rows].astype(np.float64)
    squared = np.maximum((way**2).sum(axis=1), 1e-12)
    factor = np.abs((way * normals).sum(axis=1)) / squared**1.5 / np.pi  # of one candela, over a captured 1 cd/m²
    shown = cloud.light(np.clip(cloud.sh[rows, 0] * C0 + 0.5, 0, 1)).max(axis=1)
    usual = _quantile(factor, area, 0.5)
    return _GAIN / max(usual, _GAIN * _quantile(factor * shown, area, 1 - _BRIGHT), 1e-12)


def _quantile(values: F64, weights: F64, share: float) -> float:
    """The value that so much of the weight lies below."""
    order = np.argsort(values, kind="stable")
    up_to = np.cumsum(weights[order])
    return float(values[order][min(int(np.searchsorted(up_to, share * up_to[-1])), len(order) - 1)])


def _file(one: beside.Lights, level: float, named: Names, names: FreeNames) -> Iterator[str]:
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

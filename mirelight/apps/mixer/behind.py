"""What stands behind the splats on the mixer's page: the surroundings of each layer at unit strength, or a picture.

Light adds up, so what a lighting has behind it is the sum of its layers' surroundings times their weights; the page's
shader looks the maps up in the direction of each pixel (`page/behind.mjs`).
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mirelight.apps.mixer import rgb9e5
from mirelight.io.atomic import atomic_path
from mirelight.io.environment import read_environment
from mirelight.model import F32, F64, Backdrop, Camera
from mirelight.model.unit_lights import Unit, terms
from mirelight.pipeline.backdrops import around_unit
from mirelight.pipeline.scene import Scene
from mirelight.relighting import backdrop
from mirelight.relighting.surroundings import MOST_ROWS, Map, Sun, Surroundings

BEHIND = "behind.bin"
_MOST_PIXELS = 2048  # of a picture's longer side, on the page
_FINEST = (MOST_ROWS - 1) / np.pi  # pixels: the focal length that a map of so many rows is fine enough for


@dataclass(frozen=True, slots=True, eq=False)
class _Seen:
    """Light that the page shows behind the splats, and what of it."""

    layer: int | None  # of the page's, whose weight it is multiplied by; None: none
    captured: F64  # (3,) weight where the splats are shown as captured
    around: Surroundings


def write(scene: Scene, units: tuple[Unit, ...], folder: Path) -> dict[str, Any] | None:
    """Write the file of what stands behind the splats.

    Args:
        scene: a prepared job, whose `display.backdrop` is followed.
        units: what each of the page's first layers is the light of.
        folder: of the page; an earlier file is replaced, or goes.

    Returns:
        What the page has to know of it; None: a plain colour stands there.

    Raises:
        InputError: a picture or panorama cannot be used.
        OutputError: the file cannot be written.
    """
    how, file = scene.job.display.backdrop, folder / BEHIND
    if how is None:
        file.unlink(missing_ok=True)
        return None
    maps: list[dict[str, Any]] = []
    suns: list[dict[str, Any]] = []
    packed: list[NDArray[np.uint32]] = []
    if how.picture is not None:
        picture = Map(_small(read_environment(how.picture), how), 0.0, np.ones(3))
        seen = [_Seen(None, np.ones(3), Surroundings((picture,)))]
        gain = 1.0
    else:
        seen, gain = _surroundings(scene, units, how), 2.0**how.exposure
    for one in seen:
        shared = {"layer": one.layer, "captured": one.captured.tolist()}
        for entry in one.around.maps:
            pixels, scales = rgb9e5.pack(entry.radiance.reshape(1, -1, 3))
            height, width = entry.radiance.shape[:2]
            start = sum(len(x) for x in packed)
            place = {"width": width, "height": height, "start": start, "rotation": float(np.radians(entry.rotation))}
            maps.append({**shared, **place, "scale": (gain * float(scales[0]) * entry.factor).tolist()})
            packed.append(pixels[0])
        suns += [{**shared, **_disc(x, gain)} for x in one.around.suns]
    with atomic_path(file) as temporary:
        np.concatenate(packed or [np.zeros(0, np.uint32)]).astype("<u4").tofile(temporary)
    ground = how.ground
    floor = None if ground is None else [*map(float, ground.center), float(ground.height), float(ground.radius)]
    return {"picture": how.picture is not None, "ground": floor, "maps": maps, "suns": suns}


def _surroundings(scene: Scene, units: tuple[Unit, ...], how: Backdrop) -> list[_Seen]:
    """Of every layer that has any, and of the captured light, which shows where no light is changed."""
    captured = scene.job.captured
    taken: dict[str, F64] = {}
    every: dict[str, tuple[int | None, Unit]] = {x.digest: (k, x) for k, x in enumerate(units)}
    for term in () if captured is None else terms(captured):
        taken[term.unit.digest] = taken.get(term.unit.digest, np.zeros(3)) + term.weight
        every.setdefault(term.unit.digest, (None, term.unit))
    out = []
    for key, (layer, unit) in every.items():
        around = around_unit(unit, scene.resolved, with_ground=True)
        if around is not None:
            out.append(_Seen(layer, taken.get(key, np.zeros(3)), backdrop.prepared(around, how, _FINEST)))
    return out


def _disc(sun: Sun, gain: float) -> dict[str, Any]:
    """A sun as the page draws it."""
    light = gain * backdrop.radiance_of(sun)
    return {"to": (-sun.direction).tolist(), "radius": float(np.radians(sun.diameter / 2)), "scale": light.tolist()}


def _small(picture: F32, how: Backdrop) -> F32:
    """A picture (h, w, 3) as large as the page takes it, its exposure applied."""
    height, width = picture.shape[:2]
    share = min(1.0, _MOST_PIXELS / max(height, width))
    size = max(round(width * share), 1), max(round(height * share), 1)
    return backdrop.fitted(picture, Camera.perspective(np.eye(4), *size, yfov=45), how.exposure)

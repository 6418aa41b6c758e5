"""Light from far away, which splats beyond the proxy show: the sky of a capture follows that of the new light.

A far map holds what a lighting has in every direction: its sky above the horizon and below it a white matt ground,
lit by sky and suns, since what lies there is a surface and keeps its own colour. It is blurred: of the quotient of two
maps only what is smooth is wanted, as the clouds that are seen are those of the splats.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable
from typing import NamedTuple

import numpy as np

from mirelight.base import colour
from mirelight.base.conventions import unit
from mirelight.model import F32, F64, Camera
from mirelight.relighting.backdrop import blurred, with_lit_ground
from mirelight.relighting.mode import Seen
from mirelight.relighting.surroundings import Lookup, Surroundings, solid_angles

ROWS = 128  # of a far map, which is twice as wide
_BLUR = np.radians(2.5)  # standard deviation; coarser than a map's pixels, finer than an evening's glow
_MOST_MAPS = 256  # of single lights that are kept, 0.4 MB each
_SUN_SHARE = 0.005  # of the sky, the brightest part of a map that counts no more than the rest: a panorama's own sun


class Far(NamedTuple):
    """Far maps of a frame's new and captured light, (128, 256, 3) each."""

    new: F32
    captured: F32


def far_map(around: Surroundings | None) -> F32:
    """The far map of a lighting, (128, 256, 3) linear radiance, row 0 is +Y; dark where it has none.

    Suns are no part of the sky, neither lamps nor those in panoramas: splats show them as white at most.
    """
    found = around or Surroundings()
    sky = Surroundings(found.maps).picture(ROWS) if found.maps else np.zeros((ROWS, 2 * ROWS, 3), np.float32)
    sky[ROWS // 2 :] = 0
    lux = sum((x.lux * max(0.0, -float(x.direction[1])) for x in found.suns), np.zeros(3))
    whole = with_lit_ground(sky, lux, np.ones(3))
    if not whole.any():
        return whole
    whole[: ROWS // 2] = _without_suns(whole[: ROWS // 2])
    return blurred(whole, float(_BLUR))


class FarMaps:
    """Far maps of many lights together; those of single ones are kept."""

    def __init__(self) -> None:
        self._known: dict[Hashable, F32] = {}

    def of(self, lights: Iterable[tuple[Hashable, F32 | F64, Callable[[], Surroundings | None]]]) -> F32:
        """The far map of lights: of each what it is known by, its factor (3,), and what gives its surroundings."""
        out = far_map(None)
        for key, factor, around in lights:
            found = self._known.get(key)
            if found is None:
                if len(self._known) >= _MOST_MAPS:
                    self._known.clear()
                found = self._known[key] = far_map(around())
            out += factor.astype(np.float32) * found
        return out


def _without_suns(sky: F32) -> F32:
    """The upper half of a map (h, 4h, 3), its brightest part as bright as what is next to it."""
    level = colour.luminance(sky)
    share = np.broadcast_to(solid_angles(ROWS)[: ROWS // 2], level.shape).ravel()
    order = np.argsort(level, axis=None)
    up_to = np.cumsum(share[order])
    most = level.ravel()[order[np.searchsorted(up_to, (1 - _SUN_SHARE) * up_to[-1])]]
    return np.asarray(sky * np.minimum(1, most / np.maximum(level, 1e-30))[..., None], np.float32)


class FarView:
    """Far maps as a camera sees them past the proxy.

    Args:
        camera: of the frame.
        seen: (H, W) where nothing but the proxy is seen: nothing is looked up there.
    """

    def __init__(self, camera: Camera, seen: Seen) -> None:
        self._shape = seen.shape
        self._where = np.flatnonzero(~seen)
        way = camera.rays()[1].reshape(-1, 3)[self._where] if self._where.size else np.zeros((0, 3))
        self._look = Lookup(unit(way), ROWS)

    def of(self, far: F32) -> F32:
        """(H, W, 3) radiance of a far map (128, 256, 3) at the camera's pixels, 0 where nothing but the proxy is."""
        out = np.zeros((self._shape[0] * self._shape[1], 3), np.float32)
        out[self._where] = self._look(far)
        return out.reshape(*self._shape, 3)

"""Triangles that stop light where a capture's cameras saw nothing, so that it does not pass through walls nobody saw.

Two things are made. What was seen is the front of something: a second sheet stands behind it, at most as thick as the
space that is hidden from all cameras (space carving: Kutulakos and Seitz, 2000). So light does not come through cracks
between faces, and bars and frames that were seen from the front alone cast shadows of something with a depth. Farther
behind it may be the open: a beam of the sun comes into a room through space that no camera looked into. Space in no
picture at all is left open, as the sky is such space; but large planes go on in it (`beyond`), and a room whose
pictures end below its ceiling gets one (`ceiling`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mirelight.base.progress import ShareProgress
from mirelight.lighting.sight import Sight
from mirelight.model import F64, Camera, triangles
from mirelight.proxy.backs import backs_of
from mirelight.proxy.beyond import Look, beyond_pictures, box_of, cell_of
from mirelight.proxy.ceiling import Ceiling, ceiling_of
from mirelight.proxy.depth import DepthMap
from mirelight.proxy.pictures import Pictures
from mirelight.proxy.planes import planes_of
from mirelight.proxy.tuning import TUNING
from mirelight.proxy.types import Soup


@dataclass(frozen=True, slots=True, eq=False)
class Closing:
    """What closes a surface."""

    soup: Soup  # fronts face the space that was seen
    ceiling: Ceiling | None  # the guess that is part of it


@dataclass(frozen=True, slots=True, eq=False)
class Walls:
    """How walls go on where no picture shows them."""

    ceiling: bool = True  # whether one is guessed, which they reach
    top: tuple[F64, float] | None = None  # (3,) unit, and how far along it they end; None: where all was seen, or stood


_ANYHOW = Walls()


def closing(
    soup: Soup,
    sight: Sight,
    cameras: Sequence[Camera],
    spacing: float,
    progress: ShareProgress,
    shown: Sequence[DepthMap] = (),
    *,
    walls: Walls = _ANYHOW,
    guessed: bool = False,
) -> Closing:
    """What closes a surface against light from where no camera saw.

    Args:
        soup: the surface, in the space of the cameras.
        sight: into it.
        cameras: those of the capture.
        spacing: of the capture's splats.
        progress: hears what is done.
        shown: depth maps by cameras of these: through a gap of the surface nothing was seen where they show something.
        walls: how they go on.
        guessed: whether the cameras are: a ceiling may be where they show nothing.
    """
    progress("looking for what no camera saw", 0.0)
    pictures = Pictures.of(cameras, sight, shown)
    progress("looking for what no camera saw", 0.3)
    low, high = box_of(soup, pictures.eyes)
    cell = cell_of(low, high, spacing)
    planes = planes_of(soup, cell, TUNING.beyond_small * float(triangles.areas(soup.vertices[soup.faces]).sum()))
    backs = backs_of(soup, planes, sight, pictures, spacing)
    told = pictures.opaque(shown) if guessed else pictures
    found = ceiling_of(soup, planes, told, cell) if walls.ceiling else None
    if found is not None:
        low, high = found.box(low, high)
        backs = backs.beside(found.soup(planes, low, high, cell, told))
    progress("carrying on walls", 0.7)

    def look(before: float) -> Look:
        return lambda points: pictures.states(points.astype(np.float32), -before)

    return Closing(backs.beside(beyond_pictures(soup, planes, low, high, cell, look, walls.top)), found)

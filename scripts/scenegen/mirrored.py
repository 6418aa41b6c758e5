"""The room that was walked round with a mirror on its wall, as nearly every flat has. Only for `scripts/bench truth`.

What a mirror shows an optimiser makes of splats behind the wall: a second room, whose windows are windows, too.
"""

from __future__ import annotations

from dataclasses import replace

from scenegen import interior, interior_walk
from scenegen.geometry import boxes, soups
from scenegen.recipe import Recipe
from scenegen.textures import Surface, plain, srgb
from scenegen.truth import Looks

PANE = (-0.2, 1.05, interior.DEEP)  # its middle, across from the shelves
SIZE = (1.9, 1.3)  # metres, high and wide
SILVER = 0.003  # Beckmann alpha


def looks() -> Looks:
    """Geometry and materials."""
    room = interior.looks()
    x, y, z = PANE
    high, wide = SIZE
    edge = 0.05
    bars = [[x, y + s * (high + edge) / 2, z - 0.015] for s in (-1, 1)]
    bars += [[x + s * (wide + edge) / 2, y, z - 0.015] for s in (-1, 1)]
    sizes = [[wide + 2 * edge, edge, 0.03]] * 2 + [[edge, high, 0.03]] * 2
    more = [
        boxes((x, y, z - 0.005), (wide, high, 0.02), "mirror", bevel=0.0005),
        boxes(bars, sizes, "oak", bevel=0.004, seed=41),
    ]
    silver = Surface(texture=plain(srgb(244, 244, 244), 243, contrast=0.0), size=1.0, roughness=SILVER, metal=True)
    return Looks(soups=[*room.soups, *soups(more)], surfaces=room.surfaces | {"mirror": silver})


def recipe() -> Recipe:
    """The room's, but for the mirror."""
    return replace(interior_walk.recipe(), name="mirrored", looks=looks)

"""The kitchen with painted walls, by day: nothing on them tells where they are. Only for `scripts/bench truth`.

As in most homes; structure from motion finds no points there, and splats of them hang anywhere before or behind.
"""

from __future__ import annotations

from dataclasses import replace

from scenegen import kitchen
from scenegen.recipe import Recipe
from scenegen.textures import Surface, plain, srgb
from scenegen.truth import Looks


def surfaces() -> dict[str, Surface]:
    """Every material."""
    return kitchen.surfaces() | {
        "wall": Surface(texture=plain(srgb(222, 214, 198), 531, contrast=0.004), size=2.4),
        "ceiling": Surface(texture=plain(srgb(232, 230, 226), 533, contrast=0.004), size=2.0),
        "floor": Surface(texture=plain(srgb(150, 142, 132), 535, contrast=0.02), size=2.0),
    }


def looks() -> Looks:
    """Geometry and materials."""
    return replace(kitchen.looks(), surfaces=surfaces())


def recipe() -> Recipe:
    """How the scene is made."""
    made = kitchen.recipe()
    clouds = next(x for x in made.lightings if x.name == "clouds")
    others = (made.captured, *(x for x in made.lightings if x is not clouds))
    title = "Things on a table before painted walls, captured on a cloudy day."
    return replace(made, name="painted", title=title, looks=looks, captured=clouds, lightings=others)

"""A toy on a white table before white boards, as sellers photograph things: only the toy tells where it is.

Where guessed walls end was found on it, and nothing else tuned; only for `scripts/bench truth`.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from scenegen import bust
from scenegen.geometry import Part, boxes, place, soups
from scenegen.recipe import Recipe
from scenegen.skies import clear
from scenegen.textures import Surface, plain, srgb
from scenegen.truth import Looks

BOARDS = 9
AWAY, HIGH = 1.6, 0.7  # metres


def surfaces() -> dict[str, Surface]:
    """Every material."""
    white = {
        "table": Surface(texture=plain(srgb(226, 224, 220), 731, contrast=0.004), size=2.0),
        "board": Surface(texture=plain(srgb(214, 214, 212), 733, contrast=0.004), size=2.0),
    }
    return bust.surfaces() | white


def _set() -> list[Part]:
    """The table, as wide as the boards reach, and these around it."""
    wide = 2 * AWAY * np.tan(np.pi / BOARDS)
    table = boxes((0, -0.02, 0), (2.2 * AWAY, 0.04, 2.2 * AWAY), "table", bevel=0)
    board = boxes((0, HIGH / 2, -AWAY), (wide, HIGH, 0.01), "board", bevel=0)
    return [table, *(board.moved(place(turn=360 * k / BOARDS)) for k in range(BOARDS))]


def looks() -> Looks:
    """Geometry and materials."""
    down = place(0, -bust.STAND, 0)
    toy = [part.moved(down) for part in (*bust.duck(), *bust.beside())]
    return Looks(soups=soups(toy + _set()), surfaces=surfaces())


def recipe() -> Recipe:
    """How the scene is made."""
    made = bust.recipe()
    sun = clear("sun", (150, 42), (1.0, 0.9, 0.74), 2.6, 0.5)
    others = (sun, *(x for x in made.lightings if x.name != "low sun"))
    title = "A toy on a white table, captured between soft boxes; relit by a sun, by clouds and by a lamp."
    return replace(made, name="product", title=title, looks=looks, lightings=others)

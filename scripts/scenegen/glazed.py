"""The plinth in a glazed, a varnished and a metal finish beside matt stone, which highlights are judged on.

It is not shipped: `scripts/bench gloss` makes it where it is needed.
"""

from __future__ import annotations

from dataclasses import replace

from scenegen import plinth
from scenegen.recipe import Recipe
from scenegen.textures import Surface, plain, srgb
from scenegen.truth import Looks

FINISH = {"clay": 0.2, "wood": 0.3, "fruit": 0.35}  # Beckmann alpha; all else is matt
METAL = "fruit"


def surfaces() -> dict[str, Surface]:
    """Every material."""
    made = {name: replace(x, roughness=FINISH.get(name)) for name, x in plinth.surfaces().items()}
    brass = plain(srgb(214, 178, 110), 313, contrast=0.08)
    return made | {METAL: replace(made[METAL], texture=brass, metal=True)}


def looks() -> Looks:
    """Geometry and materials."""
    return replace(plinth.looks(), surfaces=surfaces())


def recipe() -> Recipe:
    """How the scene is made."""
    title = "A glazed vase, a varnished bench and brass fruit, captured on a clear day."
    return replace(plinth.recipe(), name="glazed", title=title, looks=looks)

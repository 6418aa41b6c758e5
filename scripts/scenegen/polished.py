"""The plinth and its paving in dark polished stone, as in museums and lobbies. Only for `scripts/bench truth`.

What polished stone shows an optimiser makes of splats below it: a vase that hangs upside down in the plinth.
"""

from __future__ import annotations

from dataclasses import replace

from scenegen import plinth
from scenegen.recipe import Recipe
from scenegen.textures import Surface, srgb, stone
from scenegen.truth import Looks

POLISH = 0.03  # Beckmann alpha


def surfaces() -> dict[str, Surface]:
    """Every material."""
    granite = Surface(texture=stone(srgb(62, 62, 66), srgb(40, 40, 44), 315), size=0.8, roughness=POLISH)
    return plinth.surfaces() | {"stone": granite, "paving": granite}


def looks() -> Looks:
    """Geometry and materials."""
    return replace(plinth.looks(), surfaces=surfaces())


def recipe() -> Recipe:
    """How the scene is made."""
    title = "A vase on a plinth of dark polished stone, captured on a clear day."
    return replace(plinth.recipe(), name="polished", title=title, looks=looks)

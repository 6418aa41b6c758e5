"""How lighting meets the splats."""

from __future__ import annotations

from dataclasses import dataclass

from mirelight.model.profiles import FarFactor, Gloss, Per, Profile, RelightMode, Space


@dataclass(frozen=True, slots=True, kw_only=True)
class RelightSettings:
    """How lighting meets splats. Defaults are the engine's GsplatRelighting attributes."""

    mode: RelightMode = "tint"
    profile: Profile = "physical"
    space: Space = "linear"  # in which the factor multiplies
    blend: float = 1.0  # 0: unlit frame, bit for bit; 1: fully relit
    brightness: float = 2.0  # multiplies the lit proxy (tint)
    background: FarFactor = 1.0  # the factor far from the proxy; playcanvas: wherever it does not cover
    texture_scale: float = 1.0  # lighting pixels per frame pixel along each axis, (0, 2]
    delta: float = 0.003  # ratio: regularisation, share of the captured light's mean luminance
    max_ratio: float = 16.0  # ratio: upper clamp
    per: Per = "pixel"  # light is found for each pixel of a view, or for each splat
    repair: bool = True  # captured light has the shadows and the white that the picture shows (ratio, albedo)
    gloss: bool = False  # what the materials' lobes reflect of the new light is added
    sh: Gloss = "keep"  # SH above degree 0: relit as all else, never brightened (fade), or left out (remove)

    @property
    def follows_sky(self) -> bool:
        """Whether splats beyond the proxy change as the light from far away does."""
        return self.background == "environment"

    @property
    def far_number(self) -> float:
        """The factor far from the proxy where it is a number; no change where it is to be found."""
        return 1.0 if isinstance(self.background, str) else self.background

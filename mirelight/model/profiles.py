"""What a profile decides, as one object that the stages ask. The two profiles and all that tells them apart are here.

`physical` is what splats were trained with and what light does; `playcanvas` is the real-time engine, so that its
frames can be predicted. Sources of the numbers: Kerbl et al. 2023 and its CUDA rasteriser (forward.cu, auxiliary.h) for
`physical`, the PlayCanvas 2.23 shader chunks gsplatCorner and gsplat for `playcanvas`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Literal, TypeAlias

from mirelight.base.colour import Transfer

Profile: TypeAlias = Literal["physical", "playcanvas"]
RelightMode: TypeAlias = Literal["tint", "ratio", "albedo"]  # names; `mirelight.relighting` holds what each does
COMPARING: frozenset[RelightMode] = frozenset({"ratio", "albedo"})  # must know the light of the capture
COLOURING: frozenset[RelightMode] = frozenset({"albedo"})  # splats colour the proxy unless the job says else
BRIGHTEST = 0.95  # albedo: no surface reflects more, fresh snow as much
Per: TypeAlias = Literal["pixel", "splat"]  # what light is found for
FarFactor: TypeAlias = float | Literal["environment"]  # of splats beyond the proxy: one number, or as their sky changes
Gloss: TypeAlias = Literal["keep", "fade", "remove"]  # what becomes of colour that changes with the view
Space: TypeAlias = Literal["linear", "display"]

_MOST_ALPHA = 0.9900000095367432  # float32(0.99), as the CUDA code has it: a second one would leave just less than 1e-4


@dataclass(frozen=True, slots=True, kw_only=True)
class SplatRules:
    """How a profile rasterises splats, but for what depends on the frame's size. Lengths in pixels of the frame."""

    low_pass: float  # px², added to both variances
    alpha_max: float  # upper clamp of a fragment's alpha; 1: none
    truncated: bool  # the kernel minus its value at d² = 8, rescaled
    stop: float | None  # a fragment that would leave less transmittance is not blended and ends its pixel
    frustum_margin: float | None  # Jacobian's slope clamp, in tangents of the half field of view; None: no clamp
    clips_depth: bool  # centres outside near..far are dropped; else only those behind the eye
    least_compensation: float  # floor of the squared opacity compensation of antialiased clouds
    drops_small: bool  # splats below `CompositorSettings.min_pixel_size` are dropped
    largest_half: int | None  # px: half a splat's quad is no larger, nor larger than the frame; None: no limit
    packed: bool  # splats are read from the engine's work buffer, `CompositorSettings.work_buffer`
    pipelines: bool  # the engine's gamma and linear pipelines: linear, tone, exposure and eight_bit count


@dataclass(frozen=True, slots=True, kw_only=True)
class ProfileRules:
    """What a profile decides: transfer curve, modes, how splats and light are computed."""

    name: Profile
    transfer: Transfer  # curve between light and display values
    splats: SplatRules
    path_traced: bool  # light adds up as it does in nature: it can be re-weighted, and surfaces light each other
    unit_texels: bool  # the lighting texture has one sample a texel, covered or not, and its size rounds down
    splits_colour: bool  # colour that changes with the view can be told from the rest, and be treated apart
    blending_space: bool  # a tint multiplies in the space that splats blend in, whatever the settings say
    modes: tuple[RelightMode, ...]  # what the thing that the profile stands for can do

    def default_mode(self, captured: bool) -> RelightMode:
        """The mode of a job that names none; `captured`: the light of the capture is known."""
        return "ratio" if captured and self.path_traced else "tint"

    def default_space(self, blends_linear: bool) -> Space:
        """The space of a job that names none; `blends_linear`: splats blend in linear light."""
        return "display" if self.blending_space and not blends_linear else "linear"


PROFILES: Mapping[Profile, ProfileRules] = MappingProxyType(
    {
        rules.name: rules
        for rules in (
            ProfileRules(
                name="physical",
                transfer="srgb",
                splats=SplatRules(
                    low_pass=0.3,
                    alpha_max=_MOST_ALPHA,
                    truncated=False,
                    stop=1e-4,
                    frustum_margin=0.3,
                    clips_depth=True,
                    least_compensation=2.5e-5,
                    drops_small=False,
                    largest_half=None,
                    packed=False,
                    pipelines=False,
                ),
                path_traced=True,
                unit_texels=False,
                splits_colour=True,
                blending_space=False,
                modes=("tint", "ratio", "albedo"),
            ),
            ProfileRules(
                name="playcanvas",
                transfer="power",
                splats=SplatRules(
                    low_pass=0.075,  # the engine adds 0.3 to a covariance in doubled pixels
                    alpha_max=1.0,
                    truncated=True,
                    stop=None,
                    frustum_margin=None,
                    clips_depth=False,
                    least_compensation=0.0,
                    drops_small=True,
                    largest_half=1024,
                    packed=True,
                    pipelines=True,
                ),
                path_traced=False,
                unit_texels=True,
                splits_colour=False,
                blending_space=True,
                modes=("tint",),
            ),
        )
    }
)


def rules_of(profile: Profile) -> ProfileRules:
    """All that a profile decides."""
    return PROFILES[profile]

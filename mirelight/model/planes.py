"""The one table of what a frame's EXR file can hold besides its picture: layers and AOVs, one row each.

The writer, the reader, the lighting film, upsampling, `output.aovs` and docs/reference/outputs.md follow this table.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias

Owner: TypeAlias = Literal["frame", "splats", "lighting", "objects", "layer"]
Upsampling: TypeAlias = Literal["none", "bilinear", "covered", "unit", "variance"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Plane:
    """One layer of a file."""

    name: str  # in files and in `output.aovs`; NAME stands for the light
    channels: Literal["RGBA", "RGB", "XYZ", "Z", "Y"]
    owner: Owner  # Frame, SplatLayer, LightingBuffer, that of inserted objects, or LightLayer
    meaning: str  # as docs/reference/outputs.md says it, with the unit
    upsampling: Upsampling = "none"  # from a smaller lighting to the frame's pixels, see relight.upsample
    half: bool = False  # a colour that `output.half` stores in 16 bits
    color: bool = False  # linear colour, which files hold in `output.color_space`; all else is data
    called: str = ""  # by its owner, where that has another name for it
    exact: bool = False  # of no use when rounded: not in files of the lossy compression, which rounds R, G, B and Y

    @property
    def field(self) -> str:
        """The owner's attribute: (H, W, channels), or (H, W) for Z and Y."""
        return self.called or self.name

    @property
    def width(self) -> int:
        """How many numbers a pixel has."""
        return len(self.channels)


PLANES: tuple[Plane, ...] = (
    Plane(
        name="unlit",
        channels="RGBA",
        owner="frame",
        meaning="the splats as captured, decoded to linear light, premultiplied",
        half=True,
        color=True,
    ),
    Plane(
        name="factor",
        channels="RGB",
        owner="frame",
        meaning="what the splats were multiplied by, in the space that the job chose",
        half=True,
    ),
    Plane(
        name="noise",
        channels="RGB",
        owner="frame",
        meaning="standard deviation of the relit picture that the lighting's own noise causes",
        exact=True,
    ),
    Plane(
        name="background",
        channels="RGB",
        owner="frame",
        meaning="light behind the picture, where `display.background` is an environment or a picture; the two together "
        "are RGB + (1 − A) background. Dark where the splats are all but opaque",
        half=True,
        color=True,
    ),
    Plane(
        name="shadow",
        channels="RGB",
        owner="frame",
        meaning="light beside inserted objects over the same without them: below 1 their shadow, above 1 what they "
        "reflect; 1 where nothing is lit. By name alone, as new light is traced a second time for it",
        half=True,
    ),
    Plane(
        name="splat_color",
        channels="RGB",
        owner="splats",
        called="color",
        meaning="the splats in the space that they blend in, premultiplied: display-encoded, or linear "
        "Rec.709 where they blend in light",
    ),
    Plane(
        name="transmittance",
        channels="Y",
        owner="splats",
        meaning="what the splats let through of a background, 0 to 1",
    ),
    Plane(
        name="splat_depth",
        channels="Z",
        owner="splats",
        called="depth",
        meaning="mean view depth of the blended splats, world units; 0 where there are none",
    ),
    Plane(
        name="splat_median_depth",
        channels="Z",
        owner="splats",
        called="median_depth",
        meaning="view depth where half of the light is blocked, world units; 0 where it never is",
    ),
    Plane(
        name="lighting",
        channels="RGBA",
        owner="lighting",
        called="rgba",
        meaning="the lit proxy, linear radiance, premultiplied; A = its coverage (antialiased)",
        half=True,
        color=True,
    ),
    Plane(
        name="lighting_noisy",
        channels="RGB",
        owner="lighting",
        called="noisy_beauty",
        meaning="with `render.denoise`: the lit proxy before denoising; `output.layers` adds each light's layers with "
        "`_noisy` behind their names",
        half=True,
        color=True,
    ),
    Plane(
        name="depth",
        channels="Z",
        owner="lighting",
        meaning="depth of the proxy along the view axis, world units; 0 where it is not covered",
        upsampling="covered",
    ),
    Plane(
        name="position",
        channels="XYZ",
        owner="lighting",
        meaning="position on the proxy, world units",
        upsampling="covered",
        exact=True,
    ),
    Plane(
        name="normal",
        channels="XYZ",
        owner="lighting",
        meaning="shading normal in world axes, turned to the viewer",
        upsampling="unit",
        exact=True,
    ),
    Plane(
        name="geometric_normal",
        channels="XYZ",
        owner="lighting",
        meaning="face normal in world axes, turned to the viewer",
        upsampling="unit",
        exact=True,
    ),
    Plane(
        name="albedo",
        channels="RGB",
        owner="lighting",
        meaning="the proxy's albedo as rendered, linear",
        upsampling="covered",
        half=True,
        color=True,
    ),
    Plane(
        name="sun_visibility",
        channels="Y",
        owner="lighting",
        meaning="share of the directional lights' and suns' light that reaches the surface: 1 lit, 0 shadowed or "
        "turned away. With several suns each counts by its illuminance; absent without one",
        upsampling="covered",
    ),
    Plane(
        name="ambient_occlusion",
        channels="Y",
        owner="lighting",
        meaning="share of the cosine-weighted hemisphere that is free of the proxy up to `render.ao_distance`: 1 open, "
        "0 closed",
        upsampling="covered",
    ),
    Plane(
        name="variance",
        channels="RGB",
        owner="lighting",
        meaning="variance of the mean of `lighting`; denoised, its estimated mean square error. With `output.layers` "
        "each light's `light_NAME_variance` comes with it",
        upsampling="variance",
        exact=True,
    ),
    Plane(
        name="samples",
        channels="Y",
        owner="lighting",
        meaning="light samples that went into the pixel",
        upsampling="bilinear",
        exact=True,
    ),
    Plane(
        name="object_coverage",
        channels="Y",
        owner="objects",
        called="coverage",
        meaning="share of the pixel that inserted objects cover, whatever splats in front let through; absent, as all "
        "of these, without objects",
    ),
    Plane(
        name="object_depth",
        channels="Z",
        owner="objects",
        called="depth",
        meaning="depth of inserted objects along the view axis, world units; 0 where there are none",
    ),
    Plane(
        name="object_normal",
        channels="XYZ",
        owner="objects",
        called="normal",
        meaning="their shading normal in world axes, turned to the viewer",
        exact=True,
    ),
    Plane(
        name="object_albedo",
        channels="RGB",
        owner="objects",
        called="albedo",
        meaning="their base colour as rendered, linear",
        half=True,
        color=True,
    ),
    Plane(
        name="object_light",
        channels="RGBA",
        owner="objects",
        called="rgba",
        meaning="what they send out, linear radiance, premultiplied; A = `object_coverage`",
        half=True,
        color=True,
    ),
)
LIGHT_PLANES: tuple[Plane, ...] = (
    Plane(
        name="light_NAME_direct",
        channels="RGB",
        owner="layer",
        called="direct",
        meaning="what one light or group of lights, the environment or glowing surfaces add after one reflection, "
        "linear radiance, premultiplied",
        upsampling="bilinear",
        half=True,
        color=True,
    ),
    Plane(
        name="light_NAME_indirect",
        channels="RGB",
        owner="layer",
        called="indirect",
        meaning="the same after more reflections. Direct and indirect of all lights together are `lighting`",
        upsampling="bilinear",
        half=True,
        color=True,
    ),
    Plane(
        name="light_NAME_variance",
        channels="RGB",
        owner="layer",
        called="variance",
        meaning="variance of the mean of `light_NAME_direct` + `light_NAME_indirect`",
        upsampling="variance",
        exact=True,
    ),
)
AOVS = tuple(plane.name for plane in PLANES)  # what `output.aovs` can name, and what `true` means
OBJECT_MATTE = "cryptomatte_object"  # of inserted objects
MATTES = (
    "cryptomatte_material",
    "cryptomatte_node",
    OBJECT_MATTE,
)  # `output.aovs` can name them, too: `model.results.Matte`
NAMEABLE = AOVS + MATTES
EXACT = frozenset(plane.name for plane in PLANES if plane.exact) | frozenset(MATTES)
SURFACE = tuple(plane for plane in PLANES if plane.upsampling in ("covered", "unit"))  # in the film's order


def planes_of(owner: Owner) -> tuple[Plane, ...]:
    """The rows of one type, in the table's order."""
    return tuple(plane for plane in (*PLANES, *LIGHT_PLANES) if plane.owner == owner)

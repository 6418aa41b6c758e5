"""Tables of the job file for settings. Keys and defaults are those of the types in `mirelight.model`."""

from __future__ import annotations

import re
from typing import Annotated, Any, Literal, TypeAlias

from pydantic import BeforeValidator, Discriminator, Field, Tag, field_validator, model_validator

from mirelight import model
from mirelight.base.primaries import ColorSpace
from mirelight.io.job.background_tables import Background, BackgroundTable
from mirelight.io.job.fields import NotNegative, Positive, Seed, Share, Table, wrong
from mirelight.io.job.material_tables import Masks
from mirelight.io.job.words import meant, shown, shown_path
from mirelight.model import (
    Compression,
    HdrFormat,
    HeldOut,
    Indirect,
    Layout,
    RelightMode,
    Sort,
    Space,
    ToneCurve,
    Variant,
)
from mirelight.model.planes import EXACT, NAMEABLE
from mirelight.model.profiles import Gloss, Per

_RENDER = model.RenderSettings()
_COMPOSITOR = model.CompositorSettings()
_RELIGHT = model.RelightSettings()
_DISPLAY = model.DisplaySettings()
_OUTPUT = model.OutputSettings()
_DATASET = model.DatasetSettings()
_ENGINE = model.EngineSettings()


class RenderTable(Table):
    """Settings of the lighting pass."""

    spp: int = Field(default=_RENDER.spp, ge=1, le=1_000_000, description="Samples per pixel.")
    noise: float | None = Field(
        default=_RENDER.noise,
        ge=1e-4,
        le=1,
        allow_inf_nan=False,
        description="Relative error to reach. Default: spp alone decides.",
    )
    max_depth: int = Field(
        default=_RENDER.max_depth,
        ge=1,
        le=1000,
        description="Vertices of a path from the first hit on; 1: direct light alone. "
        "Where walls are bright more are worth their cost: docs/explanation/lighting.md.",
    )
    indirect: Indirect = Field(
        default=_RENDER.indirect,
        description="Reflected light: traced anew for every picture; or gathered on the proxy once for all cameras and "
        "read at a path's first hit (surface); auto: surface in rooms, traced under an open sky. "
        "docs/explanation/surface-light.md: what is gained and lost.",
    )
    seed: int = Field(default=_RENDER.seed, ge=0, le=2**31 - 1, description="Same seed, same picture.")
    variant: Variant = Field(default=_RENDER.variant, description="Mitsuba's backend.")
    denoise: bool = Field(default=_RENDER.denoise, description="Denoise the lighting; needs the extra `denoise`.")
    threads: int | None = Field(default=_RENDER.threads, ge=1, le=4096, description="CPU threads. Default: every core.")
    max_memory: int | None = Field(
        default=_RENDER.max_memory,
        ge=2**20,
        le=2**50,
        description="Bytes that a picture's film may take, and light on the surface. "
        "Default: what the machine has free.",
    )
    lens_samples: int = Field(
        default=_RENDER.lens_samples,
        ge=1,
        le=4096,
        description="Of cameras with a lens or a shutter: pinholes whose mean is the frame. They share spp.",
    )
    ao_distance: Positive | None = Field(
        default=_RENDER.ao_distance,
        description="How far ambient occlusion looks, in world units. Default: a tenth of the proxy's diagonal.",
    )


class CompositorTable(Table):
    """Settings of the splat compositor. Keys marked playcanvas have no effect in the profile physical."""

    sort: Sort | None = Field(
        default=None,
        description="Order of splats: by view-space z (depth), or by distance to the eye (radial). "
        "Default: radial for glTF, as its splats are defined, else depth.",
    )
    work_buffer: Literal["compact", "large"] = Field(
        default=_COMPOSITOR.work_buffer, description="playcanvas: precision of the engine's splat buffer."
    )
    min_pixel_size: NotNegative = Field(
        default=_COMPOSITOR.min_pixel_size,
        description="playcanvas: smaller splats are dropped, in the engine's doubled pixels.",
    )
    alpha_clip: Share = Field(default=_COMPOSITOR.alpha_clip, description="Fragments with less alpha are dropped.")
    tone: ToneCurve = Field(
        default=_COMPOSITOR.tone, description="playcanvas, gamma pipeline: tone curve of each splat."
    )
    exposure: NotNegative = Field(
        default=_COMPOSITOR.exposure, description="playcanvas: linear factor before that curve."
    )
    linear: bool = Field(default=_COMPOSITOR.linear, description="playcanvas: the linear pipeline (CameraFrame).")
    eight_bit: bool = Field(
        default=_COMPOSITOR.eight_bit, description="playcanvas: round after every splat as 8-bit targets do."
    )
    supersampling: int = Field(
        default=_COMPOSITOR.supersampling,
        ge=1,
        le=8,
        description="Each pixel is the mean of so many by so many. In frames smaller than the pictures that splats "
        "were trained on 2 keeps them from coming out too wide; takes about its square of the time. playcanvas: 1.",
    )
    max_memory: int | None = Field(
        default=_COMPOSITOR.max_memory,
        ge=2**20,
        le=2**50,
        description="Bytes it may take. Default: what the machine has free.",
    )


def _number_or_word(value: Any) -> str:
    return "type=word" if isinstance(value, str) else "type=number"


def _known_word(value: Any) -> Any:
    if isinstance(value, str) and value != "environment":
        raise wrong(shown(value), 'give a number, or "environment"')
    return value


FarFactor: TypeAlias = Annotated[
    Annotated[NotNegative, Tag("type=number")] | Annotated[Literal["environment"], Tag("type=word")],
    Discriminator(_number_or_word),
    BeforeValidator(_known_word),
]


class RelightTable(Table):
    """How light changes the splats' colours."""

    mode: RelightMode | None = Field(
        default=None,
        description="tint: multiply by the lit proxy; ratio: by new over captured light; "
        "albedo: divide the captured light out and light what is left. "
        "Default: ratio where captured is given and the profile is physical, else tint.",
    )
    space: Space | None = Field(
        default=None,
        description="In which the factor multiplies. "
        "Default: linear for the profile physical and the engine's linear pipeline, else display.",
    )
    blend: Share = Field(default=_RELIGHT.blend, description="0: as captured; 1: fully relit.")
    brightness: NotNegative = Field(default=_RELIGHT.brightness, description="tint: multiplies the lit proxy.")
    background: FarFactor = Field(
        default=_RELIGHT.background,
        description='The factor far from the proxy: a number; or "environment", new over captured light that comes '
        "from each pixel's direction, so that splats of the sky follow it (ratio and albedo). "
        "playcanvas: a number.",
    )
    texture_scale: float = Field(
        default=_RELIGHT.texture_scale,
        ge=0.01,
        le=2,
        description="Lighting pixels per image pixel along each axis. At 2 a denoiser keeps edges apart; "
        "`spp` is per lighting pixel.",
    )
    delta: float = Field(
        default=_RELIGHT.delta,
        gt=0,
        le=1,
        description="ratio, albedo: regularisation, as share of the captured light's mean luminance.",
    )
    max_ratio: Positive = Field(default=_RELIGHT.max_ratio, description="ratio: largest factor.")
    per: Per = Field(
        default=_RELIGHT.per,
        description="What light is found for: each pixel of a view, or each splat, wherever it is seen from "
        "(docs/explanation/relighting.md: which is better where). playcanvas: pixel.",
    )
    repair: bool = Field(
        default=_RELIGHT.repair,
        description="ratio, albedo, light found for pixels: captured light takes the place of the sun's shadows, and "
        "the white that it ends at, from the picture. playcanvas: false.",
    )
    gloss: bool = Field(
        default=_RELIGHT.gloss,
        description="Add what the proxy's materials mirror of the new light (docs/guides/gloss.md). playcanvas: false.",
    )
    mask: Masks = Field(
        default=[],
        description="Painted over frames, a table or a list: where the factor is wrong, it is taken from the surface "
        "around (docs/guides/captured-light.md). Profile physical, light found for pixels.",
    )
    sh: Gloss = Field(
        default=_RELIGHT.sh,
        description="Colour that changes with the view (SH above degree 0): keep (relit as all else), fade (darkened "
        "as all else, never brightened) or remove. playcanvas: keep.",
    )


class DisplayTable(Table):
    """Settings of the PNG. Of the EXR, only the layer `background` is affected."""

    exposure: float = Field(default=_DISPLAY.exposure, ge=-64, le=64, description="In stops.")
    tone: ToneCurve = Field(default=_DISPLAY.tone, description="Tone curve.")
    view: str | None = Field(
        default=None,
        min_length=1,
        max_length=200,
        description="View of an OpenColorIO config, by its name there, in place of a tone curve; needs the extra "
        "`ocio`.",
    )
    display: str | None = Field(
        default=None, min_length=1, max_length=200, description="Display of that config. Default: the config's own."
    )
    config: str | None = Field(
        default=None,
        min_length=1,
        max_length=4096,
        description="OpenColorIO config: a file, relative to the job file, or a built-in one, `ocio://NAME`. "
        "Default: what the environment variable OCIO names, or else OpenColorIO's built-in ACES config.",
    )
    background: Background = Field(
        default=BackgroundTable(color=list(_DISPLAY.background)),
        description='What lies behind the splats: display-encoded [r, g, b], 0 to 1; "environment", which is what the '
        'lighting has all around; a picture\'s path; "transparent"; or a table. Default: black.',
    )

    @model_validator(mode="after")
    def _check(self) -> DisplayTable:
        alone = next((name for name in ("display", "config") if getattr(self, name) is not None), None)
        if self.view is None and alone is not None:
            raise wrong("no view to go with it", "name one, or leave it out", at=alone)
        if self.view is not None and self.tone != "none":
            raise wrong("a tone curve beside a view, which has its own", "leave one out", at="tone")
        return self


class OutputTable(Table):
    """Which files are written, and where."""

    directory: str = Field(
        default=str(_OUTPUT.directory), min_length=1, max_length=4096, description="Folder, relative to the job file."
    )
    store: Literal["both", "frames", "layers"] = Field(
        default=_OUTPUT.store,
        description="both: keep traced light beside the frames, so that a changed colour or intensity traces nothing; "
        "frames: keep frames alone; layers: write no frames, they are mixed when they are read "
        "(docs/guides/datasets.md).",
    )
    exr: bool = Field(default=_OUTPUT.exr, description="Write linear OpenEXR.")
    png: bool = Field(default=_OUTPUT.png, description="Write a PNG for display.")
    layers: bool | None = Field(
        default=None,
        description="EXR: direct and indirect light of each light or group, and their sum. Default: true, but false in "
        "a job with a sweep, whose light is kept once a camera, unless store is frames.",
    )
    aovs: bool | list[str] | None = Field(
        default=None,
        description="EXR: layers besides the picture and those of lights, all (true), none (false), or by name: "
        f"{', '.join(NAMEABLE)}. With dwaa, true leaves out what rounding would spoil; it never means cryptomattes. "
        "Default: as for layers.",
        json_schema_extra={"anyOf": [{"type": "boolean"}, {"type": "array", "items": {"enum": list(NAMEABLE)}}]},
    )
    half: bool = Field(default=_OUTPUT.half, description="EXR: 16-bit colour; depth and position stay 32-bit.")
    color_space: ColorSpace = Field(
        default=_OUTPUT.color_space, description="EXR: primaries of its linear colours; data stay as they are."
    )
    compression: Compression = Field(
        default=_OUTPUT.compression,
        description="EXR: zip (lossless), dwaa (lossy, small; only for what may be rounded) or none (fast, large).",
    )

    @field_validator("aovs", mode="before")
    @classmethod
    def _known(cls, value: Any) -> Any:
        if value is None or isinstance(value, bool):
            return value
        if not isinstance(value, list) or not all(isinstance(name, str) for name in value):
            raise wrong(shown(value), "give true, false, or a list of names")
        for name in value:
            if name not in NAMEABLE:
                remedy = meant(name, list(NAMEABLE), f"there are {', '.join(NAMEABLE)}")
                raise wrong(f"no layer {shown(name)}", remedy)
        return list(dict.fromkeys(value))

    @model_validator(mode="after")
    def _exact(self) -> OutputTable:
        rounded = [name for name in self.aovs if name in EXACT] if isinstance(self.aovs, list) else []
        if rounded and self.compression == "dwaa":
            raise wrong(f"dwaa, which would round {rounded[0]}", 'use "zip", or leave that layer out', at="compression")
        return self

    @field_validator("directory")
    @classmethod
    def _check_directory(cls, value: str) -> str:
        if not value.isprintable():
            raise wrong(f"{shown_path(value)} cannot be a folder's name", "use letters, digits and '/'")
        return value

    @model_validator(mode="after")
    def _check(self) -> OutputTable:
        if not self.exr and not self.png:
            raise wrong("neither exr nor png", "write one of them", at="png")
        return self


class DatasetTable(Table):
    """Data sets that are written beside the frames when all are there."""

    layouts: list[Layout] = Field(
        default=[],
        max_length=20,
        description="Which ones, each into a folder of its name in dataset/ of the output folder "
        "(docs/guides/datasets.md).",
    )
    normalize: bool = Field(
        default=_DATASET.normalize,
        description="Move and scale the world so that what cameras see of the proxy fits a box of ±1.",
    )
    split: HeldOut = Field(default=_DATASET.split, description="What is held out: cameras, lightings or both.")
    held_out: Share = Field(default=_DATASET.held_out, description="Share of their names, chosen by a hash.")
    seed: Seed = Field(default=_DATASET.seed, description="Another seed, another choice.")
    license: str = Field(default=_DATASET.license, max_length=200, description="Licence, for the data sets' pages.")
    hdr: bool = Field(
        default=_DATASET.hdr, description="Write linear pictures, too, in layouts whose loaders take them."
    )

    @field_validator("layouts")
    @classmethod
    def _once(cls, value: list[Layout]) -> list[Layout]:
        return list(dict.fromkeys(value))

    @field_validator("license")
    @classmethod
    def _one_line(cls, value: str) -> str:
        if not is_license(value):
            raise wrong(f"{shown(value)} cannot be a licence's name", f"give one such as {LICENSE}")
        return value


class EngineTable(Table):
    """Settings of the real-time engine: of `mirelight realtime`, and of what lights of type playcanvas mean."""

    clustered: bool = Field(
        default=_ENGINE.clustered,
        description="The engine's clustered lighting, its default: cones of spots are narrower by a hundredth of their "
        "angles, and omni and spot lights have no penumbra.",
    )
    physical_units: bool = Field(
        default=_ENGINE.physical_units,
        description="The engine's physicalUnits: lights of type playcanvas give luminance instead of intensity.",
    )
    hdr_format: HdrFormat | None = Field(
        default=_ENGINE.hdr_format,
        description="Linear pipeline: the pixels that splats are blended in. Default: the engine's choice, 111110F.",
    )


LICENSE = "cc-by-4.0"


def is_license(text: str) -> bool:
    """Whether a text can stand for a licence on a data set's page: a name as SPDX has it, or an address."""
    return re.fullmatch(r"[A-Za-z0-9 .,+:/()_-]*", text) is not None and ": " not in text

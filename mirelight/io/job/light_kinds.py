"""Table of the real-time engine's light components, and the union of all kinds of lights."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeAlias, Union, get_args

from pydantic import Discriminator, Field, Tag, model_validator

from mirelight.io.job.described_tables import DESCRIBED_TABLES, DescribedTable
from mirelight.io.job.fields import Direction, DisplayColor, NotNegative, Positive, Vec3, wrong
from mirelight.io.job.lamp_tables import (
    TARGET,
    AreaTable,
    DirectionalTable,
    LightTable,
    PointTable,
    SpotTable,
    SunTable,
    aimed,
)
from mirelight.io.job.moon import MoonTable
from mirelight.model import Falloff
from mirelight.model.playcanvas_lights import DEFAULT_RANGE


class PlayCanvasTable(LightTable):
    """A light component of the real-time engine, in its own units and with its defaults."""

    type: Literal["playcanvas"]
    kind: Literal["omni", "spot", "directional"] = Field(description="The component's type.")
    color: DisplayColor = Field(default=[1.0, 1.0, 1.0], description="Display-encoded [r, g, b], 0 to 1 (2.2 power).")
    intensity: NotNegative = Field(default=1.0, description="The component's intensity.")
    luminance: NotNegative | None = Field(
        default=None,
        description="The component's luminance, with `engine.physical_units`: lumens of an omni or spot, lux of a "
        "directional light; instead of intensity.",
    )
    position: Vec3 | None = Field(default=None, description="[x, y, z] in world units; not of directional.")
    direction: Direction | None = Field(default=None, description="[x, y, z], the way the light travels; not of omni.")
    target: Vec3 | None = Field(default=None, description=TARGET)
    range: Positive = Field(default=DEFAULT_RANGE, description="Distance at which the light has faded to nothing.")
    falloff: Falloff = Field(
        default="linear", description="1 - d / range, or 16 / (d² + 1) with a squared window at the range."
    )
    inner_cone_angle: Annotated[float, Field(ge=0, le=90, allow_inf_nan=False)] = Field(
        default=40.0, description="Half angle in degrees at which a spot starts to fade."
    )
    outer_cone_angle: Annotated[float, Field(gt=0, le=90, allow_inf_nan=False)] = Field(
        default=45.0, description="Half angle in degrees at which it is gone."
    )
    cast_shadows: bool = Field(default=False, description="Whether it casts shadows, in the profile playcanvas.")
    penumbra_size: Positive | None = Field(
        default=None,
        description="With cast_shadows: soft shadows (PCSS) of this penumbraSize, the engine's own frames alone. "
        "Default: hard ones (PCF3).",
    )
    penumbra_falloff: Positive = Field(
        default=1.0, description="The penumbraFalloff of a directional light's soft shadows."
    )

    @model_validator(mode="after")
    def _check(self) -> PlayCanvasTable:
        pose = {"position": self.position, "direction": self.direction, "target": self.target}
        for key in {"omni": ("direction", "target"), "directional": ("position", "target"), "spot": ()}[self.kind]:
            if pose[key] is not None:
                raise wrong(f"a {key} of a light of kind {self.kind}", "leave it out", at=key)
        needed = "direction" if self.kind == "directional" else "position"
        if pose[needed] is None:
            raise wrong(f"a light of kind {self.kind} without {needed}", f"add {needed} = [x, y, z]")
        if self.kind == "spot" and self.position is not None:
            aimed(self, self.position, self.target)
            if self.inner_cone_angle > self.outer_cone_angle:
                found = f"{self.inner_cone_angle:g}, and outer_cone_angle is {self.outer_cone_angle:g}"
                raise wrong(found, "make the inner angle the smaller one", at="inner_cone_angle")
        if self.penumbra_size is not None and not self.cast_shadows:
            raise wrong("a penumbra without shadows", "add cast_shadows = true", at="penumbra_size")
        if "penumbra_falloff" in self.model_fields_set:
            if self.penumbra_size is None:
                raise wrong("the falloff of a penumbra that has no size", "add penumbra_size", at="penumbra_falloff")
            if self.kind != "directional":
                found = f"a penumbra's falloff of a light of kind {self.kind}"
                raise wrong(found, "leave it out; the engine has it of directional ones", at="penumbra_falloff")
        return self


def _light_type(value: Any) -> str | None:
    kind = value.get("type") if isinstance(value, dict) else getattr(value, "type", None)
    return f"type={kind}" if isinstance(kind, str) else None


_TABLES = (
    DirectionalTable,
    PointTable,
    SpotTable,
    SunTable,
    MoonTable,
    AreaTable,
    PlayCanvasTable,
    *DESCRIBED_TABLES,
)


def _tag(table: type[LightTable]) -> str:
    """What `_light_type` says of a table of this type."""
    return f"type={get_args(table.model_fields['type'].annotation)[0]}"


if TYPE_CHECKING:
    AnyLight: TypeAlias = (
        DirectionalTable | PointTable | SpotTable | SunTable | MoonTable | AreaTable | PlayCanvasTable | DescribedTable
    )
else:
    AnyLight = Annotated[Union[tuple(Annotated[x, Tag(_tag(x))] for x in _TABLES)], Discriminator(_light_type)]  # noqa: UP007

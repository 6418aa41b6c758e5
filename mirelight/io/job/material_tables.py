"""Materials of the proxy, as a job file says them."""

from __future__ import annotations

from typing import Annotated, Any, TypeAlias

from pydantic import BeforeValidator, Field, model_validator

from mirelight.io.job.fields import AssetPath, Bounds, ColorOrGray, LightName, Name, Share, Table, wrong
from mirelight.model.dressing import Dress, Mask


class MaskTable(Table):
    """A picture that is painted over a frame: opaque where it has an alpha channel, else white, where this is meant."""

    path: AssetPath = Field(description="The picture, of the camera's shape and any size: .png or .jpg.")
    camera: Name = Field(description="The job's camera whose frame it is painted over.")


def _as_list(value: Any) -> Any:
    return value if isinstance(value, list) else [value]


Masks: TypeAlias = Annotated[
    list[MaskTable],
    Field(max_length=100),
    BeforeValidator(_as_list, json_schema_input_type=MaskTable | list[MaskTable]),
]


class MaterialTable(Table):
    """What some faces of the proxy are made of. Of several tables for a face the last one counts."""

    name: LightName | None = Field(
        default=None, description="Of a material in the proxy's file. Default: whatever faces are made of there."
    )
    box: Bounds | None = Field(
        default=None,
        description="Lowest and highest corner, world units: faces whose middles lie in it. Default: anywhere.",
    )
    mask: MaskTable | None = Field(
        default=None, description="Painted over a camera's frame: what is seen there of the surface. Default: anywhere."
    )
    metallic: Share | None = Field(default=None, description="In place of the file's: 0 no metal, 1 a metal.")
    roughness: Share | None = Field(default=None, description="In place of the file's: 0 a mirror, 1 matt.")
    emission: ColorOrGray | None = Field(
        default=None,
        description="Radiance that the faces send out in every lighting, as captured: a number or linear [r, g, b].",
    )

    @model_validator(mode="after")
    def _check(self) -> MaterialTable:
        if self.metallic is None and self.roughness is None and self.emission is None:
            raise wrong("a material that says nothing", "add roughness, metallic or emission")
        return self

    def dress(self, mask: Mask | None) -> Dress:
        """The same as the model has it, with its mask."""
        box, light = self.box, self.emission
        return Dress(
            name=self.name,
            box=None if box is None else ((box[0][0], box[0][1], box[0][2]), (box[1][0], box[1][1], box[1][2])),
            mask=mask,
            metallic=self.metallic,
            roughness=self.roughness,
            emission=None if light is None else (light[0], light[1], light[2]),
        )

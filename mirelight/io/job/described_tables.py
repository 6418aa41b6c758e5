"""Tables of the job file for lights that their record describes (`model.surface_lights.DESCRIBED`), made from it."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import Field, create_model, model_validator

from mirelight.base import conventions
from mirelight.io.job.fields import Direction, NotNegative, Vec3
from mirelight.io.job.lamp_tables import ColouredTable, aimed
from mirelight.io.job.light_units import SurfaceUnit, nits
from mirelight.model import Light, LightKind
from mirelight.model.surface_lights import DESCRIBED, described_light

_TARGET = "[x, y, z], a point that direction leads to; instead of it."


class DescribedTable(ColouredTable):
    """A glowing surface with a pose. It lights, but is not seen and blocks nothing."""

    kind: ClassVar[LightKind]
    type: str
    position: Vec3 = Field(description="[x, y, z] of its middle in world units.")
    direction: Direction | None = Field(default=None)
    target: Vec3 | None = Field(default=None)
    intensity: NotNegative = Field(
        default=1.0, description="Luminance in candela per square metre, or what `unit` says."
    )
    unit: SurfaceUnit = Field(
        default="nit", description="Of the intensity. candela: in its brightest direction; lumen: all of its light."
    )

    @model_validator(mode="after")
    def _check(self) -> Self:
        aimed(self, self.position, self.target)
        _ = self.light("")
        return self

    def light(self, name: str) -> Light:
        """The light of the model."""
        way = (
            self.direction if self.target is None else [t - p for t, p in zip(self.target, self.position, strict=True)]
        )
        pose = conventions.look_at([0, 0, 0], way or [0, 0, -1])
        pose[:3, 3] = self.position
        values = {x.name: float(getattr(self, x.name)) for x in self.kind.fields}
        one = described_light(self.kind, name, pose, values, color=self.rgb)
        return replace(one, intensity=nits(self.intensity, self.unit, one), group=self.group)


def _table(kind: LightKind) -> type[DescribedTable]:
    """The table of one kind: what all have, and a key for each field of its record."""
    keys: dict[str, Any] = {"type": (Literal[kind.name], ...)}
    keys["direction"] = (Direction | None, Field(default=None, description=f"[x, y, z]. {kind.aim}"))
    keys["target"] = (Vec3 | None, Field(default=None, description=_TARGET))
    for one in kind.fields:
        least, above = (one.least, None) if one.least_itself else (None, one.least)
        number = Annotated[float, Field(ge=least, gt=above, le=one.most, allow_inf_nan=False)]
        keys[one.name] = (number, Field(default=one.default, description=one.meaning))
    made = create_model(f"{kind.name.capitalize()}Table", __base__=DescribedTable, __doc__=kind.meaning, **keys)
    made.kind = kind
    return made


DESCRIBED_TABLES: tuple[type[DescribedTable], ...] = tuple(_table(x.KIND) for x in DESCRIBED)

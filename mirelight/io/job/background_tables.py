"""What lies behind the splats, as a job file says it."""

from __future__ import annotations

from typing import Annotated, Any, TypeAlias

from pydantic import AfterValidator, BeforeValidator, Field, ValidationInfo, model_validator

from mirelight import model
from mirelight.io.job.fields import DisplayColor, Positive, Table, Vec3, existing, one_way, wrong

_GROUND, _BACKDROP = model.Ground(), model.Backdrop()
ENVIRONMENT, TRANSPARENT = "environment", "transparent"  # as the background's path


def _existing_or_word(value: str, info: ValidationInfo) -> str:
    return value if value in (ENVIRONMENT, TRANSPARENT) else existing(value, info)


class GroundTable(Table):
    """The ground of a panorama, which its lower half is laid on; what is above lies on a dome."""

    center: Vec3 = Field(
        default=list(_GROUND.center), description="Of the floor, [x, y, z], below where the panorama was taken."
    )
    height: Positive = Field(
        default=_GROUND.height, description="Of the panorama's camera above the floor, in world units."
    )
    radius: Positive = Field(default=_GROUND.radius, description="Of the dome, in world units.")

    @model_validator(mode="after")
    def _check(self) -> GroundTable:
        if self.radius <= self.height:
            raise wrong(f"a dome of radius {self.radius:g} below the camera's height", "make it larger", at="radius")
        return self


class BackgroundTable(Table):
    """What lies behind the splats. A list stands for a colour, a string for a path."""

    color: DisplayColor | None = Field(
        default=None, description="Display-encoded [r, g, b], 0 to 1; in EXR files there is no background then."
    )
    path: Annotated[str, Field(min_length=1, max_length=4096), AfterValidator(_existing_or_word)] | None = Field(
        default=None,
        description='"environment": environment, sky and suns of the frame\'s lighting. "transparent": the PNG has an '
        "alpha channel. Else a picture, .exr or .hdr (linear), .png or .jpg (sRGB-decoded), of which the frame shows "
        "the middle; instead of color.",
    )
    exposure: float = Field(
        default=_BACKDROP.exposure,
        ge=-64,
        le=64,
        allow_inf_nan=False,
        description="In stops, of the background alone, beside `display.exposure`.",
    )
    blur: float = Field(
        default=_BACKDROP.blur,
        ge=0,
        le=90,
        allow_inf_nan=False,
        description="Degrees (standard deviation) that an environment is blurred by; 0: sharp.",
    )
    ground: GroundTable | None = Field(
        default=None,
        description="Lays an environment's lower half on the ground, so that it moves with the camera. "
        "Default: all of it lies far away.",
    )

    @model_validator(mode="after")
    def _check(self) -> BackgroundTable:
        one_way(self, ("color",), ("path",), needed='add color = [0, 0, 0] or path = "environment"')
        picture = self.path not in (None, TRANSPARENT, ENVIRONMENT)
        for name in ("exposure", "blur", "ground"):
            fits = self.path == ENVIRONMENT or (picture and name == "exposure")
            if name in self.model_fields_set and not fits:
                raise wrong(f"a background's {name} without an environment", 'add path = "environment"', at=name)
        return self


def _as_table(value: Any) -> Any:
    if isinstance(value, list):
        return {"color": value}
    return {"path": value} if isinstance(value, str) else value


Background: TypeAlias = Annotated[
    BackgroundTable, BeforeValidator(_as_table, json_schema_input_type=DisplayColor | str | BackgroundTable)
]

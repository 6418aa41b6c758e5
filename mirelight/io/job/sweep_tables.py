"""Tables of the job file for sweeps: many lightings out of one."""

from __future__ import annotations

from datetime import datetime
from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from mirelight.io.job.fields import Kelvin, Positive, Seed, Table, Vec3, given, one_way, wrong

MOST = 100_000  # lightings of a job

_SPREAD = ("range", "kelvin", "dome", "sphere")  # what takes steps or draws


class BallTable(Table):
    """Places around a point: for a position there, for a direction towards the centre."""

    center: Vec3 = Field(default=[0.0, 0.0, 0.0], description="[x, y, z] in world units.")
    radius: Positive = Field(default=1.0, description="World units; no matter for directions.")


class AxisTable(Table):
    """One field of the lightings and the values that it takes."""

    field: str = Field(
        min_length=1,
        max_length=1000,
        description='A key of a lighting, as in overrides: "lights[0].position", or by name "lights.key.intensity", '
        '"environment.rotation", "environment.sky.time"; of an object: "objects.chair.path", '
        '"objects.chair.scatter.seed"; or of the relight settings: "relight.blend".',
    )
    name: str | None = Field(
        default=None, min_length=1, max_length=40, description="In the lightings' names. Default: the field's last key."
    )
    values: list[Any] | None = Field(
        default=None, min_length=1, max_length=MOST, description="The values, one after the other."
    )
    range: list[Any] | None = Field(
        default=None,
        min_length=2,
        max_length=2,
        description="First and last value: numbers, lists of numbers, or dates with time; instead of values.",
    )
    log: bool = Field(default=False, description="range: by equal factors instead of equal differences.")
    kelvin: Annotated[list[Kelvin], Field(min_length=2, max_length=2)] | None = Field(
        default=None,
        description="Colours of black bodies between two temperatures, of luminance 1; equal steps of 1 / temperature. "
        "Instead of values.",
    )
    dome: BallTable | None = Field(default=None, description="Places on the upper half of a sphere; instead of values.")
    sphere: BallTable | None = Field(default=None, description="Places on a sphere; instead of values.")
    files: str | None = Field(
        default=None,
        min_length=1,
        max_length=4096,
        description='A pattern of files, sorted by name: "hdris/*.exr"; instead of values.',
    )
    steps: int | None = Field(
        default=None, ge=1, le=MOST, description="range, kelvin, dome, sphere: so many, evenly spread."
    )
    draws: int | None = Field(
        default=None,
        ge=1,
        le=MOST,
        description="range, kelvin, dome, sphere: so many at random, by the seed; instead of steps. Alone, for a field "
        "named seed: so many seeds.",
    )

    @model_validator(mode="after")
    def _check(self) -> AxisTable:
        if self.are_seeds:
            return self
        ways = ("values", *_SPREAD, "files")
        one_way(self, *((way,) for way in ways), needed="add values, range, kelvin, dome, sphere or files")
        one_way(self, ("steps",), ("draws",))
        spread, counted = given(self, *_SPREAD), given(self, "steps", "draws")
        if spread and not counted:
            raise wrong("no count", "add steps (evenly spread) or draws (at random)")
        if counted and not spread:
            raise wrong("a count of given values", "leave it out", at=counted[0])
        if self.range is not None:
            _check_range(self.range, self.log)
        elif self.log:
            raise wrong("log without a range", "leave it out", at="log")
        return self

    @property
    def are_seeds(self) -> bool:
        """Whether the values are seeds, drawn themselves."""
        ways = given(self, "values", *_SPREAD, "files", "steps")
        return self.draws is not None and not ways and self.field.endswith("seed") and not self.log


def _check_range(ends: list[Any], log: bool) -> None:
    numbers = [_numbers(x) for x in ends]
    if all(isinstance(x, datetime) and x.tzinfo is not None for x in ends) and not log:
        return
    alike = isinstance(ends[0], list) == isinstance(ends[1], list) and len(numbers[0] or ()) == len(numbers[1] or ())
    if None in numbers or not alike:
        found = "two ends that are not of one kind"
        raise wrong(found, "give two numbers, two lists of as many, or two dates with time and offset", at="range")
    if log and any(x <= 0 for end in numbers for x in end or ()):
        raise wrong("a logarithmic range that is not above 0", "start above 0, or leave log out", at="range")


def _numbers(value: Any) -> list[float] | None:
    found = value if isinstance(value, list) and value else [value]
    plain = all(isinstance(x, int | float) and not isinstance(x, bool) and abs(x) < 1e12 for x in found)
    return found if plain else None


class SweepTable(Table):
    """Many lightings out of each lighting of the job."""

    axes: list[AxisTable] = Field(default=[], max_length=20, description="Fields and their values, one table each.")
    how: Literal["crossed", "paired"] = Field(
        default="crossed",
        description="crossed: every value of one axis with every value of the others; paired: first with first, …",
    )
    seed: Seed = Field(default=0, description="Of the axes with draws.")
    lightings: list[str] | None = Field(
        default=None, min_length=1, description="Which of the job's lightings, by name. Default: all."
    )
    one_at_a_time: bool = Field(
        default=False, description="After each lighting, its lights one by one: lamps, groups, environment."
    )

    @model_validator(mode="after")
    def _check(self) -> SweepTable:
        if not self.axes and not self.one_at_a_time:
            raise wrong("nothing to sweep", "add axes, or one_at_a_time = true")
        return self

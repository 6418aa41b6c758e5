"""The job's table `moved`: other places for lights that the job has, as the mixer's page exports them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Annotated, Any, TypeAlias

from pydantic import Field, WithJsonSchema

from mirelight.io.job.fields import LARGEST
from mirelight.io.job.mistakes import Mistake
from mirelight.io.job.mixing import MOST_NAMES, by_lighting, of_values
from mirelight.io.job.positions import Path
from mirelight.io.job.words import shown
from mirelight.model import Lighting

_POINT = {
    "type": "array",
    "items": {"type": "number", "minimum": -LARGEST, "maximum": LARGEST},
    "minItems": 3,
    "maxItems": 3,
}
_SCHEMA = {
    "type": "object",
    "additionalProperties": {"anyOf": [_POINT, {"type": "object", "additionalProperties": _POINT}]},
    "maxProperties": MOST_NAMES,
}

MovedTable: TypeAlias = Annotated[dict[str, Any], Field(max_length=MOST_NAMES), WithJsonSchema(_SCHEMA)]


def mistakes(moved: object) -> Iterator[Mistake]:
    """What is wrong with the values of the table."""
    return of_values("moved", moved, _point)


def _point(path: Path, value: object) -> Iterator[Mistake]:
    numbers: list[Any] = value if isinstance(value, list) else []
    sound = all(isinstance(x, int | float) and not isinstance(x, bool) and x == x for x in numbers)
    if not sound or len(numbers) != 3:
        yield Mistake(path, shown(value), "give [x, y, z] in world units")
    elif any(abs(x) > LARGEST for x in numbers):
        yield Mistake(path, shown(value), f"give -{LARGEST:g} to {LARGEST:g}")


def moved(lightings: tuple[Lighting, ...], table: dict[str, Any], wrong: list[Mistake]) -> tuple[Lighting, ...]:
    """The lightings with lights where the table puts them; names that nothing has are added to `wrong`."""
    if not table:
        return lightings
    places = {x.name: [light.name for light in x.lights if light.place is not None] for x in lightings}
    given = by_lighting("moved", table, places, "light with a position", wrong)
    out: list[Lighting] = []
    for one in lightings:
        there = dict(given[one.name])
        lights = tuple(x.moved_to(there[x.name]) if x.name in there else x for x in one.lights)
        out.append(replace(one, lights=lights) if there else one)
    return tuple(out)

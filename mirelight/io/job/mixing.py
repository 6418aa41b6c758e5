"""The job's table `mix`: factors of lights that the job has, as the mixer's page exports them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Annotated, Any, TypeAlias

import numpy as np
from pydantic import Field, WithJsonSchema

from mirelight.io.job.fields import LARGEST
from mirelight.io.job.mistakes import MOST, Mistake
from mirelight.io.job.positions import Path
from mirelight.io.job.words import meant, shown
from mirelight.model import LayerFactor, Lighting
from mirelight.model.unit_lights import terms

MOST_NAMES = 10_000
_LISTED = 10  # names in a message

_NUMBER = {"type": "number", "minimum": 0, "maximum": LARGEST}
_FACTOR = {"anyOf": [_NUMBER, {"type": "array", "items": _NUMBER, "minItems": 3, "maxItems": 3}]}
_SCHEMA = {
    "type": "object",
    "additionalProperties": {"anyOf": [*_FACTOR["anyOf"], {"type": "object", "additionalProperties": _FACTOR}]},
    "maxProperties": MOST_NAMES,
}

MixTable: TypeAlias = Annotated[dict[str, Any], Field(max_length=MOST_NAMES), WithJsonSchema(_SCHEMA)]


def mistakes(mix: object) -> Iterator[Mistake]:
    """What is wrong with the values of the table."""
    return of_values("mix", mix, _factor)


def _factor(path: Path, value: object) -> Iterator[Mistake]:
    numbers: list[Any] = value if isinstance(value, list) else [value]
    sound = all(isinstance(x, int | float) and not isinstance(x, bool) and x == x for x in numbers)
    if not sound or (isinstance(value, list) and len(value) != 3):
        yield Mistake(path, shown(value), "give a number or [r, g, b], 0 or more")
    elif any(not 0 <= x <= LARGEST for x in numbers):
        yield Mistake(path, shown(value), f"give 0 to {LARGEST:g}")


def mixed(lightings: tuple[Lighting, ...], mix: dict[str, Any], wrong: list[Mistake]) -> tuple[Lighting, ...]:
    """The lightings with the factors that the table gives them; names that nothing has are added to `wrong`."""
    if not mix:
        return lightings
    layers = {x.name: [term.layer for term in terms(x)] for x in lightings}
    given = by_lighting("mix", mix, layers, "light, group or environment", wrong)
    return tuple(
        replace(one, mix=tuple(LayerFactor(layer=k, factor=np.broadcast_to(v, 3)) for k, v in given[one.name]))
        for one in lightings
    )


# --- tables of values by name, for all lightings or by lighting ------------------------------------------------------


def of_values(table: str, values: object, check: Callable[[Path, object], Iterator[Mistake]]) -> Iterator[Mistake]:
    """What `check` finds in the values of a table, unless it is none or too large."""
    if not isinstance(values, dict) or len(values) > MOST_NAMES:
        return
    for name, value in values.items():
        if not isinstance(value, dict):
            yield from check((table, name), value)
        elif len(value) > MOST_NAMES:
            yield Mistake((table, name), f"{len(value)} names", f"give at most {MOST_NAMES}")
        else:
            for own, one in value.items():
                yield from check((table, name, own), one)


def by_lighting(
    table: str, values: dict[str, Any], known: dict[str, list[str]], what: str, wrong: list[Mistake]
) -> dict[str, list[tuple[str, Any]]]:
    """The entries of a table that each lighting has, those for all of them first.

    Args:
        table: its name.
        values: by a name for all lightings, or by lighting and name.
        known: the names of each lighting.
        what: they are.
        wrong: takes a mistake for each name that nothing has.
    """
    everywhere = {name: value for name, value in values.items() if not isinstance(value, dict)}
    apart = {name: value for name, value in values.items() if isinstance(value, dict)}
    unknown((table,), everywhere, list(dict.fromkeys(name for names in known.values() for name in names)), what, wrong)
    unknown((table,), apart, list(known), "lighting", wrong)
    for lighting, own in apart.items():
        if lighting in known:
            unknown((table, lighting), own, known[lighting], what, wrong)
    found: dict[str, list[tuple[str, Any]]] = {}
    for lighting, names in known.items():
        there, given = set(names), (*everywhere.items(), *apart.get(lighting, {}).items())
        found[lighting] = [(name, value) for name, value in given if name in there]
    return found


def unknown(at: Path, wanted: dict[str, Any], known: list[str], what: str, wrong: list[Mistake]) -> None:
    """Adds a mistake for every name that is not known."""
    there = set(known)
    for name in wanted:
        if len(wrong) >= MOST:
            return
        if name not in there:
            listed = f"there are {', '.join(known[:_LISTED])}" if known else "there is none"
            remedy = meant(name, known, listed)
            wrong.append(Mistake((*at, name), f"no {what} is named {shown(name)}", remedy, at_key=True))

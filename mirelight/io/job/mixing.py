"""The job's table `mix`: factors of lights that the job has, as the mixer's page exports them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Annotated, Any, TypeAlias

import numpy as np
from pydantic import Field, WithJsonSchema

from mirelight.io.job.fields import LARGEST
from mirelight.io.job.mistakes import MOST, Mistake
from mirelight.io.job.positions import Path
from mirelight.io.job.words import closest, shown
from mirelight.model import LayerFactor, Lighting
from mirelight.units import terms

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
    for name, value in entries(mix):
        if not isinstance(value, dict):
            yield from _factor(("mix", name), value)
        elif len(value) > MOST_NAMES:
            yield Mistake(("mix", name), f"{len(value)} names", f"give at most {MOST_NAMES}")
        else:
            for layer, factor in value.items():
                yield from _factor(("mix", name, layer), factor)


def entries(mix: object) -> list[tuple[str, Any]]:
    """What a table holds, unless it is none or too large."""
    return list(mix.items()) if isinstance(mix, dict) and len(mix) <= MOST_NAMES else []


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
    everywhere = {name: value for name, value in mix.items() if not isinstance(value, dict)}
    apart = {name: value for name, value in mix.items() if isinstance(value, dict)}
    known = list(dict.fromkeys(name for names in layers.values() for name in names))
    unknown(("mix",), everywhere, known, "light, group or environment", wrong)
    unknown(("mix",), apart, list(layers), "lighting", wrong)
    for name, factors in apart.items():
        if name in layers:
            unknown(("mix", name), factors, layers[name], "light, group or environment", wrong)
    out: list[Lighting] = []
    for one in lightings:
        there = [*everywhere.items(), *apart.get(one.name, {}).items()]
        own = set(layers[one.name])
        given = tuple(LayerFactor(layer=k, factor=np.broadcast_to(v, 3)) for k, v in there if k in own)
        out.append(replace(one, mix=given))
    return tuple(out)


def unknown(at: Path, wanted: dict[str, Any], known: list[str], what: str, wrong: list[Mistake]) -> None:
    """Adds a mistake for every name that is not known."""
    there = set(known)
    for name in wanted:
        if len(wrong) >= MOST:
            return
        if name not in there:
            near = closest(name, known)
            listed = f"there are {', '.join(known[:_LISTED])}" if known else "there is none"
            remedy = f'did you mean "{near}"?' if near else listed
            wrong.append(Mistake((*at, name), f"no {what} is named {shown(name)}", remedy, at_key=True))

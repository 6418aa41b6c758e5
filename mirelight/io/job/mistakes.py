"""What pydantic finds wrong, in words: which key, what was found, what to do about it."""

from __future__ import annotations

import re
from dataclasses import dataclass
from itertools import islice
from typing import Any

from pydantic import ValidationError
from pydantic_core import ErrorDetails

from mirelight.io.job.outline import Outline
from mirelight.io.job.positions import Path
from mirelight.io.job.words import closest, shown

_LONGEST = 20  # keys that a message lists
MOST = 100  # mistakes that are worked out; a hundred thousand would take minutes to word
_GONE = {  # values that settings had once, and what stands in their place
    "near": 'this way is no longer there; use "surface", or "traced", which has no bias',
    "scalar_rgb": 'this variant is no longer there; use "llvm_ad_rgb"',
    "orb": "this layout is no longer there; nerf holds the same pictures",
}


@dataclass(frozen=True, slots=True)
class Mistake:
    """One thing that is wrong with a job file."""

    path: Path
    found: str
    remedy: str
    at_key: bool = False  # the key itself is wrong, not its value


def locate(location: tuple[str | int, ...], data: Any) -> Path:
    """Where in the job's own data a pydantic location is; short forms and the kinds of a union have no place there."""
    path: Path = ()
    node = data
    for part in location:
        if _has(node, part):
            path, node = (*path, part), node[part]
        elif not isinstance(node, dict | list):
            break
        elif isinstance(part, str) and not part.startswith("type="):
            return (*path, part)  # a key that is missing
    return path


def mistakes(error: ValidationError, data: dict[str, Any], outline: Outline) -> list[Mistake]:
    """What pydantic reports, in the order of the tables' keys, each thing once; of thousands the first ones."""
    found = [_mistake(detail, data, outline) for detail in islice(error.errors(include_url=False), MOST)]
    return list(dict.fromkeys(found))


def _mistake(detail: ErrorDetails, data: dict[str, Any], outline: Outline) -> Mistake:
    path = locate(detail["loc"], data)
    context = detail.get("ctx", {})
    value = detail["input"]
    match detail["type"]:
        case "mirelight":
            at = context["at"]
            return Mistake((*path, at) if at else path, context["found"], context["remedy"])
        case "extra_forbidden":
            return Mistake(path, "unknown key", _other_key(path, data, outline), at_key=True)
        case "missing":
            about = outline.description(path, data)
            return Mistake(path, "missing", f"add it: {about}" if about else "add it")
        case "union_tag_invalid":
            kinds = [kind.strip("' ").removeprefix("type=") for kind in context["expected_tags"].split(",")]
            return Mistake((*path, "type"), shown(data_at(data, (*path, "type"))), _choice(value.get("type"), kinds))
        case "union_tag_not_found":
            return _without_kind(path, value, outline, data)
        case "literal_error":
            gone = _GONE.get(value) if isinstance(value, str) else None
            return Mistake(path, shown(value), gone or _choice(value, re.findall(r"'([^']*)'", context["expected"])))
        case "too_short" | "too_long":
            return Mistake(path, _count(value), _wanted_length(detail["type"], context, outline, path, data))
        case kind:
            return Mistake(path, shown(value), _plain(kind, context))


def _plain(kind: str, context: dict[str, Any]) -> str:
    bounds = {
        "greater_than": "give a number above {gt:.7g}",
        "greater_than_equal": "give a number of at least {ge:.7g}",
        "less_than": "give a number below {lt:.7g}",
        "less_than_equal": "give a number of at most {le:.7g}",
        "string_too_short": "give at least {min_length} character",
        "string_too_long": "give at most {max_length} characters",
    }
    if kind in bounds:
        return bounds[kind].format(**context)
    kinds = {
        "int_type": "give a whole number",
        "float_type": "give a number",
        "string_type": "give a string in quotes",
        "bool_type": "give true or false",
        "list_type": "give a list in [ ]",
        "model_type": "give a table",
        "dict_type": "give a table",
        "finite_number": "give a finite number, or leave the key out",
    }
    return kinds.get(kind, f"give another value ({kind.replace('_', ' ')})")


def _count(value: list[Any] | dict[str, Any]) -> str:
    if isinstance(value, dict):
        return f"{len(value)} names"
    return "an empty list" if not value else f"{len(value)} value{'s' if len(value) > 1 else ''}"


def _wanted_length(kind: str, context: dict[str, Any], outline: Outline, path: Path, data: dict[str, Any]) -> str:
    low, high = outline.lengths(path, data)
    if low is not None and low == high:
        return f"give {low} values"
    return f"give at least {context['min_length']}" if kind == "too_short" else f"give at most {context['max_length']}"


def _choice(value: Any, kinds: list[str]) -> str:
    near = closest(value, kinds) if isinstance(value, str) else None
    listed = ", ".join(f'"{kind}"' for kind in kinds)
    return f'did you mean "{near}"? There are {listed}' if near else f"give one of {listed}"


def _without_kind(path: Path, value: Any, outline: Outline, data: dict[str, Any]) -> Mistake:
    if not isinstance(value, dict):
        return Mistake(path, shown(value), "give a table")
    kinds = ", ".join(f'"{kind}"' for kind in outline.kinds(path, data))
    return Mistake((*path, "type"), "no type" if "type" not in value else shown(value["type"]), f"give one of {kinds}")


def _other_key(path: Path, data: dict[str, Any], outline: Outline) -> str:
    table, name = path[:-1], str(path[-1])
    keys = outline.keys(table, data)
    near = closest(name, keys)
    if near is not None:
        return f"did you mean {near}?"
    if table and name in outline.keys((), data):
        return f"{name} belongs at the top, above the first [table]"
    homes = [str(home) for home in outline.keys((), data) if name in outline.keys((home,), data)]
    if homes:
        return f"it belongs in [{homes[0]}]"
    return f"remove it; known here: {', '.join(keys)}" if 0 < len(keys) <= _LONGEST else "remove it"


def data_at(data: Any, path: Path) -> Any:
    """The value at a path; None where there is none."""
    for part in path:
        if not _has(data, part):
            return None
        data = data[part]
    return data


def _has(node: Any, part: str | int) -> bool:
    if isinstance(node, list):
        return isinstance(part, int) and part < len(node)
    return isinstance(node, dict) and part in node

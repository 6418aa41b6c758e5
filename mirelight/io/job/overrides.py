"""Settings from the command line, laid over the job file: ``render.spp=256``, ``lights[0].intensity=3``."""

from __future__ import annotations

import re
from copy import deepcopy
from dataclasses import dataclass
from typing import Any

from mirelight.base.errors import InputError
from mirelight.io.job.limits import DEEPEST, load_toml
from mirelight.io.job.positions import Path
from mirelight.io.job.words import label, shown

_SEGMENT = re.compile(r"""(?P<bare>[A-Za-z0-9_-]+)|"(?P<basic>[^"\\]*)"|'(?P<literal>[^']*)'""")
_INDEX = re.compile(r"\[(\d{1,6})\]")
_WORD = re.compile(r"[A-Za-z_./~][\w./~+ -]*")  # what may stand without quotes


@dataclass(frozen=True, slots=True)
class Override:
    """One setting that replaces, or adds to, what the job file says."""

    source: str  # what the user wrote, for messages
    path: Path
    value: Any  # a TOML value


def parse(text: str, option: str = "--set") -> Override:
    """An override from ``key=value``: a dotted TOML key with indices, and a TOML value or one bare word.

    Raises:
        InputError: it is not of that form.
    """
    source = f"{option} {text}"
    key, equals, value = text.partition("=")
    if not equals:
        raise InputError(source, "no '='", "write key=value, e.g. render.spp=256")
    return Override(source, _path(key.strip(), source), _value(value.strip(), source))


def _path(key: str, source: str) -> Path:
    path: Path = ()
    at = 0
    while at < len(key):
        index = _INDEX.match(key, at)
        dot = 1 if path and key[at] == "." else 0
        segment = _SEGMENT.match(key, at + dot) if dot or not path else None
        if index and path:
            path, at = (*path, int(index[1])), index.end()
        elif segment:
            path, at = (*path, str(segment[segment.lastgroup or 0])), segment.end()
        else:
            raise InputError(source, f"{shown(key)} is not a key", "write it as render.spp or lights[0].intensity")
    if not path:
        raise InputError(source, "no key before '='", "write key=value, e.g. render.spp=256")
    if len(path) > DEEPEST:
        raise InputError(source, f"a key of {len(path)} parts", "a job has no such key")
    return path


def _value(text: str, source: str) -> Any:
    try:
        found = load_toml(f"value = {text}\n")
    except ValueError:  # no TOML, nested too deeply, or a number of thousands of digits
        found = {}
    if set(found) == {"value"}:
        return found["value"]
    if _WORD.fullmatch(text):
        return text
    raise InputError(
        source, f"{shown(text)} is not a TOML value", "write numbers plain, strings in quotes, lists in [ ]"
    )


def apply(data: dict[str, Any], overrides: tuple[Override, ...]) -> dict[str, Any]:
    """A copy of the job's data with the overrides laid over it, in order.

    Raises:
        InputError: an override goes into something that is not a table or list, or past the end of a list.
    """
    out = deepcopy(data)
    for override in overrides:
        _set(out, override)
    return out


def _set(data: dict[str, Any], override: Override) -> None:
    node: Any = data
    last = len(override.path) - 1
    for depth, part in enumerate(override.path):
        where = label(override.path[:depth]) or "the job"
        if isinstance(part, int):
            if not isinstance(node, list):
                raise InputError(override.source, f"{where} is not a list", "leave the index out")
            if part >= len(node):
                entries = "1 entry" if len(node) == 1 else f"{len(node)} entries"
                raise InputError(override.source, f"{where} has {entries}", "count from 0")
        elif not isinstance(node, dict):
            remedy = "name an entry by its index, e.g. lights[0]" if isinstance(node, list) else "set it as a whole"
            raise InputError(override.source, f"{where} is not a table", remedy)
        if depth == last:
            node[part] = override.value
        else:
            node = node[part] if isinstance(part, int) else node.setdefault(part, {})

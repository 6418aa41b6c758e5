"""A job file as read: its text, its data with the overrides laid over it, and where everything stands."""

from __future__ import annotations

import re
import shlex
import tomllib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from mirelight.base.errors import InputError, ManyInputsError
from mirelight.io import safety
from mirelight.io.job import overrides as overriding
from mirelight.io.job import positions
from mirelight.io.job.fields import lightings_as_tables
from mirelight.io.job.limits import large_numbers, load_toml
from mirelight.io.job.mistakes import MOST, Mistake, locate
from mirelight.io.job.overrides import Override
from mirelight.io.job.words import label
from mirelight.io.suffixes import SPLATS

MOST_BYTES = 16 * 2**20  # a job of 100,000 lights is below this


@dataclass(frozen=True, kw_only=True)
class Source:
    """The job file and what was laid over it."""

    path: Path  # absolute
    shown: str  # the path as the user wrote it
    text: str
    data: dict[str, Any]  # of the text, with the overrides laid over it
    overrides: tuple[Override, ...] = ()

    @cached_property
    def places(self) -> positions.Positions:
        """Where everything stands in the text; worked out when the first mistake asks for it."""
        return positions.index(self.text)

    @property
    def folder(self) -> Path:
        """What the job's paths are relative to."""
        return self.path.parent

    def error(self, mistake: Mistake) -> InputError:
        """The mistake with its position, or with the override that brought it."""
        field = label(mistake.path)
        brought = self._override(mistake.path)
        if brought is not None:
            return InputError(brought.source, mistake.found, mistake.remedy, field=field)
        place = self.places.key(mistake.path) if mistake.at_key else self.places.value(mistake.path)
        where = f"{self.shown}:{place.line}:{place.column}" if place else self.shown
        return InputError(where, mistake.found, mistake.remedy, field=field)

    def refuse(self, mistakes: Iterable[Mistake]) -> None:
        """Raise all mistakes at once, in the order in which they stand in the file; nothing where there is none.

        Raises:
            InputError: there is one.
            ManyInputsError: there are several.
        """
        placed = [replace(mistake, path=locate(mistake.path, self.data)) for mistake in mistakes]
        found = sorted(placed, key=self._order)
        if len(found) == 1:
            raise self.error(found[0])
        if found:
            said = [self.error(mistake) for mistake in found[:MOST]]
            more = [InputError(self.shown, "more mistakes than these", "mend them first")] if len(found) > MOST else []
            raise ManyInputsError(said + more)

    def _order(self, mistake: Mistake) -> int:
        brought = self._override(mistake.path)
        if brought is not None:
            return MOST_BYTES + self.overrides.index(brought)  # after the file's own
        place = self.places.key(mistake.path)
        return place.start if place else -1

    def _override(self, path: positions.Path) -> Override | None:
        """The last override at or above `path`, or below it where the file has nothing there."""
        newest_first = self.overrides[::-1]
        above = [o for o in newest_first if path[: len(o.path)] == o.path]
        below = [o for o in newest_first if path and o.path[: len(path)] == path]
        in_file = path in self.places.values
        return next(iter(above if in_file else above + below), None)


def read(path: str | Path, overrides: Sequence[str | Override] = (), text: str | None = None) -> Source:
    """Read a job file and lay overrides (``render.spp=256``) over it; `text`: what would be in the file.

    Raises:
        InputError: the file cannot be read or is no TOML (with line and column); an override does not fit.
    """
    over = tuple(overriding.parse(o) if isinstance(o, str) else o for o in overrides)
    text = _text(Path(path)) if text is None else text
    data = overriding.apply(_data(path, text), over)
    if "lightings" in data:
        data = {**data, "lightings": lightings_as_tables(data["lightings"])}
    source = Source(
        path=Path(path).absolute(),
        shown=str(path),
        text=text,
        data=data,
        overrides=over,
    )
    source.refuse(
        Mistake(at, "a number of more than 64 bits", "give a smaller number") for at in large_numbers(source.data)
    )
    return source


def _text(path: Path) -> str:
    if path.is_dir():
        raise InputError(path, "a folder", "name a job file (.toml)")
    raw = safety.read_bytes(safety.existing(path), MOST_BYTES)
    try:
        return raw.decode("utf-8-sig").replace("\r\n", "\n")
    except UnicodeDecodeError as e:
        if path.suffix.lower() in SPLATS:
            remedy = f"name a job file; mirelight new {shlex.quote(str(path))} writes one"
            raise InputError(path, "a capture or a mesh, not a job", remedy) from None
        line = raw[: e.start].count(b"\n") + 1
        raise InputError(f"{path}:{line}", "bytes that are not UTF-8", "save the job file as UTF-8 text") from None


def _data(path: str | Path, text: str) -> dict[str, Any]:
    try:
        return load_toml(text)
    except tomllib.TOMLDecodeError as e:
        where, found = _syntax_error(str(e), text)
        raise InputError(f"{path}:{where}", f"not TOML: {found}", _syntax_remedy(found)) from None
    except ValueError as e:
        raise InputError(path, f"not TOML: {str(e)[:80]}", "a job needs no such value") from None


def _syntax_error(message: str, text: str) -> tuple[str, str]:
    at = re.search(r" \(at line (\d+), column (\d+)\)$", message)
    if at:
        return f"{at[1]}:{at[2]}", _lowered(message[: at.start()])
    lines = text.split("\n")
    return f"{len(lines)}:{len(lines[-1]) + 1}", _lowered(message.removesuffix(" (at end of document)"))


def _lowered(message: str) -> str:
    return message[:1].lower() + message[1:]


def _syntax_remedy(found: str) -> str:
    if "invalid value" in found:
        return "write strings in quotes, numbers plain, lists in [ ]"
    if "overwrite a value" in found or "twice" in found:
        return "keep one of the two"
    return "see https://toml.io for the grammar"

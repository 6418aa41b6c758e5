"""The job file: TOML read into checked tables, and from them into the model's types.

``positions`` knows where keys stand; ``source`` reads the text and lays overrides over it; the ``*_tables`` modules say
what a job may hold (pydantic); ``mistakes`` and ``checks`` say what is wrong with it; ``build`` reads what it names.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from mirelight.io.job.build import build
from mirelight.io.job.overrides import Override
from mirelight.io.job.source import Source, read
from mirelight.io.job.tables import JobTable, json_schema
from mirelight.io.job.validate import validated
from mirelight.model import Job

__all__ = ["JobTable", "Override", "Source", "json_schema", "load", "load_text", "parse"]


def load(path: str | Path, overrides: Sequence[str | Override] = ()) -> Job:
    """Read a job file and everything it names.

    Args:
        path: the job file (TOML; `json_schema` says what it may hold).
        overrides: settings laid over it, ``render.spp=256`` each: a dotted key with indices, and a TOML value.

    Raises:
        InputError: one thing is wrong; its text starts with ``file:line:column`` where it is in the job file.
        ManyInputsError: several things are wrong with the job file.
    """
    source, table = parse(path, overrides)
    return build(source, table)


def load_text(text: str, path: str | Path, overrides: Sequence[str | Override] = ()) -> Job:
    """As :func:`load`, of a job that is in no file; `path` is where it would be, which its paths are relative to."""
    found = read(path, overrides, text)
    return build(found, validated(found))


def parse(path: str | Path, overrides: Sequence[str | Override] = ()) -> tuple[Source, JobTable]:
    """The first half of :func:`load`: the checked tables; no file that the job names is opened."""
    source = read(path, overrides)
    return source, validated(source)

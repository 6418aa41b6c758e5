"""Checks a job's data against the tables, and reports everything that is wrong with it at once."""

from __future__ import annotations

from copy import deepcopy
from functools import cache
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from mirelight.io.job import positions
from mirelight.io.job.checks import across_tables
from mirelight.io.job.mistakes import Mistake, data_at, mistakes
from mirelight.io.job.outline import Outline
from mirelight.io.job.source import Source
from mirelight.io.job.tables import JobTable, json_schema


def validated(source: Source) -> JobTable:
    """The job's tables, checked.

    Raises:
        InputError: one thing is wrong.
        ManyInputsError: several things are wrong; in the order in which they stand in the file.
    """
    table, wrong = _checked(source.data, source.folder)
    unknown = [mistake.path for mistake in wrong if mistake.at_key]
    if unknown:  # checks between the keys of a table only run once its keys are known ones
        _, more = _checked(_without(source.data, unknown), source.folder)
        wrong += more
    source.refuse(dict.fromkeys([*wrong, *across_tables(source.data)]))
    assert table is not None  # no mistakes
    return table


def _checked(data: dict[str, Any], folder: Path) -> tuple[JobTable | None, list[Mistake]]:
    try:
        return JobTable.model_validate(data, context={"base": folder}), []
    except ValidationError as e:
        return None, mistakes(e, data, _outline())


def _without(data: dict[str, Any], paths: list[positions.Path]) -> dict[str, Any]:
    out = deepcopy(data)
    for path in paths:
        table = data_at(out, path[:-1])
        del table[path[-1]]
    return out


@cache
def _outline() -> Outline:
    return Outline(json_schema())

"""A sweep: the job's lightings with their fields changed, as more lightings of the job."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator
from copy import deepcopy
from dataclasses import replace
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from mirelight.base.errors import InputError
from mirelight.io.job import overrides
from mirelight.io.job.light_tables import LightingTable
from mirelight.io.job.lighting import FreeNames, LightFiles, lighting
from mirelight.io.job.mistakes import Mistake
from mirelight.io.job.settings_tables import RelightTable
from mirelight.io.job.sweep_tables import MOST, SweepTable
from mirelight.io.job.sweep_values import Value, plain, values
from mirelight.io.job.tables import JobTable
from mirelight.io.job.words import closest, shown
from mirelight.model import Light, Lighting, RelightSettings

_AT = ("sweep",)
_RELIGHT = "relight."  # fields of the relight settings begin so


def swept(
    table: JobTable,
    base: tuple[Lighting, ...],
    files: LightFiles,
    folder: Path,
    settings: Callable[[RelightTable], RelightSettings],
    wrong: list[Mistake],
) -> tuple[Lighting, ...]:
    """The job's lightings, those that are swept replaced by their variants; what is wrong is added to `wrong`.

    Names: the lighting's and a word for each axis, without dots; with lights one by one, the light's name after that.
    `settings` makes the job's relight settings of a table.
    """
    sweep = table.sweep
    assert sweep is not None
    names = [x.name for x in base]
    for i, name in enumerate(sweep.lightings or ()):
        if name not in names:
            near = closest(name, names)
            remedy = f'did you mean "{near}"?' if near else f"there are: {', '.join(names[:10])}"
            wrong.append(Mistake((*_AT, "lightings", i), f"no lighting is named {shown(name)}", remedy))
    axes = [values(axis, sweep.seed, folder) for axis in sweep.axes]
    wrong += _counts(sweep, axes, len(base), folder)
    wrong += _shared(table)
    if not base:
        wrong.append(Mistake(_AT, "a sweep without a lighting", "add lights or an environment", at_key=True))
    if wrong:
        return base
    chosen = set(names if sweep.lightings is None else sweep.lightings)
    free = FreeNames([x.name for x in base if x.name not in chosen])
    out: list[Lighting] = []
    for i, one in enumerate(base):
        if one.name not in chosen:
            out.append(one)
            continue
        for variant in _variants(table, i, one, axes, files, folder, settings, wrong):
            named = replace(variant, name=free.take(variant.name))
            out.append(named)
            if sweep.one_at_a_time:
                out += [replace(x, name=free.take(x.name)) for x in one_by_one(named)]
            if wrong or len(out) > MOST:
                break
    if len(out) > MOST:
        wrong.append(Mistake(_AT, f"more than {MOST:,} lightings", "give fewer steps", at_key=True))
    return base if wrong else tuple(out)


def one_by_one(whole: Lighting) -> Iterator[Lighting]:
    """Each lamp, group, and environment of a lighting as a lighting of its own; a sky model stays whole."""
    layers: dict[str, list[Light]] = {}
    for light in whole.lights:
        layers.setdefault(light.group or light.name, []).append(light)
    how = whole.relight
    for name, lights in layers.items():
        yield Lighting(name=f"{whole.name}-{plain(name)}", lights=tuple(lights), relight=how)
    if whole.environment is not None:
        name = f"{whole.name}-{plain(whole.environment.name)}"
        yield Lighting(name=name, environment=whole.environment, relight=how)
    if whole.sky is not None:
        yield Lighting(name=f"{whole.name}-sky", sky=whole.sky, relight=how)


def _counts(sweep: SweepTable, axes: list[list[Value]], lightings: int, folder: Path) -> Iterator[Mistake]:
    for i, (axis, found) in enumerate(zip(sweep.axes, axes, strict=True)):
        if not found:
            remedy = f"patterns start from the job file's folder, {folder}"
            yield Mistake((*_AT, "axes", i, "files"), f"no file fits {shown(axis.files)}", remedy)
    lengths = [len(found) for found in axes]
    if sweep.how == "paired" and len(set(lengths)) > 1:
        differ = f"paired axes of {', '.join(map(str, lengths))} values"
        yield Mistake((*_AT, "how"), differ, "give each axis as many values")
    elif sweep.how == "crossed" and math.prod(lengths) * lightings > MOST:
        many = f"{math.prod(lengths) * lightings:,} lightings"
        yield Mistake((*_AT, "axes"), many, f"a job has at most {MOST:,}; take fewer values, or draws that are paired")


def _shared(table: JobTable) -> Iterator[Mistake]:
    """Relight settings that lightings of one job cannot have each for itself."""
    sweep = table.sweep
    assert sweep is not None
    for i, axis in enumerate(sweep.axes):
        if axis.field == "relight.texture_scale":
            found = "texture_scale, which decides what is traced"
            yield Mistake((*_AT, "axes", i, "field"), found, "render a job for each value")
        if axis.field == "relight.mode" and table.proxy is not None and table.proxy.albedo == "splats":
            found = 'modes that share a proxy with albedo = "splats", which a tint does not take'
            yield Mistake((*_AT, "axes", i, "field"), found, "give the proxy another albedo")


def _variants(
    table: JobTable,
    index: int,
    one: Lighting,
    axes: list[list[Value]],
    files: LightFiles,
    folder: Path,
    settings: Callable[[RelightTable], RelightSettings],
    wrong: list[Mistake],
) -> Iterator[Lighting]:
    sweep = table.sweep
    assert sweep is not None
    if not axes:
        yield one
        return
    whole: LightingTable | JobTable = table.lightings[index] if table.lightings else table
    written = whole.model_dump(exclude_unset=True, include={"lights", "lights_from", "environment"})
    how = table.relight.model_dump(exclude_unset=True)
    of_light = any(not axis.field.startswith(_RELIGHT) for axis in sweep.axes)
    of_relight = any(axis.field.startswith(_RELIGHT) for axis in sweep.axes)
    together = itertools.product(*axes) if sweep.how == "crossed" else zip(*axes, strict=True)
    for combination in together:
        data = {**deepcopy(written), "relight": dict(how)}
        for i, (axis, value) in enumerate(zip(sweep.axes, combination, strict=True)):
            problem = _set(data, axis.field, value.value, one.name)
            if problem is not None:
                wrong.append(replace(problem, path=(*_AT, "axes", i, "field")))
                return
        words = [value.word for value in combination]
        if sweep.how == "paired":  # their draws bear the same numbers
            words = list(dict.fromkeys(words))
        name = "-".join([plain(one.name), *words])
        try:
            relight = RelightTable.model_validate(data.pop("relight"))
            made = replace(one, name=name)
            if of_light:  # from the tables again; without, lights may be those of the proxy's file
                checked = LightingTable.model_validate({"name": name[:100], **data}, context={"base": folder})
                made = lighting(name, checked, _AT, files, wrong)
        except ValidationError as e:
            wrong.append(_refused(e, name, len(axes)))
            return
        yield replace(made, relight=settings(relight)) if of_relight else made


def _set(data: dict[str, Any], field: str, value: Any, name: str) -> Mistake | None:
    """Put a value into a lighting's data; says what is wrong where there is no such place."""
    try:
        path = overrides.parse(f"{field}=0", "field").path
    except InputError as e:
        return Mistake((), e.found, e.remedy)
    node: Any = data
    for depth, part in enumerate(path):
        last = depth == len(path) - 1
        if isinstance(node, list) and isinstance(part, str):
            named = [i for i, x in enumerate(node) if isinstance(x, dict) and (x.get("name") or x.get("type")) == part]
            if not named:
                return Mistake((), f"no light {shown(part)} in lighting {shown(name)}", "name one that is there")
            part = named[0]
        there = 0 <= part < len(node) if isinstance(node, list) and isinstance(part, int) else isinstance(node, dict)
        if not there or (not last and isinstance(node, dict) and part not in node):
            found = f"{shown(field)} leads nowhere in lighting {shown(name)}"
            return Mistake((), found, "name a key of a light or environment that the job file gives there")
        if last:
            node[part] = value
        else:
            node = node[part]
    return None


def _refused(error: ValidationError, name: str, axes: int) -> Mistake:
    detail = error.errors(include_url=False)[0]
    context = detail.get("ctx", {})
    key = next((str(part) for part in reversed(detail["loc"]) if isinstance(part, str) and "=" not in part), "")
    said = context["found"] if detail["type"] == "mirelight" else detail["msg"].lower()
    remedy = context["remedy"] if detail["type"] == "mirelight" else "give the axis values that its field takes"
    path = (*_AT, "axes", 0) if axes == 1 else (*_AT, "axes")
    return Mistake(path, f"lighting {shown(name)}: {key}: {said}", remedy)

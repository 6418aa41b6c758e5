"""A sweep: the job's lightings with their fields changed, as more lightings of the job."""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Callable, Iterator
from copy import deepcopy
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from mirelight.base.errors import InputError
from mirelight.base.names import FreeNames
from mirelight.io.job import overrides
from mirelight.io.job.assets import Assets
from mirelight.io.job.light_tables import LightingTable
from mirelight.io.job.lighting import lighting
from mirelight.io.job.mistakes import Mistake
from mirelight.io.job.scene_tables import ObjectTable
from mirelight.io.job.settings_tables import RelightTable
from mirelight.io.job.sweep_tables import MOST, SweepTable
from mirelight.io.job.sweep_values import Value, plain, values
from mirelight.io.job.tables import JobTable
from mirelight.io.job.words import meant, shown
from mirelight.model import Inserted, Light, Lighting, RelightSettings

_AT = ("sweep",)


@dataclass(frozen=True, slots=True)
class Makers:
    """What makes the model's types of a job's tables."""

    files: Assets
    relight: Callable[[RelightTable], RelightSettings]
    objects: Callable[[list[ObjectTable]], tuple[Inserted, ...]]


def swept(
    table: JobTable, base: tuple[Lighting, ...], makers: Makers, folder: Path, wrong: list[Mistake]
) -> tuple[Lighting, ...]:
    """The job's lightings, those that are swept replaced by their variants; what is wrong is added to `wrong`.

    Names: the lighting's and a word for each axis, without dots; with lights one by one, the light's name after that.
    """
    sweep = table.sweep
    assert sweep is not None
    names = [x.name for x in base]
    for i, name in enumerate(sweep.lightings or ()):
        if name not in names:
            remedy = meant(name, names, f"there are: {', '.join(names[:10])}")
            wrong.append(Mistake((*_AT, "lightings", i), f"no lighting is named {shown(name)}", remedy))
    axes = [values(axis, sweep.seed, folder) for axis in sweep.axes]
    wrong += _counts(sweep, axes, len(base), folder)
    wrong += _shared(table)
    if not base:
        wrong.append(Mistake(_AT, "a sweep without a lighting", "add lights or an environment", at_key=True))
    if wrong:
        return base
    chosen = set(names if sweep.lightings is None else sweep.lightings)
    if not all(_is_of(x.field, "relight") or _is_of(x.field, "objects") for x in sweep.axes):
        still = {x.name for x in table.lightings if x.is_captured}
        if still and (sweep.lightings is not None or chosen == still) and chosen & still:
            remedy = "name lightings with lights, or take its axes of lights out"
            wrong.append(
                Mistake(_AT, "a sweep of the captured light, of which nothing is written", remedy, at_key=True)
            )
            return base
        chosen -= still
    free = FreeNames([x.name for x in base if x.name not in chosen])
    variants = _Variants(table, sweep, axes, makers, folder, wrong)
    out: list[Lighting] = []
    for i, one in enumerate(base):
        if one.name not in chosen:
            out.append(one)
            continue
        for variant in variants.of(i, one):
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
    alone = Lighting(relight=whole.relight, objects=whole.objects)
    for name, lights in layers.items():
        yield replace(alone, name=f"{whole.name}-{plain(name)}", lights=tuple(lights))
    if whole.environment is not None:
        name = f"{whole.name}-{plain(whole.environment.name)}"
        yield replace(alone, name=name, environment=whole.environment)
    if whole.sky is not None:
        yield replace(alone, name=f"{whole.name}-sky", sky=whole.sky)


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


@dataclass(frozen=True, slots=True)
class _Variants:
    """Makes the lightings of a sweep out of the job's."""

    table: JobTable
    sweep: SweepTable
    axes: list[list[Value]]
    makers: Makers
    folder: Path
    wrong: list[Mistake]
    arranged: dict[str, tuple[Inserted, ...]] = field(default_factory=dict)  # objects by what is said of them

    def of(self, index: int, one: Lighting) -> Iterator[Lighting]:
        """Those of the lighting of an index in the job."""
        if not self.axes:
            yield one
            return
        table = self.table
        whole: LightingTable | JobTable = table.lightings[index] if table.lightings else table
        written = whole.model_dump(exclude_unset=True, include={"lights", "lights_from", "environment"})
        how = table.relight.model_dump(exclude_unset=True)
        objects = [x.model_dump(exclude_unset=True) for x in table.objects]
        for combination in self._combinations():
            data = {**deepcopy(written), "relight": dict(how), **({"objects": deepcopy(objects)} if objects else {})}
            for i, (axis, value) in enumerate(zip(self.sweep.axes, combination, strict=True)):
                problem = _set(data, axis.field, value.value, one.name)
                if problem is not None:
                    self.wrong.append(replace(problem, path=(*_AT, "axes", i, "field")))
                    return
            words = [value.word for value in combination]
            if self.sweep.how == "paired":  # their draws bear the same numbers
                words = list(dict.fromkeys(words))
            name = "-".join([plain(one.name), *words])
            try:
                yield self._made(replace(one, name=name), data)
            except ValidationError as e:
                self.wrong.append(_refused(e, name, len(self.axes)))
                return

    def _combinations(self) -> Iterator[list[Value]]:
        """A value of each axis; where objects are elsewhere all else is gone through before they are moved again."""
        if self.sweep.how == "paired":
            yield from (list(x) for x in zip(*self.axes, strict=True))
            return
        order = sorted(range(len(self.axes)), key=lambda i: not _is_of(self.sweep.axes[i].field, "objects"))
        for found in itertools.product(*(self.axes[i] for i in order)):
            by_axis = dict(zip(order, found, strict=True))
            yield [by_axis[i] for i in range(len(order))]

    def _made(self, one: Lighting, data: dict[str, Any]) -> Lighting:
        """A lighting with what the axes name made of the tables again; raises ValidationError."""
        of = {kind: [_is_of(x.field, kind) for x in self.sweep.axes] for kind in ("relight", "objects")}
        relight = RelightTable.model_validate(data.pop("relight"))
        objects = data.pop("objects", [])
        if not all(map(any, zip(*of.values(), strict=True))):  # else lights may be those of the proxy's file
            said = {"name": one.name[:100], **data}
            checked = LightingTable.model_validate(said, context={"base": self.folder})
            one = replace(lighting(one.name, checked, _AT, self.makers.files, self.wrong), relight=one.relight)
        if any(of["objects"]):
            known = repr(objects)
            if known not in self.arranged:
                tables = [ObjectTable.model_validate(x, context={"base": self.folder}) for x in objects]
                self.arranged[known] = self.makers.objects(tables)
            one = replace(one, objects=self.arranged[known])
        return replace(one, relight=self.makers.relight(relight)) if any(of["relight"]) else one


def _is_of(field: str, kind: str) -> bool:
    """Whether a field of an axis is one of the relight settings, or of objects."""
    return re.match(rf"{kind}\b", field) is not None


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
            named = [i for i, x in enumerate(node) if isinstance(x, dict) and _called(x) == part]
            if not named:
                kind = "object" if path[0] == "objects" else "light"
                return Mistake((), f"no {kind} {shown(part)} in lighting {shown(name)}", "name one that is there")
            part = named[0]
        there = 0 <= part < len(node) if isinstance(node, list) and isinstance(part, int) else isinstance(node, dict)
        if not there or (not last and isinstance(node, dict) and part not in node):
            found = f"{shown(field)} leads nowhere in lighting {shown(name)}"
            return Mistake((), found, "name a key of a light, environment or object that the job file gives there")
        if last:
            node[part] = value
        else:
            node = node[part]
    return None


def _called(table: dict[str, Any]) -> str | None:
    """What a light, or an object, is known by."""
    named = table.get("name") or table.get("node") or table.get("type")
    return named or (Path(table["path"]).stem if "path" in table else None)


def _refused(error: ValidationError, name: str, axes: int) -> Mistake:
    detail = error.errors(include_url=False)[0]
    context = detail.get("ctx", {})
    key = next((str(part) for part in reversed(detail["loc"]) if isinstance(part, str) and "=" not in part), "")
    said = context["found"] if detail["type"] == "mirelight" else detail["msg"].lower()
    remedy = context["remedy"] if detail["type"] == "mirelight" else "give the axis values that its field takes"
    path = (*_AT, "axes", 0) if axes == 1 else (*_AT, "axes")
    return Mistake(path, f"lighting {shown(name)}: {key}: {said}", remedy)

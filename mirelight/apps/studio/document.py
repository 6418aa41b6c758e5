"""The job that the studio's page edits: read or begun, checked after each edit, and saved as a file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np

from mirelight.apps.first_job import Wish, job_for
from mirelight.base.errors import InputError, ManyInputsError
from mirelight.io import job as jobs
from mirelight.io.atomic import write_file
from mirelight.io.job.fields import LIT, is_captured, lightings_as_tables
from mirelight.io.job.limits import load_toml
from mirelight.io.job.placing import matrix
from mirelight.io.job.scene_tables import Transform
from mirelight.io.job.write import text_of
from mirelight.io.safety import existing, open_binary
from mirelight.io.splats.training import resolved
from mirelight.io.suffixes import SPLATS
from mirelight.model import Job, Light

SUFFIX = ".studio.toml"
EDITED = (
    "lightings",
    "objects",
    "cameras",
    "captured",
    "proxy",
    "display",
    "render",
    "resolution",
)  # what the page may change
MOST_BYTES = 1 << 20  # of what it sends
_HEAD = ("saved by mirelight studio", "`mirelight render` takes it; edit it by hand, or in the studio again")
_MARK = f"# {_HEAD[0]}\n".encode()
UPS = {
    f"{sign}{axis}": (factor * (axis == "X"), factor * (axis == "Y"), factor * (axis == "Z"))
    for axis in "XYZ"
    for sign, factor in (("+", 1.0), ("-", -1.0))
}


@dataclass(frozen=True, slots=True, eq=False)
class Document:
    """A job as data, and where it is saved."""

    path: Path
    data: Mapping[str, Any]  # as TOML gives it; paths are relative to the file's folder
    notes: tuple[str, ...]  # what was found in a capture, a line each
    begun: bool  # for a bare capture, whose light is only assumed
    up: str = ""  # as it was asked for, "+Y" or "0.1 1 0"; "": as it was found

    def text(self, edits: Mapping[str, Any]) -> str:
        """The job's TOML with other values for what may be edited."""
        data = {key: value for key, value in self.data.items() if key not in edits}
        return text_of(data | {key: value for key, value in edits.items() if value}, self.path.parent, self.path, _HEAD)

    def own_way(self, world: Sequence[float]) -> str:
        """A direction in the world as one in the capture's own axes, as :func:`way_of` takes it."""
        splats = self.data["splats"]
        placed = splats.get("transform", {}) if isinstance(splats, Mapping) else {}
        own = matrix(Transform(**placed))[:3, :3].T @ np.asarray(world, np.float64)
        return " ".join(f"{x:.5f}" for x in own / max(float(np.linalg.norm(own)), 1e-9))

    def job(self, text: str) -> Job:
        """What such a text says.

        Raises:
            InputError: something is wrong with it.
        """
        try:
            return jobs.load_text(text, self.path)
        except ManyInputsError as error:
            raise _plain(error.errors[0]) from None
        except InputError as error:
            raise _plain(error) from None

    def save(self, text: str) -> None:
        """Write a text that was checked.

        Raises:
            InputError: there is a file that the studio has not written.
            OutputError: it cannot be written.
        """
        _spare_others(self.path)
        write_file(self.path, text)


def way_of(up: str) -> tuple[float, float, float] | None:
    """A direction in a capture's own axes as it is asked for: one of UPS, or three numbers; None: it is looked for.

    Raises:
        InputError: it is none.
    """
    if not up or up in UPS:
        return UPS.get(up)
    try:
        x, y, z = (float(number) for number in up.split())
    except ValueError:
        x, y, z = 0.0, 0.0, 0.0
    if not 1e-6 < x * x + y * y + z * z < 1e6:
        raise InputError("the page", "a way up that is none")
    return x, y, z


def opened(name: str | Path, out: str | Path | None, up: str = "") -> Document:
    """A capture or a job to be edited.

    Args:
        name: a splat file or a job file.
        out: where to save; None: beside it, in a file of its own.
        up: of a capture, as :func:`way_of` has it.

    Raises:
        InputError: it cannot be used; `out` is a file that the studio has not written.
        BackendError: this machine cannot composite.
    """
    path = existing(name)
    is_job = path.suffix.lower() == ".toml"
    if out is None:
        own = is_job and _is_ours(path)
        target = path if own else path.with_name(f"{_stem(path, is_job)}{SUFFIX}")
    else:
        target = Path(out)
    _spare_others(target)
    return _of_job(path, target) if is_job else _of_capture(resolved(path), target, up)


def edits_of(asked: Mapping[str, Any]) -> dict[str, Any]:
    """What a page sends as the job's values: times are text there.

    Raises:
        InputError: it has what may not be edited.
    """
    if set(asked) - set(EDITED):
        raise InputError("the page", f"more than {', '.join(EDITED)}")
    return {key: _with_times(value) for key, value in asked.items()}


def _of_capture(path: Path, target: Path, up: str) -> Document:
    found = job_for(path, target.parent, Wish(up=way_of(up)))
    data = load_toml(found.text)
    return Document(target, _named(data, jobs.load_text(found.text, target)), (found.up, *found.notes), True, up)


def _of_job(path: Path, target: Path) -> Document:
    source, _ = jobs.parse(path)
    if "sweep" in source.data:
        raise InputError(path, "lightings made by a sweep", "take it out", field="sweep")
    data = {"proxy": "splats", **load_toml(text_of(source.data, source.folder, target, ()))}
    work = jobs.load_text(text_of(data, target.parent, target, ()), target)
    if work.splats is None:
        raise InputError(path, "no splats", 'name a capture: splats = "capture.ply"', field="splats")
    return Document(target, _named(data, work), (), False)


def _with_captured(data: dict[str, Any]) -> dict[str, Any]:
    """The data with the captured light, where it is among the lightings, as a lighting that has lights of its own; one
    that is estimated, or another lighting's, has none that could be edited, and stays a name."""
    lightings, captured = lightings_as_tables(data.get("lightings")), data.get("captured")
    if not isinstance(lightings, list):
        return data
    if not isinstance(captured, dict) or not any(key in captured for key in LIT) or captured.get("estimate"):
        return {**data, "lightings": lightings}
    return {**data, "lightings": [{**captured, **x} if is_captured(x) else x for x in lightings]}


def _named(data: dict[str, Any], job: Job) -> dict[str, Any]:
    """The data with its lights in `lightings`, each with the name and the place that it has in the job."""
    data = _with_captured(data)
    if not isinstance(data.get("lightings"), list):
        own = {key: data[key] for key in LIT if key in data}
        data = {key: value for key, value in data.items() if key not in LIT}
        if own:
            data["lightings"] = [{"name": job.lightings[0].name, **own}]
        elif not job.lightings:
            data["lightings"] = [{"name": "light", "environment": {"radiance": [1.0, 1.0, 1.0]}}]
    built = {x.name: x for x in job.lightings}
    lightings = []
    for table in data.get("lightings", []):
        lights = built[table["name"]].lights if table["name"] in built else ()
        tables = table.get("lights", [])
        named = [_placed(one, light) for one, light in zip(tables, lights, strict=False)]
        lightings.append({**table, **({"lights": named} if len(named) == len(tables) and tables else {})})
    if "moved" in data and any("lights_from" in x for x in lightings):
        raise InputError(job.source, "places of lights of a file", "take [moved] out", field="moved")
    data = {key: value for key, value in data.items() if key != "moved"}
    objects = [{**table, "name": one.name} for table, one in zip(data.get("objects", []), job.objects, strict=True)]
    told = {"lightings": lightings, "objects": objects}
    return {**data, **{key: value for key, value in told.items() if value}}


def _placed(table: dict[str, Any], light: Light) -> dict[str, Any]:
    place = light.place
    return {**table, "name": light.name} | ({} if place is None else {"position": [float(x) for x in place]})


def _with_times(value: Any, key: str = "") -> Any:
    if isinstance(value, dict):
        return {name: _with_times(x, name) for name, x in value.items()}
    if isinstance(value, list):
        return [_with_times(x) for x in value]
    if key == "time" and isinstance(value, str):
        try:
            return datetime.fromisoformat(value)
        except ValueError:
            return value
    return value


def _plain(error: InputError) -> InputError:
    """Without a place in a text that nobody has seen."""
    return InputError(error.field or "the job", error.found, error.remedy)


def _stem(path: Path, is_job: bool) -> str:
    name = path.name
    for suffix in (".toml",) if is_job else sorted(SPLATS, key=len, reverse=True):
        if name.lower().endswith(suffix):
            return name[: -len(suffix)] or "capture"
    return path.stem or "capture"


def _spare_others(path: Path) -> None:
    if path.exists() and not _is_ours(path):
        raise InputError(path, "a file that the studio has not written", "name another with -o")


def _is_ours(path: Path) -> bool:
    try:
        with open_binary(path) as file:
            return file.read(len(_MARK)) == _MARK
    except InputError:
        return False

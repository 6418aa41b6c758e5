"""A job file written: the data of another one with one lighting replaced."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Iterator, Mapping, Sequence
from datetime import date, datetime, time
from pathlib import Path
from typing import Any

import numpy as np

from mirelight.base.errors import InputError
from mirelight.io.job.source import Source
from mirelight.model import (
    AreaLight,
    DirectionalLight,
    Environment,
    Job,
    Light,
    Lighting,
    PointLight,
    PosedLight,
    SpotLight,
    SunLight,
)

# keys that name files
_FILES = {"splats", "proxy", "lights_from", "environment", "cameras_from", "capture", "path", "cameras", "pictures"}
_WORDS = {"proxy", "splats"}  # what stands for a file in their place
_BARE = re.compile(r"[A-Za-z0-9_-]+")


def with_lighting(source: Source, job: Job, lighting: Lighting, path: Path, comments: Sequence[str]) -> str:
    """The text of the job with other lights in one of its lightings.

    Args:
        source: the job as it was read, overrides included.
        job: what was built of it.
        lighting: one of the job's by name, with other colours, intensities, factors or another rotation.
        path: where the text will stand; paths in it are relative to that.
        comments: lines for its head.

    Raises:
        InputError: the lightings are made by a sweep, or the one is the captured light, too.
    """
    data = dict(source.data)
    if "sweep" in data:
        raise InputError(source.shown, "lightings made by a sweep", "take the sweep out of the job", field="sweep")
    captured = data.get("captured")
    named = captured.get("lighting") if isinstance(captured, dict) else captured
    if lighting.name == named or {"name": lighting.name} in data.get("lightings", ()):
        found = f"{lighting.name!r} is the captured light, which must stay"
        raise InputError(source.shown, found, "match another lighting", field="captured")
    if data.get("lightings"):
        tables = [_relit(t, lighting) if t["name"] == lighting.name else t for t in data["lightings"]]
        data["lightings"] = tables
    else:
        data = _relit(data, lighting)
    factors = {x.name: x.factors() for x in job.lightings if x.name != lighting.name} | {
        lighting.name: lighting.factors()
    }
    mix = {name: {layer: _floats(f) for layer, f in own.items()} for name, own in factors.items() if own}
    data = {key: value for key, value in data.items() if key != "mix"} | ({"mix": mix} if mix else {})
    return text_of(data, source.folder, path, comments)


def with_mix(
    source: Source,
    mix: Mapping[str, Any],
    moved: Mapping[str, Any],
    exposure: float,
    path: Path,
    comments: Sequence[str],
) -> str:
    """The text of the job with another `mix`, with lights moved, and with another exposure.

    Args:
        source: the job as it was read, overrides included.
        mix: in place of the job's.
        moved: the lights that are moved, by lighting or, in all of them, by name; others stay where the job has them.
        exposure: of the display, in stops.
        path, comments: as for :func:`with_lighting`.
    """
    places = dict(source.data.get("moved", {}))
    for name, own in moved.items():
        before = places.get(name)
        places[name] = {**before, **own} if isinstance(before, dict) and isinstance(own, dict) else own
    tables = {"mix": dict(mix), "moved": places, "display": {**source.data.get("display", {}), "exposure": exposure}}
    data = {key: value for key, value in source.data.items() if key not in tables}
    data |= {key: value for key, value in tables.items() if value}
    return text_of(data, source.folder, path, comments)


def text_of(data: dict[str, Any], folder: Path, path: Path, comments: Sequence[str]) -> str:
    """The text of a job with this data.

    Args:
        data: as TOML gives it; its paths are relative to `folder`.
        path: where the text will stand; paths in it are relative to that.
        comments: lines for its head.
    """
    moved = _moved(data, folder, path.absolute().parent)
    return "\n".join([*(f"# {' '.join(x.split())}" for x in comments), *_lines(moved), ""])


def _relit(table: dict[str, Any], lighting: Lighting) -> dict[str, Any]:
    """A lighting's table with its lights written out."""
    out = {key: value for key, value in table.items() if key not in ("lights", "lights_from", "environment")}
    out["lights"] = [light_table(x) for x in lighting.lights]
    around = table.get("environment")
    if around is not None:
        around = {"path": around} if isinstance(around, str) else dict(around)
        if lighting.environment is not None:
            around = _environment(around, lighting.environment)
        elif lighting.sky is not None:
            around["intensity"] = lighting.sky.intensity
        out["environment"] = around
    return out


def _environment(table: dict[str, Any], around: Environment) -> dict[str, Any]:
    if "radiance" in table:
        return {"radiance": [float(x) for x in around.pixels.reshape(3) * around.intensity]}
    out = {"path": table["path"], "intensity": around.intensity}
    return out if around.rotation == 0 else {**out, "rotation": around.rotation}  # in Blender's orientation


def light_table(light: Light) -> dict[str, Any]:
    """A light as the job file has it. Raises InputError: it is a measured one, whose file is not known."""
    if isinstance(light, PointLight | SpotLight) and light.profile is not None:
        found = f"the light {light.name!r} has an IES profile, which a written job cannot hold"
        raise InputError("lights", found, "leave its ies out")
    return light_keys(light)


def light_keys(light: Light) -> dict[str, Any]:
    """A light in the names and units of the job file, as plain values; without its profile."""
    common: dict[str, Any] = {"type": "", "name": light.name}
    if light.group is not None:
        common["group"] = light.group
    common |= {"color": _floats(light.color), "intensity": float(light.intensity)}
    match light:
        case DirectionalLight():
            return common | {"type": "directional", "direction": _floats(light.direction)}
        case SunLight():
            size = {"angular_diameter": float(light.angular_diameter)}
            return common | {"type": "sun", "direction": _floats(light.direction)} | size
        case PointLight():
            return common | {"type": "point", "position": _floats(light.position)} | _reach(light)
        case SpotLight():
            cone = {
                "inner_cone_angle": float(np.degrees(light.inner_cone_angle)),
                "outer_cone_angle": float(np.degrees(light.outer_cone_angle)),
                **({} if light.cone == "khr" else {"cone": light.cone}),
            }
            place = {"position": _floats(light.position), "direction": _floats(light.direction)}
            return common | {"type": "spot"} | place | cone | _reach(light)
        case AreaLight():
            pose = light.world_from_light
            ways = {"direction": _floats(-pose[:3, 2]), "up": _floats(pose[:3, 1])} if light.shape != "sphere" else {}
            shape = {"shape": light.shape, "position": _floats(pose[:3, 3]), "size": [float(x) for x in light.size]}
            return common | {"type": "area"} | shape | ways
        case PosedLight():
            place = {"position": _floats(light.place), "direction": _floats(light.way)}
            own = {x.name: float(getattr(light, x.name)) for x in light.KIND.fields}
            return common | {"type": light.KIND.name} | place | own


def _reach(light: PointLight | SpotLight) -> dict[str, float]:
    range_ = {"range": float(light.range)} if np.isfinite(light.range) else {}
    return {**range_, **({"radius": float(light.radius)} if light.radius else {})}


def _floats(values: Any) -> list[float]:
    return [float(x) for x in values]


def _moved(data: dict[str, Any], old: Path, new: Path) -> dict[str, Any]:
    """The data with relative paths that start from another folder."""
    if old.resolve() == new.resolve():
        return data

    def path(text: str) -> str:
        return text if Path(text).is_absolute() else Path(os.path.relpath(old / text, new)).as_posix()

    def value(key: str, found: Any) -> Any:
        if isinstance(found, dict):
            return {k: value(k, v) for k, v in found.items()}
        if isinstance(found, list):
            return [value(key, x) for x in found]
        if isinstance(found, str) and key in _FILES and found not in _WORDS:
            return path(found)
        return found

    out = {key: value(key, found) for key, found in data.items()}
    if "output" in out:
        output = out["output"]
        out["output"] = {**output, "directory": path(output.get("directory", "out"))}
    return out


# --- TOML ------------------------------------------------------------------------------------------------------------


def _lines(data: dict[str, Any]) -> Iterator[str]:
    """The top level first, then its tables and lists of tables."""
    tables = {key: value for key, value in data.items() if _is_table(value)}
    for key, value in data.items():
        if key not in tables:
            yield f"{_key(key)} = {_value(value)}"
    for key, value in tables.items():
        for one in value if isinstance(value, list) else [value]:
            yield ""
            yield f"[[{_key(key)}]]" if isinstance(value, list) else f"[{_key(key)}]"
            for name, entry in one.items():
                yield f"{_key(name)} = {_entry(entry)}"


def _is_table(value: Any) -> bool:
    return isinstance(value, dict) or (
        isinstance(value, list) and bool(value) and all(isinstance(x, dict) for x in value)
    )


def _entry(value: Any) -> str:
    """A list of tables with a line for each."""
    if isinstance(value, list) and _is_table(value):
        return "\n".join(["[", *(f"    {_value(x)}," for x in value), "]"])
    return _value(value)


def _value(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, datetime | date | time):
        return value.isoformat()
    if isinstance(value, list):
        return f"[{', '.join(map(_value, value))}]"
    if isinstance(value, dict):
        inside = ", ".join(f"{_key(k)} = {_value(v)}" for k, v in value.items())
        return f"{{ {inside} }}" if inside else "{}"
    return repr(value)


def _key(key: str) -> str:
    return key if _BARE.fullmatch(key) else json.dumps(key, ensure_ascii=False)

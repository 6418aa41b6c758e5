"""Checks across the tables of a job. They look at the data as read, so that they speak even where a table is wrong."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from mirelight.io.job import mixing, moving
from mirelight.io.job.fields import LIT, PROXY, SPLATS, has_light
from mirelight.io.job.light_tables import ESTIMATE
from mirelight.io.job.mistakes import Mistake
from mirelight.io.job.positions import Path
from mirelight.io.job.words import meant, shown
from mirelight.io.suffixes import SCENES
from mirelight.model.profiles import COMPARING


def across_tables(data: dict[str, Any]) -> list[Mistake]:
    """What is wrong between tables that may each be right: doubled names, names of nothing, two ways at once."""
    return [
        *_something_to_see(data),
        *_one_way_to_light(data),
        *_captured(data),
        *_doubles(data, "cameras"),
        *_doubles(data, "lightings"),
        *_doubled_lights(data),
        *_needs_proxy(data),
        *_comparing(data),
        *_dataset(data),
        *_albedo_from_splats(data),
        *mixing.mistakes(data.get("mix")),
        *moving.mistakes(data.get("moved")),
    ]


def _something_to_see(data: dict[str, Any]) -> Iterator[Mistake]:
    proxy = data.get("proxy")
    made = (proxy.get("path") if isinstance(proxy, dict) else proxy) == SPLATS
    if "splats" not in data and made:
        yield Mistake(("proxy",), "a proxy made from splats, but no splats", 'add splats = "capture.ply"')
    elif "splats" not in data and "proxy" not in data:
        yield Mistake((), "neither splats nor a proxy", 'name what to render: splats = "capture.ply"')
    elif "proxy" not in data:
        for key in (*LIT, "lightings", "captured"):
            if data.get(key):
                remedy = 'add the line proxy = "splats" to have one made from them, or name a mesh'
                yield Mistake((key,), "light, but no proxy for it to fall on", remedy, at_key=True)


def _one_way_to_light(data: dict[str, Any]) -> Iterator[Mistake]:
    if data.get("lightings"):
        for key in LIT:
            if key in data:
                remedy = "move it into one of the lightings, or leave lightings out"
                yield Mistake((key,), "given beside lightings", remedy, at_key=True)


def _captured(data: dict[str, Any]) -> Iterator[Mistake]:
    captured = data.get("captured")
    name = captured.get("lighting") if isinstance(captured, dict) else captured
    estimated = captured.get("estimate") is True if isinstance(captured, dict) else captured == ESTIMATE
    if estimated:
        if "splats" not in data:
            found = "an estimate of captured light, but no splats to tell it from"
            yield Mistake(("captured",), found, "name splats, or describe the light", at_key=True)
        return
    if not isinstance(name, str):
        return
    names = [x.get("name") for x in _tables(data, "lightings") if has_light(x)]
    if name not in names:
        known = [n for n in names if isinstance(n, str)]
        remedy = meant(name, known, "name one of the lightings, or give a table with lights")
        path: Path = ("captured", "lighting") if isinstance(captured, dict) else ("captured",)
        yield Mistake(path, f"no lighting is named {shown(name)}", remedy)


def _doubles(data: dict[str, Any], key: str, around: Path = ()) -> Iterator[Mistake]:
    first: dict[str, int] = {}
    for i, table in enumerate(_entries(data, key)):
        name = table.get("name") if isinstance(table, dict) else None
        if isinstance(name, str) and name in first:
            found = f"{shown(name)} is the name of {key}[{first[name]}] too"
            yield Mistake((*around, key, i, "name"), found, "give each its own name")
        elif isinstance(name, str):
            first[name] = i


def _lit_tables(data: dict[str, Any]) -> Iterator[tuple[Path, dict[str, Any]]]:
    yield (), data
    for i, table in enumerate(_entries(data, "lightings")):
        if isinstance(table, dict):
            yield ("lightings", i), table
    if isinstance(data.get("captured"), dict):
        yield ("captured",), data["captured"]


def _doubled_lights(data: dict[str, Any]) -> Iterator[Mistake]:
    for path, table in _lit_tables(data):
        yield from _doubles(table, "lights", path)


def _needs_proxy(data: dict[str, Any]) -> Iterator[Mistake]:
    if "proxy" not in data:
        return  # said already
    proxy = data["proxy"]
    path = proxy.get("path") if isinstance(proxy, dict) else proxy
    is_scene = isinstance(path, str) and path.lower().endswith(SCENES)
    if is_scene:
        return
    users = [((*where, "lights_from"), table.get("lights_from")) for where, table in _lit_tables(data)]
    for where, value in [*users, (("cameras_from",), data.get("cameras_from"))]:
        for item in value if isinstance(value, list) else [value]:
            if item == PROXY or (isinstance(item, dict) and item.get("path") == PROXY):
                yield Mistake(where, "the proxy is not a glTF file or a stage", "name a .glb, .gltf or .usd file")


def _comparing(data: dict[str, Any]) -> Iterator[Mistake]:
    relight = data.get("relight")
    named = relight.get("mode") if isinstance(relight, dict) else None
    if isinstance(named, str) and named in COMPARING and "captured" not in data:
        remedy = 'add captured, the lighting that the splats were captured under, or use "tint"'
        yield Mistake(("relight", "mode"), f"{named!r} needs the captured lighting", remedy)


def _dataset(data: dict[str, Any]) -> Iterator[Mistake]:
    """What data sets are mixed from must be kept."""
    dataset, output = data.get("dataset"), data.get("output")
    if not isinstance(dataset, dict) or not dataset.get("layouts"):
        return
    if isinstance(output, dict) and output.get("store") == "frames":
        yield Mistake(("output", "store"), "'frames', but data sets are mixed from layers", 'use "both" or "layers"')


def _albedo_from_splats(data: dict[str, Any]) -> Iterator[Mistake]:
    proxy = data.get("proxy")
    if not isinstance(proxy, dict) or proxy.get("albedo") != "splats":
        return
    where: Path = ("proxy", "albedo")
    if "splats" not in data:
        yield Mistake(where, "'splats', but the job has none", "name splats, or give a number")
    elif "captured" not in data:
        remedy = "add captured, the lighting that the splats were captured under, or give a number"
        yield Mistake(where, "'splats' needs the captured lighting", remedy)


def _entries(data: dict[str, Any], key: str) -> list[Any]:
    value = data.get(key)
    return value if isinstance(value, list) else []


def _tables(data: dict[str, Any], key: str) -> list[dict[str, Any]]:
    return [x for x in _entries(data, key) if isinstance(x, dict)]

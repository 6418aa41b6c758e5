"""Data sets on disk: the frames of kept layers in a layout that loaders read.

One exposure for all frames, recorded; the rig of lights in the data set's world; a page that says what there is.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal, TypeAlias, get_args

import numpy as np

from mirelight.conventions import Matrix
from mirelight.dataset.draws import By, split
from mirelight.dataset.index import UnitLight
from mirelight.dataset.layouts import Picture, straight_rgba, world_of, write_colmap, write_nerf
from mirelight.dataset.layouts.olat import Lamp, write_olat
from mirelight.dataset.layouts.world import scale_of
from mirelight.dataset.view import DataSet
from mirelight.errors import InputError
from mirelight.io.atomic import atomic_path, output_error
from mirelight.model import PointLight, SpotLight

Layout: TypeAlias = Literal["nerf", "colmap", "olat"]
LAYOUTS: tuple[Layout, ...] = get_args(Layout)


@dataclass(frozen=True, slots=True, kw_only=True)
class ExportSettings:
    """How a data set is written."""

    lightings: tuple[str, ...] | None = None  # names; None: all
    normalize: bool = False  # move and scale the world so that the surface fits a box of ±1
    by: By = "camera"  # what is held out
    held_out: float = 0.1  # share of the names
    seed: int = 0  # of the choice
    license: str = ""  # of the data set, as SPDX has it


def export(data: DataSet, out: Path, layout: Layout, settings: ExportSettings | None = None) -> int:
    """Write the frames of a data set; says how many.

    Args:
        data: from `mirelight.dataset.open`.
        out: a folder; made where it is missing.
        layout: nerf and colmap: a folder for each lighting; olat: all lightings of one lamp, its place in every frame.
        settings: see :class:`ExportSettings`.

    Raises:
        InputError: a camera or lighting that the layout cannot hold; an unknown lighting.
        OutputError: a file cannot be written.
    """
    settings = settings or ExportSettings()
    names = data.lightings if settings.lightings is None else settings.lightings
    for name in names:
        if name not in data.lightings:
            raise InputError(data.folder, f"no lighting {name!r}", f"there are: {', '.join(data.lightings[:10])}")
    world = _world(data) if settings.normalize else world_of()
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as e:
        raise output_error(out, e) from None
    folders = folder_names(names)
    if layout == "olat":
        lamps = [(name, lamp) for name in names if (lamp := _only_lamp(data, name, world)) is not None]
        if not lamps:
            raise InputError(data.folder, "no lighting of one point or spot light", "sweep with one_at_a_time = true")
        names = tuple(name for name, _ in lamps)
        write_olat(out, ((p, lamp) for name, lamp in lamps for p in _pictures(data, name, settings, folders)), world)
    else:
        write = write_nerf if layout == "nerf" else write_colmap
        for name in names:
            write(out / folders[name], _pictures(data, name, settings), world=world)
    count = len(names) * len(data.cameras)
    _write(out / "lights.json", json.dumps(_rig(data, names, world), indent=1, allow_nan=False) + "\n")
    _write(out / "README.md", _card(data, layout, names, [folders[x] for x in names], count, settings, world))
    return count


def folder_names(names: Sequence[str]) -> dict[str, str]:
    """By the name of a lighting a different one of letters, digits, "-" and "_"."""
    out: dict[str, str] = {}
    for name in names:
        stem = re.sub(r"[^A-Za-z0-9-]+", "_", name).strip("_") or "lighting"
        own, number = stem, 1
        while own.casefold() in {x.casefold() for x in out.values()}:
            number += 1
            own = f"{stem}-{number}"
        out[name] = own
    return out


def _pictures(
    data: DataSet, lighting: str, settings: ExportSettings, prefix: dict[str, str] | None = None
) -> Iterator[Picture]:
    """A lighting's pictures; with `prefix`, the lighting's name is in front of the camera's."""
    held = split(data, settings.by, settings.held_out, settings.seed)
    test = {*held.novel_view, *held.novel_light, *held.novel_both}
    place = data.lightings.index(lighting)
    for i, camera in enumerate(data.cameras):
        rgba = data.frame(i, place)
        geometry = data.geometry(i)
        full = geometry.depth.shape == rgba.shape[:2]
        named = camera if prefix is None else replace(camera, name=f"{prefix[lighting]}-{camera.name}")
        yield Picture(
            camera=named,
            rgba=straight_rgba(rgba, data.index.display),
            depth=geometry.depth if full else None,
            mask=np.asarray(rgba[..., 3] > 0.5),
            split="test" if i * len(data.lightings) + place in test else "train",
        )


# --- world and lights ------------------------------------------------------------------------------------------------


def _world(data: DataSet) -> Matrix:
    corners = []
    for i in range(len(data.cameras)):
        geometry = data.geometry(i)
        seen = geometry.position[geometry.coverage > 0]
        corners += [seen.min(axis=0), seen.max(axis=0)] if len(seen) else []
    if not corners:
        raise InputError(data.folder, "no camera sees the proxy", "leave normalize out")
    low, high = np.min(corners, axis=0), np.max(corners, axis=0)
    return world_of((low + high) / 2, 2 / max(float((high - low).max()), 1e-9))


def _only_lamp(data: DataSet, lighting: str, world: Matrix) -> Lamp | None:
    weighted = data.index.lightings[data.lightings.index(lighting)]
    if len(weighted.units) != 1:
        return None
    unit = data.lights[weighted.units[0]]
    if len(unit.lights) != 1 or not isinstance(unit.lights[0], PointLight | SpotLight):
        return None
    light = unit.lights[0]
    position = world[:3, :3] @ light.position + world[:3, 3]
    candela = np.asarray(weighted.weights[0]) * light.color * light.intensity * scale_of(world) ** 2
    return Lamp(position, candela)


def _rig(data: DataSet, names: Sequence[str], world: Matrix) -> dict[str, Any]:
    index = data.index
    chosen = [x for x in index.lightings if x.name in names]
    return {
        "world_from_job": world.tolist(),
        "units": "candela for points and spots (of the scaled world), lux for suns, cd/m2 for areas and environments",
        "exposure_stops": index.display.exposure,
        "lights": [_described(unit, world) for unit in index.units],
        "lightings": [
            {
                "name": x.name,
                "lights": [
                    {"light": index.units[i].name, "weight": [float(v) for v in w]}
                    for i, w in zip(x.units, x.weights, strict=True)
                ],
            }
            for x in chosen
        ],
    }


def _described(unit: UnitLight, world: Matrix) -> dict[str, Any]:
    scale, rotation = scale_of(world), world[:3, :3] / scale_of(world)
    parts = []
    for light in unit.lights:
        part: dict[str, Any] = {
            "type": type(light).__name__.removesuffix("Light").lower(),
            "color": light.color.tolist(),
        }
        candela = isinstance(light, PointLight | SpotLight)
        part["intensity"] = light.intensity * (scale**2 if candela else 1.0)
        position = getattr(light, "position", None)
        pose = getattr(light, "world_from_light", None)
        if pose is not None:
            part |= {"pose": (world @ pose).tolist(), "size": [x * scale for x in getattr(light, "size", ())]}
        if position is not None:
            part["position"] = (world[:3, :3] @ position + world[:3, 3]).tolist()
        if getattr(light, "direction", None) is not None:
            part["direction"] = (rotation @ light.direction).tolist()  # type: ignore[union-attr]
        parts.append(part)
    return {"name": unit.name, "kind": unit.kind, "parts": parts}


# --- the page --------------------------------------------------------------------------------------------------------

_LOADING = {
    "nerf": 'import json\n\nframes = json.load(open("{first}/transforms.json"))["frames"]\nprint(len(frames))',
    "colmap": 'import pycolmap\n\nmodel = pycolmap.Reconstruction("{first}/sparse/0")\nprint(model.num_images())',
    "olat": 'import json\n\nframes = json.load(open("transforms_train.json"))["frames"]\nprint(frames[0]["pl_pos"])',
}


def _card(
    data: DataSet,
    layout: Layout,
    names: Sequence[str],
    folders: Sequence[str],
    count: int,
    settings: ExportSettings,
    world: Matrix,
) -> str:
    license_line = f"license: {settings.license}\n" if settings.license else ""
    listed = ", ".join(folders[:8]) + (", …" if len(folders) > 8 else "")
    nerfstudio = (
        "\nFor nerfstudio, which would move the world otherwise: `ns-train nerfacto nerfstudio-data --data "
        f"{folders[0]} --orientation-method none --center-method none --auto-scale-poses False`.\n"
        if layout == "nerf"
        else ""
    )
    return f"""---
{license_line}tags: [relighting, {layout}]
---

# {Path(data.index.job).stem}

{count} frames: {len(data.cameras)} cameras under {len(names)} lightings ({listed}), layout `{layout}`.

- Pictures: PNG, 8-bit sRGB, straight alpha, exposure {data.index.display.exposure:g} stops for all.
- Held out: {settings.held_out:g} of the names ({settings.by}), by a hash with seed {settings.seed}.
- World: Z up, {scale_of(world):.6g} times the job's lengths. `lights.json` has the lights in it.
{nerfstudio}
```python
{_LOADING[layout].format(first=folders[0])}
```
"""


def _write(path: Path, text: str) -> None:
    with atomic_path(path) as temporary:
        temporary.write_text(text, encoding="utf-8", newline="\n")

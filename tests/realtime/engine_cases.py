"""The engine's recorded scenes in mirelight's terms."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mirelight import conventions
from mirelight.io.gltf.scene import read_scene
from mirelight.io.hdr import read_hdr
from mirelight.io.mesh import transform
from mirelight.model import F32, Camera, Environment, ProxyMesh
from mirelight.realtime.mapping import EngineLight, EngineLighting, physical_rotation


@dataclass(frozen=True, kw_only=True)
class Case:
    """One recorded scene."""

    proxy: ProxyMesh
    camera: Camera
    lighting: EngineLighting
    relight: F32  # (H, W, 4) what the engine wrote


def read_case(folder: Path, assets: Path) -> Case:
    """A recorded case; `assets` holds the files that its scene.json names."""
    scene = json.loads((folder / "scene.json").read_text())
    meta = json.loads((folder / "meta.json").read_text())
    mesh = read_scene(assets / Path(scene["proxy"]["file"]).name).mesh
    assert mesh is not None
    turn = conventions.rotation_from_euler(scene["proxy"].get("eulerAngles", (0, 0, 0)))
    environment = None
    if "env" in scene:
        environment = Environment(
            radiance=_radiance(assets / Path(scene["env"]["equirect"]).name),
            intensity=scene["env"].get("intensity", 1),
            rotation=physical_rotation(scene["env"].get("rotation", 0)),
        )
    lights = tuple(_light(wanted, is_) for wanted, is_ in zip(scene.get("lights", ()), meta["lights"], strict=True))
    with np.load(folder / "buffers.npz") as buffers:
        relight = buffers["relight"].astype(np.float32)
    return Case(
        proxy=transform(mesh, conventions.compose(rotation=turn)),
        camera=read_camera(meta),
        lighting=EngineLighting(lights=lights, environment=environment),
        relight=relight,
    )


def read_camera(meta: dict[str, Any]) -> Camera:
    """The camera of a meta.json."""
    camera = meta["camera"]
    world = conventions.rigid_part(camera["world"])
    size = (meta["width"], meta["height"])
    return Camera.perspective(world, *size, yfov=camera["fov"], near=camera["near"], far=camera["far"])


def _radiance(path: Path) -> F32:
    if path.name == "white.hdr":  # radiance 1 everywhere
        return np.ones((1, 1, 3), dtype=np.float32)
    return read_hdr(path)


def _light(wanted: dict[str, Any], recorded: dict[str, Any]) -> EngineLight:
    return EngineLight(
        name=wanted.get("name", recorded["type"]),
        kind=recorded["type"],
        color=np.asarray(wanted["color"]),
        intensity=wanted["intensity"],
        position=np.asarray(recorded["position"]),
        direction=np.asarray(recorded["direction"]),
        range=recorded["range"],
        falloff="linear" if recorded["falloffMode"] == 0 else "inverse-squared",
        inner_cone_angle=recorded.get("innerConeAngle", 40.0),
        outer_cone_angle=recorded.get("outerConeAngle", 45.0),
    )

"""The engine's recorded scenes in mirelight's terms."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from mirelight.base import colour, conventions
from mirelight.io.gltf.scene import read_scene
from mirelight.io.hdr import read_hdr
from mirelight.io.mesh import transform
from mirelight.lighting import trace
from mirelight.model import F32, Camera, Environment, Lighting, ProxyMesh, RenderSettings
from mirelight.model.playcanvas_lights import (
    EngineLight,
    EngineLighting,
    engine_rotation,
    physical_light,
    physical_warnings,
)


@dataclass(frozen=True, kw_only=True)
class Case:
    """One recorded scene."""

    proxy: ProxyMesh
    camera: Camera
    lighting: EngineLighting
    relight: F32  # (H, W, 4) what the engine wrote


def from_engine(lighting: EngineLighting, name: str = "lighting") -> tuple[Lighting, tuple[str, ...]]:
    """The physical lighting for an engine's, and a line for each thing that physical light does not do.

    :func:`to_engine` gives the engine's lighting back.
    """
    lights = tuple(physical_light(light) for light in lighting.lights)
    environment, warnings = lighting.environment, physical_warnings(lights)
    if lighting.ambient.any():
        if environment is None:
            radiance = (lighting.ambient**colour.ENGINE_GAMMA).astype(np.float32).reshape(1, 1, 3)
            environment = Environment(name="ambient", radiance=radiance)
        else:
            warnings += ("the scene's ambient colour is left out: the environment replaces it, as in the engine",)
    return Lighting(name=name, lights=lights, environment=environment), warnings


def texture(proxy: ProxyMesh, camera: Camera, lighting: EngineLighting, diffuse: ArrayLike = 0.5) -> F32:
    """(H, W, 4) what `mirelight.trace` makes of the engine's lights: lit colour and coverage.

    The lights go through physical units, as those of a job do.
    """
    job_lighting, _ = from_engine(lighting)
    albedo = np.broadcast_to(np.asarray(diffuse, dtype=np.float64) ** colour.ENGINE_GAMMA, (3,))
    buffer = trace(replace(proxy, albedo=albedo), job_lighting, camera, RenderSettings(profile="playcanvas"))
    return np.concatenate([buffer.beauty, buffer.coverage[..., None]], axis=-1)


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
            rotation=engine_rotation(scene["env"].get("rotation", 0)),
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
        return np.ones((16, 32, 3), dtype=np.float32)
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

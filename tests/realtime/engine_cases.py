"""The engine's recorded scenes in mirelight's terms."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from mirelight import conventions
from mirelight.engine_lights import EngineLight, EngineLighting, from_engine, physical_albedo, physical_rotation
from mirelight.io.gltf.scene import read_scene
from mirelight.io.hdr import read_hdr
from mirelight.io.mesh import transform
from mirelight.lighting import trace
from mirelight.model import F32, Camera, Environment, ProxyMesh, RenderSettings


@dataclass(frozen=True, kw_only=True)
class Case:
    """One recorded scene."""

    proxy: ProxyMesh
    camera: Camera
    lighting: EngineLighting
    relight: F32  # (H, W, 4) what the engine wrote


def texture(proxy: ProxyMesh, camera: Camera, lighting: EngineLighting, diffuse: ArrayLike = 0.5) -> F32:
    """(H, W, 4) what `mirelight.trace` makes of the engine's lights: lit colour and coverage.

    The lights go through physical units, as those of a job do.
    """
    job_lighting, _ = from_engine(lighting)
    albedo = np.broadcast_to(physical_albedo(diffuse), (3,))
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

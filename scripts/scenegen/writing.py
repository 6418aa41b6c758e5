"""Files of a shipped scene: splats, proxy, skies, lights and the job that names them."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from mirelight.base.backend import mitsuba
from mirelight.io import splats as splat_files
from mirelight.io.cameras.transforms import lens_entry, matrix_entry
from mirelight.io.gltf.write import write_glb
from mirelight.model import Camera, Environment, Lighting, ProxyMesh, SplatCloud, SunLight
from scenegen.recipe import Recipe
from scenegen.truth import F32

SPLATS, CAMERAS, PROXY, JOB = "splats.compressed.ply", "transforms.json", "proxy.glb", "job.toml"


def write_splats(cloud: SplatCloud, folder: Path) -> None:
    """The capture."""
    splat_files.write(cloud, folder / SPLATS)


def write_cameras(cameras: Sequence[Camera], folder: Path, photographs: str = "{:02}.png") -> None:
    """Those of the capture's photographs, in the splats' own axes, with the paths of these by their count, whether they
    are kept or not."""
    frames = []
    for i, camera in enumerate(cameras):
        pose = [[round(x, 9) + 0.0 for x in row] for row in matrix_entry(camera, np.eye(4))]
        lens = {k: round(x, 6) if isinstance(x, float) else x for k, x in lens_entry(camera).items()}
        frames.append(json.dumps({"file_path": photographs.format(i), **lens, "transform_matrix": pose}))
    (folder / CAMERAS).write_text('{"frames": [\n' + ",\n".join(frames) + "\n]}\n", encoding="utf-8")


def write_proxy(mesh: ProxyMesh, recipe: Recipe, folder: Path) -> None:
    """The proxy with the scene's cameras."""
    write_glb(folder / PROXY, mesh, cameras=recipe.cameras)


def write_lighting(lighting: Lighting, folder: Path) -> None:
    """The map of its environment, and a glTF file of its punctual lights (suns stand in the job)."""
    if lighting.environment is not None:
        _write_hdr(lighting.environment, folder / f"{lighting.name}.hdr")
    punctual = [light for light in lighting.lights if not isinstance(light, SunLight)]
    if punctual:
        write_glb(folder / f"{lighting.name}.glb", lights=punctual)


def _write_hdr(environment: Environment, path: Path) -> None:
    mitsuba().Bitmap(np.array(environment.pixels)).write(str(path))


def numbers(values: object) -> str:
    """A list of TOML."""
    return "[" + ", ".join(f"{float(v):.6g}" for v in np.asarray(values)) + "]"


def lighting_lines(lighting: Lighting, header: str, lights_header: str) -> list[str]:
    """TOML of a lighting, a blank line last; its sky and lamps are in files of its name, suns stand here."""
    lines = [header]
    if not header.startswith("[captured"):
        lines.append(f'name = "{lighting.name}"')
    if any(not isinstance(light, SunLight) for light in lighting.lights):
        lines.append(f'lights_from = "{lighting.name}.glb"')
    if lighting.environment is not None:
        lines.append(f'environment = {{ path = "{lighting.name}.hdr" }}')
    for light in lighting.lights:
        if isinstance(light, SunLight):
            lines += [
                "",
                lights_header,
                'type = "sun"',
                f'name = "{light.name}"',
                f"direction = {numbers(light.direction)}",
                f"color = {numbers(light.color)}",
                f"intensity = {light.intensity:g} # lux",
                f"angular_diameter = {light.angular_diameter:g} # degrees",
            ]
    return [*lines, ""]


def write_job(recipe: Recipe, folder: Path) -> None:
    """The job file: every camera under every new lighting, and the lighting of the capture."""
    lines = [
        f"# {recipe.title}",
        f"# Made by scripts/make_scenes.py {recipe.name}. Light is scaled so that exposure 0 shows it; the splats were",
        "# baked at that exposure.",
        f'splats = "{SPLATS}"',
        f'proxy = {{ path = "{PROXY}", albedo = "splats" }}',
        'cameras_from = "proxy"',
        "resolution = [640, 360]",
        "",
    ]
    lines += lighting_lines(recipe.captured, "[captured]", "[[captured.lights]]")
    for lighting in recipe.lightings:
        lines += lighting_lines(lighting, "[[lightings]]", "[[lightings.lights]]")
    lines += [
        "[render]",
        f"spp = {recipe.spp}",
        "",
        "[output]",
        f'directory = "../../out/{recipe.name}"',
        "half = true",
        "",
    ]
    (folder / JOB).write_text("\n".join(lines), encoding="utf-8")


def write_png(picture: F32, path: Path) -> None:
    """Linear premultiplied RGBA as it is displayed at exposure 0 on black."""
    from PIL import Image

    from mirelight.base.colour import srgb_encode

    shown = np.clip(np.asarray(srgb_encode(np.clip(picture[..., :3], 0, 1))), 0, 1)
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray((shown * 255 + 0.5).astype(np.uint8)).save(path, optimize=True)

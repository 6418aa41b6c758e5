"""docs/guides/blender.md, run as it stands at toy size, on a file as Blender exports it."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from mirelight import cli
from mirelight.io import image
from mirelight.io.gltf.scene import read_scene
from mirelight.io.gltf.write import write_glb
from mirelight.io.hdr import write_hdr
from mirelight.model import Camera, PointLight, SpotLight

from .test_dataset_view import make_scene

PAGE = (Path(__file__).resolve().parents[2] / "docs" / "guides" / "blender.md").read_text(encoding="utf-8")


def test_from_blenders_export_to_an_exr_with_its_layers(tmp_path: Path) -> None:
    make_scene(tmp_path)
    (tmp_path / "splats.ply").rename(tmp_path / "capture.ply")
    camera = Camera.look_at((0, 2, 3), (0, 0, 0), 16, 12, yfov=45, name="Camera")
    watt = 683 / (4 * np.pi)  # candela that the exporter writes of 1 W
    lamps = (
        PointLight(name="Lamp", position=np.array([0.5, 1, 0.5]), intensity=100 * watt),
        SpotLight(name="Spot", position=np.array([0, 2, 0]), direction=np.array([0, -1, 0]), intensity=50 * watt),
    )
    mesh = read_scene(tmp_path / "proxy.glb").mesh
    assert mesh is not None
    write_glb(tmp_path / "room.glb", mesh)
    write_glb(tmp_path / "lit.glb", mesh, lamps, [camera])
    write_hdr(tmp_path / "world.hdr", np.full((4, 8, 3), 0.2, np.float32))

    (text,) = re.findall(r"```toml\n(.*?)```", PAGE, flags=re.DOTALL)
    job = tmp_path / "shot.toml"
    job.write_text(text, encoding="utf-8")
    small = [x for s in ("resolution=[16, 12]", "render.spp=4") for x in ("--set", s)]
    out = tmp_path / "out"
    assert cli.main(["inspect", str(job)]) == 0
    assert cli.main(["render", str(job), "--preview", "-o", str(out), "-q", *small]) == 0
    (found,) = out.glob("*.exr")
    light = image.read(found).lighting
    assert light is not None
    layers = {x.name for x in light.layers}
    assert {"Lamp", "Spot", "environment"} <= layers

"""A clone of the repository with toy scenes: what pages tell people to type can be run in it as it stands."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np

from mirelight.io import splats
from mirelight.io.gltf.scene import read_scene
from mirelight.io.gltf.write import write_glb
from mirelight.model import Camera
from mirelight.proxy.capture import take

from .test_dataset_view import make_scene

ROOT = Path(__file__).resolve().parents[2]
SPLATS = 480  # light is estimated from 200 on the floor; 500 are asked, place by place, where they were seen from
TOY = ("render.spp=1", "render.denoise=false", "render.lens_samples=2")


def make_clone(folder: Path) -> None:
    """`folder`/scenes with the shipped scenes' own file names: splats and proxy are a small floor, light maps and glTF
    lights the shipped ones."""
    toy = folder / "toy"
    toy.mkdir(parents=True)
    make_scene(toy)
    cloud = splats.read(toy / "splats.ply")
    more = replace(cloud, means=cloud.means + np.array([0.05, 0, 0.05], np.float32))
    splats.write(take(splats.merge([cloud, more]), np.arange(SPLATS)), toy / "splats.ply")
    mesh = read_scene(toy / "proxy.glb").mesh
    eye = np.array([0.3, 1.5, 4])
    cameras = [Camera.look_at(eye, (0, 0, 0), 24, 16, yfov=45, name=name) for name in ("front", "fountain", "low")]
    for scene in ("courtyard", "stage"):
        home = folder / "scenes" / scene
        home.mkdir(parents=True)
        shutil.copy(toy / "splats.ply", home / "splats.compressed.ply")
        write_glb(home / "proxy.glb", mesh, (), cameras)
        for file in (ROOT / "scenes" / scene).iterdir():
            if not (home / file.name).exists():
                (home / file.name).symlink_to(file)

"""Two jobs in one folder, in either order, and in folders of their own: the same pixels, to the bit.

What one job keeps the other finds by its key; a key that misses something gives a picture that depends on what was
rendered before.
"""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from mirelight import cli
from mirelight.io.exr import read_exr
from mirelight.io.gltf.write import write_glb
from mirelight.model import Material, ProxyMesh

from .test_dataset_view import make_scene

JOB = """
splats = "splats.ply"
proxy = { path = "proxy.glb", albedo = "splats" }
resolution = [16, 12]
cameras = [{ name = "front", position = [0, 1.5, 4], target = [0, 0, 0] }]

[render]
spp = 2
max_depth = 3

[relight]
delta = 0.1

[output]
aovs = ["splat_depth", "sun_visibility", "cryptomatte_material"]
"""
LIT = """
[captured]
lights = [{ type = "sun", direction = [-0.2, -1, -0.3], intensity = 3.0 }]
environment = { radiance = [0.3, 0.4, 0.6] }

[[lightings]]
name = "day"
lights = [
  { name = "key", type = "point", position = [-1, 1, 0.2], intensity = 2.0, color = [1, 0.6, 0.3] },
  { name = "fill", type = "point", position = [1, 2, 0.3], intensity = 0.7, color = [0.3, 0.6, 1] },
]
environment = { sky = { elevation = 40, azimuth = 30 }, intensity = 0.0001 }
"""
RATIO = 'proxy={path="proxy.glb",albedo=0.5}', "relight.mode=ratio"
PAIRS: dict[str, tuple[str, tuple[str, ...], tuple[str, ...]]] = {  # job, settings of one and of the other
    "the engine's profile": ("lit", RATIO, (*RATIO, "profile=playcanvas")),
    "one layer of all lights": ("lit", (), ("output.layers=false",)),
    "no EXR": ("lit", (), ("output.exr=false",)),
    "splat by splat, another seed": ("lit", ("relight.per=splat",), ("relight.per=splat", "render.seed=3")),
    "from the surface, fewer bounces": (
        "lit",
        ("render.indirect=surface",),
        ("render.indirect=surface", "render.max_depth=2"),
    ),
    "unlit, another proxy": ("unlit", ('proxy="proxy.glb"',), ('proxy="other.glb"',)),
    "traced whole, mixed": ("lit", ("render.noise=0.5",), ("render.noise=0.5", "mix={key=[0.5,1,2]}")),
}


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("jobs")
    make_scene(folder)
    mesh = ProxyMesh(  # a floor and a wall, between which light goes
        vertices=np.array([[-1, 0, -1], [1, 0, -1], [1, 0, 1], [-1, 0, 1], [-1, 1, -1], [1, 1, -1]], np.float32),
        faces=np.array([[0, 2, 1], [0, 3, 2], [0, 1, 5], [0, 5, 4]], np.int32),
        materials=(Material(name="clay", base_color=np.array([0.7, 0.5, 0.4])),),
    )
    write_glb(folder / "proxy.glb", mesh)
    (folder / "lit.toml").write_text(JOB + LIT)
    (folder / "unlit.toml").write_text(JOB)
    write_glb(folder / "other.glb", replace(mesh, vertices=mesh.vertices * np.float32(0.5)))
    return folder


def pixels(out: Path) -> dict[str, np.ndarray]:
    """All that the frames of a folder hold."""
    found: dict[str, np.ndarray] = {}
    for path in sorted(out.glob("front*.*")):
        if path.suffix == ".png":
            with Image.open(path) as image:
                found[path.name] = np.asarray(image)
        else:
            found |= {f"{path.name} {name}": plane for name, plane in read_exr(path).channels.items()}
    return found


@pytest.mark.parametrize("what", PAIRS)
def test_what_was_rendered_before_changes_nothing(scene: Path, tmp_path: Path, what: str) -> None:
    name, *both = PAIRS[what]
    job = scene / f"{name}.toml"

    def render(out: str, settings: tuple[str, ...]) -> dict[str, np.ndarray]:
        changes = (word for setting in settings for word in ("--set", setting))
        assert cli.main(["render", str(job), "-q", "-o", str(tmp_path / out), *changes]) == 0
        return pixels(tmp_path / out)

    alone = [render(f"alone {i}", settings) for i, settings in enumerate(both)]
    assert any(not np.array_equal(plane, alone[1].get(name, 0)) for name, plane in alone[0].items())
    for first, second in ((0, 1), (1, 0)):
        shutil.copytree(tmp_path / f"alone {first}", tmp_path / f"{first} first")
        after = render(f"{first} first", both[second])
        for name, plane in alone[second].items():
            assert np.array_equal(after[name], plane, equal_nan=True), (name, second)

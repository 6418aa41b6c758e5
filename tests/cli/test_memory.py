"""The memory that is said beforehand, against the peak of a process that renders."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from mirelight.apps.inspect.facts import JobFacts
from mirelight.apps.inspect.inspect import inspect
from mirelight.io import splats
from mirelight.io.gltf.write import write_glb
from mirelight.model import Material, ProxyMesh, SplatCloud

SIZE = 640, 360
RENDER = """
import sys
from pathlib import Path
from mirelight.cli import main
Path("/proc/self/clear_refs").write_text("5")
assert main(["render", sys.argv[1], "-o", sys.argv[1] + ".out", "-q"]) == 0
print(next(x for x in Path("/proc/self/status").read_text().splitlines() if x.startswith("VmHWM")).split()[1])
"""
SETTINGS = {  # lightings, lights in each, what else
    "lights in layers": (1, 5, ""),
    "lightings": (3, 2, ""),
    "layers denoised": (2, 3, "denoise = true, "),
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("memory")
    rng, count = np.random.default_rng(0), 900
    floor = SplatCloud(
        means=np.stack([rng.uniform(-3, 3, count), np.full(count, -1.0), rng.uniform(-3, 3, count)], 1).astype("f4"),
        quats=np.tile(np.array([1, 0, 0, 0], np.float32), (count, 1)),
        scales=np.tile(np.array([0.2, 0.005, 0.2], np.float32), (count, 1)),
        opacities=np.full(count, 0.9, np.float32),
        sh=rng.normal(0, 0.3, (count, 1, 3)).astype(np.float32),
    )
    splats.write(floor, out / "floor.ply")
    corners = np.array([[-3, -1, -3], [3, -1, -3], [3, -1, 3], [-3, -1, 3]], dtype=np.float32)
    faces = np.array([[0, 2, 1], [0, 3, 2]], dtype=np.int32)
    mesh = ProxyMesh(vertices=corners, faces=faces, materials=(Material(name="floor"),))
    write_glb(out / "proxy.glb", mesh, [], [])
    return out


def _job(folder: Path, name: str, size: tuple[int, int]) -> str:
    lightings, lights, more = SETTINGS[name]
    text = 'splats = "floor.ply"\nproxy = { path = "proxy.glb", albedo = 0.5 }\ncaptured = "l0"\n'
    text += f"resolution = {list(size)}\nrender = {{ {more}spp = 1, max_depth = 2, threads = 2 }}\n"
    text += "[[cameras]]\nposition = [0, 1, 6]\ntarget = [0, 0, 0]\n"
    for i in range(lightings):
        own = (f'{{ type = "point", name = "p{k}", position = [{k}, 2, {i}], intensity = 30 }}' for k in range(lights))
        text += f'[[lightings]]\nname = "l{i}"\nlights = [{", ".join(own)}]\n'
    path = f"{name.replace(' ', '-')}-{size[0]}.toml"
    (folder / path).write_text(text)
    return path


def _peaks(folder: Path, job: str) -> tuple[int, int]:
    """Bytes: what is said, and what is taken."""
    ran = subprocess.run([sys.executable, "-c", RENDER, job], cwd=folder, capture_output=True, text=True, check=True)
    facts = inspect(folder / job)
    assert isinstance(facts, JobFacts)
    return facts.memory, int(ran.stdout) * 1024


@pytest.fixture(scope="module")
def program(folder: Path) -> tuple[int, int]:
    return _peaks(folder, _job(folder, "lightings", (16, 9)))


@pytest.mark.skipif(not Path("/proc/self/clear_refs").exists(), reason="peaks are read from Linux' /proc")
@pytest.mark.parametrize("name", SETTINGS)
def test_the_memory_that_is_said_is_taken(folder: Path, program: tuple[int, int], name: str) -> None:
    """Within a fifth, without what the program takes for pictures of hardly a pixel."""
    if "denoise" in SETTINGS[name][2]:
        pytest.importorskip("pyoidn")
    said, taken = (a - b for a, b in zip(_peaks(folder, _job(folder, name, SIZE)), program, strict=True))
    assert said == pytest.approx(taken, rel=0.2)


def test_a_dry_run_says_the_memory_too(folder: Path) -> None:
    job = _job(folder, "lightings", (16, 9))
    command = [sys.executable, "-m", "mirelight", "render", job, "--dry-run"]
    assert "MB of new files, 18" in subprocess.run(command, cwd=folder, capture_output=True, text=True).stdout

"""`mirelight inspect` of jobs, as a real process."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mirelight.io import splats
from mirelight.io.gltf.write import write_glb
from mirelight.model import ProxyMesh, SplatCloud

from .conftest import Run

LAMP = Path(__file__).resolve().parents[2] / "scenes" / "plinth" / "lamp.glb"


def ball(count: int) -> SplatCloud:
    """Discs on a ball of radius 1, turned to the outside."""
    k = np.arange(count) + 0.5
    z, turn = 1 - 2 * k / count, k * np.pi * (3 - np.sqrt(5))
    flat = np.sqrt(1 - z * z)
    x, y = flat * np.cos(turn), flat * np.sin(turn)
    quats = np.stack([1 + z, -y, x, 0 * z], axis=1)  # the shortest turn from +Z
    return SplatCloud(
        means=np.stack([x, y, z], axis=1).astype(np.float32),
        quats=(quats / np.linalg.norm(quats, axis=1, keepdims=True)).astype(np.float32),
        scales=(1.6 / np.sqrt(count) * np.tile([1, 1, 0.05], (count, 1))).astype(np.float32),
        opacities=np.full(count, 0.95, np.float32),
        sh=np.zeros((count, 1, 3), np.float32),
    )


def sphere() -> ProxyMesh:
    import trimesh

    made = trimesh.creation.icosphere(subdivisions=4)
    return ProxyMesh(vertices=made.vertices.astype(np.float32), faces=made.faces.astype(np.int32))


JOB = """
splats = "ball.ply"
proxy = "%s"
resolution = [96, 64]
[[cameras]]
name = "left 1"
position = [3, 1, 3]
target = [0, 0, 0]
[[cameras]]
name = "right"
position = [-3, 1, 3]
target = [0, 0, 0]
[[lights]]
type = "point"
name = "lamp"
position = [%s, 0, 0]
intensity = 10
"""


@pytest.fixture
def jobs(tmp_path: Path) -> Path:
    splats.write(ball(2000), tmp_path / "ball.ply")
    mesh = sphere()
    write_glb(tmp_path / "right.glb", mesh)
    write_glb(tmp_path / "off.glb", replace(mesh, vertices=mesh.vertices + np.array([0.8, 0, 0], np.float32)))
    (tmp_path / "right.toml").write_text(JOB % ("right.glb", 3))
    (tmp_path / "off.toml").write_text(JOB % ("off.glb", 0.8))
    (tmp_path / "made.toml").write_text(JOB % ("splats", 3))
    return tmp_path


def test_a_right_job_has_its_fit_said_and_nothing_wrong(run: Run, jobs: Path) -> None:
    done = run("inspect", "right.toml")
    assert done.returncode == 0, done.stderr
    assert "fit          through its 2 cameras" in done.stdout
    assert " ! " not in done.stdout and not done.stderr


def test_what_is_wrong_is_said_and_shown(run: Run, jobs: Path) -> None:
    from PIL import Image

    done = run("inspect", "off.toml", "--heat", "heat")
    assert done.returncode == 0, done.stderr
    wrong = [line for line in done.stdout.splitlines() if line.startswith("  ! ")]
    assert len(wrong) == 2
    assert "off the proxy" in wrong[0] and "moved: try transform.translation = [" in wrong[0]
    assert "light 'lamp'" in wrong[1] and "inside the proxy" in wrong[1]
    assert sorted(x.name for x in (jobs / "heat").iterdir()) == ["left_1.png", "right.png"]
    with Image.open(jobs / "heat" / "right.png") as picture:
        pixels = np.asarray(picture.convert("RGB"), int)
    red = (pixels[..., 0] > 150) & (pixels[..., 1] < 90) & (pixels[..., 2] < 90)
    blue = (pixels[..., 2] > 200) & (pixels[..., 0] < 90)
    assert red.mean() > 0.03 and blue.mean() > 0.02  # uncovered on one side, past the splats on the other


def test_json_holds_the_same(run: Run, jobs: Path) -> None:
    found = json.loads(run("inspect", "off.toml", "--json").stdout)
    assert [x["kind"] for x in found["findings"]] == ["uncovered", "light"]
    assert [x["name"] for x in found["fit"]["cameras"]] == ["left 1", "right"]
    assert found["fit"]["uncovered"] > 0.18


def test_a_proxy_that_is_to_be_made_is_not_made_by_looking(run: Run, jobs: Path) -> None:
    done = run("inspect", "made.toml")
    assert done.returncode == 0, done.stderr
    assert "made from the splats when something is rendered" in done.stdout
    assert "fit  " not in done.stdout
    assert not (jobs / "out").exists()


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("ball.ply", "--heat", "heat"), "give a job file"),
        (("made.toml", "--heat", "heat"), "made from the splats by the first render"),
        (("right.toml", "--heat", "right.glb"), "right.glb"),
    ],
)
def test_wrong_use_is_one_line(run: Run, jobs: Path, arguments: tuple[str, ...], said: str) -> None:
    done = run("inspect", *arguments)
    assert done.returncode == 2
    assert len(done.stderr.strip().splitlines()) == 1 and said in done.stderr


@pytest.mark.parametrize(("name", "data"), [("a.glb", bytes(range(256))), ("a.glb", b""), ("a.gltf", b"hello")])
def test_a_glb_of_other_content_is_no_gltf_file(run: Run, tmp_path: Path, name: str, data: bytes) -> None:
    (tmp_path / name).write_bytes(data)
    done = run("inspect", name)
    assert done.returncode == 2 and done.stderr.startswith(f"mirelight: {name}: no glTF file: ")
    assert done.stderr.count("\n") == 1


def test_a_glb_is_told_by_its_content(run: Run, tmp_path: Path) -> None:
    """JSON is glTF under either suffix, and splats stay splats."""
    (tmp_path / "text.glb").write_text('{"asset": {"version": "2.0"}}')
    splats.write(ball(60), tmp_path / "ball.spz")
    (tmp_path / "ball.spz").rename(tmp_path / "ball.glb")
    assert "kind         mesh" in run("inspect", "text.glb").stdout
    assert "kind         splats, SPZ" in run("inspect", "ball.glb").stdout


def test_a_file_of_lights_alone_is_not_called_a_mesh(run: Run) -> None:
    said = run("inspect", str(LAMP)).stdout
    assert "kind         lights and cameras without a mesh" in said
    assert "light        lamp: point, 3.2 cd" in said and "triangles" not in said and "memory" not in said


def test_objects_are_said_where_they_stand_and_lenses_are_said(run: Run, tmp_path: Path) -> None:
    """Of a cube that falls from 3 units over a floor at height 0.5."""
    import trimesh

    for name, extents, at in (("floor", (4, 0.2, 4), (0, 0.4, 0)), ("cube", (0.4, 0.4, 0.4), (0, 0, 0))):
        made = trimesh.creation.box(extents)
        made.apply_translation(at)
        mesh = ProxyMesh(vertices=made.vertices.astype(np.float32), faces=made.faces.astype(np.int32))
        write_glb(tmp_path / f"{name}.glb", mesh)
    (tmp_path / "job.toml").write_text(
        'proxy = "floor.glb"\ncaptured = { environment = { radiance = 1.0 } }\n'
        "[[lights]]\ntype = 'sun'\nelevation = 40\nazimuth = 0\n"
        "[[cameras]]\nposition = [0, 2, 5]\ntarget = [0, 0.5, 0]\naperture_radius = 0.1\n"
        "[[objects]]\npath = 'cube.glb'\ndrop = true\ntransform = { translation = [1, 3, 0] }\n"
    )
    said = run("inspect", "job.toml").stdout
    assert "object       cube: 12 triangles, (0.8, 0.5, -0.2) to (1.2, 0.9, 0.2)" in said
    assert "aperture 0.1, sharp at 5.22" in said
    (thing,) = json.loads(run("inspect", "job.toml", "--json").stdout)["objects"]
    assert thing["name"] == "cube" and not thing["to_drop"]

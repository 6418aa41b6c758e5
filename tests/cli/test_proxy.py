"""`mirelight proxy` as a real process."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np

from mirelight.io import splats
from mirelight.io.gltf.scene import read_cameras
from mirelight.io.gltf.write import write_glb
from mirelight.io.mesh import read_mesh
from mirelight.model import ProxyMesh, SplatCloud
from tests.proxy.clouds import ball as discs

from .conftest import Run


def ball(count: int) -> SplatCloud:
    """Discs on a ball of radius 1."""
    k = np.arange(count) + 0.5
    z, turn = 1 - 2 * k / count, k * np.pi * (3 - np.sqrt(5))
    flat = np.sqrt(1 - z * z)
    return SplatCloud(
        means=np.stack([flat * np.cos(turn), flat * np.sin(turn), z], axis=1).astype(np.float32),
        quats=np.tile(np.array([1, 0, 0, 0], np.float32), (count, 1)),
        scales=np.full((count, 3), 2.4 / np.sqrt(count), np.float32),
        opacities=np.full(count, 0.95, np.float32),
        sh=np.zeros((count, 1, 3), np.float32),
    )


def test_a_proxy_is_made_and_its_fit_is_said(run: Run, tmp_path: Path) -> None:
    splats.write(ball(1000), tmp_path / "ball.ply")
    done = run("proxy", "ball.ply", "-o", "ball.glb")
    assert done.returncode == 0, done.stderr
    mesh = read_mesh(tmp_path / "ball.glb")
    assert len(mesh.faces) > 100
    for word in (f"{len(mesh.faces):,}", "uncovered", "depth gap", "leaks", "ball.heat.png"):
        assert word in done.stdout
    assert (tmp_path / "ball.heat.png").stat().st_size > 1000


def test_a_mesh_that_misfits_is_fitted(run: Run, tmp_path: Path) -> None:
    splats.write(discs(600, thin=0.05), tmp_path / "ball.ply")  # of which a proxy is made soonest
    made = json.loads(run("proxy", "ball.ply", "-o", "own.glb", "-q", "--json").stdout)
    assert made["files"] == ["own.glb", "own.heat.png"] and 0 <= made["fit"]["uncovered"] < 0.2
    assert made["triangles"] == len(read_mesh(tmp_path / "own.glb").faces)
    own = read_mesh(tmp_path / "own.glb")
    write_glb(tmp_path / "off.glb", replace(own, vertices=own.vertices + np.float32(0.1)))
    done = run("proxy", "ball.ply", "--fit", "off.glb", "-o", "fitted.glb")
    assert done.returncode == 0, done.stderr
    assert "off.glb fitted to the splats" in done.stdout
    assert "before" in done.stdout
    write_glb(tmp_path / "far.glb", replace(own, vertices=own.vertices + np.float32(20)))
    far = run("proxy", "ball.ply", "--fit", "far.glb", "-o", "from_far.glb")
    assert "100.0% before" in far.stdout and "nan" not in far.stdout  # what covers nothing has no gap
    low, high = read_mesh(tmp_path / "fitted.glb").bounds
    np.testing.assert_allclose(low + high, 0, atol=0.05)


CAMERAS = "x,y,z,target_x,target_y,target_z,yfov,width,height\n0,{y},4,0,{y},{z},60,64,64\n"


def test_what_the_cameras_did_not_see_is_closed(run: Run, tmp_path: Path) -> None:
    """One camera sees half of a ball, and the rest of it is inside what it hides."""
    splats.write(ball(1000), tmp_path / "ball.ply")
    (tmp_path / "ball.csv").write_text(CAMERAS.format(y=0, z=0), encoding="utf-8")
    (tmp_path / "other.csv").write_text(CAMERAS.format(y=0, z=9), encoding="utf-8")
    done = run("proxy", "ball.ply", "--cameras", "other.csv", "-o", "made.glb")
    assert done.returncode == 2
    assert "ball.ply: its 1 cameras have 0% of it in their pictures" in done.stderr
    assert done.stderr.count("\n") == 1
    assert not (tmp_path / "made.glb").exists()
    (tmp_path / "ball.csv").write_text(CAMERAS.format(y=0, z=0) + "0,0,-4,0,0,0,60,64,64\n", encoding="utf-8")
    done = run("proxy", "ball.ply", "--cameras", "ball.csv", "-o", "made.glb")
    assert done.returncode == 0, done.stderr
    assert "triangles more close what its 2 cameras did not see" in done.stdout


def test_bad_input_is_one_line_and_writes_nothing(run: Run, tmp_path: Path) -> None:
    splats.write(ball(2), tmp_path / "two.ply")
    for arguments, said in (
        (("two.ply", "-o", "two.glb"), "two.ply: 2 splats, too few"),
        (("none.ply", "-o", "two.glb"), "none.ply: no such file"),
        (("two.ply", "-o", "two.obj"), "written as .glb"),
        (("two.ply", "-o", "nowhere/two.glb"), "the folder does not exist"),
    ):
        done = run("proxy", *arguments)
        assert done.returncode == 2
        assert said in done.stderr
        assert done.stderr.count("\n") == 1
    assert [path.name for path in tmp_path.iterdir()] == ["two.ply"]


def test_a_jobs_proxy_is_written_upright_with_its_cameras(run: Run, tmp_path: Path) -> None:
    """Of a capture that looks down Y the file stands as the job's world does, and goes back into it as it is."""
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 2, 0], [0, 0, 3]], np.float32)
    mesh = ProxyMesh(vertices=corners, faces=np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]], np.int32))
    write_glb(tmp_path / "down.glb", mesh)
    half = "transform = { rotation_euler = [180, 0, 0] }"
    (tmp_path / "job.toml").write_text(f"""
proxy = {{ path = "down.glb", {half} }}
lights = [{{ type = "point", position = [0, 3, 0] }}]
cameras = [{{ name = "front", position = [0, 1, 6], target = [0, 0, 0] }}]
""")
    done = run("proxy", "job.toml", "-o", "room.glb", "--json")
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout) == {"files": ["room.glb"], "triangles": len(mesh.faces), "cameras": 1}
    np.testing.assert_allclose(read_mesh(tmp_path / "room.glb").vertices, mesh.vertices * (1, -1, -1), atol=1e-6)
    (camera,) = read_cameras(tmp_path / "room.glb")
    np.testing.assert_allclose(camera.to_camera(64, 36).position, (0, 1, 6), atol=1e-6)
    assert "leave it out" in run("proxy", "job.toml", "-o", "room.glb", "--triangles", "500").stderr

"""Materials of what is painted over a frame: faces are cut along the paint, and what is hidden is left."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

import mirelight
from mirelight.base.errors import InputError
from mirelight.io.gltf.write import write_glb
from mirelight.model import Camera, Deferred, ProxyMesh, RenderSettings
from mirelight.model.dressing import Dress, Mask
from mirelight.pipeline.keys import Keys
from mirelight.pipeline.painted import dressed_by

FLOOR = np.array([[-50, 0, -50], [-50, 0, 50], [50, 0, 50], [50, 0, -50]], np.float32)
PLATE = np.array([[0, 1, -3], [0, 1, 3], [3, 1, 3], [3, 1, -3]], np.float32)
SIDES = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
MESH = ProxyMesh(vertices=np.concatenate([FLOOR, PLATE]), faces=np.concatenate([SIDES, SIDES + 4]))
CAMERA = Camera.look_at((0, 4, 0.001), (0, 0, 0), 160, 120, yfov=60)


def disc(radius: float) -> NDArray[np.float32]:
    y, x = np.mgrid[:120, :160] + 0.5
    return np.asarray((x - 80) ** 2 + (y - 60) ** 2 < radius**2, np.float32)


def areas(mesh: ProxyMesh, chosen: NDArray[np.bool_]) -> tuple[float, float]:
    """Of chosen faces, on the floor and on the plate."""
    corners = mesh.vertices[mesh.faces[chosen]].astype(np.float64)
    own = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) / 2
    high = corners[..., 1].mean(axis=1) > 0.5
    return float(own[~high].sum()), float(own[high].sum())


def test_a_painted_disc_is_cut_out_of_what_is_seen() -> None:
    mask = Mask(camera=CAMERA, painted=Deferred("disc", lambda: disc(40)))
    made = dressed_by(MESH, [Dress(mask=mask, roughness=0.2)], "test", RenderSettings())
    assert made.face_materials is not None
    chosen = np.array([x.roughness == 0.2 for x in made.materials])[made.face_materials]
    floor, plate = areas(made, chosen)
    metre = 40 / CAMERA.fy  # of the disc's radius, one unit before the camera
    half = np.pi * metre**2 / 2
    assert floor == pytest.approx(half * 4**2, rel=0.03) and plate == pytest.approx(half * 3**2, rel=0.03)
    assert len(made.faces) < 20_000
    whole = areas(made, np.ones(len(made.faces), bool))
    assert whole == pytest.approx((100**2, 18), rel=1e-5)  # nothing is lost in cutting


def test_a_face_that_reaches_behind_the_camera_is_cut_in_what_is_before_it() -> None:
    ahead = Camera.look_at((0, 1, 0), (0, 0.5, -3), 160, 120, yfov=60)
    mask = Mask(
        camera=ahead, painted=Deferred("low", lambda: np.pad(np.ones((20, 40), np.float32), ((100, 0), (60, 60))))
    )
    floor = ProxyMesh(vertices=FLOOR, faces=SIDES)
    made = dressed_by(floor, [Dress(mask=mask, roughness=0.2)], "test", RenderSettings())
    assert made.face_materials is not None
    chosen = np.array([x.roughness == 0.2 for x in made.materials])[made.face_materials]
    seen = made.vertices[made.faces[chosen]].mean(axis=1)
    assert len(seen) > 100 and seen[:, 2].max() < 0 and np.abs(seen[:, 0]).max() < 1


JOB = """
proxy = "proxy.glb"
materials = [{ mask = { path = "mask.png", camera = "front" }, emission = 2 }]
lights = [{ type = "point", position = [0, 3, 0], intensity = 1 }]
cameras = [{ name = "front", position = [0, 4, 0.01], target = [0, 0, 0] }]
resolution = [40, 30]
render = { spp = 4, max_depth = 1 }
"""


def test_what_is_painted_glows(tmp_path: Path) -> None:
    write_glb(tmp_path / "proxy.glb", ProxyMesh(vertices=FLOOR, faces=SIDES))
    Image.fromarray((disc(40) * 255).astype(np.uint8)).save(tmp_path / "mask.png")
    (tmp_path / "job.toml").write_text(JOB)
    job = mirelight.load(tmp_path / "job.toml")
    scene = mirelight.prepare(job)
    lit = mirelight.light(scene, job.cameras[0], job.lightings[0])
    glow = next(x for x in lit.new.layers if x.name == "emission").direct[..., 0]
    inside, outside = disc(35)[2::4, 2::4] > 0, disc(45)[2::4, 2::4] == 0
    np.testing.assert_allclose(glow[inside], 2, rtol=1e-5)
    assert not glow[outside].any() and inside.sum() > 200 and outside.sum() > 500
    Image.fromarray((disc(39) * 255).astype(np.uint8)).save(tmp_path / "mask.png")
    other = mirelight.load(tmp_path / "job.toml")
    assert Keys(job).proxy != Keys(other).proxy and "mask.png" in job.inputs


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (('camera = "front"', 'camera = "fron"'), "no camera is named"),
        (("mask.png", "wide.png"), "a mask of 80 x 30 pixels for a camera of 40 x 30"),
        (("mask.png", "none.png"), "no faces seen in the paint of its mask"),
    ],
)
def test_a_wrong_mask_is_a_line(tmp_path: Path, change: tuple[str, str], says: str) -> None:
    write_glb(tmp_path / "proxy.glb", ProxyMesh(vertices=FLOOR, faces=SIDES))
    for name, picture in (("mask", disc(40)), ("wide", np.ones((30, 80))), ("none", np.zeros((30, 40)))):
        Image.fromarray((picture * 255).astype(np.uint8)).save(tmp_path / f"{name}.png")
    (tmp_path / "job.toml").write_text(JOB.replace(*change))
    with pytest.raises(InputError, match=says):
        _ = mirelight.prepare(mirelight.load(tmp_path / "job.toml")).mesh

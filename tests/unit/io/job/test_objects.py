"""`[[objects]]` and `lightings = "captured"`: what is read, what is refused, and what is made again."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import mirelight
from mirelight.base.errors import InputError
from mirelight.io import job as jobs
from mirelight.io.gltf.write import write_glb
from mirelight.model import Job, Material, ProxyMesh
from mirelight.pipeline import requirements
from mirelight.pipeline.keys import Keys
from mirelight.pipeline.plan import plan, warnings

from .conftest import WriteJob

HEAD = """splats = "splats.ply"
proxy = "proxy.glb"
cameras_from = "proxy"
lightings = "captured"
captured = { environment = { radiance = 1 } }
"""
OBJECT = """
[[objects]]
path = "thing.glb"
drop = true
metallic = 0.5
transform = { translation = [0, 2, 0], scale = 0.5 }
"""


@pytest.fixture
def thing(tmp_path: Path) -> Path:
    mesh = ProxyMesh(
        vertices=np.array([[-1, 0, 0], [1, 0, 0], [0, 2, 0]], np.float32),
        faces=np.array([[0, 1, 2]], np.int32),
        materials=(Material(base_color=np.array([0.2, 0.4, 0.6])),),
    )
    write_glb(tmp_path / "thing.glb", mesh, (), ())
    return tmp_path / "thing.glb"


def loaded(write_job: WriteJob, text: str) -> Job:
    return jobs.load(write_job(text))


def test_an_object_is_read_with_its_place_and_finish(write_job: WriteJob, thing: Path) -> None:
    job = loaded(write_job, HEAD + OBJECT)
    (one,) = job.objects
    assert (one.name, one.drop) == ("thing", True)
    np.testing.assert_allclose(one.mesh.value.vertices, np.array([[-0.5, 2, 0], [0.5, 2, 0], [0, 3, 0]]))
    (material,) = one.mesh.value.materials
    assert material.metallic == 0.5
    np.testing.assert_allclose(material.base_color, [0.2, 0.4, 0.6], rtol=1e-6)
    assert job.output.store == "both" and one.category == "thing"
    assert "thing.glb" in job.inputs


def test_captured_lightings_are_the_captured_light(write_job: WriteJob) -> None:
    job = loaded(write_job, HEAD)
    (one,) = job.lightings
    assert job.captured is not None and one.name == "captured"
    assert one.environment is job.captured.environment
    with pytest.raises(InputError, match="no captured light to render in"):
        loaded(write_job, HEAD.replace("captured = {", "# {"))


def test_objects_make_new_light_again_and_leave_captured_light(write_job: WriteJob, thing: Path) -> None:
    bare, with_one = Keys(loaded(write_job, HEAD)), Keys(loaded(write_job, HEAD + OBJECT))
    moved = Keys(loaded(write_job, HEAD + OBJECT.replace("[0, 2, 0]", "[0.1, 2, 0]")))
    lifted = Keys(loaded(write_job, HEAD + OBJECT.replace("drop = true\n", "")))
    camera = with_one.job.cameras[0]
    (lighting,) = with_one.job.lightings
    (part,) = with_one.mixture(lighting).sets
    frames = {x.frame(camera, lighting) for x in (bare, with_one, moved, lifted)}
    assert len(frames) == 4
    assert len({x.light_with_objects(part, camera) for x in (bare, with_one, moved, lifted)}) == 4
    assert len({x.light(part, camera) for x in (with_one, moved, lifted)}) == 1
    assert len({f(camera) for x in (with_one, moved, lifted) for f in (x.in_front, x.object_matte)}) == 6
    assert len({x.object_boxes for x in (with_one, moved, lifted)}) == 3
    needs = with_one.needs(camera, [lighting])
    assert with_one.light_with_objects(part, camera) in needs.keys and with_one.light(part, camera) in needs.keys
    assert (
        {with_one.in_front(camera), with_one.object_matte(camera)}
        < set(needs.keys)
        <= set(with_one.lights()) | {with_one.composite(camera)}
    )
    assert len({x.captured_level for x in (bare, with_one, moved, lifted)}) == 1


def test_a_scattered_object_is_known_by_its_seed(write_job: WriteJob, thing: Path) -> None:
    one, same, other = (
        loaded(write_job, f"{HEAD}{OBJECT}scatter = {{ center = [0, 0, 0], radius = 2, seed = {seed} }}\n")
        for seed in (1, 1, 2)
    )
    assert one.objects[0].scatter is not None and one.objects[0].scatter.radius == 2 and one.objects[0].scatter.turn
    assert Keys(one).object_boxes == Keys(same).object_boxes != Keys(other).object_boxes
    with pytest.raises(InputError, match="radius"):
        loaded(write_job, f"{HEAD}{OBJECT}scatter = {{ center = [0, 0, 0], radius = 0 }}\n")


@pytest.mark.parametrize(
    ("more", "says"),
    [
        ('[relight]\nmode = "tint"', "a mode that does not compare with the captured light"),
        ('[relight]\nper = "splat"', "light that is found for splats"),
    ],
)
def test_what_objects_are_not_made_for_is_a_line(write_job: WriteJob, thing: Path, more: str, says: str) -> None:
    with pytest.raises(InputError) as refused:
        mirelight.prepare(loaded(write_job, f"{HEAD}{OBJECT}\n{more}\n"))
    assert says in str(refused.value) and "\n" not in str(refused.value)


def test_light_beside_objects_is_traced_whatever_the_job_says(write_job: WriteJob, thing: Path) -> None:
    job = loaded(write_job, HEAD + OBJECT + '\n[render]\nindirect = "surface"\n')
    mirelight.prepare(job)
    assert not requirements.reads_surface(job)
    assert "render.indirect: light beside inserted objects is traced, not read from the surface" in warnings(plan(job))


@pytest.mark.parametrize(
    ("was", "now", "says"),
    [
        ('"thing.glb"', '"nothing.glb"', "there is no file"),
        ("metallic = 0.5", "metallic = 1.5", "metallic"),
        ("metallic = 0.5", "base_color = [0.5, 2, 0]", "an albedo of"),
        ('"thing.glb"', '"splats.ply"', "Gaussian splats, not a mesh"),
    ],
)
def test_a_wrong_object_is_a_line(write_job: WriteJob, thing: Path, was: str, now: str, says: str) -> None:
    with pytest.raises(InputError, match=says):
        job = loaded(write_job, HEAD + OBJECT.replace(was, now))
        _ = job.objects[0].mesh.value

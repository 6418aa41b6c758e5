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


def test_an_object_is_one_node_of_a_file(write_job: WriteJob, thing: Path) -> None:
    """Which light on it depends on, and its name."""
    mesh = jobs.load(write_job(HEAD + OBJECT)).objects[0].mesh
    node = OBJECT.replace("drop = true", 'node = "proxy"\ndrop = true')
    job = loaded(write_job, HEAD + node)
    (one,) = job.objects
    assert one.name == one.category == "proxy" and one.mesh.digest != mesh.digest
    np.testing.assert_array_equal(one.mesh.value.vertices, mesh.value.vertices)
    with pytest.raises(InputError, match="node: no node named 'chair'; give one of proxy"):
        _ = loaded(write_job, HEAD + node.replace('"proxy"', '"chair"')).objects[0].mesh.value
    sweep = '\n[sweep]\naxes = [{ field = "objects.proxy.node", values = ["proxy", "chair"] }]\n'
    swept = loaded(write_job, HEAD + node + sweep).lightings
    assert [x.name for x in swept] == ["captured-node-proxy", "captured-node-chair"]


def test_captured_lightings_are_the_captured_light(write_job: WriteJob) -> None:
    job = loaded(write_job, HEAD)
    (one,) = job.lightings
    assert job.captured is not None and one.name == "captured"
    assert one.environment is job.captured.environment
    with pytest.raises(InputError, match="no captured light to render in"):
        loaded(write_job, HEAD.replace("captured = {", "# {"))


LISTED = HEAD.replace('"captured"\n', '["captured", { name = "evening", environment = { radiance = 2 } }]\n')
TABLES = (
    HEAD.replace('lightings = "captured"\n', "")
    + """
[[lightings]]
name = "captured"
[[lightings]]
name = "evening"
environment = { radiance = 2 }
"""
)


@pytest.mark.parametrize("text", [LISTED, TABLES])
@pytest.mark.parametrize("captured", ["{ environment = { radiance = 1 } }", '"estimate"'])
def test_the_captured_light_stands_beside_other_lightings(write_job: WriteJob, text: str, captured: str) -> None:
    text = text.replace("captured = { environment = { radiance = 1 } }", f"captured = {captured}")
    job = loaded(write_job, text)
    assert job.captured is not None and [x.name for x in job.lightings] == ["captured", "evening"]
    own = job.lightings[0]
    assert (own.environment, own.sky) == (job.captured.environment, job.captured.sky)
    assert not own.relight or not own.relight.repair
    made = plan(job)
    assert [task.name.partition(".")[2] for task in made.groups[0].tasks] == ["captured", "evening"]
    needs = made.keys.needs(job.cameras[0], job.lightings)
    assert len(needs.lights) == 2  # what frames are compared with is what the first is made in


def test_of_the_captured_light_nothing_is_swept(write_job: WriteJob) -> None:
    sweep = '\n[sweep]\naxes = [{ field = "environment.intensity", values = [1, 2] }]\n'
    names = [x.name for x in loaded(write_job, LISTED + sweep).lightings]
    assert names == ["captured", "evening-intensity1", "evening-intensity2"]
    with pytest.raises(InputError, match="a sweep of the captured light"):
        loaded(write_job, LISTED + sweep + 'lightings = ["captured"]\n')
    with pytest.raises(InputError, match="a sweep of the captured light"):
        loaded(write_job, HEAD + sweep)
    with pytest.raises(InputError, match="no lighting is named 'captured'"):
        loaded(write_job, LISTED.replace("captured = {", 'captured = "captured"#'))


def test_objects_make_new_light_again_and_leave_captured_light(write_job: WriteJob, thing: Path) -> None:
    bare, with_one = Keys(loaded(write_job, HEAD)), Keys(loaded(write_job, HEAD + OBJECT))
    moved = Keys(loaded(write_job, HEAD + OBJECT.replace("[0, 2, 0]", "[0.1, 2, 0]")))
    lifted = Keys(loaded(write_job, HEAD + OBJECT.replace("drop = true\n", "")))
    camera = with_one.job.cameras[0]
    (lighting,) = with_one.job.lightings
    (part,) = with_one.mixture(lighting).sets
    frames = {x.frame(camera, lighting) for x in (bare, with_one, moved, lifted)}
    assert len(frames) == 4
    assert len({x.light_with_objects(part, camera, x.job.objects) for x in (bare, with_one, moved, lifted)}) == 4
    assert len({x.light(part, camera) for x in (with_one, moved, lifted)}) == 1
    assert len({f(camera, x.job.objects) for x in (with_one, moved, lifted) for f in (x.in_front, x.object_matte)}) == 6
    assert len({x.object_boxes(x.job.objects) for x in (with_one, moved, lifted)}) == 3
    objects = with_one.job.objects
    needs = with_one.needs(camera, [lighting])
    assert {with_one.light_with_objects(part, camera, objects), with_one.light(part, camera)} < set(needs.keys)
    assert (
        {with_one.in_front(camera, objects), with_one.object_matte(camera, objects)}
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
    first, again, another = (Keys(x).object_boxes(x.objects) for x in (one, same, other))
    assert first == again != another
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


SCATTERED = (
    OBJECT
    + """scatter = { center = [0, 0, 0], radius = 2 }

[[objects]]
path = "thing.glb"
name = "other"

[[sweep.axes]]
field = "objects.thing.scatter.seed"
draws = 3

[[sweep.axes]]
field = "objects.other.roughness"
values = [0, 1]
"""
)


def test_objects_are_swept_and_each_way_they_stand_has_light_of_its_own(write_job: WriteJob, thing: Path) -> None:
    job = loaded(write_job, HEAD + SCATTERED)
    names = [f"captured-seed{i:04d}-roughness{k}" for i in range(3) for k in (0, 1)]
    assert [x.name for x in job.lightings] == names and len(requirements.arrangements(job)) == 6
    first, second = job.lightings[:2]
    assert first.objects is not None and second.objects is not None and first.objects is not second.objects
    assert first.objects[0].scatter is not None and second.objects[0].scatter is not None
    assert not job.bare.objects and not any(job.bare.objects_of(x) for x in job.bare.lightings)
    assert first.objects[0].scatter.seed == second.objects[0].scatter.seed
    assert [x.objects[1].mesh.value.materials[0].roughness for x in (first, second)] == [0, 1]  # type: ignore[index]
    keys = Keys(job)
    camera = job.cameras[0]
    assert len({keys.frame(camera, x) for x in job.lightings}) == 6
    assert len({s.digest for x in job.lightings for s in keys.mixture(x).sets}) == 1
    needs = keys.needs(camera, job.lightings)
    assert len(needs.lights) == 6 + 1 and len(needs.veiled) == 6 * 2  # and the captured light, which knows none
    assert set(needs.keys) <= set(keys.lights()) | {keys.composite(camera)}
    longer = loaded(write_job, HEAD + SCATTERED.replace("draws = 3", "draws = 4"))
    assert [Keys(longer).frame(camera, x) for x in longer.lightings[:6]] == [
        keys.frame(camera, x) for x in job.lightings
    ]


def test_light_is_gone_through_before_objects_are_moved(write_job: WriteJob, thing: Path) -> None:
    axes = SCATTERED.replace('field = "objects.other.roughness"\nvalues', 'field = "environment.radiance"\nvalues')
    head = HEAD.replace('lightings = "captured"\n', "environment = { radiance = 1 }\n")
    swap = axes.split("[[sweep.axes]]")
    job = loaded(write_job, head + "[[sweep.axes]]".join([swap[0], swap[2], swap[1]]))
    assert [x.name for x in job.lightings[:3]] == [
        "lighting-radiance0-seed0000",
        "lighting-radiance1-seed0000",
        "lighting-radiance0-seed0001",
    ]
    assert job.lightings[0].objects is job.lightings[1].objects and len(requirements.arrangements(job)) == 3
    assert job.pooled
    paired = loaded(write_job, head + axes.replace("[0, 1]", "[0, 1, 2]") + '\n[sweep]\nhow = "paired"\n')
    assert not paired.pooled and len(paired.lightings) == 3


@pytest.mark.parametrize(
    ("was", "now", "says"),
    [
        ("objects.thing.scatter", "objects.thin.scatter", "no object"),
        ("objects.thing.scatter.seed", "objects.other.scatter.seed", "leads nowhere"),
        ("draws = 3", "draws = 3\nlog = true", "nothing is given for it"),
        ("values = [0, 1]", "values = [0, 2]", "roughness"),
    ],
)
def test_a_wrong_sweep_of_objects_is_a_line(write_job: WriteJob, thing: Path, was: str, now: str, says: str) -> None:
    with pytest.raises(InputError, match=says):
        loaded(write_job, HEAD + SCATTERED.replace(was, now))

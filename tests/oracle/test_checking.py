"""What is said of a job before it is rendered: of right ones nothing, of wrong ones the right thing."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import mirelight
from mirelight.lighting.sight import Sight
from mirelight.model import Camera, Deferred, Job, Lighting, PointLight, ProxyMesh, SplatCloud, SpotLight
from mirelight.pipeline.job_diagnostics import Check, check, hidden_lights
from mirelight.proxy.capture import take
from tests.proxy.looked_at import once

SCENES = Path(__file__).resolve().parents[2] / "scenes"
PROXY = 'proxy={path="proxy.glb",transform=%s}'


@pytest.fixture(autouse=True, scope="module")
def _looked_at_once() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        once(patch)
        yield


def job_of(scene: str, *overrides: str) -> Job:
    plain = ["resolution=[160,90]", 'proxy={path="proxy.glb"}', """cameras_from={path="proxy",transform="none"}"""]
    job = mirelight.load(SCENES / scene / "job.toml", [*plain, *overrides])
    return replace(job, splats=splats_of(scene))


@cache
def splats_of(scene: str) -> Deferred[SplatCloud] | None:
    return mirelight.load(SCENES / scene / "job.toml").splats


def kinds(found: Check) -> list[str]:
    return [x.kind for x in found.findings]


@pytest.mark.parametrize("scene", ["courtyard", "stage"])
def test_right_jobs_are_silent(scene: str) -> None:
    found = check(job_of(scene))
    assert kinds(found) == []
    assert found.quality is not None and found.cameras == 2
    assert [x.camera for x in found.quality.by_view] == [x.name for x in job_of(scene).cameras]
    assert all(x.uncovered < 0.13 and x.shown > 0.5 for x in found.quality.by_view)


@pytest.mark.parametrize("scene", ["courtyard", "stage"])
def test_right_jobs_of_small_pictures_are_silent(scene: str) -> None:
    assert kinds(check(job_of(scene, "resolution=[64,36]"))) == []


@pytest.mark.parametrize(
    ("transform", "kind"),
    [
        ("{rotation_euler=[180,0,0]}", "uncovered"),
        ("{rotation_euler=[0,0,90]}", "uncovered"),
        ("{translation=[0.3,0,0]}", "gap"),
        ("{translation=[0.08,0.02,0]}", "gap"),
        ("{scale=0.5}", "uncovered"),
        ("{scale=1.03}", "gap"),
    ],
)
def test_a_proxy_that_is_turned_moved_or_scaled_is_said(transform: str, kind: str) -> None:
    found = check(job_of("stage", PROXY % transform))
    assert kinds(found)[-1:] == [kind], found.findings
    assert found.findings[-1].remedy


def test_one_view_that_misfits_among_many_is_named() -> None:
    """A wall that the mesh lacks is said of the camera that looks at it."""
    job = job_of("stage")
    assert job.proxy is not None
    mesh = job.proxy.value
    front = job.cameras[0]
    # what only a narrow look to the upper left sees
    narrow = Camera.look_at(front.position, (-1.6, 2.4, -1.2), 160, 90, yfov=12, name="corner")
    corners = mesh.vertices[mesh.faces].mean(axis=1)
    kept = (corners[:, 0] > -0.9) | (corners[:, 1] < 1.9)
    holed = replace(mesh, faces=mesh.faces[kept], nodes=(), face_nodes=None)
    many = (*(replace(front, name=f"front {k}") for k in range(7)), narrow)
    found = check(replace(job, proxy=Deferred.of(holed), cameras=many))
    assert found.quality is not None and not found.quality.advice
    (said,) = found.findings
    assert said.kind == "uncovered" and "'corner'" in said.text


def test_many_cameras_are_looked_through_in_part() -> None:
    job = job_of("stage")
    assert job.splats is not None
    few = Deferred.of(take(job.splats.value, np.arange(0, len(job.splats.value), 20)))
    many = tuple(replace(job.cameras[0].resized(32, 18), name=f"{k}") for k in range(60))
    found = check(replace(job, splats=few, cameras=many, lightings=()))
    assert found.cameras == 60 and found.quality is not None and found.quality.views == 20
    every = check(replace(job, splats=few, cameras=many[:25], lightings=()), every_camera=True)
    assert every.quality is not None and every.quality.views == 25


def test_cameras_that_see_nothing_are_said() -> None:
    job = job_of("stage")
    away = Camera.look_at((0, 1, 9), (0, 1, 20), 160, 90, yfov=40, name="away")
    found = check(replace(job, cameras=(*job.cameras, away), lightings=()))
    assert kinds(found) == ["nothing"] and "'away' sees nothing" in found.findings[0].text


def test_splats_without_a_surface_are_said_and_no_error() -> None:
    few = SplatCloud(
        means=np.zeros((2, 3), np.float32),
        quats=np.tile(np.array([1, 0, 0, 0], np.float32), (2, 1)),
        scales=np.full((2, 3), 0.1, np.float32),
        opacities=np.ones(2, np.float32),
        sh=np.zeros((2, 1, 3), np.float32),
    )
    found = check(replace(job_of("stage"), splats=Deferred.of(few), lightings=()))
    assert found.quality is None
    assert "too few" in found.findings[-1].text


# --- lights: a closed box beside a floor ------------------------------------------------------------------------------


def box_and_floor() -> ProxyMesh:
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], np.float32)
    sides = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
    quads = np.array([*sides, (8, 9, 10, 11)])
    floor = np.array([[-20, 0, -20], [-20, 0, 20], [20, 0, 20], [20, 0, -20]], np.float32)
    faces = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    return ProxyMesh(vertices=np.concatenate([corners * 0.5, floor]), faces=faces.astype(np.int32))


CAMERA = Camera.look_at((4, 3, 4), (0, 0, 0), 64, 36, yfov=40, name="eye")


@pytest.mark.parametrize(
    ("light", "said"),
    [
        (PointLight(name="lamp", position=np.array([0.25, 0.25, 0.25])), "inside the proxy"),
        (PointLight(name="lamp", position=np.array([0.25, 5.0, 0.25]), range=0.5), "reaches 0.5 units"),
        (SpotLight(name="lamp", position=np.array([0, 5.0, 0]), direction=np.array([0, 1.0, 0])), "shines past"),
        (PointLight(name="lamp", position=np.array([0.25, 5.0, 0.25]), range=6.0), None),
        (PointLight(name="lamp", position=np.array([0.25, 0.25, 0.75])), None),
        (PointLight(name="lamp", position=np.array([0.2, 0.2, -0.3])), None),  # the box hides it from the cameras
        (SpotLight(name="lamp", position=np.array([0, 5.0, 0]), direction=np.array([0, -1.0, 0])), None),
        (PointLight(name="lamp", position=np.array([0.25, 0.25, 0.25]), intensity=0.0), None),
    ],
)
def test_lights_that_reach_nothing_are_said(light: PointLight | SpotLight, said: str | None) -> None:
    mesh = box_and_floor()
    found = hidden_lights([Lighting(name="room", lights=(light,))], [CAMERA], Sight(mesh))
    if said is None:
        assert not found
    else:
        assert len(found) == 1 and said in found[0].text and "'lamp' of 'room'" in found[0].text

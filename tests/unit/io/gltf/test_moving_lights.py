"""Lights of animated files: at a moment, at many, and at the times of the job's cameras."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import mirelight
from mirelight.base.errors import InputError, ManyInputsError
from mirelight.io.gltf.moving_lights import Shot, light_times, moving_lights
from mirelight.model import Job, PointLight, SpotLight
from mirelight.pipeline.keys import Keys
from mirelight.pipeline.plan import plan

TIMES = np.array([1, 3], dtype=np.float32)


def animate(glb: Any, target: dict[str, Any], values: np.ndarray, times: np.ndarray = TIMES) -> None:
    sampler = {"input": glb.accessor(times), "output": glb.accessor(values.astype(np.float32))}
    glb.put("animations", {"samplers": [sampler], "channels": [{"sampler": 0, "target": target}]})


def pointer(path: str) -> dict[str, Any]:
    return {"path": "pointer", "extensions": {"KHR_animation_pointer": {"pointer": path}}}


@pytest.fixture
def shot(glb: Any) -> Any:
    """A lamp that walks along x under a parent that turns, one that is dimmed and coloured, one that stays; a camera
    that walks from time 0 to 4; a floor."""
    glb.node(mesh=glb.mesh(glb.primitive()))
    glb.light({"name": "walker"}, type="spot", intensity=5, spot={"innerConeAngle": 0.1, "outerConeAngle": 0.5})
    glb.light({"name": "dimmed", "translation": [0, 1, 0]}, type="point", intensity=8)
    glb.light({"name": "still", "translation": [0, 2, 0]}, type="point", intensity=3)
    glb.camera({"name": "eye", "translation": [0, 0, 5]}, type="perspective", perspective={"yfov": 0.8, "znear": 0.1})
    turned = glb.node(children=[1], rotation=[0, 0, 0, 1])
    glb.top["scenes"][0]["nodes"].remove(1)
    half = np.sqrt(0.5)
    animate(glb, {"node": 1, "path": "translation"}, np.array([[1, 0, 0], [3, 0, 0]]))
    animate(glb, {"node": turned, "path": "rotation"}, np.array([[0, 0, 0, 1], [0, half, 0, half]]))
    light = "/extensions/KHR_lights_punctual/lights/1"
    animate(glb, pointer(f"{light}/intensity"), np.array([8.0, 2.0]))
    animate(glb, pointer(f"{light}/color"), np.array([[1, 1, 1], [1, 0.5, 0]]))
    animate(glb, pointer("/extensions/KHR_lights_punctual/lights/0/spot/outerConeAngle"), np.array([0.5, 0.7]))
    animate(glb, pointer("/nodes/3/scale"), np.array([[1, 1, 1], [2, 2, 2]]))  # of no light: passed over
    eye = np.array([[0, 0, 5], [0, 0, 9]])
    animate(glb, {"node": 4, "path": "translation"}, eye, np.array([0, 4], dtype=np.float32))
    glb.top["extensionsRequired"] = ["KHR_lights_punctual", "KHR_animation_pointer"]
    return glb


def test_lights_stand_shine_and_fade_as_of_their_moment(shot: Any) -> None:
    opened = Shot.of(shot.save())
    names = [x.name for x in opened.at(0).lights]
    assert dict(zip(names, moving_lights(shot.save()), strict=True)) == {"walker": True, "dimmed": True, "still": False}
    middle = opened.at(2.0).lights
    walker, dimmed, still = (next(x for x in middle if x.name == name) for name in ("walker", "dimmed", "still"))
    c = np.sqrt(0.5)  # half of the parent's quarter turn about +Y, and half of the way
    assert isinstance(walker, SpotLight)
    np.testing.assert_allclose(walker.position, [2 * c, 0, -2 * c], atol=1e-6)
    np.testing.assert_allclose(walker.direction, [-c, 0, -c], atol=1e-6)
    assert walker.outer_cone_angle == pytest.approx(0.6)
    assert walker.inner_cone_angle == pytest.approx(0.1)
    assert walker.intensity == 5
    assert isinstance(dimmed, PointLight)
    assert dimmed.intensity == pytest.approx(5)
    np.testing.assert_allclose(dimmed.color, [1, 0.75, 0.5])
    for time, x in ((-5.0, [1, 0, 0]), (50.0, [0, 0, -3])):  # held before the first key and after the last
        ends = {light.name: light for light in opened.at(time).lights}
        np.testing.assert_allclose(ends["walker"].position, x, atol=1e-6)  # type: ignore[union-attr]
        assert repr(ends["still"]) == repr(still)


def test_moments_lie_between_the_keys_that_change_a_light(shot: Any) -> None:
    path = shot.save()
    np.testing.assert_allclose(light_times(path, count=3), [1, 2, 3])
    np.testing.assert_allclose(light_times(path, fps=2), [1, 1.5, 2, 2.5, 3])
    del shot.top["animations"][:-1]  # the camera's is left
    with pytest.raises(InputError, match="nothing moves or changes a light"):
        light_times(shot.save("camera.glb"), count=3)


def test_clips_of_other_nodes_are_no_matter(shot: Any) -> None:
    """A file of a game has one node in many clips; only what moves a light is read."""
    before = Shot.of(shot.save()).at(2).lights
    for _ in range(2):
        animate(shot, {"node": 0, "path": "scale"}, np.ones((2, 3)))
    again = Shot.of(shot.save())
    assert [repr(x) for x in again.at(2).lights] == [repr(x) for x in before]
    animate(shot, {"node": 1, "path": "translation"}, np.ones((2, 3)))
    with pytest.raises(InputError, match="animated twice"):
        Shot.of(shot.save())
    assert sum(moving_lights(shot.save())) == 2


def test_damaged_pointers_are_named(shot: Any) -> None:
    light = "/extensions/KHR_lights_punctual/lights/1"
    animate(shot, pointer(f"{light}/intensity"), np.array([8.0, 2.0]))
    with pytest.raises(InputError, match=r"lights\[1\] intensity is animated twice"):
        Shot.of(shot.save())
    shot.top["animations"][-1]["channels"][0]["target"] = pointer(f"{light}/range")
    with pytest.raises(InputError, match="must be positive"):
        animate(shot, pointer("/extensions/KHR_lights_punctual/lights/2/range"), np.array([-1.0, -1.0]))
        Shot.of(shot.save()).at(2)
    shot.top["animations"][-1]["samplers"][0]["output"] = 0
    with pytest.raises(InputError, match=r"animations\[8\]\.samplers\[0\]\.output"):
        Shot.of(shot.save())


# --- in a job --------------------------------------------------------------------------------------------------------

HEAD = 'proxy = "scene.glb"\nresolution = [16, 9]\n'
EYE = 'cameras_from = { path = "proxy", frames = 5 }\n'


@pytest.fixture
def load(shot: Any, tmp_path: Path) -> Callable[[str], Job]:
    shot.save()

    def loaded(text: str) -> Job:
        (tmp_path / "job.toml").write_text(text)
        return mirelight.load(tmp_path / "job.toml")

    return loaded


def place(job: Job, lighting: int) -> float:
    return float(np.linalg.norm(next(x for x in job.lightings[lighting].lights if x.name == "walker").position))  # type: ignore[union-attr]


def test_one_moment_is_one_lighting(load: Callable[[str], Job]) -> None:
    job = load(HEAD + 'lights_from = { path = "proxy", time = 2 }\n')
    assert [x.name for x in job.lightings] == ["lighting"]
    assert place(job, 0) == pytest.approx(2)
    assert place(load(HEAD + 'lights_from = "proxy"\n'), 0) == 0  # as the nodes stand


def test_many_moments_trace_anew_what_moves_and_nothing_else(load: Callable[[str], Job]) -> None:
    job = load(HEAD + 'lights_from = { path = "proxy", frames = 3 }\n[mix.lighting]\nstill = 0.5\n')
    assert [x.name for x in job.lightings] == ["lighting-0001", "lighting-0002", "lighting-0003"]
    assert [place(job, k) for k in range(3)] == pytest.approx([1, 2, 3])
    keys = Keys(job)
    mixtures = [keys.mixture(x) for x in job.lightings]
    units = [{term.layer: (term.unit.digest, tuple(term.weight)) for term in m.terms} for m in mixtures]
    for layer, moves in (("walker", True), ("dimmed", False), ("still", False)):
        assert (len({u[layer][0] for u in units}) == 3) == moves
    assert [u["dimmed"][1][0] for u in units] == pytest.approx([8, 5, 2])  # dimming is a weight, and traces nothing
    assert [u["still"][1][0] for u in units] == pytest.approx([1.5] * 3)
    new = [{u.digest for s in m.sets for u in s.units} for m in mixtures]
    assert [len(new[0]), len(new[1] - new[0]), len(new[2] - new[1] - new[0])] == [3, 1, 1]
    assert len(plan(job).tasks) == 3 * len(job.cameras)


def test_each_camera_is_lit_as_at_its_own_time(load: Callable[[str], Job]) -> None:
    job = load(
        f'{HEAD}{EYE}[[lightings]]\nname = "shot"\nlights_from = {{ path = "proxy", time = "camera" }}\n'
        '[[lightings]]\nname = "day"\nenvironment = { radiance = 1 }\n'
    )
    assert [x.time for x in job.cameras] == pytest.approx([0, 1, 2, 3, 4])
    made = plan(job)
    assert [task.name for group in made.groups for task in group.tasks] == [
        name for k in range(1, 6) for name in (f"eye.{k:04d}.shot-{k:04d}", f"eye.{k:04d}.day")
    ]
    assert [place(job, k) for k in range(5)] == pytest.approx([1, 1, 2, 3, 3])  # held at both ends
    for group in made.groups:  # all lamps of a moment share their paths
        lighting = group.tasks[0].lighting
        assert lighting is not None
        (one,) = made.keys.mixture(lighting).sets
        assert len(one.units) == 3
    every = set(made.keys.lights())
    for group in made.groups:
        assert set(made.keys.needs(group.camera, [t.lighting for t in group.tasks]).keys) <= every


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('lights_from = { path = "proxy", time = "camera" }', "of no animation"),
        ('lights_from = { path = "proxy", time = 1, frames = 2 }', "time"),
        ('lights_from = { path = "proxy", fps = 2, frames = 2 }', "fps"),
        ('lights_from = { path = "proxy", time = "noon" }', "time"),
        ('lights_from = [{ path = "proxy", frames = 2 }, { path = "proxy", frames = 3 }]', "give both the same frames"),
        (
            EYE + 'lights_from = [{ path = "proxy", frames = 2 }, { path = "proxy", time = "camera" }]',
            "beside lights at the cameras' times",
        ),
        (
            'lights_from = "proxy"\n[captured]\nlights_from = { path = "proxy", frames = 2 }',
            "captured light that moves",
        ),
        (
            'captured = "a"\n[[lightings]]\nname = "a"\nlights_from = { path = "proxy", frames = 2 }',
            "a lighting that moves",
        ),
        (
            'lights_from = { path = "proxy", frames = 2 }\n[[sweep.axes]]\nfield = "lights_from[0].intensity"\n'
            "values = [1, 2]",
            "a sweep of lights that move",
        ),
        ('lights_from = { path = "proxy", time = nan }', "time"),
        ('lights_from = { path = "proxy", fps = 10000 }', "20,001 moments; at most 10,000"),
        (EYE + 'lights_from = { path = "proxy", time = "camera" }\n[output]\nstore = "layers"', "lights of its own"),
        (EYE + 'lights_from = { path = "proxy", time = "camera" }\n[dataset]\nlayouts = ["nerf"]', "data sets"),
    ],
)
def test_what_moving_lights_cannot_be_is_one_line(load: Callable[[str], Job], text: str, said: str) -> None:
    with pytest.raises((InputError, ManyInputsError), match=said):
        load(HEAD + text)


def test_moments_of_many_lights_are_bounded(load: Callable[[str], Job], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("mirelight.io.job.moments._MOST_LIGHTS", 8)
    load(HEAD + 'lights_from = { path = "proxy", frames = 2 }')
    for many in ("frames = 3 }", 'time = "camera" }\n' + EYE):
        with pytest.raises(InputError, match=r"moments of 3 lights; take fewer: 8 in all"):
            load(HEAD + f'lights_from = {{ path = "proxy", {many}')

"""`lights_from.unit`: lamps that Blender's exporter wrote, in a job."""

from __future__ import annotations

import json
import math
from pathlib import Path

import pytest

import mirelight
from mirelight.apps.inspect.inspect import inspect
from mirelight.model import Job, SpotLight
from mirelight.pipeline.plan import plan, warnings

from .conftest import WriteJob

SCENE = 'splats = "splats.ply"\nproxy = "proxy.glb"\ncameras = [{ position = [0, 0, 5], target = [0, 0, 0] }]\n'


@pytest.fixture
def lamps(write_job: WriteJob) -> WriteJob:
    """Writes jobs beside lamps.gltf, a lamp of 1 W as Blender exports it, 2 m up."""
    top = {
        "asset": {"version": "2.0", "generator": "Khronos glTF Blender I/O v4.2.60"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"translation": [0, 2, 0], "extensions": {"KHR_lights_punctual": {"light": 0}}}],
        "extensions": {"KHR_lights_punctual": {"lights": [{"type": "point", "name": "lamp", "intensity": 54.351413}]}},
    }
    path = write_job(SCENE)
    Path(path.parent / "lamps.gltf").write_text(json.dumps(top), encoding="utf-8")
    return write_job


def intensity(job: Job) -> float:
    return job.lightings[0].lights[0].intensity


def test_as_the_file_says_with_a_line(lamps: WriteJob) -> None:
    path = lamps(f'{SCENE}lights_from = "lamps.gltf"\n')
    job = mirelight.load(path)
    assert intensity(job) == 54.351413
    (line,) = warnings(plan(job))
    assert line.startswith("lamps.gltf: lights written by 'Khronos glTF Blender I/O v4.2.60' are 683 times as strong")
    assert 'lights_from = { path = "lamps.gltf", unit = "blender" }' in line
    assert inspect(path).notes == (line,)  # type: ignore[union-attr]


@pytest.mark.parametrize(("unit", "candela"), [("khr", 54.351413), ("blender", 54.351413 / 683)])
def test_a_unit_that_is_chosen_ends_the_line(lamps: WriteJob, unit: str, candela: float) -> None:
    job = mirelight.load(lamps(f'{SCENE}lights_from = {{ path = "lamps.gltf", unit = "{unit}", intensity = 2 }}\n'))
    assert intensity(job) == pytest.approx(2 * candela, rel=1e-12)
    assert warnings(plan(job)) == ()


@pytest.mark.parametrize(("cone", "law"), [("khr", "khr"), ("playcanvas", "playcanvas"), ("blender", "playcanvas")])
def test_spots_of_a_file_take_another_cone(lamps: WriteJob, cone: str, law: str) -> None:
    """The exporter writes a spot of size 60 degrees and blend 0.4 as these two half angles."""
    path = lamps(f'{SCENE}lights_from = {{ path = "lamps.gltf", unit = "blender", cone = "{cone}" }}\n')
    file = path.parent / "lamps.gltf"
    top = json.loads(file.read_text())
    half = math.radians(30)
    (entry,) = top["extensions"]["KHR_lights_punctual"]["lights"]
    entry |= {"type": "spot", "spot": {"innerConeAngle": 0.6 * half, "outerConeAngle": half}}
    file.write_text(json.dumps(top))
    (light,) = mirelight.load(path).lightings[0].lights
    assert isinstance(light, SpotLight) and light.cone == law
    inner = math.acos(math.cos(half) + 0.4 * (1 - math.cos(half))) if cone == "blender" else 0.6 * half
    assert (light.inner_cone_angle, light.outer_cone_angle) == pytest.approx((inner, half))


def test_several_lightings_and_a_sweep_say_it_once(lamps: WriteJob) -> None:
    sweep = '[[sweep.axes]]\nfield = "lights_from[0].intensity"\nvalues = [1, 2, 3]\n'
    lightings = "".join(f'[[lightings]]\nname = "{x}"\nlights_from = "lamps.gltf"\n' for x in "ab")
    job = mirelight.load(lamps(SCENE + lightings + sweep))
    assert len(job.lightings) == 6 and len(warnings(plan(job))) == 1


def test_a_wrong_unit(lamps: WriteJob) -> None:
    with pytest.raises(mirelight.base.errors.InputError, match=r"lights_from\.unit: 'watt'; give one of"):
        mirelight.load(lamps(f'{SCENE}lights_from = {{ path = "lamps.gltf", unit = "watt" }}\n'))

"""Gloss in whole frames: nothing changes in the captured light, and what glows lights what is beside it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import mirelight
from mirelight.base.errors import InputError
from mirelight.model import Frame
from mirelight.pipeline import stages
from mirelight.pipeline.scene import prepare

from .test_objects_whole import JOB, folder

__all__ = ["folder"]
FLOOR = "\n[[materials]]\nroughness = 0.3\n[relight]\ngloss = true\n"
LAMP = 'lightings = [{ name = "lamp", lights = [{ type = "point", position = [0, 1, -2], intensity = 3 }] }]'


def made(folder: Path, text: str) -> Frame:
    (folder / "gloss.toml").write_text(text, encoding="utf-8")
    job = mirelight.load(folder / "gloss.toml")
    scene = mirelight.prepare(job)
    return stages.frame(scene, job.cameras[0], job.lightings[0])


def test_in_the_captured_light_a_glossy_floor_is_as_captured(folder: Path) -> None:
    frame = made(folder, JOB + FLOOR)
    assert frame.unlit is not None
    lit = frame.unlit[..., 3] > 0.9
    np.testing.assert_allclose(frame.rgba[lit], frame.unlit[lit], rtol=0.02)


def test_a_new_lamp_is_mirrored_where_it_must_be(folder: Path) -> None:
    text = JOB.replace('lightings = "captured"', LAMP)
    plain = made(folder, text).rgba[..., :3]
    added = (made(folder, text + FLOOR).rgba[..., :3] - plain).mean(axis=-1)
    assert added.max() > 0.02
    row, column = np.unravel_index(added.argmax(), added.shape)
    camera = mirelight.load(folder / "gloss.toml").cameras[0]
    eye, lamp = camera.position, np.array([0.0, 1, -2])
    share = eye[1] / (eye[1] + lamp[1])
    point = eye + share * (lamp - eye)  # where the floor mirrors it
    point[1] = 0
    x, y, z = (camera.camera_from_world @ np.append(point, 1))[:3]
    assert abs(row + 0.5 - (camera.cy - camera.fy * y / -z)) < 4
    assert abs(column + 0.5 - (camera.cx + camera.fx * x / -z)) < 4


def test_a_part_glows_in_every_lighting(folder: Path) -> None:
    text = JOB.replace('lightings = "captured"', LAMP)
    glow = "\n[[materials]]\nbox = [[-3, -1, -3], [0, 1, 3]]\nemission = [0, 0, 2]\n"
    (folder / "gloss.toml").write_text(text + glow, encoding="utf-8")
    job = mirelight.load(folder / "gloss.toml")
    scene = prepare(job)
    lit = stages.light(scene, job.cameras[0], job.lightings[0])
    assert scene.glows and lit.captured is not None
    for buffer in (lit.new, lit.captured):
        layer = next(x for x in buffer.layers if x.name == "emission")
        assert layer.total[..., 2].max() == pytest.approx(2.0, rel=0.02) and not layer.total[..., :2].any()


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ('profile = "playcanvas"\n', "relight.gloss: gloss and the profile playcanvas"),
    ],
)
def test_gloss_is_refused_where_it_is_not(folder: Path, change: str, said: str) -> None:
    text = change + JOB.replace('lightings = "captured"', LAMP) + FLOOR
    with pytest.raises(InputError, match=said):
        made(folder, text.replace("[relight]", '[relight]\nmode = "tint"'))

"""`captured = "estimate"` in a job: planned without being made, made once, kept, and used as any captured light is."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import mirelight
from mirelight.errors import InputError
from mirelight.estimate import estimate
from mirelight.io import job, splats
from mirelight.io.environment import write_environment
from mirelight.io.gltf.write import write_glb
from mirelight.io.job.captured_text import captured_text
from mirelight.kept import KeptNowhere
from mirelight.model import F32, EstimatedSky, Job
from mirelight.plan import plan
from mirelight.scene import prepare

from .test_estimate import LIGHT, painted, yard

JOB = """
splats = "yard.ply"
proxy = "yard.glb"
captured = "estimate"
resolution = [48, 36]
lights = [{ type = "sun", direction = [0, -1, 0.4], intensity = 2 }]
cameras = [{ position = [4, 4, 5], target = [0, 0.5, 0] }]
[render]
spp = 4
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    splats.write(painted(yard(), LIGHT, 700), tmp_path / "yard.ply")
    write_glb(tmp_path / "yard.glb", replace(yard(), vertex_colors=None))
    (tmp_path / "job.toml").write_text(JOB)
    return tmp_path


class Shelf(KeptNowhere):
    """Keeps arrays in memory."""

    def __init__(self) -> None:
        self.arrays: dict[str, F32] = {}

    def array(self, key: str) -> F32 | None:
        return self.arrays.get(key)

    def keep_array(self, key: str, values: F32) -> None:
        self.arrays[key] = values


def loaded(folder: Path, *changes: str) -> Job:
    return job.load(folder / "job.toml", changes)


def test_it_is_the_estimate_and_is_made_once(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    work, shelf = loaded(folder), Shelf()
    assert work.captured is not None and isinstance(work.captured.sky, EstimatedSky)
    assert work.relight.mode == "ratio"
    light = prepare(work, shelf).resolved(work.captured)
    assert work.splats is not None and work.proxy is not None
    found = estimate(work.splats.value, work.proxy.value, work.render)
    assert light.environment is not None
    np.testing.assert_array_equal(light.environment.pixels, found.radiance.astype(np.float32))
    monkeypatch.setattr("mirelight.estimate.estimate", None)  # not called again
    again = prepare(work, shelf).resolved(work.captured)
    np.testing.assert_array_equal(again.lights[0].color, light.lights[0].color)
    assert again.layer_names == work.captured.layer_names


def test_a_frame_is_relit_by_it(folder: Path) -> None:
    work = loaded(folder)
    scene = mirelight.prepare(work)
    camera, lighting = work.cameras[0], work.lightings[0]
    lit = mirelight.light(scene, camera, lighting)
    frame = mirelight.relight(scene, mirelight.composite(scene, camera), lit)
    assert lit.captured is not None and frame.unlit is not None
    assert [layer.name for layer in lit.captured.layers] == ["sun", "sky"]
    assert np.isfinite(frame.rgba).all() and not np.allclose(frame.rgba, frame.unlit, atol=0.02)


def test_frames_are_made_again_when_the_estimate_changes(folder: Path) -> None:
    def key(*changes: str) -> str:
        return plan(loaded(folder, *changes)).tasks[0].files[".exr"]

    same = key()
    assert key() == same
    assert key("render.seed=5") != same
    assert key("captured={ estimate = true, exposure = 1 }") != same
    assert key("captured={ estimate = true }") == same


def test_the_table_that_is_written_can_be_read(folder: Path) -> None:
    work = loaded(folder)
    assert work.captured is not None
    light = prepare(work).resolved(work.captured)
    assert light.environment is not None
    write_environment(folder / "captured.exr", light.environment.pixels)
    text = JOB.replace('captured = "estimate"\n', "") + captured_text(light, "captured.exr", ["found"])
    (folder / "pasted.toml").write_text(text)
    pasted = job.load(folder / "pasted.toml").captured
    assert pasted is not None and pasted.environment is not None
    np.testing.assert_array_equal(pasted.environment.pixels, light.environment.pixels)
    np.testing.assert_allclose(pasted.lights[0].color, light.lights[0].color, rtol=1e-5)


def test_without_splats_it_is_one_line(folder: Path) -> None:
    (folder / "job.toml").write_text(JOB.replace('splats = "yard.ply"\n', ""))
    with pytest.raises(InputError, match="no splats to tell it from"):
        loaded(folder)
    (folder / "job.toml").write_text(JOB.replace('"estimate"', "{ exposure = 1 }"))
    with pytest.raises(InputError, match="estimate = true"):
        loaded(folder)

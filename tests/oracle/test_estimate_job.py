"""`captured = "estimate"` in a job: planned without being made, made once, kept, and used as any captured light is."""

from __future__ import annotations

import json
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import mirelight
from mirelight.apps.inspect.inspect import of_job
from mirelight.base.errors import InputError
from mirelight.cli import main
from mirelight.cli.report import lines
from mirelight.estimate import Estimate, estimate
from mirelight.estimate.describe import doubted
from mirelight.estimate.even import or_even
from mirelight.estimate.types import Confidence
from mirelight.io import job, splats
from mirelight.io.environment import read_environment, write_environment
from mirelight.io.gltf.write import write_glb
from mirelight.io.job.captured_text import captured_text
from mirelight.lighting import captured_level
from mirelight.model import EstimatedSky, Job, PointLight, ProxyMesh
from mirelight.pipeline.plan import plan
from mirelight.pipeline.scene import prepare

from .shelf import Shelf
from .test_estimate import LIGHT, painted, yard
from .toy_estimate import of_toys

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


def loaded(folder: Path, *changes: str) -> Job:
    return job.load(folder / "job.toml", changes)


def told(sun: float, *named: PointLight) -> Estimate:
    """An estimate: a wide sun of so many lux, lamps, and an uneven sky."""
    rng = np.random.default_rng(4)
    return Estimate(
        to_sun=np.array([0.6, 0.8, 0.0]),
        sun=sun * np.array([1.0, 0.9, 0.7]),
        sun_diameter=4.5,
        named=named,
        lamps=np.zeros((0, 6)),
        radiance=rng.random((48, 96, 3)).astype(np.float32).astype(np.float64),
        confidence=Confidence(
            places=500,
            blocked=0.4,
            scale_known=True,
            sun_gain=0.1,
            sun_apart=1.0,
            sun_beaten=-3.0,
            sun_disc=(0.53, 0.53),
            halves_apart=0.05,
            held_out=0.1,
            lamps_gain=(),
            albedo=(0.1, 0.3, 0.7),
        ),
    )


def test_a_doubted_one_is_said(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    sure = told(2.0)
    cases = ((-3.0, 1.0, 0), (6.0, 1.0, 1), (-3.0, 60.0, 0), (0.0, 60.0, 1))
    for case, (beaten, apart, times) in enumerate(cases):
        found = replace(sure, confidence=replace(sure.confidence, sun_beaten=beaten, sun_apart=apart))
        monkeypatch.setattr("mirelight.estimate.estimate", lambda *_, found=found: found)
        work, said = loaded(folder, f"captured={{ estimate = true, exposure = {case} }}"), list[str]()  # none is kept
        assert work.captured is not None
        prepare(work, Shelf(), said.append).resolved(work.captured)
        assert sum("not known: where the sun stood" in x for x in said) == times


def test_even_light_takes_the_place_of_a_doubted_one(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As strong, said each time, and never where lamps were named; `mirelight estimate` writes what was found."""
    sure = told(2.0)
    wrong = replace(sure, confidence=replace(sure.confidence, sun_beaten=6.0))
    monkeypatch.setattr("mirelight.estimate.estimate", lambda *_: wrong)
    work, shelf = loaded(folder), Shelf()
    assert work.captured is not None and work.splats is not None and work.proxy is not None
    for _ in range(2):
        said = list[str]()
        light = prepare(work, shelf, said.append).resolved(work.captured)
        assert sum("even light, as strong, takes its place" in x for x in said) == 1
        assert light.environment is not None and light.lights[0].intensity == 0
        assert np.ptp(light.environment.pixels.reshape(-1, 3), axis=0).max() == 0
        assert light.layer_names == work.captured.layer_names
    levels = [captured_level(work.splats.value, work.proxy.value, x, work.render) for x in (light, wrong.lighting)]
    assert levels[0] == pytest.approx(levels[1], rel=1e-3)
    assert main(["estimate", str(folder / "job.toml"), "-o", str(folder / "found.toml"), "-q"]) == 0
    np.testing.assert_array_equal(read_environment(folder / "found.exr"), wrong.radiance.astype(np.float32))
    lamp = PointLight(name="lamp", position=np.array([0.0, 3, 0]), intensity=2.0)
    named = replace(wrong, named=(lamp,))
    assert or_even(named, work.splats.value, work.proxy.value, work.render) is named


def test_lamps_beside_one_wall_alone_are_doubted() -> None:
    """Nothing there tells their light from paint; a sun is judged by its edges."""
    sure = replace(told(0.0), lamps=np.array([[0.0, 1, 0, 5, 5, 5]]))
    alone = replace(sure.confidence, blocked=0.002)
    assert not doubted(sure) and not doubted(replace(told(2.0), confidence=alone))
    assert doubted(replace(sure, confidence=alone))


def test_a_doubted_estimate_of_a_room_stays(folder: Path) -> None:
    """Even light would come through its windows alone."""
    sure = told(2.0)
    wrong = replace(sure, confidence=replace(sure.confidence, sun_beaten=6.0))
    work = loaded(folder)
    assert work.splats is not None and work.proxy is not None
    around = work.proxy.value
    corners = np.array([[x, y, z] for x in (-20, 20) for y in (-1, 20) for z in (-20, 20)], np.float32)
    sides = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
    box = np.array([t for a, b, c, d in sides for t in ((a, b, c), (a, c, d))], np.int32)
    vertices = np.concatenate([around.vertices, corners])
    closed = ProxyMesh(vertices=vertices, faces=np.concatenate([around.faces, box + len(around.vertices)]))
    assert or_even(wrong, work.splats.value, closed, work.render) is wrong
    assert or_even(wrong, work.splats.value, around, work.render) is not wrong


def test_it_is_the_estimate_and_is_made_once(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The same to the bit whoever asks for it."""
    of_toys(monkeypatch, rough=True)
    work, shelf = loaded(folder), Shelf()
    assert work.captured is not None and isinstance(work.captured.sky, EstimatedSky)
    assert work.relight.mode == "ratio"
    light = prepare(work, shelf).resolved(work.captured)
    assert work.splats is not None and work.proxy is not None
    found = or_even(
        estimate(work.splats.value, work.proxy.value, work.render), work.splats.value, work.proxy.value, work.render
    )
    assert light.environment is not None
    np.testing.assert_array_equal(light.environment.pixels, found.radiance.astype(np.float32))
    monkeypatch.setattr("mirelight.estimate.estimate", None)  # not called again
    again = prepare(work, shelf).resolved(work.captured)
    np.testing.assert_array_equal(again.lights[0].color, light.lights[0].color)
    assert again.layer_names == work.captured.layer_names


def test_every_command_finds_it(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The command's own is what a job takes that asks for the same; another exposure is another."""
    calls: list[float] = []

    def counted(*arguments: Any) -> Estimate:
        calls.append(arguments[3])
        return told(3.0)

    monkeypatch.setattr("mirelight.estimate.estimate", counted)
    assert main(["estimate", str(folder / "job.toml"), "-o", str(folder / "found.toml"), "-q"]) == 0
    lights = []
    for changes in ([], ["output.directory=other"], ["captured={ estimate = true, exposure = 1 }"]):
        work = loaded(folder, *changes)
        assert work.captured is not None
        lights.append(prepare(work).resolved(work.captured))
    assert calls == [0.0, 1.0]
    found = read_environment(folder / "found.exr")
    for light in lights[:2]:
        assert light.environment is not None
        np.testing.assert_array_equal(light.environment.pixels, found)


def test_it_is_kept_with_all_that_is_said_of_it(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The command finds what it, or a render, made before: the same files, the same words; its picture, too."""
    lamp = PointLight(name="lamp", position=np.array([1.0, 1, 1]), color=np.array([1, 0.7, 0.3]), intensity=2.1)
    monkeypatch.setattr("mirelight.estimate.estimate", lambda *_: told(3.0, lamp))
    (folder / "lamp.toml").write_text(
        JOB.replace(
            '"estimate"', '{ estimate = true, lights = [{ name = "lamp", type = "point", position = [1, 1, 1] }] }'
        )
    )
    work = job.load(folder / "lamp.toml")
    assert work.captured is not None
    prepare(work).resolved(work.captured)
    monkeypatch.setattr("mirelight.estimate.estimate", None)  # not called again
    said = []
    for name in ("first", "second"):
        assert main(["estimate", str(folder / "lamp.toml"), "-o", str(folder / f"{name}.toml"), "--json"]) == 0
        said.append(json.loads(capsys.readouterr().out.replace(f"{name}.", "found.")))
        monkeypatch.setattr("mirelight.estimate.pictures.sheet", None)
    assert said[0] == said[1] and len(said[0]["captured"]["lights"]) == 2
    for suffix in (".exr", ".png"):
        assert (folder / f"first{suffix}").read_bytes() == (folder / f"second{suffix}").read_bytes()
    np.testing.assert_array_equal(read_environment(folder / "first.exr"), told(3.0).radiance.astype(np.float32))
    with pytest.raises(TypeError):  # another view's is drawn
        main(["estimate", str(folder / "lamp.toml"), "-o", str(folder / "other.toml"), "--set", "resolution=[40, 36]"])


def test_a_frame_is_relit_by_it(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("mirelight.estimate.estimate", lambda *_: told(3.0))
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


def test_the_table_that_is_written_can_be_read(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("mirelight.estimate.estimate", lambda *_: told(3.0))
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


@pytest.mark.parametrize("out", ["captured.glb", "captured.gltf", "dark.glb"])
def test_gltf_that_is_written_is_the_same_light(
    folder: Path, out: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The line that the command prints is put into the job as it is."""
    lamp = PointLight(name="lamp", position=np.array([1.0, 1, 1]), intensity=2.0, radius=0.05)
    made = told(0.0) if out == "dark.glb" else told(3.0, lamp)
    monkeypatch.setattr("mirelight.estimate.estimate", lambda *_: made)
    (folder / "blind.toml").write_text(JOB.replace("cameras", "# cameras"))
    assert main(["estimate", str(folder / "blind.toml"), "-o", str(folder / out), "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    line = said["use"]
    assert [x["name"] for x in said["captured"]["lights"]] == [x.name for x in made.lighting.lights]
    (folder / "pasted.toml").write_text(JOB.replace('captured = "estimate"', line[line.index("captured = ") :]))
    pasted = job.load(folder / "pasted.toml").captured
    assert pasted is not None and pasted.environment is not None
    np.testing.assert_array_equal(pasted.environment.pixels, made.radiance.astype(np.float32))
    shining = [light for light in made.lighting.lights if light.intensity > 0]
    assert len(shining) == len(pasted.lights) == (0 if out == "dark.glb" else 2)
    assert (folder / out).exists() == bool(shining) == (str(folder / out) in said["files"])
    for old, new in zip(shining, pasted.lights, strict=True):
        assert type(old) is type(new)
        for field in fields(old):
            if field.name != "group":
                np.testing.assert_array_equal(getattr(old, field.name), getattr(new, field.name))


def test_named_lamps_are_listed_before_they_are_found(folder: Path) -> None:
    lamps = '{ estimate = true, lights = [{ type = "point", name = "desk", position = [1, 1, 1], intensity = 7 }] }'
    facts = of_job(loaded(folder, f"captured={lamps}"), folder / "job.toml")
    assert facts.captured is not None and facts.captured.estimated
    assert [(x.name, x.position) for x in facts.captured.lights] == [("desk", (1.0, 1.0, 1.0))]
    text = "\n".join(lines(facts))
    assert "light      desk: point, as strong as the splats tell, at (1, 1, 1)" in text


def test_without_splats_it_is_one_line(folder: Path) -> None:
    (folder / "job.toml").write_text(JOB.replace('splats = "yard.ply"\n', ""))
    with pytest.raises(InputError, match="no splats to tell it from"):
        loaded(folder)
    (folder / "job.toml").write_text(JOB.replace('"estimate"', "{ exposure = 1 }"))
    with pytest.raises(InputError, match="estimate = true"):
        loaded(folder)

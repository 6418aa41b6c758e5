"""What is traced for a served page: the layers of moved lights, in stages that newer requests end, and stills."""

from __future__ import annotations

import io
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from mirelight.apps.mixer import first_light, layers, rgb9e5
from mirelight.apps.mixer.first_light import FirstLight
from mirelight.apps.mixer.session import Session
from mirelight.apps.mixer.stills import View
from mirelight.io import job as jobs
from mirelight.io import splats
from mirelight.io.gltf.write import write_glb
from mirelight.io.png import encode_display
from mirelight.lighting import splat_light
from mirelight.lighting.splat_light import Places
from mirelight.model import F32, Camera, Job, LayerFactor, Lighting, PointLight, RenderSettings
from mirelight.model.unit_lights import LightSet, terms
from mirelight.pipeline import stages
from mirelight.pipeline.scene import Scene, prepare
from mirelight.pipeline.splat_light import SplatLight

from .mixer_scene import walls

JOB = """
splats = "splats.ply"
proxy = "proxy.glb"
resolution = [48, 36]
render.spp = 4

[captured]
environment = { radiance = [1, 1, 1] }

[[cameras]]
position = [0.5, 1.6, 4.2]
target = [0, 0.4, 0]
yfov = 40

[[lightings]]
name = "day"
environment = { radiance = [0.2, 0.3, 0.5] }
[[lightings.lights]]
type = "point"
name = "lamp"
position = [1, 1.5, 1]
color = [1, 0.7, 0.4]
[[lightings.lights]]
type = "point"
name = "left"
group = "pair"
position = [-1, 0.8, 0.5]
[[lightings.lights]]
type = "point"
name = "right"
group = "pair"
position = [1.2, 0.3, 1.2]
intensity = 0.5

[[lightings]]
name = "night"
[[lightings.lights]]
type = "point"
name = "lantern"
position = [1, 1.5, 1]
"""
STAGES = (8, 16, 32)


@pytest.fixture(scope="module")
def job(tmp_path_factory: pytest.TempPathFactory) -> Job:
    out = tmp_path_factory.mktemp("session")
    cloud, proxy = walls(20)
    splats.write(cloud, out / "splats.ply")
    write_glb(out / "proxy.glb", proxy, (), ())
    (out / "job.toml").write_text(JOB)
    return jobs.load(out / "job.toml")


@pytest.fixture(scope="module")
def scene(job: Job) -> Scene:
    return prepare(job)


@pytest.fixture(scope="module")
def made(scene: Scene) -> layers.MixLayers:
    return layers.make(scene, spp=4, lightings=scene.job.lightings)


def moved(job: Job, text: str) -> Job:
    return jobs.load_text(JOB + text, Path(job.source))


def traced(job: Job, layer: str, made: layers.MixLayers) -> np.ndarray:
    """A layer of a job's first lighting with the last stage's samples, as it is packed."""
    unit = next(x.unit for x in terms(job.lightings[0]) if x.layer == layer)
    light = SplatLight(prepare(job), STAGES[-1], None).light(LightSet((unit,)), layer)[0]
    packed, _ = rgb9e5.pack(made.layer_of(light)[None])
    return np.asarray(packed[0])


@pytest.mark.parametrize(
    ("error", "said"),
    [
        (RuntimeError("a kernel failed\n  it is said in more lines\nno room in the arena"), "no room in the arena"),
        (RuntimeError(), "no reason was given"),
        (MemoryError(), "not enough memory"),
    ],
)
def test_a_trace_that_fails_is_said_and_the_next_one_made(
    scene: Scene, made: layers.MixLayers, monkeypatch: pytest.MonkeyPatch, error: Exception, said: str
) -> None:
    told: list[str] = []
    session = Session(scene, made, STAGES, told.append)
    pair, trace = made.names.index("pair"), FirstLight.light

    def fails(self: FirstLight, lighting: Lighting) -> F32:
        monkeypatch.setattr(FirstLight, "light", trace)
        raise error

    monkeypatch.setattr(FirstLight, "light", fails)
    session.move(pair, 1, np.array([0.2, 1.1, 0.4]))
    session.run(until=lambda: True)
    (line,) = told
    assert line.startswith("pair: ") and said in line and session.state().trouble == line and "\n" not in line
    assert not session.state().layers
    session.move(pair, 1, np.array([0.2, 1.0, 0.4]))
    session.run(until=lambda: True)
    assert pair in session.state().layers and session.state().trouble == "" and len(told) == 1


def test_a_moved_light_is_the_layer_of_the_job_with_it_moved(scene: Scene, made: layers.MixLayers) -> None:
    session = Session(scene, made, STAGES)
    where = [0.2, 1.1, 0.4]
    pair = made.names.index("pair")
    assert session.move(pair, 1, np.array(where))
    session.run(lambda: True)
    state = session.state()
    assert set(state.layers) == {pair} and state.layers[pair].samples == STAGES[-1]
    assert state.moved == {(pair, 1): tuple(where)} and state.trouble == ""
    after = moved(scene.job, f"[moved.day]\nright = {where}\n")
    np.testing.assert_array_equal(np.frombuffer(state.layers[pair].packed, "<u4"), traced(after, "pair", made))


def test_lights_that_are_not_there_are_told(scene: Scene, made: layers.MixLayers) -> None:
    session = Session(scene, made, STAGES)
    base, lamp = made.names.index("base"), made.names.index("lamp")
    for layer, light in ((base, 0), (lamp, 1), (99, 0), (-1, 0), (lamp, -1)):
        assert not session.move(layer, light, np.zeros(3))
    assert session.state().version == 0


def test_a_lamp_that_two_lightings_share_has_a_handle_in_each(made: layers.MixLayers) -> None:
    day, night = made.lightings
    assert [(x.name, x.layer, x.light) for x in day.handles] == [("lamp", 0, 0), ("left", 1, 0), ("right", 1, 1)]
    assert [(x.name, x.layer, x.light) for x in night.handles] == [("lantern", 0, 0)]


class Interrupting(Session):
    """Moves the lamp again while it is traced with the most samples, once."""

    seen: list[int]

    def _heard(self, what: str, share: float) -> None:
        urgency = int(self._working[0]) if np.isfinite(self._working[0]) else -1
        self.seen = [*getattr(self, "seen", []), urgency]
        if urgency == 2 and self.seen.count(2) == 1:
            self.move(0, 0, np.array([0.0, 1.0, 0.0]))
        super()._heard(what, share)


def test_a_newer_place_ends_what_is_traced(scene: Scene, made: layers.MixLayers) -> None:
    session = Interrupting(scene, made, STAGES)
    session.move(0, 0, np.array([0.5, 1.5, 0.5]))
    session.run(lambda: True)
    stages_seen = [x for k, x in enumerate(session.seen) if k == 0 or session.seen[k - 1] != x]
    assert stages_seen == [-1, 1, 2, 1, 2]  # few samples come between, which nobody hears of
    after = moved(scene.job, "[moved]\nlamp = [0, 1, 0]\nlantern = [0, 1, 0]\n")
    np.testing.assert_array_equal(np.frombuffer(session.state().layers[0].packed, "<u4"), traced(after, "lamp", made))


def test_first_light_from_a_few_splats_is_near_the_whole(monkeypatch: pytest.MonkeyPatch) -> None:
    """Direct light is every splat's own; indirect light of neighbours is off by little."""
    _, proxy = walls(20)
    lighting = Lighting(lights=(PointLight(name="0", position=np.array([0.5, 1.0, 0.3]), intensity=3),))
    points, normals = even_points()
    tracer = splat_light.tracer_for(proxy, RenderSettings())
    whole = tracer.point_layers(lighting, points, normals, 512).total / np.pi
    monkeypatch.setattr(first_light, "FEW", 200)
    monkeypatch.setattr(first_light, "FEW_SAMPLES", 256)
    light: F32 = first_light.FirstLight(tracer, Places(points, normals, 1.0)).light(lighting)
    assert np.abs(light - whole).mean() < 0.01 * whole.mean()
    assert np.abs(light - whole).max() < 0.1 * whole.mean()


def even_points() -> tuple[np.ndarray, np.ndarray]:
    """(800, 3) places on floor and wall, and their normals."""
    s = np.linspace(-1.9, 1.9, 20)
    a, b = (x.ravel() for x in np.meshgrid(s, s))
    zero, one = np.zeros_like(a), np.ones_like(a)
    points = np.concatenate([np.stack([a, zero, b], 1), np.stack([a, b + 2, zero - 2], 1)])
    return points, np.concatenate([np.stack([zero, one, zero], 1), np.stack([zero, zero, one], 1)])


def test_a_still_is_the_frame_of_the_moved_job(scene: Scene, made: layers.MixLayers) -> None:
    session = Session(scene, made, STAGES)
    camera = Camera.look_at([1, 2, 3], [0, 0.5, 0], 40, 30, yfov=50, name="still")
    factors = (LayerFactor(layer="lamp", factor=np.array([2, 1, 0.5])), LayerFactor(layer="pair", factor=np.zeros(3)))
    session.move(0, 0, np.array([0.5, 1.5, 0.5]))
    session.ask_still(View(1, camera, "day", factors, 0.5))
    session.run(lambda: True)
    still = session.state().still
    assert still is not None and (still.number, still.state, still.done) == (1, "done", 1)
    text = "[moved]\nlamp = [0.5, 1.5, 0.5]\n[mix]\nlamp = [2, 1, 0.5]\npair = 0\n"
    job = moved(scene.job, text)
    frame = stages.frame(prepare(job), camera, job.lightings[0])
    wanted = encode_display(frame.rgba, replace(job.display, exposure=0.5), frame.profile)
    np.testing.assert_array_equal(np.asarray(Image.open(io.BytesIO(still.png))), wanted)

    session.ask_still(View(2, camera, None, (), 0.0))
    session.run(lambda: True)
    captured = session.state().still
    assert captured is not None and captured.state == "done"
    plain = encode_display(stages.frame(prepare(job), camera, None).rgba, job.display, "physical")
    np.testing.assert_array_equal(np.asarray(Image.open(io.BytesIO(captured.png))), plain)


def test_a_still_that_nobody_looks_at_ends(scene: Scene, made: layers.MixLayers) -> None:
    session = Session(scene, made, STAGES)
    camera = Camera.look_at([1, 2, 3], [0, 0.5, 0], 40, 30, yfov=50)
    heard: list[float] = []
    whole = session._heard

    def drop(what: str, share: float) -> None:
        heard.append(share)
        session.drop_still()
        whole(what, share)

    session._heard = drop  # type: ignore[method-assign]
    session.ask_still(View(1, camera, "day", (), 0.0))
    session.run(lambda: True)
    assert len(heard) == 1 and session.state().still is None

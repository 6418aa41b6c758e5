"""The pipeline with counted stand-ins for compositor and tracer: what is shared, what is skipped, what is told.

The fingerprint must change with everything that decides pixels, and with nothing else.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mirelight import pipeline, relight
from mirelight.errors import InputError
from mirelight.model import (
    Camera,
    CompositorSettings,
    DirectionalLight,
    DisplaySettings,
    Environment,
    Frame,
    Job,
    Lighting,
    LightingBuffer,
    LightLayer,
    Material,
    OutputSettings,
    ProxyMesh,
    RelightSettings,
    RenderSettings,
    Scene,
    SplatCloud,
    SplatLayer,
)
from mirelight.pipeline import FrameTask

W, H = 8, 6
WHITE = np.ones((1, 1, 3), dtype=np.float32)


def camera(name: str, x: float = 0.0) -> Camera:
    return Camera.look_at((x, 0, 3), (x, 0, 0), W, H, name=name)


def sun(name: str, lux: float = 1.0) -> Lighting:
    return Lighting(name=name, lights=(DirectionalLight(name="sun", direction=np.array([0, -1, 0]), intensity=lux),))


def cloud() -> SplatCloud:
    fields: dict[str, Any] = {
        "means": np.zeros((2, 3)),
        "quats": np.tile([1, 0, 0, 0], (2, 1)),
        "scales": np.full((2, 3), 0.1),
        "opacities": np.full(2, 0.5),
        "sh": np.zeros((2, 1, 3)),
    }
    return SplatCloud(**fields)


def triangle() -> ProxyMesh:
    return ProxyMesh(vertices=np.eye(3, dtype=np.float32), faces=np.array([[0, 1, 2]], dtype=np.int32))


def make_job(**changed: Any) -> Job:
    scene: dict[str, Any] = {
        "splats": cloud(),
        "proxy": triangle(),
        "cameras": (camera("front"), camera("side", 1.0)),
        "lightings": (sun("day", 3.0), sun("night", 0.1)),
        "captured": sun("captured", 2.0),
        "albedo_from_splats": False,
    }
    scene |= {k: changed.pop(k) for k in list(changed) if k in scene}
    fields: dict[str, Any] = {"source": Path("job.toml"), "relight": RelightSettings(mode="ratio"), **changed}
    return Job(scene=Scene(**scene), **fields)


class Counted:
    """Stand-ins for the two halves; every call is written down."""

    def __init__(self) -> None:
        self.calls: list[tuple[str, ...]] = []

    def compositor(self, splats: SplatCloud, settings: CompositorSettings, **kwargs: Any) -> Any:
        self.calls.append(("compositor",))
        counted = self

        class Compositor:
            def composite(self, view: Camera, *, depth: bool) -> SplatLayer:
                counted.calls.append(("composite", view.name, "depth" if depth else "no depth"))
                half: Any = np.full((view.height, view.width, 3), 0.5)
                flat = half[..., 0]
                return SplatLayer(camera=view, color=half / 2, transmittance=flat, depth=flat, median_depth=flat)

        return Compositor()

    def tracer(self, proxy: ProxyMesh, settings: RenderSettings, *, layers: bool, aovs: bool) -> Any:
        self.calls.append(("tracer", *(name for name, wanted in (("layers", layers), ("aovs", aovs)) if wanted)))
        counted = self

        class Tracer:
            def trace(self, lights: Lighting, view: Camera, progress: Callable[[int, int], None]) -> LightingBuffer:
                counted.calls.append(("trace", lights.name, view.name, f"{view.width}x{view.height}"))
                progress(settings.spp // 2, settings.spp)
                progress(settings.spp, settings.spp)
                light = lights.lights[0]
                assert isinstance(light, DirectionalLight)
                one: Any = np.ones((view.height, view.width, 3))
                return LightingBuffer(
                    camera=view,
                    coverage=one[..., 0],
                    layers=(LightLayer(name="sun", direct=one * light.intensity, indirect=0 * one),),
                    depth=one[..., 0],
                    position=one,
                    normal=one,
                    geometric_normal=one,
                    albedo=one,
                )

        return Tracer()

    def of(self, kind: str) -> list[tuple[str, ...]]:
        return [call[1:] for call in self.calls if call[0] == kind]


@pytest.fixture
def counted(monkeypatch: pytest.MonkeyPatch) -> Counted:
    stand_ins = Counted()
    monkeypatch.setattr("mirelight.compositor.Compositor", stand_ins.compositor)
    monkeypatch.setattr("mirelight.lighting.tracer", stand_ins.tracer)
    return stand_ins


class Told:
    def __init__(self) -> None:
        self.tasks: list[str] = []
        self.fractions: dict[str, list[float]] = {}
        self.ended: list[tuple[str, bool]] = []

    def started(self, tasks: Sequence[FrameTask]) -> None:
        self.tasks = [t.name for t in tasks]

    def samples(self, task: FrameTask, done: int, total: int) -> None:
        self.fractions.setdefault(task.name, []).append(done / total)

    def finished(self, task: FrameTask, skipped: bool) -> None:
        self.ended.append((task.name, skipped))


# --- plan ------------------------------------------------------------------------------------------------------------


def names(tasks: Sequence[FrameTask]) -> list[str]:
    return [t.name for t in tasks]


def test_every_camera_under_every_lighting_camera_by_camera() -> None:
    assert names(pipeline.plan(make_job())) == ["front.day", "front.night", "side.day", "side.night"]


def test_frames_are_chosen_by_name_without_changing() -> None:
    job = make_job()
    everything = {t.name: t.fingerprint for t in pipeline.plan(job)}
    some = pipeline.plan(job, cameras=["side"], lightings=["night", "day"])
    assert names(some) == ["side.day", "side.night"]
    assert all(everything[t.name] == t.fingerprint for t in some)


@pytest.mark.parametrize(("chosen", "exists"), [({"cameras": ["back"]}, "front, side"), ({"lightings": ["x"]}, "day")])
def test_an_unknown_name_lists_those_that_exist(chosen: dict[str, list[str]], exists: str) -> None:
    with pytest.raises(InputError, match=f"no (camera|lighting) named .*there are: {exists}"):
        pipeline.plan(make_job(), **chosen)


def test_names_are_safe_and_unique() -> None:
    cameras = (camera("../up"), camera("a b"), camera("a/b"), camera("A b"), camera(""))
    found = names(pipeline.plan(make_job(cameras=cameras, lightings=(sun("x"),))))
    assert found == ["_up.x", "a_b.x", "a_b.x-2", "A_b.x-3", "_.x"]


def test_a_job_without_lights_shows_the_splats(counted: Counted) -> None:
    job = make_job(lightings=(), proxy=None)
    tasks = pipeline.plan(job)
    assert names(tasks) == ["front", "side"]
    frames: list[Frame] = []
    pipeline.render(job, tasks, sink=lambda _, frame: frames.append(frame))
    assert frames[0].unlit is not None
    np.testing.assert_array_equal(frames[0].rgba, frames[0].unlit)
    assert not counted.of("trace")


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"proxy": None}, "no proxy mesh"),
        ({"captured": None}, "relight.mode.*captured|made under"),
        ({"splats": None, "lightings": ()}, "nothing to render"),
        ({"cameras": ()}, "no camera"),
    ],
)
def test_jobs_that_cannot_work_are_refused(changed: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        pipeline.plan(make_job(**changed))


# --- fingerprint -----------------------------------------------------------------------------------------------------


def fingerprint(**changed: Any) -> str:
    return pipeline.plan(make_job(**changed))[0].fingerprint


def moved(mesh: ProxyMesh) -> ProxyMesh:
    return replace(mesh, vertices=mesh.vertices + np.float32(1e-6))


RELEVANT: dict[str, dict[str, Any]] = {
    "a splat moved": {"splats": replace(cloud(), means=np.full((2, 3), 1e-6))},
    "the proxy moved": {"proxy": moved(triangle())},
    "the proxy's albedo": {"proxy": replace(triangle(), albedo=np.full(3, 0.4))},
    "the splats' colours on the proxy": {"albedo_from_splats": True},
    "a material": {"proxy": replace(triangle(), materials=(Material(base_color=np.array([1, 0, 0])),))},
    "the camera": {"cameras": (camera("front", 1e-6),)},
    "a light": {"lightings": (sun("day", 3.0000001),)},
    "an environment": {"lightings": (replace(sun("day", 3.0), environment=Environment(radiance=WHITE)),)},
    "the captured light": {"captured": sun("captured", 2.5)},
    "mode": {"relight": RelightSettings(mode="tint")},
    "blend": {"relight": RelightSettings(mode="ratio", blend=0.5)},
    "samples": {"render": RenderSettings(spp=65)},
    "seed": {"render": RenderSettings(seed=1)},
    "kernel": {"compositor": CompositorSettings(profile="playcanvas")},
    "exposure": {"display": DisplaySettings(exposure=0.5)},
    "half": {"output": OutputSettings(half=True)},
}

IRRELEVANT: dict[str, dict[str, Any]] = {
    "output folder": {"output": OutputSettings(directory=Path("elsewhere"))},
    "threads": {"render": RenderSettings(threads=1)},
    "memory": {"compositor": CompositorSettings(max_memory=1 << 30)},
    "the job file's place": {"source": Path("other/place.toml")},
    "another camera": {"cameras": (camera("front"), camera("third", 2.0))},
    "another lighting": {"lightings": (sun("day", 3.0), sun("dusk"), sun("night", 0.1))},
}


@pytest.mark.parametrize("changed", RELEVANT.values(), ids=RELEVANT.keys())
def test_the_fingerprint_changes_with_what_decides_pixels(changed: dict[str, Any]) -> None:
    assert fingerprint(**changed) != fingerprint()


@pytest.mark.parametrize("changed", IRRELEVANT.values(), ids=IRRELEVANT.keys())
def test_the_fingerprint_stays_with_all_else(changed: dict[str, Any]) -> None:
    assert fingerprint(**changed) == fingerprint()


def test_captured_light_is_irrelevant_to_a_tint() -> None:
    tint = {"relight": RelightSettings(mode="tint")}
    assert fingerprint(**tint) == fingerprint(**tint, captured=sun("captured", 9.0))


@pytest.mark.parametrize(
    "unused",
    [
        {"relight": RelightSettings(mode="tint")},
        {"render": RenderSettings(profile="playcanvas")},
        {"splats": None},
    ],
    ids=["tint", "the engine's light", "no splats"],
)
def test_the_proxy_takes_colours_only_where_they_are_of_use(unused: dict[str, Any]) -> None:
    """Elsewhere it stays gray, the same frames come out, and a warning says so."""
    plain, asked = make_job(**unused), make_job(**unused, albedo_from_splats=True)
    assert pipeline.lit_proxy(asked) is asked.scene.proxy
    assert pipeline.plan(asked)[0].fingerprint == pipeline.plan(plain)[0].fingerprint
    told = set(pipeline.warnings(asked, pipeline.plan(asked))) - set(pipeline.warnings(plain, pipeline.plan(plain)))
    assert told == {"proxy.albedo: the splats' colours are used in mode 'ratio' with path-traced light; gray here"}
    used = make_job(albedo_from_splats=True)
    assert not any("proxy.albedo" in line for line in pipeline.warnings(used, pipeline.plan(used)))


def test_the_fingerprint_changes_with_versions(monkeypatch: pytest.MonkeyPatch) -> None:
    before = fingerprint()
    monkeypatch.setattr("mirelight.provenance.versions", lambda: {"mirelight": "0.1.0", "mitsuba": "99"})
    assert fingerprint() != before


def test_frames_of_one_job_have_their_own_fingerprints() -> None:
    tasks = pipeline.plan(make_job())
    assert len({t.fingerprint for t in tasks}) == len(tasks)


# --- render ----------------------------------------------------------------------------------------------------------


def test_what_can_be_shared_is_made_once(counted: Counted) -> None:
    job = make_job()
    frames: dict[str, Frame] = {}
    summary = pipeline.render(job, pipeline.plan(job), sink=lambda task, frame: frames.update({task.name: frame}))

    assert (summary.rendered, summary.skipped) == (4, 0)
    assert list(frames) == ["front.day", "front.night", "side.day", "side.night"]
    assert len(counted.of("compositor")) == len(counted.of("tracer")) == 1
    assert counted.of("composite") == [("front", "depth"), ("side", "depth")]
    traces = [(light, view) for light, view, _ in counted.of("trace")]
    assert traces == [
        ("captured", "front"),
        ("day", "front"),
        ("night", "front"),
        ("captured", "side"),
        ("day", "side"),
        ("night", "side"),
    ]


def test_only_what_is_written_is_traced(counted: Counted) -> None:
    for output in (
        OutputSettings(),
        OutputSettings(layers=False),
        OutputSettings(aovs=False),
        OutputSettings(exr=False),
    ):
        job = make_job(output=output)
        pipeline.render(job, pipeline.plan(job), sink=lambda task, frame: None)
    assert counted.of("tracer") == [("layers", "aovs"), ("aovs",), ("layers",), ()]


def test_frames_are_those_of_apply(counted: Counted) -> None:
    job = make_job(relight=RelightSettings(mode="ratio", delta=0.0))
    frames: list[Frame] = []
    pipeline.render(job, pipeline.plan(job, ["front"], ["day"]), sink=lambda _, frame: frames.append(frame))
    unlit = frames[0].unlit
    assert unlit is not None
    np.testing.assert_allclose(frames[0].rgba[..., :3], unlit[..., :3] * (3.0 / 2.0), rtol=1e-6)


def test_tint_traces_no_captured_light(counted: Counted) -> None:
    job = make_job(relight=RelightSettings(mode="tint", texture_scale=0.5))
    pipeline.render(job, pipeline.plan(job, ["side"]), sink=lambda *_: None)
    assert counted.of("trace") == [("day", "side", "4x3"), ("night", "side", "4x3")]


def test_depth_is_not_composited_where_nobody_writes_it(counted: Counted) -> None:
    job = make_job(output=OutputSettings(exr=False))
    pipeline.render(job, pipeline.plan(job, ["front"], ["day"]), sink=lambda *_: None)
    assert counted.of("composite") == [("front", "no depth")]


def test_without_splats_the_lit_proxy_is_rendered(counted: Counted) -> None:
    job = make_job(splats=None)
    frames: list[Frame] = []
    pipeline.render(job, pipeline.plan(job, ["front"]), sink=lambda _, frame: frames.append(frame))
    assert len(frames) == 2
    assert not counted.of("composite")
    assert [t[0] for t in counted.of("trace")] == ["day", "night"]


def test_existing_frames_cost_nothing(counted: Counted) -> None:
    job = make_job()
    told = Told()
    made: list[str] = []
    summary = pipeline.render(
        job,
        pipeline.plan(job),
        is_done=lambda task: task.name != "side.night",
        sink=lambda task, _: made.append(task.name),
        progress=told,
    )
    assert (summary.rendered, summary.skipped, made) == (1, 3, ["side.night"])
    assert counted.of("composite") == [("side", "depth")]
    assert [t[:2] for t in counted.of("trace")] == [("captured", "side"), ("night", "side")]
    assert told.ended == [("front.day", True), ("front.night", True), ("side.day", True), ("side.night", False)]


def test_nothing_is_set_up_when_all_is_there(counted: Counted) -> None:
    job = make_job()
    assert pipeline.render(job, pipeline.plan(job), is_done=lambda _: True, sink=lambda *_: None).skipped == 4
    assert counted.calls == []


def test_a_stopped_render_goes_on_where_it_stopped(counted: Counted) -> None:
    job = make_job()
    kept: set[str] = set()

    def stop_after_two(task: FrameTask, frame: Frame) -> None:
        if len(kept) == 2:
            raise KeyboardInterrupt
        kept.add(task.fingerprint)

    with pytest.raises(KeyboardInterrupt):
        pipeline.render(job, pipeline.plan(job), is_done=lambda t: t.fingerprint in kept, sink=stop_after_two)
    again = pipeline.render(
        job,
        pipeline.plan(job),
        is_done=lambda t: t.fingerprint in kept,
        sink=lambda task, _: kept.add(task.fingerprint),
    )
    assert (again.rendered, again.skipped, len(kept)) == (2, 2, 4)


def test_progress_rises_to_one_for_each_frame(counted: Counted) -> None:
    job = make_job()
    told = Told()
    pipeline.render(job, pipeline.plan(job), sink=lambda *_: None, progress=told)
    assert told.tasks == list(told.fractions)
    assert told.fractions["front.day"] == [0.25, 0.5, 0.75, 1.0]  # the captured light is this frame's first half
    assert told.fractions["front.night"] == [0.5, 1.0]


def test_a_frame_says_what_made_it(counted: Counted) -> None:
    job = make_job(inputs={"splats.ply": "ab" * 32})
    frames: dict[str, Frame] = {}
    tasks = pipeline.plan(job)
    pipeline.render(job, tasks, sink=lambda task, frame: frames.update({task.name: frame}))
    made_by = frames["side.night"].made_by
    assert made_by is not None
    assert made_by.fingerprint == tasks[3].fingerprint
    assert made_by.lighting == "night"
    assert made_by.inputs == {"splats.ply": "ab" * 32}
    assert made_by.settings["relight"]["mode"] == "ratio"
    assert "directory" not in made_by.settings["output"]
    assert made_by.versions["mitsuba"]


def test_layers_can_be_weighed_without_tracing_again(counted: Counted) -> None:
    """One trace serves many intensities: scaled layers relight exactly as a light of that intensity."""
    job = make_job(relight=RelightSettings(mode="tint"))
    frames: list[Frame] = []
    pipeline.render(job, pipeline.plan(job, ["front"], ["day"]), sink=lambda _, frame: frames.append(frame))
    traced, splats = frames[0].lighting, frames[0].splats
    assert traced is not None
    layer = traced.layers[0]
    dimmed = replace(traced, layers=(replace(layer, direct=layer.direct * np.float32(0.1 / 3)),))
    by_weight = relight.apply(splats, dimmed, job.relight)
    pipeline.render(job, pipeline.plan(job, ["front"], ["night"]), sink=lambda _, frame: frames.append(frame))
    np.testing.assert_allclose(by_weight.rgba, frames[1].rgba, rtol=1e-6)

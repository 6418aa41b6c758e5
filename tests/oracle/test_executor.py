"""Plans and their running with counted stand-ins for compositor and tracer: what is shared, found, and made again."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mirelight.base.errors import InputError
from mirelight.batch import executor
from mirelight.io.exr import read_exr
from mirelight.model import (
    Camera,
    CompositorSettings,
    Deferred,
    DirectionalLight,
    DisplaySettings,
    Environment,
    Job,
    Lighting,
    LightingBuffer,
    LightLayer,
    OutputSettings,
    PointLight,
    ProxyMesh,
    RelightSettings,
    RenderSettings,
    SplatCloud,
    SplatLayer,
)
from mirelight.pipeline import scene, stages
from mirelight.pipeline.plan import FrameTask, plan, warnings
from mirelight.store import Store

W, H = 8, 6


def camera(name: str, x: float = 0.0) -> Camera:
    return Camera.look_at((x, 0, 3), (x, 0, 0), W, H, name=name)


def sun(name: str, lux: float = 1.0, towards: tuple[float, float, float] = (0, -1, 0)) -> Lighting:
    light = DirectionalLight(name="sun", direction=np.array(towards), intensity=lux)
    return Lighting(name=name, lights=(light,))


def lamp(name: str, candela: float = 1.0, x: float = 0.0) -> PointLight:
    return PointLight(name=name, position=np.array([x, 2.0, 0.0]), intensity=candela)


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


def make_job(folder: Path = Path("out"), **changed: Any) -> Job:
    fields: dict[str, Any] = {
        "source": Path("job.toml"),
        "splats": Deferred.of(cloud()),
        "proxy": Deferred.of(triangle()),
        "cameras": (camera("front"), camera("side", 1.0)),
        "lightings": (sun("day", 3.0), sun("night", 0.1, (0, -1, 1))),
        "captured": sun("captured", 2.0, (1, -1, 0)),
        "relight": RelightSettings(mode="ratio"),
        "output": OutputSettings(directory=folder),
    }
    return Job(**{**fields, **changed})


class Counted:
    """Stand-ins for the two halves; every call is written down."""

    def __init__(self) -> None:
        self.calls: list[tuple[str, ...]] = []
        self.stop_after: int | None = None  # traces after which the next one is interrupted

    def compositor(self, splats: SplatCloud, settings: CompositorSettings, **kwargs: Any) -> Any:
        self.calls.append(("compositor",))
        counted = self

        class Compositor:
            def composite(self, view: Camera, *, depth: bool, diffuse: bool = False) -> SplatLayer:
                counted.calls.append(("composite", view.name, "depth" if depth else "no depth"))
                half: Any = np.full((view.height, view.width, 3), 0.5)
                flat = half[..., 0]
                return SplatLayer(camera=view, color=half / 2, transmittance=flat, depth=flat, median_depth=flat)

        return Compositor()

    def tracer(self, proxy: ProxyMesh, settings: RenderSettings, *, layers: bool, aovs: bool) -> Any:
        self.calls.append(("tracer", *(name for name, wanted in (("layers", layers), ("aovs", aovs)) if wanted)))
        counted = self

        class Tracer:
            def trace(
                self, lights: Lighting, view: Camera, *, emission: bool, progress: Callable[[int, int], None] | None
            ) -> LightingBuffer:
                strengths: dict[str, Any] = {}
                for light in lights.lights:
                    name = light.group or light.name
                    strengths[name] = strengths.get(name, 0) + light.intensity * light.color
                if lights.environment is not None:
                    strengths[lights.environment.name] = np.full(3, lights.environment.intensity)
                names = list(strengths)
                counted.calls.append(("trace", view.name, f"{view.width}x{view.height}", *names))
                if counted.stop_after is not None and len(counted.of("trace")) > counted.stop_after:
                    raise KeyboardInterrupt
                if progress is not None:
                    progress(settings.spp // 2, settings.spp)
                    progress(settings.spp, settings.spp)
                one: Any = np.ones((view.height, view.width, 3))
                made = (
                    LightLayer(name=name, direct=one * strength, indirect=0 * one, variance=one * 0.01)
                    for name, strength in strengths.items()
                )
                return LightingBuffer(
                    camera=view,
                    coverage=one[..., 0],
                    layers=tuple(made),
                    depth=one[..., 0],
                    position=one,
                    normal=one,
                    geometric_normal=one,
                    albedo=one,
                    variance=one * 0.01 * len(names),
                )

        return Tracer()

    def of(self, kind: str) -> list[tuple[str, ...]]:
        return [call[1:] for call in self.calls if call[0] == kind]

    def forget(self) -> None:
        self.calls.clear()


@pytest.fixture
def counted(monkeypatch: pytest.MonkeyPatch) -> Counted:
    stand_ins = Counted()
    monkeypatch.setattr("mirelight.compositor.Compositor", stand_ins.compositor)
    monkeypatch.setattr("mirelight.lighting.tracer", stand_ins.tracer)
    monkeypatch.setattr("mirelight.lighting.level.captured_level", lambda *_: 1.0)
    return stand_ins


class Heard(executor.Progress):
    def __init__(self) -> None:
        self.tasks: list[str] = []
        self.fractions: dict[str, list[float]] = {}
        self.ended: list[tuple[str, bool]] = []
        self.failures: dict[str, str] = {}
        self.notes: list[str] = []

    def started(self, tasks: Sequence[FrameTask]) -> None:
        self.tasks = [t.name for t in tasks]

    def samples(self, task: FrameTask, done: int, total: int) -> None:
        self.fractions.setdefault(task.name, []).append(done / total)

    def finished(self, task: FrameTask, seconds: float | None) -> None:
        self.ended.append((task.name, seconds is None))

    def failed(self, task: FrameTask, error: str) -> None:
        self.failures[task.name] = error

    def working(self, frames: Sequence[str]) -> None: ...

    def waiting(self, cameras: int) -> None: ...

    def note(self, line: str) -> None:
        self.notes.append(line)


def run(job: Job, heard: Heard | None = None, **chosen: list[str]) -> executor.RenderSummary:
    store = Store(job)
    store.open()
    try:
        return executor.run(plan(job, **chosen), store, heard)
    finally:
        store.close()


# --- plan ------------------------------------------------------------------------------------------------------------


def names(job: Job, **chosen: list[str]) -> list[str]:
    return [t.name for t in plan(job, **chosen).tasks]


def test_every_camera_under_every_lighting_camera_by_camera() -> None:
    assert names(make_job()) == ["front.day", "front.night", "side.day", "side.night"]


def test_frames_are_chosen_by_name_without_changing() -> None:
    job = make_job()
    everything = {t.name: t.files for t in plan(job).tasks}
    some = plan(job, cameras=["side"], lightings=["night", "day"]).tasks
    assert [t.name for t in some] == ["side.day", "side.night"]
    assert all(everything[t.name] == t.files for t in some)


@pytest.mark.parametrize(("chosen", "exists"), [({"cameras": ["back"]}, "front, side"), ({"lightings": ["x"]}, "day")])
def test_an_unknown_name_lists_those_that_exist(chosen: dict[str, list[str]], exists: str) -> None:
    with pytest.raises(InputError, match=f"no (camera|lighting) named .*there are: {exists}"):
        plan(make_job(), **chosen)


def test_names_are_safe_and_unique() -> None:
    cameras = (camera("../up"), camera("a b"), camera("a/b"), camera("A b"), camera(""))
    assert names(make_job(cameras=cameras, lightings=(sun("x"),))) == ["_up.x", "a_b.x", "a_b.x-2", "A_b.x-3", "_.x"]


def test_names_of_many_alike_stay_quick_and_unique() -> None:
    found = names(make_job(cameras=tuple(camera("c") for _ in range(3000)), lightings=(), proxy=None, captured=None))
    assert found[:2] == ["c", "c-2"] and len(set(found)) == 3000


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
        plan(make_job(**changed))


def test_planning_reads_nothing() -> None:
    def fail() -> Any:
        raise AssertionError("read")

    sky = Environment(radiance=Deferred("sky", fail))
    lightings = tuple(replace(sun(f"l{i}"), environment=sky) for i in range(20))
    job = make_job(splats=Deferred("splats", fail), proxy=Deferred("proxy", fail), lightings=lightings)
    assert len(plan(job).tasks) == 40


def test_the_proxy_takes_colours_only_where_they_are_of_use() -> None:
    """Elsewhere it stays gray, the same frames come out, and a warning says so."""
    gray = "proxy.albedo: the splats' colours are used in modes 'ratio' and 'albedo' with path-traced light; gray here"
    for unused in ({"relight": RelightSettings(mode="tint")}, {"splats": None}):
        plain, asked = make_job(**unused), make_job(**unused, albedo_from_splats=True)
        assert [t.files for t in plan(asked).tasks] == [t.files for t in plan(plain).tasks]
        assert set(warnings(plan(asked))) - set(warnings(plan(plain))) == {gray}
        assert scene.prepare(asked).proxy is (asked.proxy and asked.proxy.value)
    assert gray not in warnings(plan(make_job(albedo_from_splats=True)))


# --- running ---------------------------------------------------------------------------------------------------------


def test_what_can_be_shared_is_made_once(counted: Counted, tmp_path: Path) -> None:
    summary = run(make_job(tmp_path))
    assert (summary.rendered, summary.skipped) == (4, 0)
    assert len(counted.of("compositor")) == len(counted.of("tracer")) == 1
    assert counted.of("composite") == [("front", "depth"), ("side", "depth")]
    assert [x[0] for x in counted.of("trace")] == ["front"] * 3 + ["side"] * 3  # captured, day, night


def test_lightings_that_share_light_trace_it_once(counted: Counted, tmp_path: Path) -> None:
    sky = Environment(radiance=np.ones((2, 4, 3), np.float32), rotation=30)
    a, b, c = lamp("a", 5), lamp("b", 7, 1.0), lamp("c", 2, 2.0)
    job = make_job(
        tmp_path,
        cameras=(camera("front"),),
        lightings=(
            Lighting(name="all", lights=(a, b), environment=sky),
            Lighting(name="dim", lights=(replace(a, name="other", intensity=1, color=np.array([1, 0, 0])),)),
            Lighting(name="more", lights=(b, c), environment=replace(sky, intensity=0.5)),
            Lighting(name="turned", environment=replace(sky, rotation=40)),
        ),
        captured=Lighting(name="captured", lights=(c,), environment=sky),
    )
    run(job)
    traced = sorted(x[2:] for x in counted.of("trace"))
    assert traced == [("0",), ("0",), ("0", "1", "2")]  # lamp c, the turned sky, and all of the first lighting


def test_a_mixture_is_what_a_trace_of_its_lights_gives(counted: Counted, tmp_path: Path) -> None:
    """Layers by the lighting's own names and order, colours and intensities multiplied in."""
    a, b = replace(lamp("a", 5), color=np.array([1, 0.5, 0])), lamp("b", 7, 1.0)
    grouped = tuple(replace(lamp(f"g{i}", 1.0 + i, 3.0 + i), group="chain") for i in range(2))
    sky = Environment(radiance=np.ones((2, 4, 3), np.float32), intensity=0.25)
    both = Lighting(name="both", lights=(b, *grouped, a), environment=sky)
    job = make_job(tmp_path, lightings=(Lighting(name="one", lights=(a,)), both), relight=RelightSettings())
    lit = stages.light(scene.prepare(job), job.cameras[0], both).new
    assert [x.name for x in lit.layers] == ["b", "chain", "a", "environment"]
    first = [x.direct[0, 0].tolist() for x in lit.layers]
    assert first[0] == [7, 7, 7] and first[2] == [5, 2.5, 0] and first[3] == [0.25, 0.25, 0.25]
    assert lit.variance is not None and lit.layers[2].variance is not None
    np.testing.assert_allclose(lit.layers[2].variance[0, 0], [0.25, 0.0625, 0], rtol=1e-6)


def test_only_what_is_written_is_traced(counted: Counted, tmp_path: Path) -> None:
    plain = OutputSettings()
    alone = replace(plain, store="frames")
    less = replace(alone, layers=False), replace(plain, aovs=False), replace(plain, exr=False)
    for i, output in enumerate((plain, *less)):
        run(make_job(output=replace(output, directory=tmp_path / str(i))))
    assert counted.of("tracer") == [("layers", "aovs"), ("aovs",), ("layers",), ("layers",)]


def test_tint_traces_no_captured_light(counted: Counted, tmp_path: Path) -> None:
    job = make_job(tmp_path, relight=RelightSettings(mode="tint", texture_scale=0.5))
    run(job, cameras=["side"])
    assert [x[:2] for x in counted.of("trace")] == [("side", "4x3")] * 2


def test_without_splats_the_lit_proxy_is_rendered(counted: Counted, tmp_path: Path) -> None:
    run(make_job(tmp_path, splats=None), cameras=["front"])
    assert not counted.of("composite") and len(counted.of("trace")) == 2


def test_a_job_without_lights_shows_the_splats(counted: Counted, tmp_path: Path) -> None:
    job = make_job(tmp_path, lightings=(), proxy=None)
    assert run(job).rendered == 2
    picture = read_exr(tmp_path / "front.exr")
    np.testing.assert_array_equal(picture.layer()[..., :3], picture.layer("unlit")[..., :3])
    assert not counted.of("trace")


def test_existing_frames_cost_nothing(counted: Counted, tmp_path: Path) -> None:
    job = make_job(tmp_path)
    run(job)
    (tmp_path / "side.night.exr").unlink()
    counted.forget()
    heard = Heard()
    summary = run(job, heard)
    assert (summary.rendered, summary.skipped) == (1, 3)
    assert counted.of("composite") == [("side", "depth")] and not counted.of("trace")
    assert sorted(heard.ended) == [
        ("front.day", True),
        ("front.night", True),
        ("side.day", True),
        ("side.night", False),
    ]
    counted.forget()
    assert run(job).skipped == 4 and counted.calls == []


def test_a_stopped_render_goes_on_where_it_stopped(counted: Counted, tmp_path: Path) -> None:
    job = make_job(tmp_path)
    counted.stop_after = 4
    with pytest.raises(KeyboardInterrupt):
        run(job)
    counted.stop_after = None
    counted.forget()
    again = run(job)
    assert (again.rendered, again.skipped) == (2, 2)
    assert len(counted.of("trace")) == 2  # the captured light of the second camera was kept


def test_progress_rises_to_one_for_each_frame(counted: Counted, tmp_path: Path) -> None:
    heard = Heard()
    run(make_job(tmp_path), heard)
    assert heard.tasks == list(heard.fractions)
    assert heard.fractions["front.day"] == [0.25, 0.5, 0.75, 1.0]  # the captured light is this frame's first half
    assert heard.fractions["front.night"] == [0.5, 1.0]


def test_a_frame_says_what_made_it(counted: Counted, tmp_path: Path) -> None:
    job = make_job(tmp_path, inputs={"splats.ply": "ab" * 32})
    frame = stages.frame(scene.prepare(job), job.cameras[1], job.lightings[1])
    made_by = frame.made_by
    assert made_by is not None and made_by.lighting == "night"
    assert made_by.inputs == {"splats.ply": "ab" * 32}
    assert made_by.settings["relight"]["mode"] == "ratio"
    assert "directory" not in made_by.settings["output"]
    assert made_by.versions["mitsuba"]


# --- what a change makes again ---------------------------------------------------------------------------------------

BASE = RelightSettings(mode="ratio")
CHANGES: dict[str, tuple[dict[str, Any], str]] = {
    "nothing": ({}, "-"),
    "the output folder's neighbours: threads": ({"render": RenderSettings(threads=1)}, "-"),
    "a setting of another mode": ({"relight": replace(BASE, brightness=3.0)}, "-"),
    "the exposure": ({"display": DisplaySettings(exposure=1.0)}, "composite png"),
    "16-bit colours": ({"output": {"half": True}}, "composite exr"),
    "the largest ratio": ({"relight": replace(BASE, max_ratio=4.0)}, "composite exr png"),
    "a camera's name": ({"cameras": (camera("left"), camera("side", 1.0))}, "composite exr png"),
    "a light's intensity": ({"lightings": (sun("day", 9.0), sun("night", 0.1, (0, -1, 1)))}, "composite exr png"),
    "a light's place": ({"lightings": (sun("day", 3.0, (0, -1, 0.1)), sun("night", 0.1, (0, -1, 1)))}, "all"),
    "the samples": ({"render": RenderSettings(spp=65)}, "all"),
    "the proxy": ({"proxy": Deferred.of(replace(triangle(), albedo=np.full(3, 0.4)))}, "all"),
    "the splats": ({"splats": Deferred.of(replace(cloud(), means=np.full((2, 3), 1e-6)))}, "composite exr png"),
}


@pytest.mark.parametrize("change", CHANGES)
def test_only_what_changed_is_made_again(counted: Counted, tmp_path: Path, change: str) -> None:
    """One camera under its first lighting, rendered before and after the change."""
    run(make_job(tmp_path), cameras=["front"], lightings=["day"])
    before = {p.suffix: p.read_bytes() for p in tmp_path.glob("front.day.*")}
    counted.forget()
    changed, expected = CHANGES[change]
    changed = {**changed}
    output = OutputSettings(directory=tmp_path, **changed.pop("output", {}))
    job = make_job(**changed, output=output)
    name = job.cameras[0].name
    run(job, cameras=[name], lightings=["day"])
    after = {p.suffix: p.read_bytes() for p in tmp_path.glob(f"{name}.day.*")}
    made = [kind for kind in ("composite", "trace") if counted.of(kind)]
    made += [suffix[1:] for suffix in (".exr", ".png") if after[suffix] != before[suffix]]
    assert " ".join(made) or expected == "-" if expected != "all" else "trace" in made
    assert (" ".join(made) or "-") == ("composite trace exr png" if expected == "all" else expected)


def test_kept_light_can_go_at_any_time(counted: Counted, tmp_path: Path) -> None:
    job = make_job(tmp_path)
    run(job)
    for file in (tmp_path / ".mirelight" / "light").iterdir():
        file.write_bytes(b"damaged")
    changed = replace(job, display=DisplaySettings(exposure=1))
    counted.forget()
    run(changed)
    assert len(counted.of("trace")) == 6
    shutil.rmtree(tmp_path / ".mirelight")
    counted.forget()
    assert run(changed).skipped == 4 and counted.calls == []  # the files themselves say what they are


def test_nothing_is_kept_where_the_job_says_so(counted: Counted, tmp_path: Path) -> None:
    run(make_job(output=OutputSettings(directory=tmp_path, store="frames")))
    assert not list((tmp_path / ".mirelight" / "light").iterdir())

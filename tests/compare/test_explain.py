"""The ladder from the real-time frame to the physical one: its measure, its light, and whom it blames."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mirelight.apps.explain.ladder import explain
from mirelight.apps.explain.light import LitSurface, shadows
from mirelight.apps.explain.recipe import EngineRun, physical_display, physical_settings
from mirelight.apps.explain.report import write_ladder
from mirelight.apps.explain.types import CAUSES, Ladder, Rung, summary
from mirelight.apps.realtime import EngineFrames
from mirelight.base.errors import InputError
from mirelight.io.png import encode_display
from mirelight.lighting import Tracer
from mirelight.lighting.engine.raster import rasterise
from mirelight.lighting.visibility import ShadowRays
from mirelight.model import (
    AreaLight,
    Camera,
    CompositorSettings,
    Deferred,
    DirectionalLight,
    DisplaySettings,
    Environment,
    Inserted,
    Job,
    Light,
    Lighting,
    OutputSettings,
    PointLight,
    ProxyMesh,
    RelightSettings,
    RenderSettings,
    SplatCloud,
    SpotLight,
    SunLight,
)
from mirelight.pipeline import stages
from mirelight.pipeline.scene import prepare

CAMERA = Camera.look_at((0, 0, 4), (0, 0, 0), 96, 64, yfov=40, near=0.1, far=50)


# --- scenes ----------------------------------------------------------------------------------------------------------


def quads(*corners: Any) -> ProxyMesh:
    """Quads, each by four corners counter-clockwise, albedo 0.5."""
    vertices = np.asarray(corners, dtype=np.float32).reshape(-1, 3)
    faces = np.concatenate([np.array([[0, 1, 2], [0, 2, 3]]) + 4 * k for k in range(len(corners))])
    return ProxyMesh(vertices=vertices, faces=faces.astype(np.int32))


def wall(x0: float = -5, x1: float = 5, z: float = 0) -> Any:
    """A wall that faces the camera."""
    return [(x0, -5, z), (x1, -5, z), (x1, 5, z), (x0, 5, z)]


SIDE = [(-1.2, -5, 5), (-1.2, -5, 0), (-1.2, 5, 0), (-1.2, 5, 5)]  # faces +X, meets the wall on the left
LID = [(-5, 1.6, 0.5), (-5, 1.6, 1.5), (5, 1.6, 1.5), (5, 1.6, 0.5)]  # above the view


def cloud(size: float = 0.3, spacing: float = 0.2, shades: bool = False) -> SplatCloud:
    """Splats on the wall, of one gray or of two."""
    x, y = np.meshgrid(np.arange(-2.4, 2.5, spacing), np.arange(-1.8, 1.9, spacing))
    n = x.size
    means = np.stack([x.ravel(), y.ravel(), np.zeros(n)], axis=-1)
    gray = np.where(np.arange(n) % 2, 0.35, 0.75) if shades else np.full(n, 0.6)
    return SplatCloud(
        means=means.astype(np.float32),
        quats=np.tile(np.array([1, 0, 0, 0], np.float32), (n, 1)),
        scales=np.full((n, 3), size, np.float32),
        opacities=np.full(n, 0.9, np.float32),
        sh=((gray - 0.5) / 0.28209479)[:, None, None].repeat(3, axis=2).astype(np.float32),
    )


def make_job(
    *meshes: Any, lights: tuple[Light, ...] = (), sky: Any = None, splats: SplatCloud | None = None, **settings: Any
) -> Job:
    """One camera, one lighting; tinted in display space, so that the tint is no cause."""
    environment = None if sky is None else Environment(radiance=np.full((1, 1, 3), sky, np.float32))
    return Job(
        source=Path("made.toml"),
        splats=Deferred.of(splats or cloud()),
        proxy=Deferred.of(quads(*meshes)),
        cameras=(CAMERA,),
        lightings=(Lighting(name="made", lights=lights, environment=environment),),
        render=replace(RenderSettings(spp=64, max_depth=6), **settings.pop("render", {})),
        relight=replace(RelightSettings(space="display"), **settings.pop("relight", {})),
        **settings,
    )


def ladder_of(job: Job) -> Ladder:
    return explain(job, job.cameras[0], job.lightings[0])


FRONT = DirectionalLight(name="front", direction=np.array([0.0, 0, -1]), intensity=2.0)
LEFT = DirectionalLight(name="left", direction=np.array([-1.0, 0, -1]), intensity=3.0)
OVER = np.array([0.0, -1, -0.8])
NO_FACE = ProxyMesh(vertices=np.zeros((0, 3), np.float32), faces=np.zeros((0, 3), np.int32))


# --- the measure -----------------------------------------------------------------------------------------------------


def made_ladder(*frames: Any) -> Ladder:
    names = ["engine", *CAUSES][: len(frames)]
    rungs = tuple(Rung(name, name, "", np.asarray(f, dtype=np.float32)) for name, f in zip(names, frames, strict=True))
    return Ladder("made", rungs, (), "nobody", False)


def test_steps_add_up_to_the_whole() -> None:
    rng = np.random.default_rng(5)
    ladder = made_ladder(*rng.random((7, 24, 32, 3)))
    assert sum(s.share for s in ladder.steps) == pytest.approx(1, abs=1e-12)
    assert sum(s.squared for s in ladder.steps) == pytest.approx(ladder.whole.squared, rel=1e-12)
    assert sum(s.brightness for s in ladder.steps) == pytest.approx(ladder.whole.brightness, abs=1e-9)
    assert ladder.whole.squared == pytest.approx(10 ** (-ladder.whole.psnr / 10))
    assert "all together" in summary(ladder)


def test_shares_say_how_far_each_step_goes_along_the_way() -> None:
    dark, gray, light = (np.full((16, 16, 3), x) for x in (0.2, 0.5, 0.6))
    steps = made_ladder(dark, light, gray, gray).steps
    assert [s.share for s in steps] == pytest.approx([4 / 3, -1 / 3, 0], abs=1e-6)
    stripes = gray + np.where(np.arange(16) % 2, 0.1, -0.1)[None, :, None]  # at right angles to the way
    assert [s.share for s in made_ladder(dark, gray, stripes, gray).steps] == pytest.approx([1, 0, 0], abs=1e-6)


def test_equal_frames_have_no_causes() -> None:
    one = np.full((16, 16, 3), 0.4)
    ladder = made_ladder(one, one, one)
    assert [s.share for s in ladder.steps] == [0, 0]
    assert ladder.whole.psnr == math.inf


ABOVE = np.eye(4)  # of a light before the wall that shines at it
ABOVE[:3, 3] = 0.3, 0.4, 2.5


# --- the light between ------------------------------------------------------------------------------------------------


def lit_surface(proxy: ProxyMesh, lighting: Lighting) -> LitSurface:
    surface = rasterise(proxy, CAMERA)
    albedo = np.full((CAMERA.height, CAMERA.width, 3), 0.5, np.float32)
    return LitSurface(CAMERA, surface, albedo, shadows(ShadowRays(proxy), surface, CAMERA, lighting))


@pytest.mark.parametrize(
    "light",
    [
        DirectionalLight(name="a", direction=np.array([0.3, -0.5, -1]), color=np.array([1, 0.5, 0.2]), intensity=3),
        PointLight(name="a", position=np.array([0.4, 0.7, 1.1]), intensity=5, range=3),
        SpotLight(
            name="a",
            position=np.array([0, 1.5, 2.0]),
            direction=np.array([0, -0.6, -1]),
            intensity=5,
            inner_cone_angle=0.2,
            outer_cone_angle=0.6,
        ),
        AreaLight(name="a", shape="disk", world_from_light=ABOVE, size=(0.1, 0.1), intensity=300),
        AreaLight(name="a", shape="sphere", world_from_light=ABOVE, size=(0.1, 0.1), intensity=300),
    ],
    ids=["directional", "point", "spot", "disk", "sphere"],
)
def test_lights_follow_the_laws_that_the_tracer_has(light: Light) -> None:
    proxy = quads(wall())
    lighting = Lighting(lights=(light,))
    ours = lit_surface(proxy, lighting).lights((light,))
    traced = Tracer(proxy, RenderSettings(spp=256, max_depth=1)).trace(lighting, CAMERA).beauty
    np.testing.assert_allclose(ours, traced, atol=0.01 * traced.max())
    assert traced.max() > 0.01


def test_the_sky_is_summed_as_it_is_traced() -> None:
    rng = np.random.default_rng(3)
    radiance = rng.random((16, 32, 3)).astype(np.float32)
    radiance[5, 20:23] = 30  # a sun
    environment = Environment(radiance=radiance, intensity=0.7, rotation=37)
    for tilt in (0.0, 1.0, -1.3):  # walls that lean, so that other parts of the sky are seen
        turn = np.array([[1, 0, 0], [0, math.cos(tilt), -math.sin(tilt)], [0, math.sin(tilt), math.cos(tilt)]])
        proxy = quads(np.asarray(wall()) @ turn.T)
        lighting = Lighting(environment=environment)
        ours = lit_surface(proxy, lighting).environment(environment)[32, 48]
        traced = Tracer(proxy, RenderSettings(spp=256, max_depth=1)).trace(lighting, CAMERA).beauty
        np.testing.assert_allclose(ours, traced[24:40, 40:56].mean(axis=(0, 1)), rtol=0.01)


def test_shadow_rays_find_the_shadow_of_a_lid() -> None:
    light = DirectionalLight(name="sun", direction=OVER)
    proxy = quads(wall(), LID)
    seen = shadows(ShadowRays(proxy), rasterise(proxy, CAMERA), CAMERA, Lighting(lights=(light,)))[0]
    # the lid's edges at z = 0.5 and 1.5 fall to y = 1.6 - z / 0.8
    row = np.array([CAMERA.cy - CAMERA.fy * (1.6 - z / 0.8) / 4 for z in (0.5, 1.5)])
    centres = np.arange(CAMERA.height) + 0.5
    np.testing.assert_array_equal(seen[:, 48], (centres < row[0]) | (centres > row[1]))


def test_the_engine_looks_shadows_up_off_the_surface() -> None:
    """The lid's shadow as points in front of the wall see it: by the bias; for a lamp, more where its light is flat."""
    bias = 0.2
    proxy = quads(wall(), LID)
    surface, rays = rasterise(proxy, CAMERA), ShadowRays(proxy)
    sun = DirectionalLight(name="sun", direction=OVER)
    torch = SpotLight(name="torch", position=np.array([0.0, 4.0, 3.0]), direction=np.array([0.0, -1, -1]))
    lamp = PointLight(name="lamp", position=torch.position)
    lights = Lighting(lights=(sun, torch, lamp))
    column = CAMERA.width // 2
    y = surface.position[:, column, 1].astype(np.float64)
    cosine = 3 / np.hypot(4 - y, 3)
    lifted = {"torch": np.full_like(y, bias), "lamp": bias * (1 - cosine) * np.hypot(4 - y, 3)}
    exact, moved = shadows(rays, surface, CAMERA, lights), shadows(rays, surface, CAMERA, lights, bias)
    lower, upper = (1.6 - (z - bias) / 0.8 for z in (1.5, 0.5))
    np.testing.assert_array_equal(moved[0][:, column], (y > upper) | (y < lower))
    for light, mask in zip(("torch", "lamp"), moved[1:], strict=True):
        # from (y, z) to the lamp at (4, 3): the height where the way crosses the lid's level 1.6, if within its depth
        z = lifted[light]
        crossing = z + (3 - z) * (1.6 - y) / (4 - y)
        np.testing.assert_array_equal(mask[:, column], (y > 1.6) | (crossing < 0.5) | (crossing > 1.5))
    assert all((a != b).any() for a, b in zip(exact, moved, strict=True))


# --- blame -----------------------------------------------------------------------------------------------------------


def test_the_last_rung_is_what_render_shows() -> None:
    job = make_job(
        wall(),
        SIDE,
        lights=(LEFT, OVER_SUN),
        sky=0.1,
        display=DisplaySettings(exposure=0.3, tone="aces", background=(0.1, 0.2, 0.3)),
        relight={"space": "linear", "texture_scale": 0.5},
    )
    ladder = ladder_of(job)
    full = replace(job, relight=replace(job.relight, texture_scale=1.0))
    frame = stages.frame(prepare(full), full.cameras[0], full.lightings[0])
    expected = encode_display(frame.rgba, job.display)
    np.testing.assert_array_equal(np.rint(ladder.rungs[-1].frame * 255), expected)
    first = ladder.rungs[0].frame * 255
    np.testing.assert_allclose(first, np.rint(first), atol=1e-4)
    assert sum(s.share for s in ladder.steps) == pytest.approx(1, abs=1e-9)
    assert not ladder.really_rendered
    named = {rung.name for rung in ladder.rungs} | {name for name, _ in ladder.absent}
    assert named == {"engine", *CAUSES}


def test_what_files_hold_and_inserted_objects_change_no_step() -> None:
    bare = make_job(wall(), lights=(LEFT,), sky=0.1, render={"spp": 4, "max_depth": 2})
    bare = replace(bare, cameras=(CAMERA.resized(24, 16),))
    before = Inserted(name="before", mesh=Deferred.of(quads(wall(z=1))))
    other = replace(bare, objects=(before,), output=OutputSettings(exr=False))
    with_it, without = ladder_of(other), ladder_of(bare)
    for one, same in zip(with_it.rungs, without.rungs, strict=True):
        np.testing.assert_array_equal(one.frame, same.frame)
    assert any("inserted objects are left out" in x for x in with_it.warnings)


def test_the_last_rung_of_a_ratio_has_the_scene_s_own_level() -> None:
    """A floor as strong as here shows in the picture, and the view is not the scene: a level of its own would show."""
    then = Lighting(name="then", lights=(replace(LEFT, name="then", intensity=1.0),))
    job = make_job(wall(), SIDE, lights=(LEFT,), relight={"mode": "ratio", "delta": 0.5})
    job = replace(job, captured=then)
    last = ladder_of(job).rungs[-1]
    frame = stages.frame(prepare(job), job.cameras[0], job.lightings[0])
    assert last.name == "ratio"
    np.testing.assert_array_equal(np.rint(last.frame * 255), encode_display(frame.rgba, job.display))


def test_the_last_rung_follows_the_sky_past_the_proxy() -> None:
    job = make_job(wall(-5, -1.5), lights=(LEFT,), sky=0.2, relight={"mode": "ratio", "background": "environment"})
    around = Environment(radiance=np.full((1, 1, 3), 0.8, np.float32))
    job = replace(job, captured=Lighting(name="then", environment=around), relight=replace(job.relight, repair=False))
    last = ladder_of(job).rungs[-1]
    frame = stages.frame(prepare(job), job.cameras[0], job.lightings[0])
    assert frame.factor is not None
    assert frame.factor[10, -5] == pytest.approx(np.full(3, 0.25), rel=0.02)
    np.testing.assert_array_equal(np.rint(last.frame * 255), encode_display(frame.rgba, job.display))


OVER_SUN = SunLight(name="over", direction=OVER, intensity=2, angular_diameter=12)
OVER_HARD = DirectionalLight(name="over", direction=OVER, intensity=2)

ONE_CAUSE: dict[str, Job] = {
    "tint": make_job(wall(), sky=0.3, relight={"space": "linear"}),
    "units": make_job(wall(), lights=(PointLight(name="lamp", position=np.array([0.2, 0.1, 0.8]), intensity=2.0),)),
    "occlusion": make_job(wall(), SIDE, sky=1.0, render={"max_depth": 1}),
    "indirect": make_job(wall(), SIDE, lights=(LEFT,)),
    "size": make_job(wall(), LID, lights=(replace(OVER_SUN, angular_diameter=80),), render={"max_depth": 1}),
    "scale": make_job(wall(), LID, lights=(OVER_HARD,), relight={"texture_scale": 0.15}, render={"max_depth": 1}),
    "coverage": make_job(wall(-5, 0.1), lights=(replace(FRONT, intensity=0.6),), render={"max_depth": 1}),
    "kernel": make_job(wall(), lights=(replace(FRONT, intensity=math.pi),), splats=cloud(0.02, 0.2, shades=True)),
    "tone": make_job(
        wall(),
        lights=(replace(FRONT, intensity=1.5),),
        display=DisplaySettings(tone="aces", exposure=1),
        splats=cloud(0.3, 0.2, shades=True),
    ),
    "ratio": make_job(wall(), lights=(FRONT,), relight={"mode": "ratio"}),
}


@pytest.mark.parametrize("cause", ONE_CAUSE)
def test_a_scene_with_one_cause_blames_it(cause: str) -> None:
    job = ONE_CAUSE[cause]
    if cause == "ratio":
        captured = Lighting(name="then", lights=(replace(FRONT, intensity=0.5),))
        job = replace(job, captured=captured)
    ladder = ladder_of(job)
    shares = {s.name: round(s.share, 3) for s in ladder.steps}
    assert shares[cause] > 0.9, shares
    assert ladder.whole.psnr < 40


def test_nothing_is_blamed_where_both_agree() -> None:
    """White light from all around on a wall, brightness undoing its albedo: the tint is 1 in any space."""
    ladder = ladder_of(make_job(wall(), sky=1.0, relight={"space": "linear"}))
    assert all(s.psnr > 45 for s in ladder.steps)


def gradient(job: Job) -> Job:
    """The job under a sky that brightens upwards, so that sampling it is noisy."""
    rows = np.linspace(2, 0, 32, dtype=np.float32)[:, None, None]
    sky = Environment(radiance=np.broadcast_to(rows, (32, 64, 3)))
    return replace(job, lightings=(Lighting(name="made", environment=sky),))


def test_a_steps_noise_is_what_other_seeds_show() -> None:
    job = gradient(make_job(wall(), SIDE, render={"spp": 16, "max_depth": 2}))
    ladders = [ladder_of(replace(job, render=replace(job.render, seed=seed))) for seed in range(4)]
    for name in ("occlusion", "indirect"):
        index = next(k for k, rung in enumerate(ladders[0].rungs) if rung.name == name)
        steps = np.array([x.rungs[index].frame.astype(np.float64) - x.rungs[index - 1].frame for x in ladders])
        spread = np.sqrt(np.mean(np.var(steps, axis=0, ddof=1)))
        told = np.array([step.noise for x in ladders for step in x.steps if step.name == name], dtype=np.float64)
        np.testing.assert_allclose(told, spread, rtol=0.1)
        assert spread > 1e-3
    assert all(step.noise is None for step in ladders[0].steps if step.name in ("float", "buffer", "prefilter"))


def test_a_step_that_is_only_noise_is_called_so() -> None:
    """Nothing blocks the sky before a single wall: what that step shows is the tracing's noise."""
    open_sky = {s.name: s for s in ladder_of(gradient(make_job(wall(), render={"spp": 4}))).steps}
    assert open_sky["occlusion"].within_noise
    walled = {s.name: s for s in ladder_of(gradient(make_job(wall(), SIDE, render={"spp": 64}))).steps}
    assert not walled["occlusion"].within_noise
    assert walled["occlusion"].noise_psnr is not None
    assert walled["occlusion"].noise_psnr > walled["occlusion"].psnr + 6


def test_the_linear_pipeline_has_its_own_cause() -> None:
    job = make_job(
        wall(),
        lights=(FRONT,),
        splats=cloud(0.1, 0.2, shades=True),
        relight={"profile": "playcanvas"},
        compositor=CompositorSettings(profile="playcanvas", linear=True, tone="aces", exposure=1.5),
    )
    ladder = ladder_of(job)
    names = [s.name for s in ladder.steps]
    assert "blending" in names
    assert not {"tint", "tone"} & set(names)
    assert physical_display(job) == DisplaySettings(tone="aces", exposure=math.log2(1.5))
    assert physical_settings(job).space == "linear"


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ({"proxy": None}, "no proxy"),
        ({"splats": None}, "no splats"),
        ({"proxy": Deferred.of(NO_FACE)}, "a proxy without a face"),
        ({"relight": RelightSettings(mode="ratio")}, "captured"),
    ],
    ids=["proxy", "splats", "face", "captured"],
)
def test_what_has_no_ladder_is_refused(change: dict[str, Any], expected: str) -> None:
    job = make_job(wall(), lights=(FRONT,))
    with pytest.raises(InputError, match=expected):
        explain(replace(job, **change), CAMERA, job.lightings[0])


def empty() -> SplatCloud:
    whole = cloud()
    none = {name: getattr(whole, name)[:0] for name in ("means", "quats", "scales", "opacities", "sh")}
    return replace(whole, **none)


def engine_buffers(camera: Camera, value: float) -> EngineFrames:
    """Buffers of the engine that hold one value."""
    size = (camera.height, camera.width, 4)
    picture = np.zeros(size, np.uint8)
    light = np.zeros(size, np.float32)
    shown = np.full(size, value, np.float32)
    return EngineFrames(frame=picture, unlit=picture, relight=light, frame_f32=shown, unlit_f32=shown, meta={})


@pytest.mark.parametrize("missing", ["proxy out of view", "splats", "light"])
@pytest.mark.parametrize("rendered", [None, 0.0, math.nan], ids=["predicted", "black", "nan"])
def test_empty_pictures_have_a_ladder(missing: str, rendered: float | None, tmp_path: Path) -> None:
    """The camera looks past a proxy in its file's colours, there is no splat, or no light: every figure is a number."""
    job = make_job(wall(), lights=(FRONT,), sky=0.3, render={"spp": 2, "max_depth": 2})
    job = replace(job, proxy=Deferred.of(replace(quads(wall()), albedo=None)))
    camera = replace(CAMERA, width=24, height=16)
    if missing == "proxy out of view":
        camera = Camera.look_at((0, 0, 4), (0, 0, 9), 24, 16, yfov=40)
    elif missing == "splats":
        job = replace(job, splats=Deferred.of(empty()))
    else:
        job = replace(job, lightings=(Lighting(name="dark"),))
    run = None
    if rendered is not None:
        frames = engine_buffers(camera, rendered)
        run = EngineRun(frames, frames.relight)
    ladder = explain(job, camera, job.lightings[0], run)
    write_ladder(tmp_path, ladder)

    def refuse(word: str) -> None:
        raise AssertionError(f"{word} is no JSON")

    found = json.loads((tmp_path / "explain.json").read_text(), parse_constant=refuse)
    assert all(isinstance(step[key], float) for step in found["steps"] for key in ("share", "squared", "rms", "flip"))
    assert any(step["psnr"] is None for step in found["steps"])  # infinite: nothing changed
    assert "inf" in summary(ladder)
    assert "∞ dB" in (tmp_path / "explain.html").read_text(encoding="utf-8")


def test_orthographic_cameras_are_refused() -> None:
    job = make_job(wall(), lights=(FRONT,))
    with pytest.raises(InputError, match="orthographic"):
        explain(job, replace(CAMERA, projection="orthographic"), job.lightings[0])

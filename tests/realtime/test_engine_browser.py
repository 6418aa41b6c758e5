"""The real engine, run here: its frames against recorded ones and against the NumPy model; the page that people open.

Chromium and npm are part of the test environment (scripts/test installs them); without them these tests fail.
"""

from __future__ import annotations

import functools
import io
import json
import re
import shutil
import threading
from collections.abc import Iterator
from dataclasses import replace
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from PIL import Image

from mirelight.apps import realtime
from mirelight.apps.realtime import browser, bundle, engine, pages
from mirelight.base.errors import BackendError, InputError, RenderError
from mirelight.compositor import Compositor
from mirelight.compositor.engine import SOFTWARE_BITS, EngineDrawing, engine_rank
from mirelight.compositor.source import uploaded
from mirelight.io.gltf.scene import read_scene
from mirelight.io.png import write_png
from mirelight.io.splats import ply
from mirelight.lighting import trace
from mirelight.lighting.objects import inserted
from mirelight.model import (
    F32,
    Camera,
    CompositorSettings,
    Deferred,
    DirectionalLight,
    Environment,
    Inserted,
    Job,
    Lighting,
    Material,
    PointLight,
    ProxyMesh,
    RelightSettings,
    RenderSettings,
    SplatCloud,
    SpotLight,
)
from mirelight.model.playcanvas_lights import EngineLighting, engine_diffuse, to_engine

from .engine_cases import texture
from .waiting import LIMIT, settled

if TYPE_CHECKING:
    from playwright.sync_api import Page, Route

CAMERA = Camera.look_at((1, 2.5, 5), (0, -0.4, 0), 200, 150, yfov=45, near=0.1, far=100)
LIGHTING = Lighting(
    lights=(
        DirectionalLight(
            name="sun", direction=np.array([-0.4, -1, -0.3]), color=np.array([1, 0.8, 0.6]), intensity=1.5
        ),
        PointLight(name="lamp", position=np.array([1, 1.5, 1]), color=np.array([0.3, 0.6, 1]), intensity=12, range=8),
        SpotLight(
            name="torch",
            position=np.array([2, 3, 2]),
            direction=np.array([-0.4, -0.9, -0.2]),
            intensity=40,
            inner_cone_angle=np.radians(15),
            outer_cone_angle=np.radians(30),
        ),
    )
)


def stage(data: Path) -> ProxyMesh:
    mesh = read_scene(data / "realtime" / "assets" / "stage.glb").mesh
    assert mesh is not None
    return mesh


def make_job(data: Path, **relight: object) -> Job:
    assets = data / "realtime" / "assets"
    return Job(
        source=Path("test.toml"),
        splats=Deferred.of(ply.read(assets / "synth_stack.ply")),
        proxy=Deferred.of(stage(data)),
        compositor=CompositorSettings(profile="playcanvas", work_buffer="large"),
        relight=RelightSettings(profile="playcanvas", space="display", **relight),  # type: ignore[arg-type]
    )


@pytest.fixture(scope="module")
def rendered(data: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, realtime.EngineFrames]:
    folder = tmp_path_factory.mktemp("realtime") / "new"
    said: list[str] = []
    frames = realtime.render(make_job(data), CAMERA, LIGHTING, folder, shadows=False, report=said.append)
    assert [words.split()[0] for words in said] == ["writing", "loading", "sorting", "rendering", "rendering"]
    return folder, frames


def test_lighting_texture_agrees_with_the_mapped_lights(
    data: Path, rendered: tuple[Path, realtime.EngineFrames]
) -> None:
    proxy = stage(data)
    lights, _ = to_engine(LIGHTING, proxy, shadows=False)
    ours = texture(proxy, CAMERA, lights, engine_diffuse(0.5))
    theirs = rendered[1].relight
    both = (ours[..., 3] > 0.5) & (theirs[..., 3] > 0.5)
    error = np.abs(ours - theirs)[both][:, :3].max(axis=1) / theirs[..., :3].max()
    assert np.percentile(error, 99) < 0.01
    assert both.sum() > 0.6 * both.size


def test_frame_is_the_tint_of_the_unlit_frame(rendered: tuple[Path, realtime.EngineFrames]) -> None:
    frames = rendered[1]
    covered = frames.relight[..., 3:]
    factor = (1 - covered) + frames.relight[..., :3] * 2 * covered
    np.testing.assert_allclose(frames.frame_f32[..., :3], frames.unlit_f32[..., :3] * factor, atol=2e-3)
    np.testing.assert_array_equal(frames.frame_f32[..., 3], frames.unlit_f32[..., 3])
    eight_bit = np.clip(frames.frame_f32, 0, 1) * 255
    assert np.median(np.abs(eight_bit - frames.frame)[frames.frame[..., 3] > 0]) < 1.5


def test_what_was_rendered_is_read_back(rendered: tuple[Path, realtime.EngineFrames]) -> None:
    folder, frames = rendered
    again = realtime.load_frames(folder)
    for name in ("frame", "unlit", "relight", "frame_f32", "unlit_f32"):
        np.testing.assert_array_equal(getattr(again, name), getattr(frames, name))
    assert again.warnings == frames.warnings
    assert again.meta["engine"]["version"] == engine.VERSION
    np.testing.assert_allclose(again.meta["camera"]["world"], CAMERA.world_from_camera, atol=1e-6)
    assert not list(folder.glob(".*"))


@pytest.mark.parametrize("case", ["stage_spot", "stage_turned_sky", "synth_stack", "synth_stack_linear"])
def test_recorded_cases_are_rendered_again(data: Path, tmp_path: Path, case: str) -> None:
    recorded = data / "realtime"
    description = json.loads((recorded / case / "scene.json").read_text())
    engine.copy_page(tmp_path, "realtime", bundle.PAGE)
    for key, name in (("splat", "file"), ("proxy", "file"), ("env", "equirect")):
        if key in description:
            file = (recorded / case / description[key][name]).resolve()
            shutil.copy(file, tmp_path)
            description[key][name] = file.name
    (tmp_path / "scene.json").write_text(json.dumps(description))
    frames = browser.run_page(realtime.Exported(folder=tmp_path, description=description, warnings=()))
    with np.load(recorded / case / "buffers.npz") as buffers:
        assert {"relight", "frame_f32"} <= set(buffers)
        for name in buffers:
            np.testing.assert_allclose(getattr(frames, name), buffers[name], atol=2e-3, err_msg=name)


def test_turned_environment_agrees_with_the_model(data: Path, tmp_path: Path) -> None:
    sky = np.full((32, 64, 3), 0.1, dtype=np.float32)
    sky[6:10, 5:9] = (6.0, 3.0, 1.0)
    environment = Environment(radiance=sky, intensity=0.5, rotation=35.0)
    job, camera = make_job(data), CAMERA.resized(100, 75)
    theirs = realtime.render(job, camera, Lighting(environment=environment), tmp_path).relight
    assert job.proxy is not None
    ours = texture(job.proxy.value, camera, EngineLighting(environment=environment), engine_diffuse(0.5))
    both = (ours[..., 3] > 0.5) & (theirs[..., 3] > 0.5)
    error = np.abs(ours - theirs)[both][:, :3].max(axis=1) / theirs[..., :3].max()
    assert np.percentile(error, 99) < 0.05
    assert theirs[both][:, 0].max() > 1.5 * theirs[both][:, 0].min()  # it has a direction


def test_a_wall_that_turns_its_back_to_the_light_casts_a_shadow(tmp_path: Path) -> None:
    """The engine would cull it in its shadow maps. Its shadow is compared with the one that rays find."""
    floor = [(-4, 0, -4), (-4, 0, 4), (4, 0, 4), (4, 0, -4)]
    wall = [(-1, 0, 0), (1, 0, 0), (1, 2, 0), (-1, 2, 0)]  # faces +Z, the light comes from -Z
    proxy = ProxyMesh(
        vertices=np.array([*floor, *wall], dtype=np.float32),
        faces=np.array([[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]], dtype=np.int32),
    )
    job = Job(source=Path("test.toml"), proxy=Deferred.of(proxy))
    camera = Camera.look_at((0, 6, 5), (0, 0, 1), 120, 90, yfov=50, near=0.1, far=50)
    sun = Lighting(lights=(DirectionalLight(name="sun", direction=np.array([0.0, -1.0, 1.0]), intensity=3.0),))
    theirs = realtime.render(job, camera, sun, tmp_path).relight
    ours = trace(proxy, sun, camera, RenderSettings(profile="playcanvas")).beauty
    dark = (theirs[..., 3] > 0.5) & (theirs[..., 0] < 0.1 * theirs[..., 0].max())
    shadow = (theirs[..., 3] > 0.5) & (ours[..., 0] == 0)
    assert shadow.sum() > 500
    assert (dark & shadow).sum() > 0.93 * (dark | shadow).sum()


def test_objects_are_seen_and_cast_shadows_on_the_proxy(tmp_path: Path) -> None:
    """Their shadow is compared with the one that rays find."""
    corners = np.array([[x, y, z] for x in (-0.8, 0.8) for y in (0.5, 2.1) for z in (-0.8, 0.8)], np.float32)
    sides = [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1]]
    sides += [[2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]]
    red = Material(base_color=np.array([0.8, 0.1, 0.1]))
    cube = ProxyMesh(vertices=corners, faces=np.array(sides, np.int32), materials=(red,), albedo=None)
    floor = np.array([(-4, 0, -4), (-4, 0, 4), (4, 0, 4), (4, 0, -4)], np.float32)
    ground = ProxyMesh(vertices=floor, faces=np.array([[0, 1, 2], [0, 2, 3]], np.int32))
    one = Inserted(name="cube", mesh=Deferred("cube", lambda: cube), drop=True)
    job = Job(source=Path("test.toml"), proxy=Deferred.of(ground), objects=(one,))
    camera = Camera.look_at((0, 4, 5), (0, 0, 0), 120, 90, yfov=40, near=0.1, far=50)
    sun = Lighting(lights=(DirectionalLight(name="sun", direction=np.array([1.0, -1.0, 0.3]), intensity=3.0),))
    made = realtime.render(job, camera, sun, tmp_path)
    joined = inserted([one], ground)
    alone = trace(joined.alone, sun, camera, RenderSettings(profile="playcanvas"))
    shadow = trace(joined.mesh, sun, camera, RenderSettings(profile="playcanvas")).beauty[..., 0] == 0
    seen = alone.coverage > 0.5
    shadow &= (made.relight[..., 3] > 0.5) & ~seen
    dark = (made.relight[..., 3] > 0.5) & (made.relight[..., 0] < 0.1 * made.relight[..., 0].max()) & ~seen
    assert shadow.sum() > 200
    assert (dark & shadow).sum() > 0.9 * (dark | shadow).sum()
    lit = made.frame_f32[alone.beauty[..., 0] > 0.5 * alone.beauty.max()]
    assert len(lit) > 100 and (lit[:, 0] > 2 * lit[:, 1]).all()


def card(at: tuple[float, float], material: Material) -> ProxyMesh:
    """A sheet of 1.6 by 1.6 at a height of 1 that looks up, with v = 0 at its far edge."""
    x, z = at
    corners = np.array([(x - 0.8, 1, z - 0.8), (x - 0.8, 1, z + 0.8), (x + 0.8, 1, z + 0.8), (x + 0.8, 1, z - 0.8)])
    return ProxyMesh(
        vertices=corners.astype(np.float32),
        faces=np.array([[0, 1, 2], [0, 2, 3]], np.int32),
        normals=np.tile(np.array([0, 1, 0], np.float32), (4, 1)),
        uvs=np.array([(0, 0), (0, 1), (1, 1), (1, 0)], np.float32),
        materials=(replace(material, base_color=np.array([0.8, 0.1, 0.1])),),
        albedo=None,
    )


def halves(left: tuple[float, ...], right: tuple[float, ...]) -> F32:
    """A texture (8, 16, 3) whose left and right half are these."""
    out = np.empty((8, 16, 3), np.float32)
    out[:, :8], out[:, 8:] = left, right
    return out


def test_objects_keep_their_maps_and_their_alpha(tmp_path: Path) -> None:
    """Four cards above a floor: one cut in half, one half clear, one with two slopes, one half of metal."""
    slope = np.array([np.sin(np.radians(40)), 0, np.cos(np.radians(40))])
    stored = np.array([1.0, 0.5, 1.0]) * (slope + 1) / 2 + np.array([0, 0.25, 0])
    away = np.array([1 - stored[0], 0.5, stored[2]])
    looks = (
        Material(name="cut", alpha_texture=halves((0, 0, 0), (1, 1, 1)), cutoff=0.5),
        Material(name="gauze", alpha=0.5),
        Material(name="slopes", normal_texture=halves(tuple(stored), tuple(away))),
        Material(name="half metal", metallic=1.0, roughness=0.2, finish_texture=halves((0, 1, 1), (0, 1, 0))),
    )
    places = ((-1.0, -1.0), (1.0, -1.0), (-1.0, 1.0), (1.0, 1.0))
    objects = tuple(
        Inserted(name=x.name, mesh=Deferred(x.name, functools.partial(card, at, x)))
        for x, at in zip(looks, places, strict=True)
    )
    floor = np.array([(-4, 0, -4), (-4, 0, 4), (4, 0, 4), (4, 0, -4)], np.float32)
    ground = ProxyMesh(vertices=floor, faces=np.array([[0, 1, 2], [0, 2, 3]], np.int32))
    job = Job(source=Path("test.toml"), proxy=Deferred.of(ground), objects=objects)
    camera = Camera.look_at((0, 9, 0), (0, 1, 0), 120, 120, yfov=28, near=0.1, far=50)
    to_sun = np.array([np.sin(np.radians(40)), np.cos(np.radians(40)), 0.0])
    sun = Lighting(lights=(DirectionalLight(name="sun", direction=-to_sun, intensity=3.0),))
    made = realtime.render(job, camera, sun, tmp_path)
    written = read_scene(tmp_path / "objects.glb", finish=True).mesh
    assert written is not None and [x.name for x in written.materials] == [x.name for x in looks]
    assert (written.materials[0].cutoff, written.materials[1].alpha) == (0.5, 0.5)
    for name, k in (("alpha_texture", 0), ("normal_texture", 2), ("finish_texture", 3)):
        np.testing.assert_allclose(getattr(written.materials[k], name), getattr(looks[k], name), atol=0.51 / 255)

    shown = made.frame_f32[..., 0]  # on black, as there are no splats: only objects are seen

    def half(card_at: tuple[float, float], side: int) -> F32:
        """Pixels well within the left (-1) or right half of a card."""
        pixel = camera.fy / 8.0
        x, y = 60 + pixel * (card_at[0] + 0.4 * side), 60 + pixel * card_at[1]
        return shown[round(y) - 8 : round(y) + 8, round(x) - 4 : round(x) + 4]

    plain = float(half(places[0], 1).mean())
    assert plain > 0.1 and half(places[0], -1).max() == 0
    gauze = shown[round(60 - camera.fy / 8) - 8 :, :][:16, round(60 + camera.fy / 8) - 8 :][:, :16]
    assert np.count_nonzero(gauze) == pytest.approx(33 / 64 * gauze.size)  # of a pattern of 64 levels
    np.testing.assert_allclose(gauze[gauze > 0], plain, rtol=0.02)
    linear = [float(half(places[2], side).mean()) ** 2.2 for side in (-1, 1)]
    assert linear[0] * np.cos(np.radians(40)) == pytest.approx(plain**2.2, rel=0.05)  # it faces the sun
    assert linear[1] == pytest.approx(plain**2.2 * np.cos(np.radians(80)) / np.cos(np.radians(40)), rel=0.1)
    assert half(places[3], -1).mean() < 0.3 * plain  # a metal has no colour of its own beside the sun's mirror image
    assert half(places[3], 1).mean() == pytest.approx(plain, rel=0.05)

    def floor_under(x: float, z: float) -> float:
        """What is left of the sun's light where the floor lies in a point's shadow."""
        pixel, lit = camera.fy / 9.0, made.relight[..., 0]
        column, row = round(60 + pixel * (x - to_sun[0] / to_sun[1])), round(60 + pixel * z)
        return float(lit[row - 3 : row + 3, column - 3 : column + 3].mean() / lit.max())

    assert floor_under(-1.2, -1) > 0.99 and floor_under(-0.6, -1) < 0.01  # cut out of the shadow, too
    assert 0.4 < floor_under(1, -1) < 0.6


def test_a_constant_environment_is_the_engines_ambient_colour(data: Path, tmp_path: Path) -> None:
    """Brighter than white, and exact, where a map would be rounded to 8 bits."""
    job, camera = make_job(data), CAMERA.resized(64, 48)
    around = Lighting(environment=Environment(radiance=np.array([[[3.0, 0.4, 0.02]]], dtype=np.float32), intensity=1.5))
    theirs = realtime.render(job, camera, around, tmp_path).relight
    covered = theirs[..., 3] > 0.5
    expected = np.broadcast_to(0.5 * 1.5 * np.array([3.0, 0.4, 0.02]), theirs[covered][:, :3].shape)
    np.testing.assert_allclose(theirs[covered][:, :3], expected, rtol=2e-3)  # half floats
    assert "env" not in json.loads((tmp_path / "scene.json").read_text())


# --- the page --------------------------------------------------------------------------------------------------------


@pytest.fixture
def served(data: Path, tmp_path: Path) -> Iterator[str]:
    """An exported page on a plain static server, as a person would serve it."""
    for name in ("front.day", "front.night"):
        realtime.export(make_job(data, blend=0.75), CAMERA, LIGHTING, tmp_path / name)
        Image.new("RGB", (CAMERA.width, CAMERA.height), (255, 0, 255)).save(tmp_path / "physical.png")
        pages.write(tmp_path / name, ["front.day", "front.night"], tmp_path / "physical.png")
    handler = functools.partial(SimpleHTTPRequestHandler, directory=str(tmp_path))
    with ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        thread = threading.Thread(target=server.serve_forever, daemon=True)
        thread.start()
        yield f"http://127.0.0.1:{server.server_address[1]}/front.day/"
        server.shutdown()
        thread.join()


@pytest.fixture
def page() -> Iterator[Page]:
    """An empty page of a browser that draws as the engine's frames are drawn."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        flags = [flag for flag in browser.FLAGS if flag != "--headless"] + ["--no-sandbox"]
        chromium = playwright.chromium.launch(executable_path=browser.find_browser(), args=flags)
        page = chromium.new_page(viewport={"width": 400, "height": 300})
        page.set_default_timeout(LIMIT)
        yield page
        chromium.close()


def test_the_browser_calls_nobody(data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """By its own log of the network, it looks up no name and connects to the loopback address alone."""
    log = tmp_path / "network.json"
    monkeypatch.setattr(browser, "FLAGS", (*browser.FLAGS, f"--log-net-log={log}"))
    realtime.render(make_job(data), CAMERA, LIGHTING, tmp_path / "page")
    text = log.read_text(encoding="utf-8", errors="replace")
    reached = set(re.findall(r'"remote_address":"([^"]*)"', text))
    lists = re.findall(r'"address_list":\[([^\]]*)\]', text)
    reached |= {address for found in lists for address in re.findall(r'"([^"]*)"', found)}
    assert any(address.startswith("127.0.0.1:") for address in reached)
    assert {address for address in reached if not address.startswith("127.0.0.1:")} == set()
    constants, _, events = text.partition('"events"')
    for kind in ("UDP_BYTES_SENT", "HOST_RESOLVER_DNS_TASK", "HOST_RESOLVER_SYSTEM_TASK"):
        number = re.search(rf'"{kind}":(\d+)', constants)
        assert number is not None and f'"type":{number[1]}}}' not in events, kind


def test_exported_page_runs_live_and_its_sliders_work(served: str, page: Page) -> None:
    failures: list[str] = []
    page.on("pageerror", lambda error: failures.append(str(error)))
    page.goto(served)
    page.wait_for_selector("#controls", state="visible")
    assert page.input_value("input[name=blend]") == "0.75"
    before = settled(page, page)
    page.locator("[name=brightness]").fill("5")
    lit = settled(page, page, other_than=before)
    assert page.locator("#lights label").all_inner_texts() == ["sun", "lamp", "torch"]
    page.locator("#lights input[name=sun]").uncheck()
    settled(page, page, other_than=lit)  # darker
    for width, height in ((800, 450), (390, 844)):
        page.set_viewport_size({"width": width, "height": height})
        box = {"x": 0, "y": 0, "width": width, "height": height}
        same = "wanted => Object.entries(wanted).every(([k, x]) => view.getBoundingClientRect()[k] === x)"
        page.wait_for_function(same, arg=box)
        assert page.evaluate("document.documentElement.scrollWidth") == width
    assert failures == []


def test_controls_are_shown_once_they_work(served: str, page: Page) -> None:
    """While the page still reads what it knows of other frames, nobody can move a slider that is set afterwards."""
    meanwhile: list[bool] = []

    def answered_late(route: Route) -> None:
        settled(page, page)
        meanwhile.append(page.is_visible("#controls"))
        route.continue_()

    page.route("**/page.json", answered_late)
    page.goto(served)
    page.wait_for_selector("#controls", state="visible")
    assert page.input_value("input[name=blend]") == "0.75"
    assert page.locator("input[name=blend] + output").inner_text() == "0.75"
    assert meanwhile == [False]


def test_the_physical_frame_lies_over_the_live_one_until_the_camera_moves(served: str, page: Page) -> None:
    page.goto(served)
    page.wait_for_selector("#controls", state="visible")
    physical, back = page.locator("#physical"), page.locator("button[name=back]")
    assert not physical.is_visible() and not back.is_visible()
    page.locator("input[name=physical]").fill("0.5")
    physical.wait_for(state="visible")
    page.evaluate("document.getElementById('controls').style.visibility = 'hidden'")
    seen = np.asarray(Image.open(io.BytesIO(page.screenshot())).convert("RGB"))
    magenta = (seen == (255, 0, 255)).all(axis=-1)
    wide = min(400, 300 * CAMERA.width / CAMERA.height)  # of the frame in the window
    assert abs(int(magenta[150].sum()) - wide / 2) <= 2 and magenta[150, :202].sum() == magenta[150].sum()
    page.evaluate("document.getElementById('controls').style.visibility = ''")

    page.keyboard.down("w")  # flies on
    back.wait_for(state="visible")
    page.keyboard.up("w")
    assert not physical.is_visible()
    back.click()
    physical.wait_for(state="visible")

    page.locator("select[name=frame]").select_option("front.night")
    page.wait_for_url("**/front.night/index.html")


def test_opened_from_disk_the_page_says_what_to_do(data: Path, tmp_path: Path) -> None:
    from playwright.sync_api import sync_playwright

    realtime.export(make_job(data), CAMERA, LIGHTING, tmp_path)
    with sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=browser.find_browser(), args=["--no-sandbox"])
        page = chromium.new_page()
        page.set_default_timeout(LIMIT)
        page.goto((tmp_path / "index.html").as_uri())
        assert "python3 -m http.server" in page.inner_text("body")
        assert not page.is_visible("#controls")
        chromium.close()


def test_export_describes_the_job_in_the_engines_terms(data: Path, tmp_path: Path) -> None:
    job = make_job(data, blend=0.5, brightness=1.5, background=0.25, texture_scale=0.5)
    sky = Environment(radiance=np.ones((2, 4, 3), dtype=np.float32), intensity=0.5, rotation=30)
    exported = realtime.export(job, CAMERA, replace(LIGHTING, environment=sky), tmp_path)
    scene = json.loads((tmp_path / "scene.json").read_text())
    assert scene == json.loads(json.dumps(exported.description))
    assert scene["relighting"] == {"blend": 0.5, "brightness": 1.5, "background": 0.25, "textureScale": 0.5}
    assert scene["camera"]["fov"] == pytest.approx(45)
    assert scene["env"] == {"equirect": "environment.hdr", "intensity": 0.5, "rotation": -120.0}
    assert [light["type"] for light in scene["lights"]] == ["directional", "omni", "spot"]
    assert scene["proxy"]["diffuse"] == pytest.approx([0.5 ** (1 / 2.2)] * 3)
    assert scene["gsplat"]["dataFormat"] == "GSPLATDATA_LARGE"
    for name in ("index.html", "scene.mjs", "splats.ply", "proxy.glb", "environment.hdr", "engine/LICENSE"):
        assert (tmp_path / name).is_file()
    assert not (tmp_path / "capture.mjs").exists()


# --- what cannot be followed, and what goes wrong --------------------------------------------------------------------


def test_orthographic_camera_is_refused(data: Path, tmp_path: Path) -> None:
    flat = replace(CAMERA, projection="orthographic", fx=20.0, fy=20.0)
    with pytest.raises(InputError, match="orthographic"):
        realtime.export(make_job(data), flat, LIGHTING, tmp_path / "new")
    assert not (tmp_path / "new").exists()


def test_camera_and_mode_that_the_engine_lacks_are_warned_of(data: Path, tmp_path: Path) -> None:
    odd = replace(CAMERA, cx=90.0, fx=CAMERA.fx * 1.1)
    said = "\n".join(realtime.export(make_job(data, mode="ratio"), odd, LIGHTING, tmp_path).warnings)
    for part in ("principal point", "square", "tint only", "lamp: "):
        assert part in said


def test_a_page_that_loads_much_says_what_takes_it(data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert not [x for x in realtime.export(make_job(data), CAMERA, LIGHTING, tmp_path).warnings if "loads" in x]
    monkeypatch.setattr(bundle, "_HEAVY", 1000)
    (said,) = (x for x in realtime.export(make_job(data), CAMERA, LIGHTING, tmp_path).warnings if "loads" in x)
    for name in ("proxy.glb", "splats.ply"):
        assert f"{name} {(tmp_path / name).stat().st_size / 1e6:,.0f}" in said


def test_missing_chromium_is_one_line(data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(browser, "BROWSERS", ())
    monkeypatch.delenv("MIRELIGHT_BROWSER", raising=False)
    with pytest.raises(BackendError, match="apt-get install chromium"):
        realtime.render(make_job(data), CAMERA, LIGHTING, tmp_path / "new")
    assert not (tmp_path / "new").exists()


def test_missing_npm_is_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MIRELIGHT_CACHE", str(tmp_path))
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(BackendError, match="apt-get install npm"):
        engine.install()


@pytest.mark.parametrize(
    ("script", "said"),
    [
        ("echo 'npm error code E404' >&2; exit 1", "E404"),
        ("echo hello > playcanvas-2.23.3.tgz", "another package"),
        ("exit 0", "no message"),
    ],
)
def test_npm_that_fails_or_lies_is_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, script: str, said: str
) -> None:
    npm = tmp_path / "bin" / "npm"
    npm.parent.mkdir()
    npm.write_text(f"#!/bin/sh\n{script}\n")
    npm.chmod(0o755)
    monkeypatch.setenv("MIRELIGHT_CACHE", str(tmp_path / "cache"))
    monkeypatch.setenv("PATH", str(npm.parent), prepend=":")
    with pytest.raises(BackendError, match=said) as raised:
        engine.install()
    assert "\n" not in str(raised.value)
    assert list((tmp_path / "cache").iterdir()) == []


def test_browser_that_ends_early_is_one_line(tmp_path: Path) -> None:
    ending = tmp_path / "chromium"
    ending.write_text("#!/bin/sh\necho 'cannot open display' >&2\nexit 3\n")
    ending.chmod(0o755)
    page = realtime.Exported(folder=tmp_path, description={"width": 8, "height": 8}, warnings=())
    with pytest.raises(RenderError, match=r"exit code 3.*cannot open display"):
        browser.run_page(page, str(ending))


def test_scene_that_the_engine_cannot_load_is_one_line(tmp_path: Path) -> None:
    engine.copy_page(tmp_path, "realtime", bundle.PAGE)
    description = {
        "width": 32,
        "height": 32,
        "camera": {"position": [0, 0, 5], "target": [0, 0, 0], "fov": 45, "near": 0.1, "far": 100},
        "proxy": {"file": "absent.glb"},
    }
    (tmp_path / "scene.json").write_text(json.dumps(description))
    with pytest.raises(RenderError, match=r"absent\.glb"):
        browser.run_page(realtime.Exported(folder=tmp_path, description=description, warnings=()), seconds=120)
    assert not (tmp_path / "frame.png").exists()


def crowd() -> SplatCloud:
    """Small splats of degree 3, thousands of them side by side and behind each other: many share a bucket of depth."""
    rng = np.random.default_rng(11)
    count = 6000
    return SplatCloud(
        means=rng.uniform((-1.2, -0.9, -0.6), (1.2, 0.9, 0.6), (count, 3)).astype(np.float32),
        quats=rng.normal(size=(count, 4)).astype(np.float32),
        scales=np.exp(rng.uniform(np.log(0.005), np.log(0.05), (count, 3))).astype(np.float32),
        opacities=rng.uniform(0.2, 1, count).astype(np.float32),
        sh=rng.normal(0, 0.25, (count, 16, 3)).astype(np.float32),
    )


@pytest.mark.parametrize("settings", [{}, {"work_buffer": "large", "sort": "radial"}], ids=["compact", "radial"])
def test_the_engines_order_and_corners_explain_what_its_kernel_does_not(
    tmp_path: Path, settings: dict[str, Any]
) -> None:
    splats = crowd()
    compositor = CompositorSettings(profile="playcanvas", **settings)
    job = Job(
        source=Path("test.toml"),
        splats=Deferred.of(splats),
        compositor=compositor,
        relight=RelightSettings(profile="playcanvas"),
    )
    camera = Camera.look_at((0.3, 0.2, 3), (0, 0, 0), 160, 120, yfov=40, near=0.1, far=50)
    theirs = realtime.render(job, camera, Lighting(), tmp_path).unlit_f32.astype(np.float64)
    ours = Compositor(uploaded(splats), compositor)
    rank = engine_rank(splats, camera, radial=compositor.sort == "radial")

    def decibels(drawing: EngineDrawing) -> float:
        error = ours.composite(camera, depth=False, drawing=drawing).color - theirs[..., :3]
        return float(-10 * np.log10(np.mean(error**2)))

    both = decibels(EngineDrawing(rank, SOFTWARE_BITS))
    assert both > 75
    assert decibels(EngineDrawing(None, SOFTWARE_BITS)) < both - 10
    assert decibels(EngineDrawing(rank)) < both - 10


def test_frames_that_are_not_there_are_one_line(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="mirelight realtime"):
        realtime.load_frames(tmp_path)
    for name in ("frame.png", "unlit.png"):
        write_png(tmp_path / name, np.zeros((4, 4, 3), np.uint8), {})
    (tmp_path / "meta.json").write_text("{}")
    for content in (b"", b"PK\x03\x04 cut"):
        (tmp_path / "buffers.npz").write_bytes(content)
        with pytest.raises(InputError, match="no complete engine frames"):
            realtime.load_frames(tmp_path)

"""The mixer's page in a real browser: its picture against splats relit offline, what it exports, what it refuses."""

from __future__ import annotations

import json
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import mirelight
from mirelight.apps import mixer as mixing
from mirelight.apps.mixer.bundle import bookmark, export
from mirelight.apps.realtime import browser
from mirelight.apps.realtime.captures import _chunk_bounds
from mirelight.apps.realtime.server import serve
from mirelight.base import colour, sh
from mirelight.base.errors import RenderError
from mirelight.compositor.engine import Loaded, corners_of
from mirelight.io import job as jobs
from mirelight.io import splats
from mirelight.io.gltf.write import write_glb
from mirelight.model import F32, Frame, Job
from mirelight.pipeline import stages
from mirelight.pipeline.scene import prepare
from tests import forked

from . import mixer_page
from .mixer_page import decibels
from .mixer_scene import walls
from .waiting import LIMIT

SIZE = (160, 120)
JOB = """
splats = "splats.ply"
proxy = "proxy.glb"
resolution = [160, 120]

[captured]
environment = { radiance = [1, 1, 1] }

[[cameras]]
name = "front"
type = "perspective"
position = [0.5, 1.6, 4.2]
target = [0, 0.4, 0]
yfov = 40
near = 0.1
far = 50

[[lightings]]
name = "day"
environment = { radiance = [0.2, 0.3, 0.5] }
[[lightings.lights]]
type = "point"
name = "lamp"
position = [1, 1.5, 1]
intensity = 5
color = [1, 0.7, 0.4]

[[lightings]]
name = "night"
[[lightings.lights]]
type = "point"
name = "lamp"
position = [-1, 0.8, 0.5]
intensity = 2
[[lightings.lights]]
type = "point"
name = "glow worm"
position = [0.8, 0.3, 1.2]
intensity = 0.3
color = [0.3, 1, 0.4]
"""
STEPS = """
    await picture('day');
    page.choose(1);
    page.jump();
    await picture('night');
    set('glow worm: strength', 0.75);
    set('lamp: strength', 0.4);
    set('lamp: colour', '#ff8040');
    document.getElementById('exposure').value = 0.5;
    document.getElementById('exposure').dispatchEvent(new Event('input'));
    await picture('edited');
    document.getElementById('export').click();
    await send('text', document.querySelector('#exported pre').textContent);
    page.actions.captured();
    page.jump();
    await picture('captured');
    document.querySelectorAll('.handle')[1].click();
    const picked = [...document.querySelectorAll('.picked legend')].map((x) => x.textContent);
    await send('picked', JSON.stringify([picked, document.querySelectorAll('.handle').length,
        document.querySelectorAll('.movable').length]));
"""
SENT = ("day", "night", "edited", "captured", "text", "picked")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """job.toml with its scene."""
    out = tmp_path_factory.mktemp("mixer")
    cloud, proxy = walls()
    splats.write(cloud, out / "splats.ply")
    write_glb(out / "proxy.glb", proxy, (), ())
    (out / "job.toml").write_text(JOB)
    return out


@pytest.fixture(scope="module")
def job(folder: Path) -> Job:
    return jobs.load(folder / "job.toml")


@pytest.fixture(scope="module")
def page(job: Job, folder: Path) -> tuple[Path, mixing.MixLayers]:
    made = export(prepare(job), folder / "page", spp=256)
    assert made.warnings == ()
    return made.folder, made.layers


@pytest.fixture(scope="module")
def seen(page: tuple[Path, mixing.MixLayers]) -> dict[str, bytes]:
    return drive(page[0])


def drive(folder: Path, steps: str = STEPS) -> dict[str, bytes]:
    """What is sent from the page."""
    return mixer_page.drive(folder, steps, SIZE, SENT, 600)


def picture(data: bytes) -> F32:
    """(H, W, 3) 0..1."""
    return mixer_page.picture(data, SIZE)


def relit(job: Job, factor: F32) -> F32:
    """The job's splats in the colours that the factor gives them, composited offline with the engine's rules."""
    assert job.splats is not None
    return mixer_page.drawn(job.splats.value, factor, job.cameras[0])


def displayed(frame: Frame, stops: float) -> F32:
    return np.clip(colour.srgb_encode(frame.rgba[..., :3] * np.float32(2**stops)), 0, 1)


def test_the_page_shows_the_splats_times_the_mixed_layers(
    seen: dict[str, bytes], page: tuple[Path, mixing.MixLayers], job: Job
) -> None:
    layers = page[1]
    for index, name in enumerate(("day", "night")):
        assert decibels(picture(seen[name]), relit(job, layers.factor(layers.weights(index)))) >= 55
    ones = np.ones((len(layers.values[0]), 3), np.float32)
    assert decibels(picture(seen["captured"]), relit(job, ones * np.float32(2**0.5))) >= 55
    assert decibels(picture(seen["day"]), picture(seen["night"])) < 25


def test_the_page_and_the_offline_frame_agree(seen: dict[str, bytes], job: Job) -> None:
    scene = prepare(job)
    for name, lighting in zip(("day", "night"), job.lightings, strict=True):
        assert decibels(picture(seen[name]), displayed(stages.frame(scene, job.cameras[0], lighting), 0)) >= 30


def test_what_the_page_exports_renders_offline(seen: dict[str, bytes], folder: Path) -> None:
    text = seen["text"].decode()
    assert text.startswith("[mix.night]\n")
    (folder / "edited.toml").write_text(JOB + "\n" + text)
    edited = mirelight.load(folder / "edited.toml")
    assert edited.display.exposure == 0.5
    factors = edited.lightings[1].factors()
    np.testing.assert_allclose(factors["glow worm"], 8 * 0.75**3, rtol=1e-5)
    lamp = 8 * 0.4**3 * colour.srgb_decode(np.array([255, 128, 64]) / 255)
    np.testing.assert_allclose(factors["lamp"], lamp, rtol=1e-5)
    offline = stages.frame(prepare(edited), edited.cameras[0], edited.lightings[1])
    assert decibels(picture(seen["edited"]), displayed(offline, 0.5)) >= 30


def test_a_light_is_picked_on_the_picture(seen: dict[str, bytes]) -> None:
    assert json.loads(seen["picked"]) == [["glow worm"], 2, 0]  # nothing can be dragged: nobody would trace it


def test_many_layers_and_colours_that_change_with_the_view(job: Job, folder: Path, tmp_path: Path) -> None:
    """SH of degree 3, whose coefficients the engine keeps in 10 and 11 bits, takes the most textures; 21 layers six."""
    assert job.splats is not None
    cloud = job.splats.value
    rest = np.random.default_rng(1).normal(0, 0.1, (len(cloud), 15, 3)).astype(np.float32)
    cloud = replace(cloud, sh=np.concatenate([cloud.sh, rest], axis=1))
    splats.write(cloud, tmp_path / "splats.ply")
    shutil.copy(folder / "proxy.glb", tmp_path / "proxy.glb")
    lamp = '[[lightings.lights]]\ntype = "point"\nname = "{0}"\nposition = [{1}, 1, 0]\ncolor = [1, {2}, 0.5]\n'
    lamps = "".join(lamp.format(k, k / 5 - 1.5, k / 16) for k in range(16))
    (tmp_path / "job.toml").write_text(JOB + lamps)
    many = jobs.load(tmp_path / "job.toml")
    made = export(prepare(many), tmp_path / "page", spp=4)
    assert len(made.layers.names) == 21
    file = made.folder / "splats.compressed.ply"
    means, cloud = cloud.means[made.order], splats.read(file)
    np.testing.assert_allclose(cloud.means, means, atol=2e-3)
    steps = "page.choose(1); page.jump(); await picture('night');"
    ways = cloud.means.astype(np.float64) - many.cameras[0].position
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    seen = np.clip(0.5 + np.einsum("nkc,nk->nc", cloud.sh, sh.basis(ways, 3)), 0, None)
    flat = replace(cloud, sh=((seen - 0.5) / sh.C0)[:, None].astype(np.float32))
    loaded = Loaded(np.arange(len(flat)), corners_of(*_chunk_bounds(file)))
    factor = made.layers.factor(made.layers.weights(1))[made.order]
    offline = mixer_page.drawn(flat, factor, many.cameras[0], loaded)
    assert decibels(picture(drive(made.folder, steps)["night"]), offline) >= 55


def test_the_jobs_own_mix_is_where_the_sliders_start(job: Job, folder: Path, tmp_path: Path) -> None:
    mixed = jobs.load(folder / "job.toml", ["mix.night={ lamp = [0.5, 0.25, 0] }"])
    export(prepare(mixed), tmp_path, spp=1)
    described = json.loads((tmp_path / "layers.json").read_text())
    assert described["lightings"][1]["faders"][0]["factor"] == [0.5, 0.25, 0]
    assert described["lightings"][1]["faders"][0]["weight"] == [2, 2, 2]


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        ("splats.ply", "splats.ply is not the file that the layers were made for: run mirelight mix again"),
        ("layers.bin", "layers.bin is not the file that layers.json describes: run mirelight mix again"),
        ("layers.json", "layers.json cannot be loaded (404): run mirelight mix again"),
    ],
)
def test_files_that_do_not_belong_together_are_one_line(
    page: tuple[Path, mixing.MixLayers], tmp_path: Path, spoil: str, said: str
) -> None:
    broken = tmp_path / "page"
    shutil.copytree(page[0], broken)
    path = broken / spoil
    if spoil == "layers.json":
        path.unlink()
    else:
        data = bytearray(path.read_bytes())
        data[-5] ^= 1
        path.write_bytes(data)
    with pytest.raises(RenderError, match="the engine failed") as told:
        drive(broken)
    assert said in str(told.value)


def test_a_browser_without_webgl_is_told_in_one_line(page: tuple[Path, mixing.MixLayers]) -> None:
    from playwright.sync_api import sync_playwright

    with serve(page[0], {}, {}) as (address, _), sync_playwright() as playwright:
        chromium = playwright.chromium.launch(
            executable_path=browser.find_browser(), args=["--no-sandbox", "--disable-gpu", "--disable-3d-apis"]
        )
        shown = chromium.new_page(viewport={"width": 390, "height": 844})
        shown.set_default_timeout(LIMIT)
        shown.goto(f"{address}/index.html")
        message = shown.locator("#message")
        message.filter(has_text="WebGL").wait_for()
        assert message.inner_text() == (
            "This browser shows no WebGL 2: use a newer one, or switch its graphics acceleration on"
        )
        assert shown.locator("#panel").is_hidden()
        chromium.close()


def test_splats_at_the_end_of_the_world_have_a_bookmark(job: Job) -> None:
    """float32 holds the place, not its square."""
    assert job.splats is not None
    splats = job.splats.value
    far = replace(splats, means=splats.means + np.float32(1e25))
    with np.errstate(all="raise"):
        found = bookmark(job.cameras[0], far)
    assert np.isfinite(found["far"]) and found["far"] > found["near"]


def test_two_exports_are_the_same_to_the_bit(page: tuple[Path, mixing.MixLayers], job: Job, tmp_path: Path) -> None:
    again = replace(job, render=replace(job.render, threads=1))
    made = export(prepare(again), tmp_path, spp=256)
    for name in ("layers.bin", "splats.ply"):
        assert (made.folder / name).read_bytes() == (page[0] / name).read_bytes()


def test_the_command_writes_a_page_and_refuses_in_one_line(folder: Path, tmp_path: Path) -> None:
    def run(*arguments: str) -> subprocess.CompletedProcess[str]:
        return forked.run(("mix", *arguments), tmp_path, tmp_path, timeout=300)

    inside = f'output.directory="{tmp_path / "out"}"'
    told = run(
        str(folder / "job.toml"), "-o", str(tmp_path / "page"), "--spp", "1", "--lighting", "night", "--set", inside
    )
    assert (told.returncode, told.stderr) == (0, "")
    assert told.stdout.strip() == str(tmp_path / "page" / "index.html")
    described = json.loads((tmp_path / "page" / "layers.json").read_text())
    assert [x["name"] for x in described["lightings"]] == ["night"] and described["several"]
    assert [x["name"] for x in described["layers"]] == ["lamp", "glow worm", "base"]
    (tmp_path / "plain.toml").write_text(f'splats = "{folder / "splats.ply"}"\n')
    for arguments, said in (
        ([str(tmp_path / "plain.toml")], "no proxy mesh for light to fall on; add the line proxy"),
        ([str(folder / "job.toml"), "--spp", "0"], "--spp: 0; give 1 to 1000000"),
        ([str(folder / "job.toml"), "--lighting", "dusk"], "no lighting named 'dusk'; there are: day, night"),
    ):
        told = run(*arguments, "-o", str(tmp_path / "no"))
        assert told.returncode == 2
        assert said in told.stderr
        assert len(told.stderr.splitlines()) == 1
    assert not (tmp_path / "no").exists()

"""The served page in a real browser: lights are picked and dragged, their layers come back, stills, the job saved."""

from __future__ import annotations

import base64
import io
import os
import signal
import threading
from pathlib import Path
from typing import Any
from urllib.request import urlopen

import numpy as np
import pytest
from PIL import Image

from mirelight.apps.mixer.bundle import export
from mirelight.apps.mixer.saved import Saved
from mirelight.apps.mixer.server import serving
from mirelight.apps.mixer.session import Session
from mirelight.apps.realtime import browser
from mirelight.cli import main
from mirelight.io import job as jobs
from mirelight.io import splats
from mirelight.io.gltf.write import write_glb
from mirelight.pipeline import stages
from mirelight.pipeline.scene import prepare

from .mixer_page import decibels
from .mixer_scene import walls
from .test_mixer import JOB, displayed
from .waiting import LIMIT, settled, until

SAMPLES = 64  # a splat, in the end


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("served")
    cloud, proxy = walls()
    splats.write(cloud, out / "splats.ply")
    write_glb(out / "proxy.glb", proxy, (), ())
    (out / "job.toml").write_text(JOB + "\n[render]\nspp = 1\n")
    return out


@pytest.fixture(scope="module")
def seen(folder: Path) -> dict[str, Any]:
    """What a person does on the page, one after another, while this thread traces."""
    scene = prepare(jobs.load(folder / "job.toml"))
    made = export(scene, folder / "page", spp=SAMPLES)
    session = Session(scene, made.layers, (8, SAMPLES), order=made.order)
    saved = Saved(jobs.parse(folder / "job.toml")[0])
    found: dict[str, Any] = {}

    def visit(address: str) -> None:
        try:
            _visit(address, found)
        except Exception as error:  # told by the test
            found["trouble"] = error

    with serving(session, made.folder, saved) as address:
        visitor = threading.Thread(target=visit, args=(address,))
        visitor.start()
        session.run(lambda: not visitor.is_alive())
    if "trouble" in found:
        raise found["trouble"]
    return found


def _visit(address: str, found: dict[str, Any]) -> None:
    from playwright.sync_api import Page, Route, sync_playwright

    def handles(page: Page) -> list[dict[str, Any]]:
        return list(page.evaluate("mixer.then(x => x.mix().lightings.flatMap(l => l.handles))"))

    def traced(page: Page, samples: int) -> dict[str, Any]:
        """The news, once a layer has so many samples and nothing is traced."""
        while True:
            state = page.evaluate("fetch('live/state').then(x => x.json())")
            if not state["tracing"] and [x for x in state["layers"] if x["samples"] == samples]:
                return dict(state)
            page.wait_for_timeout(100)  # between two questions

    with sync_playwright() as playwright:
        flags = [flag for flag in browser.FLAGS if flag != "--headless"] + ["--no-sandbox"]
        chromium = playwright.chromium.launch(executable_path=browser.find_browser(), args=flags)
        page = chromium.new_page(viewport={"width": 660, "height": 320}, has_touch=True)
        page.set_default_timeout(LIMIT)
        failures: list[str] = []
        page.on("pageerror", lambda error: failures.append(str(error)))
        page.goto(address)
        page.wait_for_function("document.getElementById('message').hidden")
        view = page.locator("#view")
        lamp = page.locator(".handle").first
        lamp.wait_for(state="visible")
        found["before"] = settled(page, view)
        lamp.click()
        found["picked"] = page.locator("fieldset.picked legend").all_inner_texts()
        found["pressed"] = lamp.get_attribute("aria-pressed")

        box = lamp.bounding_box()
        assert box is not None
        x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
        page.mouse.move(x, y)
        page.mouse.down()
        page.mouse.move(x - 20, y + 10, steps=3)
        page.mouse.move(x - 60, y + 30, steps=3)
        page.mouse.up()
        found["dropped"] = lamp.bounding_box(), (x - 60, y + 30)
        found["state"] = traced(page, SAMPLES)
        found["dragged"] = handles(page)
        found["after"] = settled(page, view, other_than=found["before"])

        lamp.focus()
        page.keyboard.press("Shift+ArrowUp")
        found["ground"] = handles(page)[0]["position"]
        page.keyboard.press("Alt+ArrowUp")
        found["height"] = handles(page)[0]["position"]
        traced(page, SAMPLES)
        found["late"] = late = []

        def answered_late(route: Route) -> None:
            """News of before the light was moved, twice: when the second are asked for, the page has read the first."""
            late.append(handles(page)[0]["position"])
            route.fulfill(json=found["state"])
            if len(late) == 2:
                page.unroute("**/live/state?*")

        page.route("**/live/state?*", answered_late)
        page.keyboard.press("ArrowLeft")  # which is news, so the page asks for more
        found["left"] = handles(page)[0]["position"]
        until(page, lambda: len(late) >= 2)
        traced(page, SAMPLES)

        page.evaluate("mixer.then(x => x.view.resize(160, 120))")
        settled(page, view)
        found["picture"] = page.evaluate("document.getElementById('view').toDataURL()")
        page.evaluate("dispatchEvent(new Event('resize'))")
        page.click("#save")
        page.wait_for_function("document.getElementById('news').textContent.startsWith('Saved')")
        page.click("#render")
        page.wait_for_function("document.getElementById('news').textContent === 'Still: done'")
        found["still"] = page.evaluate(
            "[document.querySelector('#still img').naturalWidth, innerWidth - panel.offsetWidth]"
        )
        page.locator("#split").fill("0")
        found["split"] = page.evaluate("getComputedStyle(document.querySelector('#still img')).clipPath")
        page.locator("[aria-label='lamp: strength']").fill("0.3")
        page.wait_for_selector("#still", state="hidden")

        page.reload()  # what was moved is kept by the server
        page.wait_for_function("document.getElementById('message').hidden")
        until(page, lambda: handles(page)[0]["position"] == found["left"])
        found["again"] = handles(page)[0]["position"]
        page.set_viewport_size({"width": 390, "height": 844})
        settled(page, page)
        found["width"] = page.evaluate("document.documentElement.scrollWidth")

        touched = lamp.bounding_box()
        assert touched is not None
        x, y = touched["x"] + touched["width"] / 2, touched["y"] + touched["height"] / 2
        finger = page.context.new_cdp_session(page)
        for kind, shift in (("touchStart", 0), ("touchMove", 12), ("touchMove", 24), ("touchEnd", None)):
            points = [] if shift is None else [{"x": x + shift, "y": y - shift}]
            finger.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})
        found["touched"] = lamp.bounding_box(), (x + 24, y - 24), page.evaluate("[scrollX, scrollY]")
        found["failures"] = failures
        chromium.close()


def test_a_light_is_picked_and_dragged(seen: dict[str, Any]) -> None:
    assert seen["failures"] == []
    assert seen["picked"] == ["lamp"] and seen["pressed"] == "true"
    box, wanted = seen["dropped"]
    assert abs(box["x"] + box["width"] / 2 - wanted[0]) < 1.5
    assert abs(box["y"] + box["height"] / 2 - wanted[1]) < 1.5
    day, night, worm = seen["dragged"]
    assert day["position"] != day["first"] and night["position"] == night["first"] == [-1, 0.8, 0.5]
    assert worm["position"] == worm["first"]
    assert [x["layer"] for x in seen["state"]["layers"]] == [day["layer"]]
    assert seen["before"] != seen["after"]


def test_a_finger_drags_a_light_on_a_phone(seen: dict[str, Any]) -> None:
    box, wanted, scrolled = seen["touched"]
    assert abs(box["x"] + box["width"] / 2 - wanted[0]) < 1.5
    assert abs(box["y"] + box["height"] / 2 - wanted[1]) < 1.5
    assert scrolled == [0, 0]


def test_a_drag_stays_in_the_plane_that_faces_the_camera(seen: dict[str, Any], folder: Path) -> None:
    camera = jobs.load(folder / "job.toml").cameras[0]
    forward = -camera.world_from_camera[:3, 2]
    first, last = (np.array(seen["dragged"][0][key]) for key in ("first", "position"))
    assert abs((last - first) @ forward) < 1e-4
    ground, height = np.array(seen["ground"]), np.array(seen["height"])
    assert abs(ground[1] - last[1]) < 1e-9 and np.abs(ground - last).max() > 0.01
    assert height[1] > ground[1] and np.abs((height - ground)[[0, 2]]).max() < 1e-9


def test_news_of_before_a_move_do_not_put_a_light_back(seen: dict[str, Any]) -> None:
    assert seen["left"] != seen["height"]
    assert seen["late"][1] == seen["left"]


def test_the_saved_job_has_the_light_there(seen: dict[str, Any], folder: Path) -> None:
    saved = jobs.load(folder / "mix.toml")
    np.testing.assert_allclose(saved.lightings[0].lights[0].place - seen["left"], 0, atol=1e-5)
    np.testing.assert_array_equal(saved.lightings[1].lights[0].place - np.array([-1, 0.8, 0.5]), 0)
    assert seen["again"] == seen["left"]


def test_the_page_and_the_saved_job_agree(seen: dict[str, Any], folder: Path) -> None:
    saved = jobs.load(folder / "mix.toml", ["render.spp=64"])
    png = io.BytesIO(base64.b64decode(seen["picture"].partition(",")[2]))
    shown = np.asarray(Image.open(png).convert("RGB"), np.float32) / 255
    frame = stages.frame(prepare(saved), saved.cameras[0], saved.lightings[0])
    assert decibels(shown, displayed(frame, 0)) >= 30
    unmoved = jobs.load(folder / "job.toml", ["render.spp=64"])
    before = stages.frame(prepare(unmoved), unmoved.cameras[0], unmoved.lightings[0])
    assert decibels(shown, displayed(before, 0)) < 30


def test_a_still_lies_over_the_view(seen: dict[str, Any]) -> None:
    assert seen["still"][0] == seen["still"][1]
    assert seen["split"] == "inset(0px 0px 0px 0%)"
    assert seen["width"] == 390


def test_the_command_serves_until_ctrl_c(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its page is there meanwhile; a second server and a port in use are one line each, and nothing is left."""
    told: list[str] = []
    codes: list[int] = []
    arguments = ["mix", str(folder / "job.toml"), "-o", str(tmp_path / "page"), "--spp", "1", "--lighting", "night"]
    arguments += ["--set", f'output.directory="{tmp_path / "out"}"', "--serve"]
    run = Session.run

    def running(session: Session) -> None:
        if told:  # the second command came so far
            raise AssertionError("a folder is served twice")
        told.append(capsys.readouterr().out.strip())
        with urlopen(told[0]) as page:
            assert b"light mixer" in page.read()
        port = told[0].split(":")[2].split("/")[0]
        codes.append(main(arguments))
        other = [str(tmp_path / "other") if x == str(tmp_path / "page") else x for x in arguments]
        codes.append(main([*other, "--port", port]))
        threading.Timer(0.3, os.kill, (os.getpid(), signal.SIGINT)).start()
        run(session)

    monkeypatch.setattr(Session, "run", running)
    before = signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background has it ignored
    try:
        assert main(arguments) == 0
    finally:
        signal.signal(signal.SIGINT, before)
    assert codes == [2, 2]
    second, port, end = capsys.readouterr().err.splitlines()
    assert second.endswith(f"process {os.getpid()} serves or writes this page; end it, or write into another folder")
    assert "--port: " in port and port.endswith("; name another port, or none for a free one")
    assert end == "mirelight: the page is no longer served"
    assert not list((tmp_path / "page").glob("mixer-*"))


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--port", "8000"], "--port: a port, but nothing is served; add --serve"),
        (["--serve", "--port", "0"], "--port: 0; give 1 to 65535"),
        (["--serve", "--port", "70000"], "--port: 70000; give 1 to 65535"),
    ],
)
def test_wrong_use_is_one_line(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], said: str
) -> None:
    assert main(["mix", str(folder / "job.toml"), "-o", str(tmp_path / "no"), *arguments]) == 2
    assert capsys.readouterr().err == f"mirelight: {said}\n"
    assert not (tmp_path / "no").exists()

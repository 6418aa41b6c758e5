"""The studio in a real browser: from a bare capture to a saved job, and a frame that has the command's bits."""

from __future__ import annotations

import base64
import io
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from mirelight.apps.realtime import browser
from mirelight.apps.studio.desk import Desk
from mirelight.apps.studio.server import serving
from mirelight.cli import main
from mirelight.io import image, splats
from mirelight.io import job as jobs
from mirelight.io.gltf.write import write_glb
from mirelight.model import PointLight, ProxyMesh, SunLight

from .mixer_scene import walls
from .waiting import LIMIT, PAUSE, settled, until

SIZE = (160, 120)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("studio")
    splats.write(walls(24)[0], out / "corner.ply")
    size = np.full(3, 0.4)
    faces = [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1], [2, 3, 7], [2, 7, 6]]
    vertices = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)]) * size
    box = ProxyMesh(vertices=vertices.astype(np.float32), faces=np.array(faces, np.int32))
    write_glb(out.with_name("box.glb"), box, (), ())
    return out


@pytest.fixture(scope="module")
def rendered(seen: dict[str, Any], folder: Path) -> Path:
    """What the command makes of the saved job."""
    out = folder / "command"
    saved = str(folder / "corner.studio.toml")
    assert main(["render", saved, "-o", str(out), "--camera", "view-1", "--lighting", "dusk", "-q"]) == 0
    return out


@pytest.fixture(scope="module")
def seen(folder: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """What a person does on the page, one after another, while this thread traces."""
    page = tmp_path_factory.mktemp("page")
    desk = Desk(str(folder / "corner.ply"), page)
    desk.turn("+Y")  # of a floor and one wall a guess may be wrong
    found: dict[str, Any] = {}

    def visit(address: str) -> None:
        try:
            _visit(address, found, folder / "corner.studio.toml")
        except Exception as error:  # told by the test
            found["trouble"] = error

    with serving(desk) as address:
        visitor = threading.Thread(target=visit, args=(address,))
        visitor.start()
        desk.run(lambda: not visitor.is_alive())
    if "trouble" in found:
        raise found["trouble"]
    return found


def _visit(address: str, found: dict[str, Any], saved: Path) -> None:
    from playwright.sync_api import Page, sync_playwright

    def state(page: Page) -> dict[str, Any]:
        return dict(page.evaluate("studio.then(x => x.state() ?? {})"))

    def job(page: Page) -> dict[str, Any]:
        return dict(page.evaluate("studio.then(x => x.model.job)"))

    def lit(page: Page, names: set[str], samples: int) -> Callable[[], bool]:
        """Whether the page shows these layers with so many samples."""

        def holds() -> bool:
            layers = state(page).get("layers", [])
            return {x["name"] for x in layers if x["name"]} == names and all(x["samples"] >= samples for x in layers)

        return holds

    def drag(page: Page, handle: str, right: float, down: float) -> tuple[float, float]:
        """Takes a handle along; how far it went, in pixels, once it stays there."""

        def place() -> tuple[float, float]:
            box = page.locator(f".handle[title='{handle}']").bounding_box()
            assert box is not None
            return box["x"] + box["width"] / 2, box["y"] + box["height"] / 2

        def stays() -> bool:
            before = place()
            page.wait_for_timeout(PAUSE)
            return place() == before

        began = place()
        page.mouse.move(*began)
        page.mouse.down()
        page.mouse.move(began[0] + right, began[1] + down, steps=3)
        page.mouse.up()
        until(page, stays)
        return place()[0] - began[0], place()[1] - began[1]

    with sync_playwright() as playwright:
        flags = [flag for flag in browser.FLAGS if flag != "--headless"] + ["--no-sandbox"]
        chromium = playwright.chromium.launch(executable_path=browser.find_browser(), args=flags)
        page = chromium.new_page(viewport={"width": 900, "height": 600})
        page.set_default_timeout(LIMIT)
        failures: list[str] = []
        page.on("pageerror", lambda error: failures.append(str(error)))
        page.goto(address)
        page.wait_for_function("document.getElementById('message').hidden")
        found["title"] = page.inner_text("#title")
        for label, value in (("Width", SIZE[0]), ("Height", SIZE[1])):
            page.fill(f"[aria-label='{label} of frames in pixels']", str(value))
        page.fill("#samples", "64")
        until(page, lit(page, {"sun", "environment"}, 8))

        page.click("#add-point")
        page.fill("[aria-label='lamp: Kelvin']", "2700")
        page.fill("[aria-label='lamp: intensity in candela']", "12")
        found["began"] = job(page)["lightings"][0]["lights"][1]["position"]
        drag(page, "lamp", 40, 20)
        page.focus(".handle[title=lamp]")
        page.keyboard.press("Alt+ArrowUp")
        found["moved"] = job(page)["lightings"][0]["lights"][1]["position"]

        for label, degrees in (("Azimuth", "350"), ("Elevation", "20")):  # before the camera
            page.fill(f"[aria-label='sun: {label} °']", degrees)
            page.keyboard.press("Tab")
        took = drag(page, "sun", 60, -30)
        sun = job(page)["lightings"][0]["lights"][0]
        found["sun"] = took, sun, page.input_value("[aria-label='sun: Azimuth °']")
        page.fill("[aria-label='sun: Azimuth °']", "200")
        page.keyboard.press("Tab")

        page.click("[aria-label='Another lighting like this one']")
        page.fill("#lighting-name", "dusk")
        page.click("[aria-label='Remove sun']")
        until(page, lit(page, {"lamp", "environment"}, 8))
        page.click("#add-spot")
        page.click("#undo")
        page.click("#add-tube")  # of a kind that the page knows by its record alone
        page.wait_for_selector(".handle[title=tube]")
        found["tube"] = job(page)["lightings"][1]["lights"][-1]
        page.click("#undo")
        found["undone"] = [x["name"] for x in job(page)["lightings"][1]["lights"]]
        page.fill("[aria-label='lamp: Kelvin']", "-5")
        page.fill("[aria-label='lamp: Kelvin']", "3000")
        page.keyboard.press("Tab")
        page.click("#keep-view")
        page.wait_for_selector("[aria-label='Render view-1']")
        until(page, lit(page, {"lamp", "environment"}, 64))

        page.evaluate("studio.then(x => { x.view.resize(160, 120); x.go(x.cameras().at(-1)); })")
        settled(page, page.locator("#view"))
        found["picture"] = page.evaluate("document.getElementById('view').toDataURL()")
        page.click("#mesh")
        page.wait_for_selector("#mesh[aria-pressed=true]")
        settled(page, page.locator("#view"))
        found["mesh"] = page.evaluate("document.getElementById('view').toDataURL()")
        page.click("#mesh")
        found["sky"] = page.evaluate("import('./model.mjs').then(x => x.toSky(x.fromSky([40, 150])))")
        found["turned"] = page.evaluate("import('./model.mjs').then(x => x.turn({ path: 'a.hdr', rotation: 170 }, 20))")
        page.click("#misfit")
        page.wait_for_selector("#misfit[aria-pressed=true]")
        settled(page, page.locator("#view"))
        found["misfit"] = page.evaluate("document.getElementById('view').toDataURL()"), page.inner_text("#near")
        page.click("#misfit")
        page.evaluate("dispatchEvent(new Event('resize'))")

        page.click("#save")
        page.wait_for_function("document.getElementById('saved').textContent")
        found["saved"] = page.inner_text("#saved")
        page.click("[aria-label='Render view-1']")
        until(page, lambda: any(x["state"] in ("done", "failed") for x in state(page).get("renders", [])))
        found["render"] = state(page)["renders"][0]
        found["frame"] = page.request.get(page.locator("#queue img").evaluate("x => x.src")).body()
        found["said"] = page.inner_text("#error")
        with page.expect_file_chooser() as chosen:
            page.click("#add-object")
        chosen.value.set_files(saved.parent.with_name("box.glb"))
        page.wait_for_selector(".handle[title=box]")
        found["thing"] = [dict(job(page)["objects"][0]), drag(page, "box", -30, 8), dict(job(page)["objects"][0])]
        drag(page, "box: turn", 40, 0)
        page.keyboard.press("ArrowRight")
        number = page.evaluate("studio.then(x => x.number())")
        until(page, lambda: state(page)["objects"]["number"] >= number)
        found["thing"] += [job(page)["objects"][0], state(page)["objects"]["told"][0], page.inner_text("#error")]
        settled(page, page.locator("#view"))
        page.set_viewport_size({"width": 390, "height": 844})
        settled(page, page)
        found["phone"] = page.evaluate("[document.documentElement.scrollWidth, scrollX]")
        found["unlabelled"] = page.evaluate(
            "[...document.querySelectorAll('button, input, select')].filter((x) => !x.closest('[hidden]') && "
            "!(x.ariaLabel || x.textContent.trim() || x.labels?.length)).map((x) => x.outerHTML)"
        )
        text = saved.read_text()
        saved.write_text(text.replace("intensity = 12", "intensity = 9"))
        page.click("#read")
        page.wait_for_selector("[aria-label='lamp: intensity in candela']")
        until(page, lambda: page.input_value("[aria-label='lamp: intensity in candela']") == "9")
        found["read"] = page.input_value("[aria-label='lamp: intensity in candela']"), page.inner_text("#title")
        saved.write_text(text)
        found["failures"] = failures
        chromium.close()


def test_lights_are_added_moved_and_undone(seen: dict[str, Any]) -> None:
    assert seen["failures"] == [] and seen["said"] == ""
    assert seen["title"] == "corner"
    assert np.abs(np.subtract(seen["moved"], seen["began"])).max() > 0.05
    assert seen["undone"] == ["lamp"]


def test_a_light_known_by_its_record_is_added(seen: dict[str, Any]) -> None:
    tube = seen["tube"]
    assert tube["type"] == tube["name"] == "tube"
    assert tube["length"] > tube["radius"] > 0 and tube["intensity"] > 0


def test_the_saved_job_is_what_the_page_shows(seen: dict[str, Any], folder: Path, rendered: Path) -> None:
    assert seen["saved"] == "Saved: corner.studio.toml"
    job = jobs.load(folder / "corner.studio.toml")
    assert [x.name for x in job.lightings] == ["sun", "dusk"]
    sun, lamp = job.lightings[0].lights
    assert isinstance(sun, SunLight) and isinstance(lamp, PointLight)
    assert np.degrees(np.arctan2(-sun.direction[0], sun.direction[2])) % 360 == pytest.approx(200)
    np.testing.assert_allclose(lamp.position, seen["moved"])
    assert lamp.intensity == 12
    with Image.open(rendered / "view-1.dusk.png") as frame:
        away = np.asarray(frame.convert("RGB"), np.float32) - pixels(seen["picture"])
    assert 20 * np.log10(255 / np.sqrt(np.mean(away**2))) >= 28


def pixels(address: str) -> NDArray[np.float32]:
    """(H, W, 3) of a picture in an address."""
    with Image.open(io.BytesIO(base64.b64decode(address.partition(",")[2]))) as found:
        return np.asarray(found.convert("RGB"), np.float32)


def test_the_mesh_is_drawn_over_the_capture(seen: dict[str, Any]) -> None:
    change = pixels(seen["mesh"]) - pixels(seen["picture"])
    drawn = np.abs(change).max(axis=-1) > 10
    assert 0.005 < drawn.mean() < 0.9
    assert change[drawn, 2].mean() > change[drawn, 0].mean()  # its edges are blue


def test_far_light_is_turned(seen: dict[str, Any]) -> None:
    assert seen["sky"] == pytest.approx([40, 150], abs=1e-3)
    assert seen["turned"] == {"path": "a.hdr", "rotation": -170}


def test_the_proxys_fit_is_shown(seen: dict[str, Any]) -> None:
    """Splats of a proxy that fits are grey."""
    picture, said = seen["misfit"]
    shown = np.asarray(Image.open(io.BytesIO(base64.b64decode(picture.partition(",")[2]))).convert("RGB"), np.float32)
    lit = shown[shown.max(axis=-1) > 60]
    assert np.quantile(np.ptp(lit, axis=-1) / lit.max(axis=-1), 0.9) < 0.35
    assert said.startswith(("100 %", "99 %"))


def test_a_sun_is_dragged(seen: dict[str, Any]) -> None:
    """Where it stands follows the pointer, in the sky and in its row."""
    (right, down), sun, azimuth = seen["sun"]
    assert right == pytest.approx(60, abs=25) and down == pytest.approx(-30, abs=25)
    assert not 340 < sun["azimuth"] < 352 and float(azimuth) == sun["azimuth"]


def test_an_object_is_put_down_dragged_and_turned(seen: dict[str, Any]) -> None:
    began, went, moved, turned, told, said = seen["thing"]
    assert began["drop"] is True and began["path"] == "box.glb" and said == ""
    assert went[0] == pytest.approx(-30, abs=8) and went[1] == pytest.approx(8, abs=8)
    (x, y, z), (a, b, c) = began["transform"]["translation"], moved["transform"]["translation"]
    assert b == y and abs(a - x) + abs(c - z) > 0.02  # along the ground, which decides how high it stands
    assert turned["transform"]["rotation_euler"][1] not in (0, None)
    assert abs(told["place"][1]) < 0.1 and told["count"] == 24  # on the floor


def test_a_frame_has_the_commands_bits(seen: dict[str, Any], folder: Path, rendered: Path) -> None:
    assert seen["render"]["state"] == "done", seen["render"]
    assert seen["frame"] == (rendered / "view-1.dusk.png").read_bytes()
    ours, theirs = (image.read(x / "view-1.dusk.exr") for x in (folder / "out", rendered))
    np.testing.assert_array_equal(ours.rgba, theirs.rgba)


def test_what_is_written_by_hand_is_read(seen: dict[str, Any]) -> None:
    assert seen["read"] == ("9", "corner")


def test_it_is_labelled_and_fits_a_phone(seen: dict[str, Any]) -> None:
    assert seen["phone"] == [390, 0]
    assert seen["unlabelled"] == []

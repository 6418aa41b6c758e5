"""Pages in a browser, as pictures of docs/guides: the studio's whole way as a film, the mixer, reports.

    python scripts/screens.py                       # all of them, into docs/pictures
    python scripts/screens.py mixer -o FOLDER       # one

Needs Chromium, npm and the extras `test` (playwright), `compare` and `denoise`. What is rendered for them is kept in
out/screens.
"""

from __future__ import annotations

import argparse
import io
import shutil
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from page_pictures import ROOT, run

from mirelight.apps.realtime import browser
from mirelight.base.errors import MirelightError
from mirelight.io.atomic import atomic_path

if TYPE_CHECKING:
    from PIL import Image
    from playwright.sync_api import Page

STILL_LIFE = ROOT / "mirelight" / "apps" / "demo" / "scene"
PICTURES = ROOT / "docs" / "pictures"
WORK = ROOT / "out" / "screens"
SIZE = {"width": 1280, "height": 720}
PAUSE, LIMIT = 250, 600_000  # milliseconds
MOST_SAMPLES = 256  # of a splat's light after a move
MOST_FILM = 2_000_000  # bytes


@contextmanager
def opened(address: str, **size: int) -> Iterator[Page]:
    """A page in a browser; an error in the page ends it."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        flags = [flag for flag in browser.FLAGS if flag != "--headless"] + ["--no-sandbox"]
        chromium = playwright.chromium.launch(executable_path=browser.find_browser(), args=flags)
        page = chromium.new_page(viewport={**SIZE, **size})
        page.set_default_timeout(LIMIT)
        failures: list[str] = []
        page.on("pageerror", lambda error: failures.append(str(error)))
        page.goto(address)
        yield page
        chromium.close()
    if failures:
        raise MirelightError(f"{address}: {failures[0]}")


def shot(page: Page) -> Image.Image:
    """What the page shows, once it has come to rest."""
    from PIL import Image

    before = b""
    for _ in range(40):
        page.wait_for_timeout(PAUSE)
        now = page.screenshot()
        if now == before:
            break
        before = now
    return Image.open(io.BytesIO(before)).convert("RGB")


def until(page: Page, holds: Callable[[], bool]) -> None:
    """Waits for a condition."""
    for _ in range(LIMIT // PAUSE):
        if holds():
            return
        page.wait_for_timeout(PAUSE)
    raise MirelightError("the page did not get there")


class Studio:
    """What a person does on the studio's page, and what is seen of it."""

    def __init__(self, page: Page) -> None:
        self.page = page
        self.frames: list[tuple[Image.Image, int]] = []  # and for how many milliseconds
        page.wait_for_function("document.getElementById('message').hidden")

    def state(self) -> dict[str, Any]:
        """The server's last news."""
        return dict(self.page.evaluate("studio.then(x => x.state() ?? {})"))

    def lit(self, samples: int, *names: str) -> None:
        """Waits until the layers of these lights have so many samples, of the newest edit."""

        def holds() -> bool:
            layers = {x["name"]: x["samples"] for x in self.state().get("layers", [])}
            return all(layers.get(x, 0) >= samples for x in names)

        until(self.page, holds)

    def keep(self, milliseconds: int) -> None:
        """A frame of the film."""
        self.frames.append((shot(self.page), milliseconds))
        print(f"frame {len(self.frames)}", file=sys.stderr, flush=True)

    def drag(self, place: tuple[float, float], way: Sequence[tuple[float, float]], milliseconds: int) -> None:
        """Takes what is at a place of the page along a way, in pixels from there; a frame each, with light on it."""
        x, y = place
        self.page.mouse.move(x, y)
        self.page.mouse.down()
        for right, down in way:
            before = self.state()["number"]
            self.page.mouse.move(x + right, y + down)
            until(self.page, lambda before=before: self.state()["number"] > before)  # type: ignore[misc]
            self.keep(milliseconds)
        self.page.mouse.up()

    def middle(self, what: str) -> tuple[float, float]:
        """Of an element, in pixels of the page."""
        box = self.page.locator(what).bounding_box()
        assert box is not None
        return box["x"] + box["width"] / 2, box["y"] + box["height"] / 2


def in_studio(name: str, act: Callable[[Studio], None], work: Path) -> None:
    """Opens a capture or a job in the studio and does something there, while this thread traces."""
    from mirelight.apps.studio.desk import Desk
    from mirelight.apps.studio.server import serving

    shutil.rmtree(work / "page", ignore_errors=True)
    (work / "page").mkdir(parents=True)
    desk = Desk(name, work / "page", str(work / "still life.studio.toml"))
    trouble: list[Exception] = []

    def visit(address: str) -> None:
        try:
            with opened(address) as page:
                act(Studio(page))
        except Exception as error:  # told by the other thread
            trouble.append(error)

    with serving(desk) as address:
        visitor = threading.Thread(target=visit, args=(address,))
        visitor.start()
        desk.run(lambda: not visitor.is_alive())
    if trouble:
        raise trouble[0]


def film(out: Path) -> Path:
    """The studio's way as a film: mesh, a panorama turned, a lamp dragged and coloured, before and after, a frame."""
    work = WORK / "film"
    shutil.rmtree(work, ignore_errors=True)
    shutil.copytree(STILL_LIFE, work / "still life")
    frames: list[tuple[Image.Image, int]] = []

    def act(studio: Studio) -> None:
        page = studio.page
        page.add_style_tag(content="#split { z-index: 1 }")
        page.keyboard.press("c")
        studio.keep(1000)
        until(page, lambda: studio.state().get("near") is not None)
        page.click("#mesh")
        studio.keep(1200)
        page.click("#mesh")
        page.keyboard.press("c")
        studio.lit(8, "environment")
        studio.keep(900)
        studio.drag(studio.middle("#ball"), [(-8 * k, 0) for k in range(1, 5)], 250)
        page.click("[aria-label=lamp]")
        studio.lit(64, "point")
        studio.keep(900)
        way = [(35 * k, 12 * k - 3 * k * k) for k in range(1, 9)]
        studio.drag(studio.middle(".handle[title=point]"), way, 200)
        page.fill("[aria-label='point: Kelvin']", "2000")
        page.keyboard.press("Tab")
        studio.lit(64, "point")
        studio.keep(900)
        page.click("#compare")
        for share in (0.2, 0.35, 0.5, 0.65, 0.5):
            page.evaluate(f"document.getElementById('split').value = {share}; dispatchEvent(new Event('resize'))")
            studio.keep(250)
        page.click("#compare")
        page.click("#save")
        page.wait_for_function("document.getElementById('saved').textContent")
        page.click("[aria-label='Render front']")
        until(page, lambda: any(x["state"] in ("done", "failed") for x in studio.state().get("renders", [])))
        page.click("#queue .thumb")
        page.evaluate("document.getElementById('split').value = 0; dispatchEvent(new Event('resize'))")
        studio.keep(2500)
        frames.extend(studio.frames)

    in_studio(str(work / "still life" / "job.toml"), act, work)
    path = out / "studio.webp"
    shots, times = zip(*frames, strict=True)
    for quality in (70, 60, 50, 40, 30):
        with atomic_path(path) as fresh:
            shots[0].save(
                fresh, "WEBP", quality=quality, method=6, save_all=True, append_images=shots[1:], duration=list(times)
            )
        if path.stat().st_size <= MOST_FILM:
            break
    return path


@contextmanager
def served(*arguments: str | Path) -> Iterator[str]:
    """The address that a command serves, as long as it is needed."""
    program = [sys.executable, "-m", "mirelight", *map(str, arguments)]
    with subprocess.Popen(program, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        try:
            yield process.stdout.readline().strip()
        finally:
            process.terminate()


def kept(picture: Image.Image, path: Path) -> Path:
    """Written as JPEG."""
    with atomic_path(path) as fresh:
        picture.save(fresh, "JPEG", quality=86, optimize=True, progressive=True)
    return path


def mixer(out: Path) -> Path:
    """The served mixer: a lamp dragged across the still life, left as it is on the page, right as a still of it."""
    work = WORK / "mixer"
    shutil.rmtree(work, ignore_errors=True)
    shutil.copytree(STILL_LIFE, work / "still life")
    job = work / "still life" / "job.toml"
    settings = ("--set", "render.denoise=true", "--set", "render.spp=64")
    light = ("--lighting", "lamp", "--lighting", "sunset", "--spp", str(MOST_SAMPLES))
    with served("mix", job, "-o", work / "page", "--serve", *light, *settings) as address, opened(address) as page:
        page.wait_for_function("document.getElementById('message').hidden")
        page.click("#lightings button:has-text('lamp')")
        lamp = page.locator(".handle").first
        lamp.click()
        box = lamp.bounding_box()
        assert box is not None
        page.mouse.move(box["x"] + 16, box["y"] + 16)
        page.mouse.down()
        page.mouse.move(box["x"] + 316, box["y"] + 46, steps=4)
        page.mouse.up()

        def traced() -> bool:
            layers = page.evaluate("fetch('live/state').then(x => x.json())")["layers"]
            return any(x["samples"] >= MOST_SAMPLES for x in layers)

        until(page, traced)
        page.click("#render")
        page.wait_for_function("document.getElementById('news').textContent === 'Still: done'")
        return kept(shot(page), out / "mixer.jpg")


def compared(out: Path) -> Path:
    """The report of `compare`: the courtyard's evening beside its truth."""
    work = WORK / "compare"
    truth = ROOT / "scenes" / "courtyard" / "truth" / "front.evening.png"
    run("render", ROOT / "docs" / "gallery" / "difference.toml", "-o", work, "-q")
    run("compare", truth, work / "front.evening.exr", "-q", "-o", work / "report.html")
    with opened((work / "report.html").as_uri(), height=900) as page:
        page.evaluate(f"document.body.innerHTML = document.body.innerHTML.replaceAll('{ROOT.as_posix()}/', '')")
        return kept(shot(page), out / "compare.jpg")


def explained(out: Path) -> Path:
    """The report of `explain`: what the real engine's picture of the courtyard's evening lacks, cause by cause."""
    work = WORK / "explain"
    small = ("--set", "resolution_scale=0.75", "--spp", "16")
    run("explain", ROOT / "docs" / "gallery" / "difference.toml", "-o", work, "-q", *small)
    with opened((work / "explain.html").as_uri(), height=1500) as page:
        page.evaluate("scrollTo(0, 0)")
        return kept(shot(page), out / "explain.jpg")


PAGES = {"studio": film, "mixer": mixer, "compare": compared, "explain": explained}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"{', '.join(PAGES)}; none: all")
    parser.add_argument("-o", "--out", type=Path, default=PICTURES, help="folder of the pictures (docs/pictures)")
    arguments = parser.parse_args()
    if unknown := set(arguments.names) - set(PAGES):
        parser.error(f"no page {', '.join(sorted(unknown))}; there are {', '.join(PAGES)}")
    for name in arguments.names or PAGES:
        path = PAGES[name](arguments.out)
        print(f"{path} ({path.stat().st_size / 1000:.0f} kB)", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())

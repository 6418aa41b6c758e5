"""Runs an exported page in headless Chromium and reads what the engine rendered, bit for bit.

The page sends its buffers back by PUT to a server that lives as long as the run, on this machine's loopback address
alone. So Chromium needs no driver: nothing is scripted from outside, and no package has to match the browser's version.
"""

from __future__ import annotations

import json
import os
import queue
import shutil
import subprocess
import tempfile
import zipfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mirelight.apps.realtime import engine
from mirelight.apps.realtime.bundle import Exported, export
from mirelight.apps.realtime.server import serve
from mirelight.base.errors import BackendError, InputError, RenderError
from mirelight.io.atomic import atomic_path
from mirelight.io.png import write_png
from mirelight.io.safety import open_file, read_bytes
from mirelight.model import F32, Camera, Job, Lighting

BROWSERS = ("chromium", "chromium-browser", "google-chrome-stable", "google-chrome")
FLAGS = (
    "--headless",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--disable-dev-shm-usage",
    "--disable-extensions",
    # It calls nobody: no updates, metrics, field trials or safe-browsing lists, and no name is looked up.
    "--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1",
    "--no-proxy-server",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-default-apps",
    "--disable-sync",
    "--disable-breakpad",
    "--disable-domain-reliability",
    "--disable-client-side-phishing-detection",
    "--disable-features=OptimizationHints,MediaRouter,Translate,AutofillServerCommunication",
    "--metrics-recording-only",
    "--no-pings",
    "--no-default-browser-check",
    "--force-device-scale-factor=1",
    "--no-first-run",
    "--mute-audio",
)
SECONDS = 900.0  # software WebGL on two cores takes up to a minute for a capture of 100,000 splats
_CAPTURE_PAGE = ("capture.html", "capture.mjs")
_IMAGES = ("frame", "unlit")  # uint8
_BUFFERS = ("relight", "frame_f32", "unlit_f32")  # float32
_SAID = "said"  # what the page is about to do, as often as it says so
_TEXTS = ("meta", "done", "failed", _SAID)
Report = Callable[[str], None]  # gets a few words
_TEXT_LIMIT = 1 << 20
_BUFFER_LIMIT = 1 << 31  # bytes; 8192 x 8192 float pixels have half of it


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class EngineFrames:
    """What the engine rendered; row 0 is the top. RGB is premultiplied where the clear colour is transparent."""

    frame: NDArray[np.uint8]  # (H, W, 4) the back buffer
    unlit: NDArray[np.uint8]  # (H, W, 4) the same with blend 0
    relight: F32  # (h, w, 4) the relighting texture: linear lit colour, coverage
    frame_f32: F32  # (H, W, 4) the frame in a float target; linear pipeline: the scene before tone mapping
    unlit_f32: F32  # (H, W, 4)
    meta: Mapping[str, Any]  # engine, formats, matrices (row-major, column vectors), lights
    warnings: tuple[str, ...] = ()  # what of the job the engine could not follow


def find_browser() -> str:
    """The path of Chromium: $MIRELIGHT_BROWSER, else the first one on PATH.

    Raises:
        BackendError: there is none.
    """
    named = os.environ.get("MIRELIGHT_BROWSER")
    for name in (named,) if named else BROWSERS:
        found = shutil.which(name)
        if found:
            return found
    missing = f"{named} (MIRELIGHT_BROWSER)" if named else "Chromium"
    raise BackendError(f"{missing} was not found and runs the real-time engine: apt-get install chromium")


def render(
    job: Job,
    camera: Camera,
    lighting: Lighting,
    directory: str | Path,
    *,
    shadows: bool = True,
    like: Path | None = None,
    report: Report | None = None,
) -> EngineFrames:
    """Export the job's scene, render it with the real engine, and keep what it rendered beside the page.

    Writes frame.png, unlit.png, buffers.npz and meta.json into `directory`; :func:`load_frames` reads them back.

    Args and errors as for :func:`mirelight.apps.realtime.bundle.export`, and:

    Args:
        report: gets in a few words what is being done.

    Raises:
        BackendError: Chromium is missing.
        RenderError: the engine failed or did not finish.
    """
    browser = find_browser()
    if report is not None:
        report("writing the page")
    exported = export(job, camera, lighting, directory, shadows=shadows, like=like)
    return run_page(exported, browser, report=report)


def run_page(
    exported: Exported, browser: str | None = None, seconds: float = SECONDS, report: Report | None = None
) -> EngineFrames:
    """Render an exported page, adapted by hand or not, and keep what it rendered beside it."""
    size = (int(exported.description["height"]), int(exported.description["width"]))
    received = _drive(exported.folder, browser or find_browser(), seconds, report)
    frames = _assemble(received, size, exported.warnings)
    _keep(frames, exported.folder)
    return frames


# --- the browser -----------------------------------------------------------------------------------------------------


def _drive(folder: Path, browser: str, seconds: float, report: Report | None) -> dict[str, bytes]:
    """Open the capture page and collect what it sends."""
    pages = {name: engine.page_file("realtime", name) for name in _CAPTURE_PAGE}
    limits = dict.fromkeys(_TEXTS, _TEXT_LIMIT) | dict.fromkeys((*_IMAGES, *_BUFFERS), _BUFFER_LIMIT)
    return drive(folder, browser, seconds, page=_CAPTURE_PAGE[0], pages=pages, limits=limits, report=report)


def drive(
    folder: Path,
    browser: str,
    seconds: float,
    *,
    page: str,
    pages: Mapping[str, bytes],
    limits: Mapping[str, int],
    report: Report | None = None,
) -> dict[str, bytes]:
    """Open a page of a folder and collect what it sends, until it sends "done" or "failed".

    Args:
        folder: what is served.
        browser: from :func:`find_browser`.
        seconds: the most that it may take without a word.
        page: what to open.
        pages, limits: as for `mirelight.apps.realtime.server.serve`.
        report: gets what the page says that it does.

    Raises:
        RenderError: the page sent "failed", or nothing more.
    """
    # Chromium's helpers may write a last file into the profile while it is being removed
    kept = tempfile.TemporaryDirectory(prefix="mirelight-", ignore_cleanup_errors=True)
    with serve(folder, pages, limits) as (address, inbox), kept as profile:
        sandbox = ["--no-sandbox"] if hasattr(os, "geteuid") and os.geteuid() == 0 else []  # Chromium refuses root
        command = [browser, *FLAGS, *sandbox, f"--user-data-dir={profile}", f"{address}/{page}"]
        log = Path(profile) / "browser.log"
        with log.open("wb") as sink:
            process = subprocess.Popen(
                command, stdin=subprocess.DEVNULL, stdout=sink, stderr=sink, start_new_session=True
            )
            try:
                return _collect(process, inbox, seconds, log, report)
            finally:
                _end(process)


def _collect(
    process: subprocess.Popen[bytes],
    inbox: queue.Queue[tuple[str, bytes]],
    seconds: float,
    log: Path,
    report: Report | None,
) -> dict[str, bytes]:
    received: dict[str, bytes] = {}
    waited = 0.0
    while "done" not in received:
        try:
            name, body = inbox.get(timeout=1.0)
        except queue.Empty:
            waited += 1.0
            if process.poll() is not None:
                said = log.read_text(errors="replace").strip().splitlines() or ["no message"]
                raise RenderError(f"Chromium ended early (exit code {process.returncode}): {said[-1]}") from None
            if waited >= seconds:
                raise RenderError(f"the engine did not finish within {seconds:g} s; nothing was written") from None
            continue
        if name == "failed":
            raise RenderError(f"the engine failed: {' '.join(body.decode(errors='replace').split())}")
        if name == _SAID and report is not None:
            report(" ".join(body.decode(errors="replace").split())[:80])
        received[name] = body
    return received


def _end(process: subprocess.Popen[bytes]) -> None:
    """End the browser and its children, which are one group."""
    try:
        os.killpg(process.pid, 15)
        process.wait(timeout=10)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, 9)
        process.wait()
    except ProcessLookupError:
        process.wait()


# --- the buffers -----------------------------------------------------------------------------------------------------


def _assemble(received: Mapping[str, bytes], size: tuple[int, int], warnings: tuple[str, ...]) -> EngineFrames:
    try:
        meta = json.loads(received["meta"])
        texture = (int(meta["relight"]["height"]), int(meta["relight"]["width"]))
        images = {name: _upright(received[name], np.uint8, size) for name in _IMAGES}
        buffers = {
            name: _upright(received[name], np.float32, texture if name == "relight" else size) for name in _BUFFERS
        }
    except (KeyError, ValueError) as error:
        raise RenderError(f"the engine sent something else than its buffers: {error}") from error
    return EngineFrames(
        frame=images["frame"],
        unlit=images["unlit"],
        relight=buffers["relight"],
        frame_f32=buffers["frame_f32"],
        unlit_f32=buffers["unlit_f32"],
        meta=meta,
        warnings=warnings,
    )


def _upright(data: bytes, dtype: Any, size: tuple[int, int]) -> NDArray[Any]:
    """OpenGL's rows start at the bottom."""
    return np.ascontiguousarray(np.frombuffer(data, dtype=dtype).reshape(*size, 4)[::-1])


def _keep(frames: EngineFrames, folder: Path) -> None:
    for name in _IMAGES:
        write_png(folder / f"{name}.png", getattr(frames, name), {})
    with atomic_path(folder / "buffers.npz") as temporary:
        np.savez_compressed(temporary, **{name: getattr(frames, name) for name in _BUFFERS})
    with atomic_path(folder / "meta.json") as temporary:
        kept = {**frames.meta, "warnings": list(frames.warnings)}
        temporary.write_text(json.dumps(kept, indent=1) + "\n", encoding="utf-8")


def _image(path: Path) -> NDArray[np.uint8]:
    from PIL import Image

    with open_file(path) as stream, Image.open(stream, formats=("PNG",)) as image:
        return np.asarray(image.convert("RGBA"))


def load_frames(directory: str | Path) -> EngineFrames:
    """Read back what :func:`render` wrote.

    Raises:
        InputError: a file is missing or is not what was written.
    """
    folder = Path(directory)
    try:
        images: dict[str, Any] = {name: _image(folder / f"{name}.png") for name in _IMAGES}
        whole = open_file(folder / "buffers.npz")
        with whole, np.load(whole, allow_pickle=False) as stored:
            buffers = {name: stored[name] for name in _BUFFERS}
        meta = json.loads(read_bytes(folder / "meta.json", _TEXT_LIMIT))
    except (OSError, EOFError, KeyError, ValueError, RecursionError, zipfile.BadZipFile) as error:
        raise InputError(folder, f"no complete engine frames ({error})", "make them with mirelight realtime") from error
    return EngineFrames(**images, **buffers, meta=meta, warnings=tuple(meta.get("warnings", ())))

"""Drives the mixer's page as a person would, and draws offline what it should show: for tests and measurements."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mirelight.apps.realtime import browser
from mirelight.apps.realtime.engine import page_file
from mirelight.base import colour, sh
from mirelight.compositor import Compositor
from mirelight.compositor.engine import SOFTWARE_BITS, EngineDrawing, Loaded, engine_rank, loaded_ply
from mirelight.compositor.source import uploaded
from mirelight.model import F32, Camera, CompositorSettings, SplatCloud

# STEPS has `page`, `picture(name)` sends the picture once it is at rest, `set(label, value)` moves what has that label.
_DRIVER = """
const send = (name, body) => fetch(`captured/${name}`, { method: 'PUT', body });
try {
    const page = await globalThis.mixer;
    const { app } = page.view;
    const frames = (count) => new Promise((resolve) => {
        const handle = app.on('frameend', () => { if (--count <= 0) { handle.off(); resolve(); } });
    });
    const picture = async (name) => {
        page.view.resize(WIDTH, HEIGHT);
        await frames(30);  // the camera comes to rest
        page.jump();  // splats are copied and sorted again
        const gl = app.graphicsDevice.gl;
        let [before, same] = [new Uint8Array(4 * WIDTH * HEIGHT), 0];
        for (let tries = 0; tries < 100 && same < 4; tries++) {  // sorting runs in a worker
            await frames(8);
            const pixels = new Uint8Array(before.length);
            gl.bindFramebuffer(gl.FRAMEBUFFER, null);
            gl.readPixels(0, 0, WIDTH, HEIGHT, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
            same = pixels.every((x, i) => x === before[i]) ? same + 1 : 0;
            before = pixels;
        }
        await send(name, before);
    };
    const set = (label, value) => {
        const input = document.querySelector(`[aria-label="${label}"]`);
        input.value = value;
        input.dispatchEvent(new Event('input'));
    };
    await new Promise((resolve) => {
        const handle = app.systems.gsplat.on('frame:ready', (camera, layer, ready, loading) => {
            if (ready && loading === 0) { handle.off(); resolve(); }
        });
        page.view.wake();  // at rest it draws nothing
    });
STEPS
    await send('done', '');
} catch (error) {
    await send('failed', document.getElementById('message').textContent || String(error?.stack ?? error));
}
"""


def drive(folder: Path, steps: str, size: tuple[int, int], sent: tuple[str, ...], seconds: float) -> dict[str, bytes]:
    """Open an exported page in Chromium and take steps on it.

    Args:
        folder: the exported page.
        steps: JavaScript.
        size: width and height of the pictures, pixels.
        sent: names of what the steps send.
        seconds: that it may take.

    Returns:
        What was sent, by name; pictures as `picture` takes them.

    Raises:
        RenderError: the page failed, or took longer.
    """
    driver = _DRIVER.replace("STEPS", steps).replace("WIDTH", str(size[0])).replace("HEIGHT", str(size[1]))
    html = page_file("mixer", "index.html").decode()
    html = html.replace("</body>", '<script type="module" src="driver.mjs"></script></body>')
    limits = dict.fromkeys((*sent, "done", "failed"), 4 * size[0] * size[1] + (1 << 16))
    pages = {"driver.html": html.encode(), "driver.mjs": driver.encode()}
    return browser.drive(folder, browser.find_browser(), seconds, page="driver.html", pages=pages, limits=limits)


def picture(data: bytes, size: tuple[int, int]) -> F32:
    """(H, W, 3) 0..1, the top row first, of what `drive` brought."""
    rgba = np.frombuffer(data, np.uint8).reshape(size[1], size[0], 4)
    return np.float32(1 / 255) * rgba[::-1, :, :3].astype(np.float32)


def drawn(cloud: SplatCloud, factor: F32, camera: Camera, loaded: Loaded | None = None) -> F32:
    """Splats in the colours that a factor gives them, drawn offline by the engine's rules.

    Args:
        cloud: as captured.
        factor: (N, 3), of linear light.
        camera: that sees them.
        loaded: how the engine holds a compressed file; None: it reads a PLY with float32.

    Returns:
        (H, W, 3) display values, 0..1.
    """
    shown = colour.srgb_encode(colour.srgb_decode(0.5 + sh.C0 * cloud.sh[:, 0]) * factor)
    new = replace(cloud, sh=((shown - 0.5) / sh.C0)[:, None].astype(np.float32))
    settings = CompositorSettings(profile="playcanvas", work_buffer="large", eight_bit=True)
    held = uploaded(new) if loaded is None else new
    rank = engine_rank(cloud, camera, loaded=loaded or loaded_ply(cloud, reordered=False))
    picture = Compositor(held, settings).composite(camera, depth=False, drawing=EngineDrawing(rank, SOFTWARE_BITS))
    return np.clip(picture.color, 0, 1)


def decibels(a: NDArray[np.floating], b: NDArray[np.floating]) -> float:
    """PSNR of values of 0 to 1."""
    return float(-10 * np.log10(np.mean((a - b) ** 2)))

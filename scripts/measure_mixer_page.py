"""How close the mixer's page comes to the truth, and to the offline frame of the job that it exports.

    python scripts/measure_mixer_page.py [--spp N] [--pictures DIR]

`scenes/courtyard` is opened in Chromium at 640x360, under both lightings, and then with lights that were changed on the
page; what the page exports is rendered offline. In dB of display values; in brackets of means over 4x4 pixels. With
`--pictures`, each picture beside what it is held against.
"""

from __future__ import annotations

import argparse
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
from PIL import Image

import mirelight
from mirelight import colour, sh, stages
from mirelight.compositor import Compositor
from mirelight.compositor.engine import SOFTWARE_BITS, EngineDrawing, engine_rank, loaded_ply
from mirelight.compositor.source import uploaded
from mirelight.io.png import write_png
from mirelight.mixing.bundle import export, page_file
from mirelight.model import F32, CompositorSettings, Job, SplatCloud
from mirelight.realtime import browser
from mirelight.scene import prepare
from mirelight.store import Store

SCENE = Path(__file__).resolve().parents[1] / "scenes" / "courtyard"
WIDTH, HEIGHT = 640, 360
DRIVER = """
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
        page.jump();
        let [before, same] = [new Uint8Array(4 * WIDTH * HEIGHT), 0];
        for (let tries = 0; tries < 100 && same < 4; tries++) {  // fades, and sorting in a worker, come to rest
            await frames(8);
            const pixels = new Uint8Array(before.length);
            const gl = app.graphicsDevice.gl;
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
    await picture('evening');
    page.choose(1);
    page.jump();
    await picture('night');
    set('lantern 1: strength', 0.7);
    set('gallery: colour', '#80a0ff');
    await picture('edited');
    document.getElementById('export').click();
    await send('text', document.querySelector('#exported pre').textContent);
    await send('done', '');
} catch (error) {
    await send('failed', document.getElementById('message').textContent || String(error?.stack ?? error));
}
"""
LIMITS = dict.fromkeys(("evening", "night", "edited"), 1 << 21) | dict.fromkeys(("text", "done", "failed"), 1 << 16)


def main() -> None:
    """Make the page, open it, and hold its pictures against the truth and the exported job."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--spp", type=int, default=64)
    parser.add_argument("--pictures", type=Path)
    args = parser.parse_args()
    text = (SCENE / "job.toml").read_text(encoding="utf-8")
    for name in ("splats.compressed.ply", "proxy.glb", "day.hdr", "evening.hdr", "night.hdr", "night.glb"):
        text = text.replace(f'"{name}"', f'"{SCENE / name}"')
    text = text.replace('cameras_from = "proxy"', 'cameras_from = { path = "proxy", names = ["front"] }')
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        text = text.replace("../../out/courtyard", str(folder / "out"))
        (folder / "job.toml").write_text(text, encoding="utf-8")
        seen, relit = _driven(folder, args.spp)
        for name in ("evening", "night"):
            _say(
                f"page against splats relit and drawn offline, {name}", _picture(seen[name]), relit[name], args.pictures
            )
            truth = np.asarray(
                Image.open(SCENE / "truth" / f"front.{name}.png").convert("RGB"), np.float32
            ) * np.float32(1 / 255)
            _say(f"page against truth, {name}", _picture(seen[name]), truth, args.pictures)
        exported = seen["text"].decode()
        print(exported)
        (folder / "edited.toml").write_text(f"{text}\n{exported}", encoding="utf-8")
        for per in ("splat", "pixel"):
            job = mirelight.load(folder / "edited.toml", [f"relight.per={per}"])
            frame = stages.frame(prepare(job), job.cameras[0], job.lightings[1])
            offline = np.clip(colour.srgb_encode(frame.rgba[..., :3]), 0, 1)
            _say(f"edited page against its job offline, per {per}", _picture(seen["edited"]), offline, args.pictures)


def _driven(folder: Path, spp: int) -> tuple[dict[str, bytes], dict[str, F32]]:
    """What the page sends, and the same splats in the colours of its layers, drawn offline by the engine's rules."""
    job = mirelight.load(folder / "job.toml")
    store = Store(job)
    store.open()
    try:
        scene = prepare(job, store)
        made = export(scene, folder / "page", spp=spp)
    finally:
        store.close()
    page, layers = made.folder, made.layers
    assert scene.splats is not None
    relit = {x.name: _drawn(scene.splats, layers.factor(layers.weights(i)), job) for i, x in enumerate(job.lightings)}
    size = sum(path.stat().st_size for path in page.iterdir() if path.suffix in (".ply", ".bin", ".json"))
    print(f"the capture and its layers: {size / 1e6:.0f} MB")
    html = page_file("index.html").decode()
    html = html.replace("</body>", '<script type="module" src="driver.mjs"></script></body>')
    driver = DRIVER.replace("WIDTH", str(WIDTH)).replace("HEIGHT", str(HEIGHT))
    pages = {"driver.html": html.encode(), "driver.mjs": driver.encode()}
    seen = browser.drive(page, browser.find_browser(), 900, page="driver.html", pages=pages, limits=LIMITS)
    return seen, relit


def _drawn(cloud: SplatCloud, factor: F32, job: Job) -> F32:
    shown = colour.srgb_encode(colour.srgb_decode(0.5 + sh.C0 * cloud.sh[:, 0]) * factor)
    new = replace(cloud, sh=((shown - 0.5) / sh.C0)[:, None].astype(np.float32))
    rank = engine_rank(cloud, job.cameras[0], loaded=loaded_ply(cloud, reordered=False))
    settings = CompositorSettings(profile="playcanvas", work_buffer="large", eight_bit=True)
    drawing = EngineDrawing(rank, SOFTWARE_BITS)
    drawn = Compositor(uploaded(new), settings).composite(job.cameras[0], depth=False, drawing=drawing)
    return np.clip(drawn.color, 0, 1)


def _picture(data: bytes) -> F32:
    """(H, W, 3) 0..1, the top row first."""
    return np.float32(1 / 255) * np.frombuffer(data, np.uint8).reshape(HEIGHT, WIDTH, 4)[::-1, :, :3].astype(np.float32)


def _say(what: str, a: F32, b: F32, pictures: Path | None) -> None:
    print(f"{what}: {_decibels(a, b):.1f} dB ({_decibels(_coarse(a), _coarse(b)):.1f})", flush=True)
    if pictures is not None:
        pictures.mkdir(parents=True, exist_ok=True)
        both = np.concatenate([a, b], axis=1)
        path = pictures / f"{what.replace(' ', '-').replace(',', '')}.png"
        write_png(path, (both * 255 + 0.5).astype(np.uint8), {})


def _coarse(a: F32) -> F32:
    return np.asarray(a.reshape(HEIGHT // 4, 4, WIDTH // 4, 4, 3).mean(axis=(1, 3)), np.float32)


def _decibels(a: F32, b: F32) -> float:
    return float(-10 * np.log10(np.mean((a - b) ** 2)))


if __name__ == "__main__":
    main()

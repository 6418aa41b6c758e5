"""How close the mixer's page comes to the truth, and to the offline frame of the job that it exports.

    python scripts/measure_mixer_page.py [--spp N] [--pictures DIR]

`scenes/courtyard` is opened in Chromium at 640x360, under both lightings, and then with lights that were changed on the
page; what the page exports is rendered offline. In dB of display values; in brackets of means over 4x4 pixels. With
`--pictures`, each picture beside what it is held against.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import mixer_page
import numpy as np
from PIL import Image

import mirelight
from mirelight.apps.mixer.bundle import export
from mirelight.base import colour
from mirelight.io.png import write_png
from mirelight.model import F32
from mirelight.pipeline import stages
from mirelight.pipeline.scene import prepare
from mirelight.store import Store

SCENE = Path(__file__).resolve().parents[1] / "scenes" / "courtyard"
SIZE = WIDTH, HEIGHT = 640, 360
STEPS = """
    await picture('evening');
    page.choose(1);
    page.jump();
    await picture('night');
    set('lantern 1: strength', 0.7);
    set('gallery: colour', '#80a0ff');
    await picture('edited');
    document.getElementById('export').click();
    await send('text', document.querySelector('#exported pre').textContent);
"""
SENT = ("evening", "night", "edited", "text")


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
        shown = {name: mixer_page.picture(seen[name], SIZE) for name in ("evening", "night", "edited")}
        for name, offline in relit.items():
            _say(f"page against splats relit and drawn offline, {name}", shown[name], offline, args.pictures)
            truth = Image.open(SCENE / "truth" / f"front.{name}.png").convert("RGB")
            _say(
                f"page against truth, {name}",
                shown[name],
                np.asarray(truth, np.float32) / np.float32(255),
                args.pictures,
            )
        exported = seen["text"].decode()
        print(exported)
        (folder / "edited.toml").write_text(f"{text}\n{exported}", encoding="utf-8")
        for per in ("splat", "pixel"):
            job = mirelight.load(folder / "edited.toml", [f"relight.per={per}"])
            frame = stages.frame(prepare(job), job.cameras[0], job.lightings[1])
            offline = np.clip(colour.srgb_encode(frame.rgba[..., :3]), 0, 1)
            _say(f"edited page against its job offline, per {per}", shown["edited"], offline, args.pictures)


def _driven(folder: Path, spp: int) -> tuple[dict[str, bytes], dict[str, F32]]:
    """What the page sends, and the same splats in the colours of its layers, drawn offline by the engine's rules."""
    job = mirelight.load(folder / "job.toml")
    store = Store(job)
    store.open()
    try:
        scene = prepare(job, store.artefacts)
        made = export(scene, folder / "page", spp=spp)
    finally:
        store.close()
    page, layers = made.folder, made.layers
    assert scene.splats is not None
    factors = {x.name: layers.factor(layers.weights(i)) for i, x in enumerate(job.lightings)}
    relit = {name: mixer_page.drawn(scene.splats, factor, job.cameras[0]) for name, factor in factors.items()}
    size = sum(path.stat().st_size for path in page.iterdir() if path.suffix in (".ply", ".bin", ".json"))
    print(f"the capture and its layers: {size / 1e6:.0f} MB")
    seen = mixer_page.drive(page, STEPS, SIZE, SENT, 900)
    return seen, relit


def _say(what: str, a: F32, b: F32, pictures: Path | None) -> None:
    print(f"{what}: {mixer_page.decibels(a, b):.1f} dB ({mixer_page.decibels(_coarse(a), _coarse(b)):.1f})", flush=True)
    if pictures is not None:
        pictures.mkdir(parents=True, exist_ok=True)
        both = np.concatenate([a, b], axis=1)
        path = pictures / f"{what.replace(' ', '-').replace(',', '')}.png"
        write_png(path, (both * 255 + 0.5).astype(np.uint8), {})


def _coarse(a: F32) -> F32:
    return np.asarray(a.reshape(HEIGHT // 4, 4, WIDTH // 4, 4, 3).mean(axis=(1, 3)), np.float32)


if __name__ == "__main__":
    main()

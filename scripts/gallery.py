"""The pictures of docs/gallery.md and of other pages, each made from its job, a file in docs/gallery or on the page.

    python scripts/gallery.py                     # all of them, into docs/gallery
    python scripts/gallery.py night sun -o /tmp   # two of them

Frames go to out/gallery/NAME and are kept: a second run draws the pictures again and renders what has changed. Needs
the extras `denoise` and `compare`; takes about fifteen minutes on two cores.
"""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from page_pictures import ROOT, Pixels, Tiles, Work, clay, laid_out, part, picture, resized, run, unlit, written

from mirelight.base.errors import MirelightError
from mirelight.base.sh import C0
from mirelight.io.atomic import atomic_path

JOBS = ROOT / "docs" / "gallery"
TRUTH = ROOT / "scenes" / "courtyard" / "truth" / "front.evening.png"
CLIP = ROOT / "docs" / "pictures" / "courtyard.webp"  # the only film
CARD = CLIP.with_name("card.jpg")  # what is shown of a link to the site


# --- what a picture shows --------------------------------------------------------------------------------------------


def frame(work: Work) -> Tiles:
    """The job's frame."""
    return [("", picture(path)) for _, path in work.frames()[:1]]


def lightings(work: Work) -> Tiles:
    """A tile for every lighting of a sweep, under what it was called after the job's own lighting."""
    names = {
        name: re.sub(r"(m?)(\d+)$", lambda x: f" {'-' * len(x[1])}{x[2]}", name.partition("-")[2])
        for name, _ in work.frames()
    }
    return [(names[name] or "all together", picture(path)) for name, path in work.frames()]


def layers(work: Work) -> Tiles:
    """The layers of a frame's EXR."""
    from mirelight.io.exr import read_exr
    from mirelight.io.png import encode_display
    from mirelight.model import DisplaySettings

    exr = read_exr(work.frames()[0][1].with_suffix(".exr"))

    def light(name: str, gain: float = 1.0) -> Pixels:
        values = gain * exr.layer(name)
        opaque = np.ones((*values.shape[:2], 1), np.float32)
        return encode_display(np.concatenate([values[..., :3], opaque], axis=2), DisplaySettings())

    def plain(values: NDArray[Any]) -> Pixels:
        return np.asarray(np.rint(np.clip(values, 0, 1) * np.ones(3) * 255), dtype=np.uint8)

    depth = exr.layer("depth")
    near, far = (float(x) for x in np.percentile(depth[depth > 0], [1, 99]))
    return [
        ("relit", light("")),
        ("unlit", light("unlit")),
        ("factor, two stops darker", light("factor", 0.25)),
        ("lighting", light("lighting")),
        ("albedo", light("albedo")),
        ("normal", plain(exr.layer("normal") / 2 + 0.5)),
        ("depth", plain(1 - (depth - near) / max(far - near, 1e-6))),
        ("sun_visibility", plain(exr.layer("sun_visibility"))),
        ("ambient_occlusion", plain(exr.layer("ambient_occlusion"))),
    ]


def difference(work: Work) -> Tiles:
    """The relit frame, the true picture, and FLIP between both."""
    from mirelight.compare import CompareSettings, Pair, evaluate
    from mirelight.compare.figures import heat_map

    ours = work.frames()[0][1]
    truth = work.folder / "truth.png"
    resized(picture(TRUTH), picture(ours).shape).save(truth)
    result, maps = evaluate(Pair(name="front", reference=truth, test=ours), CompareSettings())
    heat = f"difference (FLIP, mean {result.overall.flip:.3f})"
    return [("relit", picture(ours)), ("path-traced truth", picture(truth)), (heat, heat_map(maps))]


def parts(work: Work) -> Tiles:
    """From the splats alone to the relit frame: the capture, the proxy, the light found in it, the frame."""
    from mirelight.io.exr import read_exr
    from mirelight.io.png import encode_display
    from mirelight.model import DisplaySettings

    relit = work.frames()[0][1]
    exr = read_exr(relit.with_suffix(".exr"))
    lit = exr.layer("lighting")
    # The frame's factor is new over captured light.
    light = lit[..., :3] / np.maximum(lit[..., 3:] * exr.layer("albedo") * exr.layer("factor"), 1e-4)
    captured = np.concatenate([light, np.ones_like(lit[..., 3:])], axis=2).astype(np.float32)
    return [
        ("capture", unlit(relit)),
        ("proxy, made from the splats", clay(exr.layer("normal"))),
        ("light that it was captured under, estimated", encode_display(captured, DisplaySettings())),
        ("relit", picture(relit)),
    ]


def closer(work: Work) -> Tiles:
    """The well and the arcade: captured, by a tint, by the ratio, true."""
    tint, path = work.again("tint", 'relight.mode="tint"'), work.frames()[0][1]
    truth = np.asarray(resized(picture(TRUTH), picture(path).shape))
    tiles = (
        ("as captured", unlit(path)),
        ("tint: the shade of the capture stays", picture(tint)),
        ("ratio of new to captured light", picture(path)),
        ("path-traced truth", truth),
    )
    return [(name, part(pixels, (0.34, 0.4, 0.7, 0.95))) for name, pixels in tiles]


def views(work: Work) -> Tiles:
    """A tile for every camera, without words."""
    return [("", picture(path)) for _, path in work.frames()]


def by_light(work: Work) -> Tiles:
    """A tile for every lighting, under its name."""
    return [(name, picture(path)) for name, path in work.frames()]


def hours(work: Work) -> Tiles:
    """A tile for every time of a day, which is the end of the lighting's name."""
    return [(f"{name[-6:-4]}:{name[-4:-2]}", picture(path)) for name, path in work.frames()]


def exported(work: Work) -> Tiles:
    """The contact sheet of a data set that is exported from kept layers."""
    run("export", work.folder, "--layout", "colmap", "--no-hdr", "-q", "-o", work.folder / "set")
    return [("", picture(work.folder / "set" / "sheet.jpg"))]


def before_and_after(work: Work) -> Tiles:
    """The capture and the frame."""
    path = work.frames()[0][1]
    return [("as captured", unlit(path)), ("relit", picture(path))]


def gloss(work: Work) -> Tiles:
    """The glazed knot: captured, relit, true."""
    path = work.frames()[0][1]
    truth = picture(ROOT / "scenes" / "stage" / "truth" / path.name)
    tiles = (("as captured", unlit(path)), ("relit", picture(path)), ("path-traced truth", truth))
    return [(name, part(pixels, (0.35, 0.06, 0.59, 0.48))) for name, pixels in tiles]


def glaze(work: Work) -> Tiles:
    """The knot: matt, with its glaze, true."""
    matt, path = work.again("matt", "relight.gloss=false"), work.frames()[0][1]
    truth = picture(ROOT / "scenes" / "stage" / "truth" / path.name)
    tiles = (("matt", picture(matt)), ("with gloss", picture(path)), ("path-traced truth", truth))
    return [(name, part(pixels, (0.35, 0.06, 0.59, 0.48))) for name, pixels in tiles]


def clipped(work: Work) -> Tiles:
    """The marble plinth, from the capture and from one that was two stops too bright for what a file can hold."""
    from mirelight.base import colour
    from mirelight.io import splats
    from mirelight.io.job import load

    bright = work.folder / "bright.ply"
    job = load(work.job)
    if job.splats is None:
        raise MirelightError(f"{work.job}: no splats")
    cloud = job.splats.value
    shown = np.clip(0.5 + C0 * cloud.sh[:, 0], 0, 1)
    light = np.minimum(4 * colour.decode(shown, "srgb"), 1)
    splats.write(replace(cloud, sh=((colour.encode(light, "srgb") - 0.5) / C0)[:, None]), bright)
    good = work.frames()[0][1]
    bad = work.again("bright", f'splats="{bright.as_posix()}"', "captured.environment.intensity=4")
    tiles = (
        ("overexposed capture", unlit(bad)),
        ("relit", picture(bad)),
        ("from the capture as shipped", picture(good)),
    )
    return [(name, part(pixels, (0.37, 0.5, 0.63, 0.86))) for name, pixels in tiles]


@dataclass(frozen=True, slots=True)
class Kind:
    """How a picture is drawn."""

    tiles: Callable[[Work], Tiles]
    columns: int = 1
    width: int = 640  # of a tile, pixels
    choice: tuple[str, ...] = ()  # arguments of `mirelight render`
    settings: tuple[str, ...] = ()  # laid over the job
    page: str = ""  # in docs, if the job stands there
    job: str = ""  # its name there


HALF = ("resolution_scale=0.5",)  # small on a sheet
SHEET = Kind(lightings, columns=3, width=320, settings=HALF)
PICTURES: dict[str, Kind] = {
    "evening": Kind(frame),
    "night": Kind(frame),
    "gels": Kind(frame),
    "softbox": Kind(frame),
    "sky": Kind(frame),
    "lens": Kind(frame),
    "objects": Kind(by_light, columns=2, width=480, settings=("resolution_scale=0.75",)),
    "sun": replace(SHEET, tiles=views),
    "one": SHEET,
    "panorama": SHEET,
    "layers": Kind(layers, columns=3, width=320, settings=HALF),
    "difference": Kind(difference, columns=3, width=320, settings=HALF),
    "parts": Kind(parts, columns=2, width=480, settings=("resolution_scale=0.75",)),
}
TUTORIALS: dict[str, Kind] = {
    "turntable": Kind(
        views,
        3,
        320,
        choice=("--camera", "turn.0001", "turn.0021", "turn.0039"),
        settings=HALF,
        page="tutorials/turntable",
        job="turn",
    ),
    "day": Kind(hours, 3, 320, settings=(*HALF, "sweep.axes[0].steps=9"), page="tutorials/day", job="day"),
    "even": Kind(
        before_and_after, 2, 480, settings=("resolution_scale=0.75",), page="explanation/cannot-be-removed", job="even"
    ),
    "glaze": Kind(glaze, 3, 320, page="guides/gloss", job="glaze"),
    "gloss": Kind(gloss, 3, 320, page="explanation/cannot-be-removed", job="gloss"),
    "tint": Kind(closer, columns=2, width=460, job="difference"),
    "set": Kind(
        exported,
        settings=(
            "resolution_scale=0.375",
            "render.spp=256",
            "display.exposure=1",
            'output.store="layers"',
            'cameras_from={path="../../scenes/stage/transforms.json",every=4}',
        ),
        job="one",
    ),
    "clipped": Kind(clipped, 3, 320, page="explanation/cannot-be-removed", job="gloss"),
}


# --- drawing ---------------------------------------------------------------------------------------------------------


def job_of(name: str, kind: Kind, folder: Path) -> Path:
    """The job file of a picture; one that stands on a page is written into `folder`, with the scenes' full paths."""
    if not kind.page:
        return JOBS / f"{kind.job or name}.toml"
    text = (ROOT / "docs" / f"{kind.page}.md").read_text(encoding="utf-8")
    _, found, rest = text.partition(f"```toml\n# {kind.job}.toml\n")
    if not found:
        raise MirelightError(f"{kind.page}.md: no job {kind.job}.toml")
    folder.mkdir(parents=True, exist_ok=True)
    job = folder / f"{kind.job}.toml"
    job.write_text(rest.partition("```")[0].replace('"scenes/', f'"{ROOT.as_posix()}/scenes/'), encoding="utf-8")
    return job


def draw(name: str, kind: Kind, work: Work, out: Path) -> Path:
    """Render what a picture needs and write `out`/NAME.jpg."""
    work.render(*kind.choice)
    tiles = kind.tiles(work)
    if kind.columns == 1:
        pixels = tiles[0][1]
    else:
        pixels = laid_out(tiles, kind.columns, kind.width, work.folder / "sheet.png")
    return written(pixels, out / f"{name}.jpg")


def clip(work: Work) -> Path:
    """The film of README and the first page: what each camera of the path sees under the lighting of its number.

    A line that wanders through the first pictures has the capture on its left.
    """
    from PIL import Image

    from mirelight.io.job import load
    from mirelight.io.job.overrides import parse

    job = load(work.job, [parse(x) for x in work.settings])
    shots = []
    for k, (camera, lighting) in enumerate(zip(job.cameras, job.lightings, strict=False)):
        work.render("--camera", camera.name, "--lighting", lighting.name)
        path = work.folder / f"{camera.name}.{lighting.name}.png"
        shots.append(Image.fromarray(wiped(unlit(path), picture(path), 1.2 - k / 10)))
    card = shots[9].crop((0, 24, 1280, 696)).resize((1200, 630), Image.Resampling.LANCZOS)
    card.save(CARD, quality=84, optimize=True, progressive=True)
    times = [100] * (len(shots) - 1) + [1500]
    with atomic_path(CLIP) as fresh:
        shots[0].save(
            fresh, "WEBP", save_all=True, append_images=shots[1:], duration=times, loop=0, quality=80, method=4
        )
    return CLIP


def trained_splats(folder: Path) -> str:
    """The setting that lays splats which were trained on pictures over the film's job; they are made and kept here."""
    from trained import capture

    from mirelight.io.job import load

    return f'splats="{capture(load(JOBS / "clip.toml").cameras, folder).as_posix()}"'


def wiped(before: Pixels, after: Pixels, share: float) -> Pixels:
    """Two pictures (H, W, 3) side by side: so much of the width shows the first, then comes a white line."""
    column = round(np.clip(share, 0, 1) * before.shape[1])
    out = np.concatenate([before[:, :column], after[:, column:]], axis=1)
    if 0 < column < out.shape[1]:
        out[:, max(column - 2, 0) : column + 2] = 255
    return out


def main() -> int:
    kinds = PICTURES | TUTORIALS
    every = [*kinds, "clip"]
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"{', '.join(every)}; none: all")
    parser.add_argument("-o", "--out", type=Path, default=JOBS, help="folder of the pictures (docs/gallery)")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help="laid over the jobs")
    arguments = parser.parse_args()
    if unknown := set(arguments.names) - set(every):
        parser.error(f"no picture {', '.join(sorted(unknown))}; there are {', '.join(every)}")
    try:
        for name in arguments.names or every:
            folder = ROOT / "out" / "gallery" / name
            if name == "clip":
                path = clip(Work(JOBS / "clip.toml", folder, (trained_splats(folder), *arguments.set)))
            else:
                kind = kinds[name]
                work = Work(job_of(name, kind, folder), folder, (*kind.settings, *arguments.set))
                path = draw(name, kind, work, arguments.out)
            print(f"{path} ({path.stat().st_size / 1000:.0f} kB)", flush=True)
    except MirelightError as error:
        print(f"gallery: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())

"""A strip of a capture that nobody tuned to: captured, proxy, estimated light, low sun, night.

    python scripts/unknown.py guitar.compressed.ply -o docs/gallery

The commands of a first visit are run as they are, `proxy`, `new` and `render`, in out/unknown/NAME; what they said
stands there in said.txt. Only the lightings are replaced. Takes three CPU minutes for 100,000 splats.
"""

from __future__ import annotations

import argparse
import sys
from contextlib import redirect_stdout
from pathlib import Path

import numpy as np
from page_pictures import ROOT, Pixels, Tiles, Work, clay, laid_out, part, picture, run, unlit, written

from mirelight.base.errors import MirelightError
from mirelight.model import Camera, DisplaySettings, Lighting, ProxyMesh, RenderSettings, SunLight

WIDTH, HEIGHT = 480, 270
LOW = (
    '{ name = "low sun", environment = { radiance = [%(sky)s] }, lights = [{ type = "sun", elevation = 11, '
    "azimuth = %(left)s, color = [1, 0.62, 0.32], intensity = %(sun)s, angular_diameter = 1 }] }"
)
NIGHT = (
    '{ name = "night", environment = { radiance = [%(dark)s] }, lights = [{ type = "point", '
    "position = [%(lamp)s], color = [1, 0.75, 0.45], intensity = %(candela)s, radius = %(radius)s }] }"
)


def commands(capture: Path, folder: Path) -> Work:
    """A proxy and a job, made as anyone would; files that are there are kept."""
    folder.mkdir(parents=True, exist_ok=True)
    here = folder / capture.name
    if not here.exists():
        here.symlink_to(capture.resolve())
    work = Work(folder / "job.toml", folder / "frames")
    with (folder / "said.txt").open("a", encoding="utf-8") as said, redirect_stdout(said):
        proxy = folder / f"{capture.name.partition('.')[0]}.proxy.glb"
        if not proxy.exists():
            run("proxy", here, "-o", proxy)
        if not work.job.exists():
            run("new", here, "-o", work.job)
    return work


def lit(work: Work) -> tuple[str, ...]:
    """Settings that replace the lightings of a first job, as bright as those are."""
    from mirelight.io.job import load

    job = load(work.job)
    camera, first = job.cameras[-1], job.lightings[0]
    sun, sky = first.lights[0], first.environment
    assert isinstance(sun, SunLight) and sky is not None
    level = sun.intensity / 3.2  # of `new`'s sun over a captured light of 1 cd/m²
    pose = camera.world_from_camera
    splats = job.splats.value if job.splats is not None else None
    assert splats is not None
    low, high = np.quantile(splats.means[splats.opacities > 0.3].astype(np.float64), [0.02, 0.98], axis=0)
    middle, size = (low + high) / 2, float(np.linalg.norm(high - low))
    back = pose[:3, 2] * (1, 0, 1) / np.linalg.norm(pose[:3, 2] * (1, 0, 1))
    way = 0.9 * back - 0.8 * pose[:3, 0]  # to the light: from the camera's left
    lamp = middle + 0.42 * size * (way / np.linalg.norm(way)) + (0, 0.22 * size, 0)
    values = {
        "sky": numbers(level * np.array([0.14, 0.18, 0.28])),
        "dark": numbers(level * np.array([0.010, 0.014, 0.026])),
        "left": round(float(np.degrees(np.arctan2(way[0], -way[2])))),
        "sun": round(4 * level, 3),
        "lamp": numbers(lamp),
        "candela": round(0.9 * level * size**2 * np.pi / 4, 4),
        "radius": round(0.02 * size, 4),
    }
    return (
        f"lightings=[{LOW % values}, {NIGHT % values}]",
        f"resolution=[{WIDTH}, {HEIGHT}]",
        "render.spp=32",
        "output.exr=true",
    )


def numbers(values: np.ndarray) -> str:
    return ", ".join(f"{x:.4g}" for x in values)


def proxy_of(path: Path) -> Pixels:
    """The proxy of a frame, lit from beside the camera."""
    from mirelight.io.exr import read_exr
    from mirelight.io.job import load

    camera = load(path.parent.parent / "job.toml").cameras[-1]
    normal = read_exr(path.with_suffix(".exr")).layer("normal")
    return clay(normal @ camera.world_from_camera[:3, :3].astype(np.float32))


def estimated(work: Work) -> tuple[Lighting, bool]:
    """The captured light, and whether anything speaks against it; kept beside the job."""
    from mirelight import estimate
    from mirelight.estimate.describe import described, doubts
    from mirelight.io.job import load
    from mirelight.pipeline.artefact_cache import NullCache
    from mirelight.pipeline.scene import Scene

    kept, said = work.job.with_name("estimate.npy"), work.job.with_name("estimate.txt")
    if not kept.exists():
        scene = Scene(load(work.job), NullCache(), None)
        assert scene.splats is not None and scene.proxy is not None
        found = estimate.estimate(scene.splats, scene.proxy, RenderSettings(), views=scene.views)
        np.save(kept, found.packed())
        said.write_text("\n".join([*described(found), *(f"? {x}" for x in doubts(found))]) + "\n", encoding="utf-8")
    return estimate.lighting_of(np.load(kept)), "\n?" in said.read_text(encoding="utf-8")


def ball(work: Work) -> tuple[str, Pixels]:
    """What is said of the estimated light, and a white ball under it, from where the camera stands."""
    import trimesh

    from mirelight.io.job import load
    from mirelight.io.png import encode_display
    from mirelight.lighting import Tracer

    light, doubted = estimated(work)
    shape = trimesh.creation.icosphere(subdivisions=5)
    mesh = ProxyMesh(vertices=shape.vertices, faces=shape.faces, normals=shape.vertices, albedo=np.full(3, 0.7))
    ahead = -load(work.job).cameras[-1].world_from_camera[:3, 2]
    camera = Camera.look_at(-6 * ahead, (0, 0, 0), WIDTH, HEIGHT, yfov=26)
    seen = Tracer(mesh, RenderSettings(spp=64), layers=False, aovs=False).trace(light, camera)
    shown = np.concatenate([sum(x.total for x in seen.layers), seen.coverage[..., None]], axis=2).astype(np.float32)
    bright = float(np.quantile(shown[..., :3].max(axis=-1)[seen.coverage > 0.5], 0.98))
    shown[..., :3] *= 0.9 / max(bright, 1e-6)
    name = "light: a sun" if light.lights[0].intensity > 0 else "light: no sun"
    return f"{name}{'?' * doubted}", encode_display(shown, DisplaySettings())


def strip(work: Work) -> Tiles:
    """The five tiles, cut to what shows something."""
    low_sun, night = (work.folder / f"first.{name}.png" for name in ("low_sun", "night"))
    captured = unlit(low_sun)
    columns = np.flatnonzero(captured.max(axis=(0, 2)) > 12)
    middle = (columns[0] + columns[-1]) / 2 / WIDTH
    half = float(np.clip((columns[-1] - columns[0]) / 2 / WIDTH + 0.03, 0.16, 0.5))
    low = float(np.clip(middle - half, 0, 1 - 2 * half))
    box = (low, 0.0, low + 2 * half, 1.0)
    told, lit_ball = ball(work)
    square = HEIGHT / WIDTH / 2
    return [
        ("captured", part(captured, box)),
        ("own proxy", part(proxy_of(low_sun), box)),
        (told, part(lit_ball, (0.5 - square, 0.0, 0.5 + square, 1.0))),
        ("low sun", part(picture(low_sun), box)),
        ("night", part(picture(night), box)),
    ]


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("captures", nargs="+", type=Path, metavar="CAPTURE")
    parser.add_argument("-o", "--out", type=Path, default=ROOT / "docs" / "gallery", help="folder of the pictures")
    arguments = parser.parse_args()
    try:
        for capture in arguments.captures:
            name = capture.name.partition(".")[0]
            work = commands(capture, ROOT / "out" / "unknown" / name)
            work = Work(work.job, work.folder, lit(work))
            work.render("--camera", "first")
            tiles = strip(work)
            sheet = laid_out(tiles, len(tiles), 260, work.folder / "sheet.png")
            arguments.out.mkdir(parents=True, exist_ok=True)
            print(written(sheet, arguments.out / f"{name}.jpg"), flush=True)
    except MirelightError as error:
        print(f"unknown: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())

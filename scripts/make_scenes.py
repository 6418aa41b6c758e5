"""Makes the shipped scenes from their geometry, and renders what they truly look like under any of their lightings.

    python scripts/make_scenes.py courtyard
    python scripts/make_scenes.py courtyard --truth --lighting night --camera front -o front.night.png
    python scripts/make_scenes.py courtyard --clean front.night.png

All but the second form need the extra `scenes`.
"""

from __future__ import annotations

import argparse
import importlib
import sys
import time
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT), str(ROOT / "scripts")]

from scenegen import training, writing  # noqa: E402
from scenegen.recipe import Recipe  # noqa: E402
from scenegen.truth import F32, Looks, Truth  # noqa: E402

from mirelight.base import colour  # noqa: E402
from mirelight.io import splats as splat_files  # noqa: E402
from mirelight.model import Camera, SplatCloud  # noqa: E402

TRAINED = "plinth"  # splats that an optimiser made from pictures alone; the others begin as discs on true surfaces
SCENES = ("courtyard", "stage", TRAINED)
TRUTH_SPP = 160
GUIDE_SPP = 32
BAKE_SPP = 16  # a first guess; the photographs decide
PHOTOGRAPH, PHOTOGRAPH_SPP = (800, 450), 12  # denoised


def load(name: str) -> Recipe:
    """The recipe of a scene."""
    recipe = importlib.import_module("trained_scene" if name == TRAINED else f"scenegen.{name}").recipe()
    assert isinstance(recipe, Recipe)
    return recipe


def say(text: str, start: float) -> None:
    """A line of progress with the seconds since `start`."""
    print(f"{time.monotonic() - start:6.1f} s  {text}", flush=True)


def make_discs(recipe: Recipe, looks: Looks, captured: Truth, start: float) -> SplatCloud:
    """Scatter splats on what the orbit sees, bake a first colour, fit the colours to photographs."""
    from scenegen import fit, surfels

    from mirelight.base.colour import srgb_encode

    points, seen = surfels.candidates(surfels.Triangles.of(looks.soups), recipe, captured)
    say(f"{len(points)} candidates on what the orbit sees", start)
    kept = surfels.thin_out(points, seen.spacing, seed=2)
    form = surfels.shape(points.where(kept), seen.spacing[kept], points)
    radiance = surfels.bake(form, seen.eye[kept], captured, BAKE_SPP, seed=3)
    lit = np.asarray(np.isfinite(radiance).all(axis=1))
    cloud = surfels.cloud(form.where(lit), np.asarray(srgb_encode(np.clip(radiance[lit], 0, 1)), dtype=np.float64))
    say(f"{len(cloud)} splats baked; {100 * np.mean(radiance[lit] > 1):.3f} % of their values clip", start)
    views = []
    for k, camera in enumerate(recipe.orbit):
        small = camera.resized(*PHOTOGRAPH)
        light = captured.photograph(small, PHOTOGRAPH_SPP, seed=100 + k)[..., :3]
        views.append(fit.View(camera=small, shown=np.asarray(srgb_encode(np.clip(light, 0, 1)), dtype=np.float64)))
        say(f"photograph {k + 1} of {len(recipe.orbit)}", start)
    return fit.fit_colours(cloud, views)


def make_splats(recipe: Recipe, looks: Looks, folder: Path, start: float) -> None:
    """Make discs, train them on pictures, write the capture; discs and pictures are kept, so that a run goes on."""
    from scenegen import refine

    captured, kept = Truth(looks, recipe.captured), ROOT / "out" / "make_scenes" / recipe.name
    discs = kept / writing.SPLATS
    if not discs.is_file():
        kept.mkdir(parents=True, exist_ok=True)
        writing.write_splats(make_discs(recipe, looks, captured, start), kept)
    begun = splat_files.read(discs)
    writing.write_splats(refine.refined(begun, recipe, captured, kept, lambda text: say(text, start)), folder)


def make(recipe: Recipe, folder: Path, only: list[str]) -> None:
    """Write a scene's files (or some of them) into its folder."""
    start = time.monotonic()
    if recipe.name == TRAINED:
        kept = ROOT / "out" / "make_scenes" / recipe.name
        importlib.import_module("trained_scene").make(folder, kept, lambda text: say(text, start))
        return
    from scenegen.proxy import proxy_of

    folder.mkdir(parents=True, exist_ok=True)
    if "job" in only:
        for lighting in (recipe.captured, *recipe.lightings):
            writing.write_lighting(lighting, folder)
        writing.write_job(recipe, folder)
        writing.write_cameras([x.resized(*PHOTOGRAPH) for x in recipe.orbit], folder)
    if only == ["job"]:
        return
    looks = recipe.looks()
    say(f"{sum(len(s.positions) for s in looks.soups)} true triangles", start)
    if "proxy" in only:
        mesh = proxy_of(recipe, looks)
        writing.write_proxy(mesh, recipe, folder)
        say(f"proxy of {len(mesh.faces)} triangles", start)
    if "splats" in only:
        make_splats(recipe, looks, folder, start)
        say("done", start)


def render_truth(recipe: Recipe, arguments: argparse.Namespace) -> None:
    """Write the true picture, as displayed at exposure 0."""
    lighting = next(x for x in (recipe.captured, *recipe.lightings) if x.name == arguments.lighting)
    camera = next(x for x in recipe.cameras if x.name == arguments.camera)
    width, height = (int(x) for x in arguments.size.split("x"))
    camera = camera.resized(width, height)
    picture = Truth(recipe.looks(), lighting).picture(camera, arguments.spp, arguments.seed)
    if recipe.name == TRAINED:  # the sky is in its pictures
        picture[..., :3] = training.before_sky(picture, lighting, camera)
    writing.write_png(picture, arguments.output)


class Guided(Truth):
    """The truth with what helps a denoiser."""

    def guides(self, camera: Camera) -> F32:
        """(H, W, 6) albedo and normals."""
        integrator = self._mi.load_dict({"type": "aov", "aovs": "albedo:albedo,normal:sh_normal"})
        return self._rendered(integrator, camera, GUIDE_SPP, 0)[..., -6:]


def clean(recipe: Recipe, path: Path, out: Path) -> None:
    """Write a true picture CAMERA.LIGHTING.png without what is left of its noise: lamps at night send hard paths."""
    import pyoidn  # type: ignore[import-untyped]
    from PIL import Image

    with Image.open(path) as image:
        light = colour.srgb_decode(np.asarray(image.convert("RGB"), np.float32) / 255)
    camera = next(x for x in recipe.cameras if x.name == path.name.partition(".")[0])
    guides = Guided(recipe.looks(), recipe.captured).guides(camera.resized(light.shape[1], light.shape[0]))
    albedo, normal = (np.ascontiguousarray(guides[..., k : k + 3]) for k in (0, 3))
    made = pyoidn.denoise(light.astype(np.float32), albedo=albedo, normal=normal, hdr=True, clean_aux=True)
    writing.write_png(np.asarray(made, np.float32), out)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene", choices=SCENES)
    parser.add_argument("--only", nargs="+", choices=("job", "proxy", "splats"), default=["job", "proxy", "splats"])
    parser.add_argument("--truth", action="store_true", help="render the true picture instead")
    parser.add_argument("--lighting", help="truth: a lighting of the scene")
    parser.add_argument("--camera", help="truth: a camera of the scene")
    parser.add_argument("--size", default="640x360", help="truth: pixels")
    parser.add_argument("--spp", type=int, default=TRUTH_SPP, help="truth: samples per pixel")
    parser.add_argument("--clean", type=Path, metavar="PNG", help="take the noise out of a true picture that is there")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("-o", "--output", type=Path, help="truth: the PNG; else the scene's folder")
    arguments = parser.parse_args()
    recipe = load(arguments.scene)
    if arguments.clean:
        clean(recipe, arguments.clean, arguments.output or arguments.clean)
    elif arguments.truth:
        render_truth(recipe, arguments)
    else:
        make(recipe, arguments.output or ROOT / "scenes" / recipe.name, arguments.only)


if __name__ == "__main__":
    main()

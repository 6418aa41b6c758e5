"""Objects in a capture beside path-traced truth: the courtyard with a gray vase, a plastic ring and a chrome ball.

    python scripts/bench objects [--spp 64] [--width 320] [--truth-spp 128] [--cache FOLDER] [--pictures FOLDER]
                                 [--ways 'own proxy*'] [--light day]

Truth is Mitsuba's `path` on the textured scene with the objects in it, their look by glTF's formulas written anew. What
is multiplied is the true captured picture, so that the splats' own error is not in it; colours of the proxy are told
by true pictures from the capture's cameras. PSNR is of display values, with the truth's noise taken out. Two ways have
nothing but splats and those pictures: their proxy is made of them, and the captured light of one is found.
"""

from __future__ import annotations

import argparse
import importlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from functools import cached_property
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray
from scenegen.geometry import Soup, soups
from scenegen.truth import Looks, Truth
from scipy import ndimage

from bench.common import Table, least, side_by_side, table, truth_options
from bench.objects_truth import Thing, bsdf, covered_by, seen_along, surface, things
from bench.truth_scores import Halves, decibels, shown, squared_error
from bench.truth_store import ROOT, Store
from mirelight import estimate, prepare, proxy
from mirelight.base.backend import mitsuba
from mirelight.io import job as jobs
from mirelight.model import (
    F32,
    Camera,
    Deferred,
    Inserted,
    Job,
    Lighting,
    LightingBuffer,
    Material,
    ProxyMesh,
    RenderSettings,
)
from mirelight.pipeline import stages
from mirelight.pipeline.artefact_cache import NullCache
from mirelight.pipeline.codecs import Codec
from mirelight.pipeline.inserted import SceneWithObjects
from mirelight.proxy.capture_views import capture_views

T = TypeVar("T")
Bool = NDArray[np.bool_]
ZONES = ("changed > 1 %", "> 10 %", "contact", "not changed", "edges")
CONTACT = 4  # px round the objects
FINER = 32  # times the truth's samples of what mirrors show: there caustics of the low sun are rare and bright
TAKEN = (350, 197, 8)  # pixels, as `view_size` reads pictures, and samples of each of the capture's, which are denoised
EYE, TARGET = (0.9, 1.7, 6.2), (-1.35, 0.25, 2.4)


@dataclass(frozen=True, slots=True, eq=False)
class Pictures:
    """True pictures of one lighting, two halves each."""

    bare: Halves
    full: Halves

    @staticmethod
    def of(both: F32) -> Pictures:
        """From (2, 2, H, W, 3): without and with the objects, halves."""
        return Pictures((both[0, 0], both[0, 1]), (both[1, 0], both[1, 1]))


class Yard:
    """The courtyard with the objects, under the light of its capture and under the evening sun."""

    def __init__(self, size: tuple[int, int], truth_spp: int, spp: int, store: Store) -> None:
        self._truth_spp, self._store, self._kept = truth_spp, store, _Kept()
        self.camera = Camera.look_at(EYE, TARGET, *size, yfov=38, name="objects")
        self.recipe = importlib.import_module("scenegen.courtyard").recipe()
        self.lightings: tuple[Lighting, ...] = (self.recipe.captured, self.recipe.lightings[0])
        self.things = things()
        job = jobs.load(ROOT / "scenes" / "courtyard" / "job.toml")
        output = replace(job.output, store="frames")
        render = replace(job.render, spp=spp, denoise=True)
        self._bare_job = replace(job, cameras=(self.camera,), render=render, output=output)

    @cached_property
    def _job(self) -> Job:
        """The job with the capture's cameras and what they took."""
        width, height, spp = TAKEN if self.camera.width > 64 else (64, 36, 1)
        cameras = tuple(x.resized(width, height) for x in self.recipe.orbit)

        def make() -> F32:
            scene = Truth(self._looks, self.recipe.captured)
            return np.stack([_clean(scene.picture(x, spp, seed=5), self._surface(x, spp)) for x in cameras])

        where = [(x.world_from_camera, x.fx) for x in cameras]
        name = f"objects.taken.{width}x{height}.{spp}"
        taken = self._store.array(name, "true pictures", make, "scenes", where)
        seen = np.clip(taken, 0, 1)  # a camera's white is 1, the sun's disc included
        whole = [np.concatenate([x, np.ones_like(x[..., :1])], axis=-1).astype(np.float32) for x in seen]
        return replace(
            self._bare_job,
            captured=self.recipe.captured,
            capture_cameras=cameras,
            capture_pictures=tuple(Deferred.of(x) for x in whole),
        )

    @cached_property
    def _looks(self) -> Looks:
        looks: Looks = self.recipe.looks()
        return looks

    @cached_property
    def _soups(self) -> list[tuple[Thing, Soup]]:
        return [(x, soups([x.part], crease=60)[0]) for x in self.things]

    def pictures(self, lighting: Lighting) -> Pictures:
        """The truth."""
        view, spp = self.camera, self._truth_spp

        def full() -> Truth:
            soups_ = [*self._looks.soups, *(s for _, s in self._soups)]
            return Truth(replace(self._looks, soups=soups_), lighting, {x.name: bsdf(x) for x in self.things})

        def make() -> F32:
            scenes = Truth(self._looks, lighting), full()
            return np.stack([[x.picture(view, spp, seed=k)[..., :3] for k in (1, 2)] for x in scenes])

        def mirrored() -> F32:
            scene = full()
            return np.stack([seen_along(scene, view, pixels, FINER * spp, seed=k) for k in (1, 2)])

        name = f"objects.{lighting.name}.{view.width}x{view.height}.{spp}"
        parts = [(x.part.vertices, x.base, x.metallic, x.roughness) for x in self.things]
        pixels = np.argwhere(np.any([covered_by(x, view) for x in self.things if x.is_mirror], axis=0))
        made = self._store.array(name, "true pictures", make, "scenes", (EYE, TARGET, parts)).copy()
        made[1, :, *pixels.T] = self._store.array(
            f"{name}.mirrored", "true pictures", mirrored, "scenes", (EYE, TARGET, parts, FINER)
        ).swapaxes(0, 1)
        return Pictures.of(made)

    @cached_property
    def _true_job(self) -> Job:
        """The job on the true surface with its textures, which no capture knows: what its proxy costs is not in it."""
        return replace(self._job, proxy=Deferred.of(surface(self._looks)), albedo_from_splats=False)

    @cached_property
    def _own_job(self) -> Job:
        """The job of who has splats and pictures alone, and knows the captured light: the proxy is made of them."""
        job, cameras = self._job, self._job.capture_cameras
        assert job.splats is not None
        splats = job.splats.value

        def mesh() -> ProxyMesh:
            return proxy.make(splats, cameras=cameras).mesh

        return replace(job, proxy=Deferred.of(self._store.mesh(f"objects.own.{self._taken}", "own proxies", mesh)))

    @cached_property
    def _found_job(self) -> Job:
        """The same where the captured light is found, too."""
        job = self._own_job
        assert job.splats is not None and job.proxy is not None
        splats, own = job.splats.value, job.proxy.value
        views = capture_views(splats, job.capture_cameras, job.capture_pictures)

        def pack() -> F32:
            return estimate.estimate(splats, own, RenderSettings(), views=views).packed().astype(np.float32)

        name = f"objects.light.{self._taken}"
        packed = self._store.array(name, "light estimated", pack, "light", (splats, own, views))
        light = replace(estimate.lighting_of(packed.astype(np.float64)), name=self.recipe.captured.name)
        return replace(job, captured=light)

    @property
    def _taken(self) -> str:
        """Of which pictures: those of one size, or the quick run's."""
        return f"{self.camera.width > 64}"

    def made(self, lighting: Lighting, *, whole: bool, job: Job | None = None) -> tuple[F32, LightingBuffer]:
        """(factor (H, W, 3), new light) of a lighting, with objects or without; `job`: the shipped proxy's, or
        another's, whose captured light is the one that stays."""
        job = self._as(job or self._job, lighting, whole=whole)
        scene = prepare(job, self._kept)
        lit = stages.light(scene, self.camera, job.lightings[0])
        frame = stages.relight(scene, stages.composite(scene, self.camera), lit)
        assert frame.factor is not None
        return frame.factor, lit.new

    def _as(self, job: Job, lighting: Lighting, *, whole: bool) -> Job:
        """A job in that light, with objects or without."""
        stays = lighting is self.recipe.captured
        new = job.captured if stays and job.captured is not None else lighting
        # repair follows the splats' own blur, which the true captured picture that is multiplied has none of
        lit = replace(new, relight=replace(job.relight, repair=False))
        objects = tuple(_inserted(x, s) for x, s in self._soups) if whole else ()
        return replace(job, objects=objects, lightings=(lit,))

    def ways(self, lighting: Lighting) -> dict[str, Callable[[], tuple[F32, LightingBuffer]]]:
        """By name, ways to put the objects in: makers of (factor (H, W, 3), new light)."""

        def on(job: Callable[[], Job]) -> Callable[[], tuple[F32, LightingBuffer]]:
            return lambda: self.made(lighting, whole=True, job=job())

        def pasted(shadow: bool) -> tuple[F32, LightingBuffer]:
            (plain, bare), (_, new) = self.made(lighting, whole=False), self.made(lighting, whole=True)
            return plain * _sun_left(bare, new) if shadow else plain, new

        return {
            "pasted": lambda: pasted(shadow=False),
            "with the sun's shadow": lambda: pasted(shadow=True),
            "mirelight": on(lambda: self._job),
            "on the true surface": on(lambda: self._true_job),
            "own proxy, light known": on(lambda: self._own_job),
            "own proxy, light estimated": on(lambda: self._found_job),
        }

    def scores(self, lighting: Lighting, chosen: str, pictures: Path | None) -> Iterator[tuple[list[str], list[str]]]:
        """Of each way whose name is of the pattern `chosen` a row of its dB, and one of its levels."""
        truth = self.pictures(lighting)
        before = self.pictures(self.recipe.captured).bare
        objects = self.made(lighting, whole=True)[1].objects
        assert objects is not None
        zones = self._zones(truth, objects)
        for way, make in self.ways(lighting).items():
            if not fnmatchcase(way, chosen):
                continue
            factor, light = make()
            assert light.objects is not None
            first, second = (_over(x, factor, light.objects) for x in before)
            error = squared_error((first, second), truth.full)
            mean, true = (np.clip(x, 0, 1) for x in ((first + second) / 2, (truth.full[0] + truth.full[1]) / 2))
            label = [lighting.name, way]
            yield (
                [*label, *(f"{decibels(error[zone]):.1f}" for zone in zones.values())],
                [*label, *(f"{mean[zone].mean() / true[zone].mean():.3f}" for zone in zones.values())],
            )
            if pictures is not None:
                side_by_side(pictures / f"{lighting.name} {way}.png".replace(" ", "-"), [shown(mean), shown(true)])

    def costs(self, lighting: Lighting) -> Iterator[tuple[str, str, str]]:
        """CPU time of a trace with the objects over that of one without, and how much of the picture shows them."""
        scene = prepare(self._as(self._job, lighting, whole=True), self._kept)
        new, bare, full = scene.job.lightings[0], scene.tracer, SceneWithObjects(scene, scene.job.objects).tracer
        spent = least(lambda: full.trace(new, self.camera), 3) / least(lambda: bare.trace(new, self.camera), 3)
        light = full.trace(new, self.camera)
        assert light.objects is not None
        yield lighting.name, "CPU time with three objects / without", f"{spent:.2f}"
        yield lighting.name, "share of pixels that show them", f"{(light.objects.coverage > 0).mean():.3f}"

    def bounced(self, lighting: Lighting) -> Iterator[tuple[str, str, str]]:
        """Of each object, what share of its light the proxy has reflected; of the ground, how bright its albedo is."""
        _, new = self.made(lighting, whole=True)
        assert new.objects is not None
        zones = self._zones(self.pictures(lighting), new.objects)
        for one in self.things:
            inside = zones[one.name]
            indirect, whole = (
                sum(float(getattr(x, part)[inside].mean()) for x in new.objects.layers)
                for part in ("indirect", "total")
            )
            yield lighting.name, f"share of light on the {one.name} object that is reflected", f"{indirect / whole:.3f}"
        true = self._surface(self.camera, 8)[..., :3]
        ground = (new.coverage > 0.999) & (new.normal[..., 1] > 0.9) & (new.objects.coverage == 0)
        level = float((new.albedo[ground].mean(0) / true[ground].mean(0)).mean())
        yield lighting.name, "albedo of the ground, told from pictures, truth = 1", f"{level:.3f}"

    def _surface(self, camera: Camera, spp: int) -> F32:
        """(H, W, 6) true albedo and normals."""
        mi = mitsuba()
        path = mi.load_dict({"type": "path", "max_depth": 2})
        aov = mi.load_dict({"type": "aov", "aovs": "a:albedo,n:sh_normal", "path": path})
        return np.asarray(Truth(self._looks, self.recipe.captured)._rendered(aov, camera, spp, 1)[..., 4:10])

    def _zones(self, truth: Pictures, objects: LightingBuffer) -> dict[str, Bool]:
        """By name (H, W) pixels: of the capture by how far the objects change them, and of each object."""
        share, beside = objects.coverage, objects.coverage == 0
        light = [(a.mean(-1) + b.mean(-1)) / 2 for a, b in (truth.bare, truth.full)]
        change = np.abs(light[1] / np.maximum(light[0], 1e-4) - 1)
        change = ndimage.uniform_filter(change, 3)  # the truth's noise is no change
        near = ndimage.binary_dilation(share > 0, iterations=CONTACT)
        centres = np.stack([x.part.vertices.mean(0) for x in self.things])
        which = np.argmin(((objects.position[..., None, :] - centres) ** 2).sum(-1), -1)
        inside = share > 0.999
        zones = {
            "changed > 1 %": beside & (change > 0.01),
            "> 10 %": beside & (change > 0.1),
            "contact": beside & near,
            "not changed": beside & (change <= 0.01),
            "edges": (share > 0) & ~inside,
        }
        return zones | {x.name: inside & (which == k) for k, x in enumerate(self.things)}


class _Kept(NullCache):
    """Artefacts in memory: colours and captured light are made once."""

    def __init__(self) -> None:
        self._there: dict[str, Any] = {}

    def get(self, key: str, codec: Codec[T]) -> T | None:
        """A kept one."""
        return self._there.get(key)

    def put(self, key: str, value: T, codec: Codec[T]) -> None:
        """Keep one."""
        self._there[key] = value


def _clean(picture: F32, surface: F32) -> F32:
    """(H, W, 3) a noisy picture without its noise, guided by (H, W, 6) albedo and normals."""
    import pyoidn  # type: ignore[import-untyped]

    color, albedo, normal = (np.ascontiguousarray(x[..., :3], np.float32) for x in (picture, surface, surface[..., 3:]))
    return np.asarray(np.maximum(pyoidn.denoise(color, albedo=albedo, normal=normal, hdr=True), 0))


def _inserted(thing: Thing, soup: Soup) -> Inserted:
    """The object as a job has it."""
    count = 3 * len(soup.positions)
    mesh = ProxyMesh(
        vertices=soup.positions.reshape(-1, 3).astype(np.float32),
        normals=soup.normals.reshape(-1, 3).astype(np.float32),
        faces=np.arange(count, dtype=np.int32).reshape(-1, 3),
        materials=(Material(base_color=np.array(thing.base), metallic=thing.metallic, roughness=thing.roughness),),
        albedo=None,
    )
    return Inserted(name=thing.name, mesh=Deferred.of(mesh))


def _over(captured: F32, factor: F32, objects: LightingBuffer) -> F32:
    """(H, W, 3) objects over the true captured picture times a factor."""
    return np.asarray((1 - objects.coverage[..., None]) * captured * factor + objects.beauty, np.float32)


def _sun_left(bare: LightingBuffer, new: LightingBuffer) -> F32:
    """(H, W, 3) what is left of the light where the objects are in the sun's way, and change nothing else."""

    def sunlight(buffer: LightingBuffer) -> F32:
        layer = next(x for x in buffer.layers if x.name == "sun")
        return np.asarray(layer.direct / np.maximum(buffer.coverage, 1e-3)[..., None])

    every = np.maximum(bare.beauty / np.maximum(bare.coverage, 1e-3)[..., None], 1e-6)
    return np.clip(1 - (sunlight(bare) - sunlight(new)) / every, 0, 1)


def options(parser: argparse.ArgumentParser) -> None:
    """The part's own."""
    truth_options(parser, 320, ROOT / "out" / "bench_truth")
    parser.add_argument(
        "--ways", default="*", help="pattern of the rows wanted, as 'own proxy*'; other tables if all are"
    )
    parser.add_argument("--light", default="*", help="pattern of lightings, as 'day'")


def run(chosen: argparse.Namespace) -> list[Table]:
    """The tables."""
    width, truth_spp, spp = (64, 4, 4) if chosen.quick else (chosen.width, chosen.truth_spp, chosen.spp)
    yard = Yard((width, width * 9 // 16), truth_spp, spp, Store(chosen.cache))
    lightings = [x for x in yard.lightings if fnmatchcase(x.name, chosen.light)]
    found = [row for lighting in lightings for row in yard.scores(lighting, chosen.ways, chosen.pictures)]
    columns = ("light", "objects", *ZONES, *(x.name for x in yard.things))
    tables = [
        table("Objects in a capture", columns, [x for x, _ in found]),
        table("Their level, truth = 1", columns, [x for _, x in found]),
    ]
    if (chosen.ways, chosen.light) != ("*", "*"):
        return tables
    day = yard.lightings[0]
    return [
        *tables,
        table("What their light comes from", ("light", "", ""), yard.bounced(day)),
        table("What they cost", ("light", "", ""), [row for x in yard.lightings for row in yard.costs(x)]),
    ]

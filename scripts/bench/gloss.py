"""Highlights beside path-traced truth: a glazed vase, a varnished bench and brass fruit, splats trained on pictures.

    python scripts/bench gloss [--spp 64] [--width 240] [--truth-spp 128] [--cache FOLDER] [--pictures FOLDER]

The captured light and the exact surface are known. A highlight is where what the true surfaces mirror of the new light
is more than a tenth of the picture. PSNR is of display values, with the truth's noise taken out; "light alone" is with
the true captured picture in place of the splats.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import get_args

import numpy as np
from numpy.typing import NDArray
from scenegen import glazed
from scenegen.proxy import welded
from scenegen.truth import Looks, Truth

from bench.common import Table, side_by_side, table, truth_options
from bench.truth_captures import Captured, Size, capture
from bench.truth_rows import WHOLE_PIXEL
from bench.truth_scores import decibels, shown, squared_error
from bench.truth_store import ROOT, Store
from mirelight import prepare
from mirelight.base.colour import srgb_decode
from mirelight.estimate import finish
from mirelight.lighting import Tracer, colored_by
from mirelight.model import (
    F32,
    Deferred,
    Job,
    Lighting,
    Material,
    OutputSettings,
    ProxyMesh,
    RelightSettings,
    RenderSettings,
)
from mirelight.model.dressing import Dress, dressed
from mirelight.model.profiles import Gloss
from mirelight.pipeline import stages
from mirelight.proxy.capture_views import capture_views

Bool = NDArray[np.bool_]
GLAZED = "glazed, trained"
HIGHLIGHT = 0.1  # share of the picture that is mirrored
RATIO = RelightSettings(mode="ratio")


class Shine:
    """One capture, relit with and without its materials."""

    def __init__(self, name: str, size: Size, spp: int, store: Store) -> None:
        self.capture: Captured = capture(name, size, store, lambda text: print(text, flush=True))
        self._store, self._size, self._spp = store, size, spp

    @cached_property
    def _pictures(self) -> tuple[Deferred[F32], ...]:
        whole = np.ones((*self.capture.pictures[0].shape[:2], 1), np.float32)
        return tuple(Deferred.of(np.concatenate([srgb_decode(x), whole], axis=2)) for x in self.capture.pictures)

    @cached_property
    def bare(self) -> ProxyMesh:
        """The true surface, all matt."""
        return _surface(glazed.looks())

    @cached_property
    def given(self) -> ProxyMesh:
        """With its true finishes: Beckmann's alpha is nearly the square of glTF's roughness."""
        finishes = [
            Dress(name=name, roughness=alpha**0.5, metallic=float(name == glazed.METAL))
            for name, alpha in glazed.FINISH.items()
        ]
        return dressed(self.bare, finishes)

    def told(self, *, by_name: bool) -> tuple[ProxyMesh, tuple[finish.Finish, ...]]:
        """With what the pictures tell of its finishes: of its materials, whose borders are known, or of parts."""
        c, settings = self.capture, RenderSettings()
        views = capture_views(c.splats, c.orbit, self._pictures)
        colored = replace(colored_by(c.splats, self.bare, c.light, settings, views), albedo=None)
        if not by_name:
            colored = replace(colored, materials=(Material(),), face_materials=None)
        regions, names = finish.regions_of(colored)
        found = finish.finishes(colored, regions, names, c.light, views, settings)
        return finish.finished(self.bare, regions, found), found

    def frames(self, mesh: ProxyMesh, ways: Sequence[RelightSettings]) -> list[list[F32]]:
        """(H, W, 3) frames of the camera that is kept apart, by lighting and way."""
        c = self.capture
        lightings = [[replace(x, relight=way) for way in ways] for x in c.lightings]
        job = Job(
            source=Path("gloss"),
            splats=Deferred.of(c.splats),
            proxy=Deferred.of(mesh),
            capture_cameras=c.orbit,
            capture_pictures=self._pictures,
            albedo_from_splats=True,
            cameras=(c.camera,),
            lightings=tuple(x for row in lightings for x in row),
            captured=c.light,
            render=RenderSettings(spp=self._spp, denoise=True),
            relight=ways[0],
            output=OutputSettings(store="frames"),
        )
        scene = prepare(job)
        return [[stages.frame(scene, c.camera, x).rgba[..., :3] for x in row] for row in lightings]

    @cached_property
    def there(self) -> Bool:
        """(H, W) pixels that count: no sky is in them."""
        tracer = Tracer(self.capture.exact, RenderSettings(spp=16, max_depth=1), layers=False, aovs=False)
        return np.asarray(tracer.trace(self.capture.light, self.capture.camera).coverage > WHOLE_PIXEL)

    def zones(self, lighting: Lighting) -> dict[str, Bool]:
        """By name (H, W) pixels."""
        c, truth = self.capture, self.capture.truth[lighting.name]
        true = (truth[0] + truth[1]) / 2
        black = {
            k: replace(x, texture=np.zeros_like(x.texture)) if not x.metal else x for k, x in glazed.surfaces().items()
        }

        def make() -> F32:
            looks = Looks(soups=glazed.looks().soups, surfaces=black)
            return Truth(looks, lighting).picture(c.camera, self._size.truth_spp)[..., :3]

        name = f"mirrored.{lighting.name}.{self._size.width}.{self._size.truth_spp}"
        mirrored = self._store.array(name, "true pictures", make)
        there = self.there
        bright = there & (mirrored.mean(-1) > HIGHLIGHT * true.mean(-1)) & (mirrored.mean(-1) > 0.01)
        return {"highlights": bright, "rest": there & ~bright, "whole": there}

    def rows(
        self, ways: Mapping[str, tuple[ProxyMesh, Sequence[RelightSettings]]], out: Path | None
    ) -> Iterator[list[str]]:
        """Of each lighting and way: dB in the zones."""
        made = {name: self.frames(mesh, settings) for name, (mesh, settings) in ways.items()}
        for k, lighting in enumerate(self.capture.lightings):
            zones, truth = self.zones(lighting), self.capture.truth[lighting.name]
            for name, frames in made.items():
                for way, frame in zip(ways[name][1], frames[k], strict=True):
                    error = squared_error((frame, frame), truth)
                    shown_as = name if way.gloss else f"{name}, `sh = {way.sh}`"
                    yield [lighting.name, shown_as, *(f"{decibels(error[x]):.1f}" for x in zones.values())]
            if out is not None:
                side = [x[k][0] for x in made.values()] + [(truth[0] + truth[1]) / 2]
                name = f"{self.capture.name}.{lighting.name}.png".replace(" ", "-")
                side_by_side(out / name, [shown(x) for x in side])


def _surface(looks: Looks) -> ProxyMesh:
    """All true triangles with their normals and the names of their materials; equal corners are one."""
    corners, faces, real = welded(np.concatenate([np.concatenate([x.positions, x.normals], 2) for x in looks.soups]))
    names = sorted(looks.surfaces)
    owners = np.concatenate([np.full(len(x.positions), names.index(x.material), np.int32) for x in looks.soups])
    return ProxyMesh(
        vertices=corners[:, :3].astype(np.float32),
        normals=corners[:, 3:].astype(np.float32),
        faces=faces.astype(np.int32),
        face_materials=owners[real],
        materials=tuple(Material(name=x) for x in names),
    )


def options(parser: argparse.ArgumentParser) -> None:
    """The part's own."""
    truth_options(parser, 240, ROOT / "out" / "bench_truth")


def run(chosen: argparse.Namespace) -> list[Table]:
    """The tables."""
    width, truth_spp, spp = (64, 8, 8) if chosen.quick else (chosen.width, chosen.truth_spp, chosen.spp)
    size = Size(width, width * 9 // 16, truth_spp=truth_spp, most=1 if chosen.quick else None)
    scene = Shine(GLAZED, size, spp, Store(chosen.cache))
    shiny = [replace(RATIO, gloss=True)]
    (by_name, found), (by_parts, _) = (scene.told(by_name=x) for x in (True, False))
    ways = {
        "matt": (scene.bare, [replace(RATIO, sh=x) for x in get_args(Gloss)]),
        "materials given": (scene.given, shiny),
        "told for its materials": (by_name, shiny),
        "told for parts": (by_parts, shiny),
    }
    rows = [[x.name, f"{x.roughness:.2f}", f"{x.metallic:g}", f"{x.explained:.2f}", str(x.pixels)] for x in found]
    return [
        table("Highlights", ("light", "way", "highlights", "rest", "whole"), scene.rows(ways, chosen.pictures)),
        table("Materials as told", ("material", "roughness", "metallic", "explained", "pixels"), rows),
    ]

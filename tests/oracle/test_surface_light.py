"""Light read from the surface through the stages: the same frame alone and among others, near the traced one."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar, cast

import numpy as np
import pytest

import mirelight
from mirelight.batch import executor
from mirelight.batch.forecast import forecast
from mirelight.lighting import Tracer
from mirelight.model import (
    Camera,
    CellLight,
    Deferred,
    Environment,
    Indirect,
    Job,
    Lighting,
    LightingBuffer,
    PointLight,
    RenderSettings,
    SurfaceCells,
    SurfaceTransport,
)
from mirelight.model.unit_lights import LightSet
from mirelight.pipeline.artefact_cache import NullCache
from mirelight.pipeline.codecs import Codec
from mirelight.pipeline.plan import plan
from mirelight.pipeline.surface_light import SurfaceLight
from mirelight.store import Store

from ..analytic.test_surface_cache import room, stage

T = TypeVar("T")


def job() -> Job:
    proxy, lighting, view = stage()
    other = Camera.look_at([-1, 2.5, 3], [0, 0.5, 0], 24, 18, name="other")
    lamp, sun = lighting.lights
    dimmed = replace(lighting, name="dimmed", lights=(replace(lamp, intensity=0.5 * lamp.intensity), sun))
    return Job(
        source=Path("job.toml"),
        splats=None,
        proxy=Deferred.of(proxy),
        cameras=(replace(view, name="front"), other),
        lightings=(replace(lighting, name="whole"), dimmed),
        render=RenderSettings(spp=16, indirect="surface"),
    )


def test_a_frame_alone_is_that_among_others() -> None:
    one = job()
    among = mirelight.prepare(one)
    every = {(c.name, x.name): mirelight.light(among, c, x) for c in one.cameras for x in one.lightings}
    by_itself = replace(one, cameras=one.cameras[1:])  # of a job with no other camera, too
    alone = mirelight.light(mirelight.prepare(by_itself), by_itself.cameras[0], one.lightings[1])
    found = every["other", "dimmed"]
    assert np.array_equal(alone.new.beauty, found.new.beauty)
    for layer, other in zip(alone.new.layers, found.new.layers, strict=True):
        assert layer.variance is not None and other.variance is not None
        assert np.array_equal(layer.variance, other.variance)

    traced = mirelight.prepare(replace(one, render=replace(one.render, indirect="traced", spp=256, max_depth=16)))
    for lighting in one.lightings:
        truth = mirelight.light(traced, one.cameras[0], lighting).new
        for layer, own in zip(truth.layers, every["front", lighting.name].new.layers, strict=True):
            assert layer.name == own.name
            np.testing.assert_allclose(own.indirect.mean(), layer.indirect.mean(), rtol=0.04)
            np.testing.assert_allclose(own.direct.mean(), layer.direct.mean(), rtol=0.03)


@pytest.mark.parametrize("enclosed", [False, True])
def test_auto_reads_the_surface_in_rooms_and_traces_under_an_open_sky(enclosed: bool) -> None:
    open_air = job()
    mesh = room((-2, -0.1, -2), (2.6, 2.6, 3.1)) if enclosed else stage()[0]
    one = replace(open_air, proxy=Deferred.of(mesh))

    def frame(indirect: Indirect) -> LightingBuffer:
        work = replace(one, render=replace(one.render, spp=4, indirect=indirect))
        return mirelight.light(mirelight.prepare(work), work.cameras[1], work.lightings[0]).new

    found = frame("auto").beauty
    assert found.any()
    assert np.array_equal(found, frame("surface" if enclosed else "traced").beauty)
    assert not np.array_equal(found, frame("traced" if enclosed else "surface").beauty)


class Shelf(NullCache):
    """Keeps light on the surface in memory, each thing once."""

    def __init__(self) -> None:
        self.found: dict[str, SurfaceCells] = {}
        self.lights: dict[str, tuple[CellLight, ...]] = {}
        self.transports: dict[str, SurfaceTransport] = {}

    def get(self, key: str, codec: Codec[T]) -> T | None:
        return cast("T | None", self.found.get(key) or self.lights.get(key) or self.transports.get(key))

    def put(self, key: str, value: T, codec: Codec[T]) -> None:
        if codec.place == "surface":
            assert self.get(key, codec) is None
            home: Any = self.lights
            if isinstance(value, SurfaceCells | SurfaceTransport):
                home = self.found if isinstance(value, SurfaceCells) else self.transports
            home[key] = value


def fills(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """How many lights each fill from now on has."""
    counts: list[int] = []
    fill = Tracer.fill

    def counted(self: Tracer, cells: SurfaceCells, lighting: Lighting, **more: object) -> object:
        counts.append(len(lighting.lights) + (lighting.environment is not None))
        return fill(self, cells, lighting, **more)  # type: ignore[arg-type]

    monkeypatch.setattr(Tracer, "fill", counted)
    return counts


def lit(work: Job, shelf: Shelf, camera: int = 0) -> mirelight.Lit:
    return mirelight.light(mirelight.prepare(work, shelf), work.cameras[camera], work.lightings[0])


def test_only_lights_that_changed_are_filled(monkeypatch: pytest.MonkeyPatch) -> None:
    """And what is filled then has the bits that it has among all the others."""
    one, shelf, counts = job(), Shelf(), fills(monkeypatch)
    whole = one.lightings[0]
    first = lit(one, shelf)
    assert counts == [3] and len(shelf.lights) == 3 and len(shelf.found) == 1
    lit(one, shelf, camera=1)
    dimmed = replace(whole, name="other", lights=(replace(whole.lights[0], intensity=0.1), *whole.lights[1:]))
    less = lit(replace(one, lightings=(dimmed,)), shelf)
    assert counts == [3]
    np.testing.assert_allclose(less.new.layers[0].indirect, first.new.layers[0].indirect * 0.05, rtol=1e-5)

    ball = PointLight(name="ball", position=np.array([1.0, 1.2, 0.8]), radius=0.1, intensity=3.0)
    grown = replace(one, lightings=(replace(whole, lights=(ball, *whole.lights)),))
    added = lit(grown, shelf)
    assert counts == [3, 1]
    again = Shelf()
    among = lit(grown, again)
    assert counts == [3, 1, 4]
    assert np.array_equal(among.new.beauty, added.new.beauty)
    assert again.lights.keys() == shelf.lights.keys()
    for key, (light,) in again.lights.items():
        (other,) = shelf.lights[key]
        for name in ("direct", "first_bounce", "indirect"):
            mine, theirs = getattr(light, name), getattr(other, name)
            assert mine is theirs or np.array_equal(mine, theirs)

    turned = replace(one, lightings=(replace(whole, environment=Environment(radiance=np.ones((2, 4, 3), np.float32))),))
    lit(turned, shelf)
    assert counts == [3, 1, 4, 1] and len(shelf.transports) == 1
    for changed in (replace(one.render, seed=1), replace(one.render, max_depth=5)):
        lit(replace(one, render=changed), shelf)
    assert counts == [3, 1, 4, 1, 3, 3]
    lit(replace(one, cameras=one.cameras[:1]), shelf)
    lit(replace(one, render=replace(one.render, spp=4)), shelf)
    assert len(counts) == 6 and len(shelf.found) == 1


def test_glowing_surfaces_are_filled_by_themselves(monkeypatch: pytest.MonkeyPatch) -> None:
    one, shelf, counts = job(), Shelf(), fills(monkeypatch)
    proxy = one.proxy.value if one.proxy else None
    assert proxy is not None
    from mirelight.model import Material

    glowing = replace(one, proxy=Deferred.of(replace(proxy, materials=(Material(emissive=np.full(3, 0.5)),))))
    first = lit(glowing, shelf)
    assert sorted(counts) == [0, 3] and len(shelf.lights) == 4
    assert np.array_equal(lit(glowing, shelf).new.beauty, first.new.beauty)
    assert len(counts) == 2


def made(work: Job) -> None:
    """The job rendered."""
    store = Store(work)
    store.open()
    try:
        executor.run(plan(work), store)
    finally:
        store.close()


def test_turning_the_sky_takes_no_new_fill(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As the forecast says, and as the folder has it."""
    measured = list[tuple[float, float]]()

    def seconds(surface: SurfaceLight, parts: list[LightSet]) -> tuple[float, float]:
        measured.append(told(surface, parts))
        return 1e7 * len(parts), 1e6 * len(parts)

    told = SurfaceLight.seconds
    monkeypatch.setattr(SurfaceLight, "seconds", seconds)
    one = job()
    sky = one.lightings[0].environment
    assert sky is not None

    def turned(degrees: float) -> Lighting:
        return Lighting(name=f"sky {degrees:g}", environment=replace(sky, rotation=degrees))

    output = replace(one.output, directory=tmp_path, png=False)
    small = tuple(x.resized(12, 9) for x in one.cameras)
    first = replace(one, cameras=small, lightings=(turned(0), turned(90)), output=output)
    before = forecast(plan(first))
    assert (before.fills, before.gathered) == (1, 2)
    assert before.seconds == pytest.approx(1.2e7, rel=1e-2)  # rays, and two skies
    made(first)
    kept = sum(x.stat().st_size for x in tmp_path.rglob("*") if x.is_file())
    assert kept == pytest.approx(before.bytes, rel=0.25), "what lies on the surface is most of it"
    swept = replace(first, lightings=(*first.lightings, turned(180), turned(270)))
    after = forecast(plan(swept))
    assert (after.fills, after.gathered) == (0, 2)
    assert after.seconds == pytest.approx(2e6, rel=1e-2)
    assert len(measured) == 2 and min(x for both in measured for x in both) > 0
    made(swept)
    assert forecast(plan(swept)).fills is None

"""Light on splats against closed forms: a lamp over a floor, an even sky, lightings as weighted sums of the layers."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mirelight.apps.mixer import rgb9e5
from mirelight.apps.mixer.layers import MixLayers, make
from mirelight.base.errors import InputError
from mirelight.lighting import Tracer, splat_light
from mirelight.lighting.appearance import shown
from mirelight.model import (
    F64,
    Deferred,
    Environment,
    Job,
    LayerFactor,
    Lighting,
    Material,
    PointLight,
    ProxyMesh,
    RelightSettings,
    RenderSettings,
    SplatCloud,
    SurfaceCells,
    SurfaceTransport,
)
from mirelight.pipeline.requirements import check_lit_splats
from mirelight.pipeline.scene import prepare
from mirelight.pipeline.splat_light import SplatLight, by_sharpness

from .test_surface_cache import stage

FLOOR = ProxyMesh(
    vertices=np.array([[-50, 0, -50], [50, 0, -50], [50, 0, 50], [-50, 0, 50]], np.float32),
    faces=np.array([[0, 2, 1], [0, 3, 2]], np.int32),
)
LAMP = PointLight(name="lamp", position=np.array([0.0, 2.0, 0.0]), color=np.array([1.0, 0.5, 0.25]), intensity=30.0)
FILL = PointLight(name="fill", position=np.array([3.0, 1.0, 1.0]), intensity=4.0)
SKY = Environment(radiance=np.full((1, 1, 3), 0.5, np.float32), intensity=2.0)
CAPTURED = Lighting(name="captured", environment=Environment(radiance=np.ones((1, 1, 3), np.float32)))
DAY = Lighting(name="day", lights=(LAMP, FILL), environment=SKY)
NIGHT = Lighting(name="night", lights=(replace(LAMP, intensity=3.0),))


def cloud(count: int = 64) -> SplatCloud:
    """Flat splats on the floor, the last one far above it."""
    rng = np.random.default_rng(3)
    means = np.stack([rng.uniform(-4, 4, count), np.full(count, 0.01), rng.uniform(-4, 4, count)], axis=1)
    means[-1, 1] = 40
    return SplatCloud(
        means=means.astype(np.float32),
        quats=np.tile(np.array([1, 0, 0, 0], np.float32), (count, 1)),
        scales=np.tile(np.array([0.1, 0.01, 0.1], np.float32), (count, 1)),
        opacities=np.full(count, 0.9, np.float32),
        sh=rng.uniform(-1, 1, (count, 1, 3)).astype(np.float32),
    )


SPLATS = cloud()
JOB = Job(
    source=Path("job.toml"),
    splats=Deferred.of(SPLATS),
    proxy=Deferred.of(FLOOR),
    lightings=(DAY, NIGHT),
    captured=CAPTURED,
    relight=RelightSettings(mode="ratio"),
    render=RenderSettings(max_depth=1),
)


def expected(light: PointLight, points: F64) -> F64:
    """I cos / d^2 / pi on a floor, (N, 3)."""
    to = light.position - points
    d = np.linalg.norm(to, axis=1)
    return np.asarray((light.color * light.intensity)[None] * (to[:, 1] / d**3)[:, None] / np.pi, np.float64)


@pytest.fixture(scope="module")
def layers() -> MixLayers:
    return make(prepare(JOB), spp=64, lightings=JOB.lightings)


def on_floor() -> F64:
    return np.asarray(SPLATS.means[:-1] * [1.0, 0.0, 1.0], np.float64)


def test_a_layer_for_each_unit_light_of_all_lightings(layers: MixLayers) -> None:
    assert layers.names == ("lamp", "fill", "environment", "base")
    assert [[f.layer for f in x.faders] for x in layers.lightings] == [[0, 1, 2], [0]]


def test_factors_are_the_ratio_of_closed_forms(layers: MixLayers) -> None:
    floor = JOB.relight.delta * 1.0  # of an even sky of radiance 1
    for index, lighting in enumerate((DAY, NIGHT)):
        lamps = [expected(x, on_floor()) for x in lighting.lights if isinstance(x, PointLight)]
        new = np.sum(lamps, axis=0) + (1.0 if lighting.environment else 0.0)
        wanted = np.minimum((new + floor) / (1 + floor), JOB.relight.max_ratio)
        np.testing.assert_allclose(layers.factor(layers.weights(index))[:-1], wanted, rtol=2e-3)


def test_a_splat_off_the_proxy_takes_the_nearest_place(layers: MixLayers) -> None:
    nearest = np.linalg.norm(on_floor() - SPLATS.means[-1], axis=1).argmin()
    assert layers.near == pytest.approx(63 / 64)
    np.testing.assert_allclose(layers.values[:2, -1], layers.values[:2, nearest], rtol=1e-5)


def test_layers_sum_to_the_irradiance() -> None:
    tracer = splat_light.tracer_for(FLOOR, replace(JOB.render, max_depth=4))
    places = splat_light.places_of(SPLATS, FLOOR, tracer, CAPTURED)
    made = make(prepare(replace(JOB, captured=None, relight=RelightSettings(mode="tint"))), spp=64, lightings=(DAY,))
    whole = shown(tracer, DAY, places.points, places.normals, 64)
    np.testing.assert_allclose(made.factor(made.weights(0)), 0.5 * whole * JOB.relight.brightness, rtol=2e-3)
    albedo, glow = tracer.materials_at(places.points, places.normals)
    np.testing.assert_allclose(albedo, 0.5, rtol=1e-6)
    assert not glow.any()
    np.testing.assert_array_equal(places.normals, np.tile([0.0, 1.0, 0.0], (len(SPLATS), 1)))


def test_a_place_where_no_light_falls_is_not_what_was_seen() -> None:
    """A sheet hidden under the floor is nearer to some splats, and dark on both sides when they are seen."""
    hidden = (FLOOR.vertices * [0.9, 1, 0.9] - [0, 0.5, 0]).astype(np.float32)
    proxy = ProxyMesh(
        vertices=np.concatenate([FLOOR.vertices, hidden]), faces=np.concatenate([FLOOR.faces, FLOOR.faces + 4])
    )
    means = SPLATS.means.copy()
    means[:5, 1] = -0.4
    tracer = splat_light.tracer_for(proxy, JOB.render)
    places = splat_light.places_of(replace(SPLATS, means=means), proxy, tracer, NIGHT)
    np.testing.assert_allclose(places.points[:, 1], 0, atol=1e-6)
    np.testing.assert_array_equal(places.normals, np.tile([0.0, 1.0, 0.0], (len(SPLATS), 1)))


def test_the_jobs_mix_is_in_the_weights_and_not_in_the_layers(layers: MixLayers) -> None:
    mix = (LayerFactor(layer="lamp", factor=np.array([0.5, 0, 2])),)
    mixed = make(prepare(JOB), spp=64, lightings=(replace(DAY, mix=mix), NIGHT))
    np.testing.assert_array_equal(mixed.values, layers.values)
    np.testing.assert_allclose(mixed.weights(0)[0], layers.weights(0)[0] * [0.5, 0, 2])
    np.testing.assert_allclose(mixed.weights(1), layers.weights(1))


def test_tint_is_the_lit_proxy() -> None:
    job = replace(JOB, captured=None, relight=RelightSettings(mode="tint", brightness=2.0))
    made = make(prepare(job), spp=16, lightings=(NIGHT,))
    assert made.names == ("lamp",)
    assert made.limit is None
    wanted = 2 * 0.5 * expected(replace(LAMP, intensity=3.0), on_floor())
    np.testing.assert_allclose(made.factor(made.weights(0))[:-1], wanted, rtol=2e-3)


def test_packed_layers_are_within_half_a_step() -> None:
    rng = np.random.default_rng(1)
    values = (
        rng.lognormal(0, 1.5, (3, 4000, 1)) * rng.uniform(0.3, 1, (3, 4000, 3)) * [[[1.0]], [[1e-6]], [[3e5]]]
    ).astype(np.float32)
    packed, scales = rgb9e5.pack(values)
    back = np.stack([rgb9e5.decode(p) * np.float32(s) for p, s in zip(packed, scales, strict=True)])
    error = np.abs(back - values).max(axis=-1) / values.max(axis=-1)
    assert error.max() <= 1 / 512 * 1.001
    shown, again = (
        np.clip(x / np.median(x, axis=(1, 2), keepdims=True) / 4, 0, 1) ** (1 / 2.2) for x in (values, back)
    )
    assert -10 * np.log10(((shown - again) ** 2).mean()) >= 70
    np.testing.assert_array_equal(rgb9e5.encode(rgb9e5.decode(packed)), packed)


def test_extremes_of_the_packing() -> None:
    for value, wanted in ((0.0, 0.0), (1e9, rgb9e5.LARGEST), (-1.0, 0.0), (2.0**-24, 2.0**-24), (511.9, 512.0)):
        assert rgb9e5.decode(rgb9e5.encode(np.full((1, 3), value, np.float32)))[0, 0] == wanted


@pytest.mark.parametrize(
    ("job", "said"),
    [
        (replace(JOB, splats=None), "no splats"),
        (replace(JOB, proxy=None), "no proxy mesh for light to fall on"),
        (replace(JOB, lightings=()), "no light"),
        (
            replace(JOB, render=RenderSettings(profile="playcanvas")),
            "the profile playcanvas, whose light is not traced",
        ),
    ],
)
def test_a_job_with_nothing_to_mix_is_refused(job: Job, said: str) -> None:
    with pytest.raises(InputError, match=said):
        check_lit_splats(job)


def test_more_layers_than_the_page_holds_are_refused() -> None:
    lamps = tuple(replace(LAMP, name=f"lamp{k}", position=np.array([k, 2.0, 0])) for k in range(33))
    with pytest.raises(InputError, match="34 layers of light; give lights a group, or choose lightings"):
        make(prepare(JOB), spp=1, lightings=(Lighting(lights=lamps),))


def test_layers_read_from_the_surface_are_the_traced_ones(monkeypatch: pytest.MonkeyPatch) -> None:
    """On a stage whose surfaces glow and light each other."""
    proxy, lighting, _ = stage()
    glowing = replace(proxy, faces=proxy.faces[:, ::-1], materials=(Material(emissive=np.array([0.2, 0.1, 0.3])),))
    rng = np.random.default_rng(4)
    means = np.stack([rng.uniform(-1.9, -0.4, 600), np.zeros(600), rng.uniform(-1.9, 1.9, 600)], axis=1)
    splats = SplatCloud(
        means=means.astype(np.float32),
        quats=np.tile(np.array([1, 0, 0, 0], np.float32), (600, 1)),
        scales=np.tile(np.array([0.1, 0.01, 0.1], np.float32), (600, 1)),
        opacities=np.full(600, 0.9, np.float32),
        sh=np.zeros((600, 1, 3), np.float32),
    )
    job = Job(
        source=Path("job.toml"),
        splats=Deferred.of(splats),
        proxy=Deferred.of(glowing),
        lightings=(replace(lighting, name="day"),),
        relight=RelightSettings(mode="tint"),
        render=RenderSettings(max_depth=12),
    )
    fills: list[int] = []
    fill = Tracer.fill

    def counted(
        self: Tracer, cells: SurfaceCells, lighting: Lighting, *, transport: SurfaceTransport, **more: object
    ) -> object:
        fills.append(len(transport.target))
        return fill(self, cells, lighting, transport=transport, **more)  # type: ignore[arg-type]

    monkeypatch.setattr(Tracer, "fill", counted)
    traced = make(prepare(job), spp=128, lightings=job.lightings)
    assert not fills
    monkeypatch.setattr(SplatLight, "_reads_surface", True)
    read = make(prepare(job), spp=128, lightings=job.lightings)
    assert fills == [128, 128] and read.names == traced.names == ("lamp", "sun", "environment", "emission")
    for one, other in zip(read.values, traced.values, strict=True):
        np.testing.assert_allclose(one.mean(axis=0), other.mean(axis=0), rtol=0.03)
        assert np.sqrt(((one - other) ** 2).mean()) < 0.15 * other.mean()


def test_lights_that_need_few_samples_are_read_apart() -> None:
    """A point or a direction takes few, all else many; the lights of a group, whose layer is one, stay together."""

    def point(name: str, radius: float = 0.0, group: str | None = None) -> PointLight:
        return PointLight(name=name, position=np.zeros(3), radius=radius, group=group)

    around = Environment(radiance=np.ones((1, 1, 3), np.float32))
    lights = (point("a"), point("ball", 0.2), point("b", group="g"), point("c", 0.1, group="g"))
    sharp, soft = by_sharpness(Lighting(lights=lights, environment=around), 32, glow=False)
    assert [x.name for x in sharp[0].lights] == ["a"] and sharp[0].environment is None and sharp[1] == 8
    assert [x.name for x in soft[0].lights] == ["ball", "b", "c"] and soft[0].environment is around and soft[1] == 32
    assert [n for _, n in by_sharpness(Lighting(lights=lights[:1]), 4, glow=False)] == [4]
    assert [n for _, n in by_sharpness(Lighting(), 32, glow=True)] == [32]

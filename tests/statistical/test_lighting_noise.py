"""Layers, error bars, noise targets and re-weighting against independent seeds."""

from __future__ import annotations

import signal
from dataclasses import replace

import numpy as np
import pytest
from ztest import Array, worst_and_allowed

from mirelight.lighting import Interrupted, Tracer, adaptive, frame
from mirelight.model import (
    Camera,
    DirectionalLight,
    Lighting,
    LightingBuffer,
    PointLight,
    ProxyMesh,
    RenderSettings,
    SunLight,
)
from tests.threads import printed

from .test_lighting_against_path import FLAT, KEY, VIEW, _quad, _sky

LAMPS = tuple(
    PointLight(
        name=f"lamp {k}",
        position=np.array([np.cos(k), 0.9 + 0.1 * k, 0.6 + np.sin(k)]),
        color=np.array([1.0, 0.3 + 0.06 * k, 0.4]),
        intensity=0.5,
        group=("warm", "cold", None)[k % 3],
    )
    for k in range(9)
)
SUN = SunLight(name="sun", direction=np.array([-0.5, -1, -0.4]), intensity=2.0, angular_diameter=6.0)
DULL = replace(FLAT, materials=FLAT.materials[:1])
LIGHTING = Lighting(lights=(*LAMPS, SUN), environment=_sky())


def frames(lighting: Lighting, count: int, *, first_seed: int = 1, **settings: object) -> list[LightingBuffer]:
    """Of independent seeds."""
    tracer = Tracer(DULL, RenderSettings(max_depth=4, **settings))  # type: ignore[arg-type]
    out = []
    for seed in range(first_seed, first_seed + count):
        tracer.settings = replace(tracer.settings, seed=seed)
        out.append(tracer.trace(lighting, VIEW))
    return out


def beauties(buffers: list[LightingBuffer]) -> Array:
    return np.stack([x.beauty.astype(np.float64) for x in buffers])


# --- layers ----------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def grouped() -> list[LightingBuffer]:
    return frames(LIGHTING, 24, spp=16)


def test_a_group_is_the_sum_of_its_lights(grouped: list[LightingBuffer]) -> None:
    """The same samples with every light in a layer of its own."""
    alone = replace(LIGHTING, lights=tuple(replace(x, group=None) for x in LIGHTING.lights))
    (apart,) = frames(alone, 1, spp=16)
    layers = {x.name: x for x in apart.layers}
    assert [x.name for x in grouped[0].layers] == ["warm", "cold", "lamp 2", "lamp 5", "lamp 8", "sun", "environment"]
    for k in range(2):
        members = [layers[f"lamp {i}"] for i in (k, k + 3, k + 6)]
        np.testing.assert_allclose(grouped[0].layers[k].direct, sum(x.direct for x in members), rtol=1e-4, atol=1e-6)
        np.testing.assert_allclose(
            grouped[0].layers[k].indirect, sum(x.indirect for x in members), rtol=1e-4, atol=1e-6
        )
    np.testing.assert_allclose(grouped[0].beauty, apart.beauty, rtol=1e-4, atol=1e-6)


def test_layers_add_up_to_the_beauty_to_float_rounding(grouped: list[LightingBuffer]) -> None:
    total = sum(x.direct.astype(np.float64) + x.indirect for x in grouped[0].layers)
    np.testing.assert_allclose(grouped[0].beauty, total, rtol=1e-6, atol=1e-8)


def test_one_layer_for_all_is_their_sum(grouped: list[LightingBuffer]) -> None:
    tracer = Tracer(DULL, RenderSettings(max_depth=4, spp=16), layers=False, aovs=False)
    plain = []
    for seed in range(24):
        tracer.settings = replace(tracer.settings, seed=500 + seed)
        plain.append(tracer.trace(LIGHTING, VIEW))
    assert [x.name for x in plain[0].layers] == ["beauty"] and plain[0].layers[0].indirect.any()
    worst, allowed = worst_and_allowed(beauties(grouped), beauties(plain))
    assert worst < allowed


def test_reweighted_is_what_a_fresh_trace_gives(grouped: list[LightingBuffer]) -> None:
    weights: dict[str, float | tuple[float, ...]] = {
        "warm": 0.25,
        "cold": (2.0, 1.0, 3.0),
        "sun": 0.0,
        "environment": 1.5,
    }
    factors = {x.name: np.asarray(weights.get(x.group or x.name, 1.0)) for x in LIGHTING.lights}
    lights = tuple(replace(x, color=x.color * factors[x.name]) for x in LIGHTING.lights)
    assert LIGHTING.environment is not None
    dimmed = Lighting(lights=lights, environment=replace(LIGHTING.environment, intensity=1.5))
    fresh = frames(dimmed, 24, first_seed=900, spp=16)
    again = [x.reweighted(weights) for x in grouped]
    worst, allowed = worst_and_allowed(beauties(again), beauties(fresh))
    assert worst < allowed
    true = beauties(again).var(axis=0, ddof=1).mean()
    predicted = np.mean([x.variance.mean() for x in again if x.variance is not None])
    assert 0.9 < predicted / true < 2.5


def test_the_test_of_reweighting_would_see_a_forgotten_light(grouped: list[LightingBuffer]) -> None:
    worst, allowed = worst_and_allowed(beauties([x.reweighted({"lamp 5": 0.9}) for x in grouped]), beauties(grouped))
    assert worst > allowed


# --- error bars ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("spp", [16, 64])
def test_every_layers_variance_is_that_of_independent_seeds(spp: int, grouped: list[LightingBuffer]) -> None:
    """Batches of a sequence overstate a little and never understate."""
    found = grouped if spp == 16 else frames(LIGHTING, 12, first_seed=200, spp=spp)
    for k, layer in enumerate(found[0].layers):
        true = np.stack([x.layers[k].total.astype(np.float64) for x in found]).var(axis=0, ddof=1).mean()
        predicted = np.mean([np.mean(np.asarray(x.layers[k].variance)) for x in found])
        assert 0.85 < predicted / true < 2.5, layer.name


# --- noise targets ---------------------------------------------------------------------------------------------------


def test_a_noise_target_is_met_and_its_means_are_those_of_even_samples() -> None:
    """Low targets from few first samples are where stopping at a pixel's own estimate would show as darkness."""
    target = 0.028
    aimed = frames(LIGHTING, 16, first_seed=40, spp=32, noise=target)
    even = frames(LIGHTING, 16, first_seed=80, spp=64)
    worst, allowed = worst_and_allowed(beauties(aimed), beauties(even))
    assert worst < allowed
    truth = beauties(even).mean(axis=0)
    covered = aimed[0].coverage > 0
    floor = 0.01 * truth[covered].mean() ** 2
    error = np.mean([np.mean((x.beauty - truth)[covered] ** 2 / (truth[covered] ** 2 + floor)) for x in aimed])
    assert 0.6 * target < np.sqrt(error) < 1.1 * target  # of the truth's own noise too
    for x in aimed:
        assert x.relative_noise is not None and 0.85 * target < x.relative_noise <= target
        assert x.samples is not None and x.samples.min() == x.spp < x.samples.max()


def _through_a_hole(spp: int, noise: float | None) -> Array:
    """A ceiling lit by one small patch of sun on the floor: most pixels' first samples see nothing of it."""
    ceiling = (
        ([-1.6, 1, 0], [1.4, 0, 0], [0, 0, 3]),
        ([1.6, 1, 0], [1.4, 0, 0], [0, 0, 3]),
        ([0, 1, -1.6], [0.2, 0, 0], [0, 0, 1.4]),
        ([0, 1, 1.6], [0.2, 0, 0], [0, 0, 1.4]),
    )
    corners = [_quad([0, 0, 0], [3, 0, 0], [0, 0, 3]), *(_quad(*part) for part in ceiling)]
    faces = [[4 * k + i for i in face] for k in range(len(corners)) for face in ([0, 1, 2], [0, 2, 3])]
    room = ProxyMesh(vertices=np.concatenate(corners).astype(np.float32), faces=np.array(faces, np.int32))
    camera = Camera.look_at([1.0, 0.1, 0.01], [1.0, 1, 0], 16, 16, yfov=50)
    noon = Lighting(lights=(DirectionalLight(name="noon", direction=np.array([0.0, -1, 0]), intensity=3.0),))
    tracer = Tracer(room, RenderSettings(), aovs=False)
    out = []
    for seed in range(8):
        tracer.settings = RenderSettings(spp=spp, noise=noise, max_depth=2, seed=1 + seed + 100 * spp)
        out.append(tracer.trace(noon, camera).beauty.astype(np.float64))
    return np.stack(out)


def test_what_is_rare_and_bright_does_not_darken(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where a pixel's own samples decided when it has enough, those that missed the light would stop and stay dark."""
    even, aimed = _through_a_hole(128, None), _through_a_hole(32, 0.45)
    worst, allowed = worst_and_allowed(aimed, even)
    assert worst < allowed
    monkeypatch.setattr(adaptive, "_sum_around", lambda image: image)
    naive = _through_a_hole(32, 0.45)
    worst, allowed = worst_and_allowed(naive, even)
    assert worst > allowed and naive.mean() < 0.9 * even.mean()


_IN_THREADS = """
import sys, hashlib
import numpy as np
from tests.statistical.test_lighting_noise import DULL, LIGHTING, VIEW
from mirelight.lighting import Tracer
from mirelight.model import RenderSettings
buffer = Tracer(DULL, RenderSettings(noise=0.1, spp=32, threads=int(sys.argv[1]))).trace(LIGHTING, VIEW)
digest = hashlib.sha256()
for array in (buffer.samples, buffer.beauty, buffer.variance, buffer.ambient_occlusion, buffer.sun_visibility,
              *(x.variance for x in buffer.layers)):
    digest.update(np.ascontiguousarray(array).tobytes())
print(digest.hexdigest())
"""


def test_a_noise_target_gives_the_same_bits_on_any_number_of_threads() -> None:
    assert len(printed(_IN_THREADS, "1", "3")) == 1


# --- unit lights ---


def test_sets_of_unit_lights_re_weighted_are_the_whole_lighting() -> None:
    """A lamp, a sun, an environment and glowing faces at once, and each set traced alone at intensity 1 in white."""
    lamp, sun = replace(LAMPS[0], group=None, intensity=0.7), replace(SUN, color=np.array([1.0, 0.8, 0.5]))
    sky = replace(_sky(), intensity=1.6)
    whole = Lighting(lights=(lamp, sun), environment=sky)
    white = np.ones(3)
    unit_lamp, unit_sun = (replace(x, intensity=1.0, color=white) for x in (lamp, sun))
    sets: tuple[tuple[Lighting, dict[str, Array | float]], ...] = (
        (Lighting(lights=(unit_lamp,)), {lamp.name: lamp.intensity * lamp.color}),
        (Lighting(lights=(unit_sun,)), {sun.name: sun.intensity * sun.color}),
        (Lighting(environment=replace(sky, intensity=1.0)), {sky.name: sky.intensity}),
        (Lighting(), {}),
    )
    count = 24
    tracer = Tracer(FLAT, RenderSettings(spp=16, max_depth=4))
    together, mixed = [], []
    for seed in range(count):
        tracer.settings = replace(tracer.settings, seed=seed)
        full = tracer.trace(whole, VIEW)
        assert [x.name for x in full.layers] == [lamp.name, sun.name, sky.name, "emission"]
        together.append(full.beauty.astype(np.float64))
        tracer.settings = replace(tracer.settings, seed=seed + 1000)
        parts = [tracer.trace(x, VIEW, emission=not weights).reweighted(weights) for x, weights in sets]
        assert [y.name for x in parts for y in x.layers] == [x.name for x in full.layers]
        mixed.append(sum(x.beauty.astype(np.float64) for x in parts))
    worst, allowed = worst_and_allowed(np.stack(together), np.stack(mixed))
    assert worst < allowed
    worst, allowed = worst_and_allowed(np.stack(together), 1.03 * np.stack(mixed))
    assert worst > allowed  # a bias of 3 % is seen


@pytest.mark.parametrize("denoise", [False, True])
def test_what_a_camera_sees_of_the_surface_has_the_same_bits_under_any_light(denoise: bool) -> None:
    tracer = Tracer(FLAT, RenderSettings(spp=24, max_depth=3, denoise=denoise))
    lightings = (LIGHTING, Lighting(), Lighting(lights=(SUN,)), Lighting(environment=_sky()))
    buffers = [tracer.trace(x, VIEW, emission=glow) for x in lightings for glow in (True, False)]
    summed = Tracer(FLAT, tracer.settings, layers=False).trace(LIGHTING, VIEW)
    for name in ("coverage", "depth", "position", "normal", "geometric_normal", "albedo", "ambient_occlusion"):
        first = getattr(buffers[0], name)
        assert first.any()
        for buffer in (*buffers[1:], summed):
            assert getattr(buffer, name).tobytes() == first.tobytes(), name


def test_halves_and_quarters_are_parts_of_each_layer() -> None:
    """6 batches of 4: three, two and one of them; together they are the layer, and errors of the last two are apart."""
    buffers = frames(LIGHTING, 40, spp=24, denoise=True)
    for layer in buffers[0].layers:
        assert layer.half is not None and layer.quarter is not None and layer.other_quarter is not None
        mean = (3 * layer.half + 2 * layer.quarter + layer.other_quarter) / 6
        np.testing.assert_allclose(mean, layer.total, rtol=1e-4, atol=1e-5)
    one, other = (
        np.stack([sum(np.asarray(getattr(y, name), np.float64) for y in x.layers) for x in buffers])
        for name in ("quarter", "other_quarter")
    )
    one, other = one - one.mean(axis=0), other - other.mean(axis=0)
    correlation = np.sum(one * other) / np.sqrt(np.sum(one**2) * np.sum(other**2))
    assert abs(correlation) < 0.02
    tinted = buffers[0].reweighted({"sun": (2.0, 1.0, 0.5)})
    (before,), (after,) = ([x for x in b.layers if x.name == "sun"] for b in (buffers[0], tinted))
    np.testing.assert_allclose(np.asarray(after.half), np.asarray(before.half) * (2.0, 1.0, 0.5), rtol=1e-6)
    assert all(x.half is None for x in frames(LIGHTING, 1, spp=24)[0].layers)


# --- interrupts ------------------------------------------------------------------------------------------------------


def test_an_interrupt_in_the_first_pass_leaves_what_has_no_sample_black() -> None:
    tracer = Tracer(DULL, RenderSettings(spp=1024))
    lighting = Lighting(lights=(KEY, DirectionalLight(name="d", direction=np.array([0.0, -1, 0]))))

    def stop(done: int, total: int) -> None:
        raise KeyboardInterrupt

    with pytest.raises(Interrupted) as caught:
        tracer.trace(lighting, VIEW.resized(640, 480), progress=stop)
    buffer = caught.value.buffer
    assert buffer is not None and buffer.samples is not None
    assert buffer.spp == 0 and buffer.samples.max() == 16 and buffer.variance is None
    assert np.isfinite(buffer.beauty).all()
    assert not buffer.beauty[buffer.samples == 0].any() and not buffer.coverage[buffer.samples == 0].any()
    assert buffer.beauty[buffer.samples > 0].mean() > 0


def test_an_interrupt_between_adding_samples_and_counting_them_waits(monkeypatch: pytest.MonkeyPatch) -> None:
    """A film with samples that nobody has counted would be too bright."""
    from mirelight.lighting.kernel.film import Film

    tracer = Tracer(DULL, RenderSettings(spp=48))
    lighting = Lighting(lights=(KEY,))
    close, calls = Film.close, list[None]()

    def interrupted(self: Film, *args: object) -> None:
        close(self, *args)  # type: ignore[arg-type]
        calls.append(None)
        if len(calls) == 2:
            signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr(frame, "TILE", 0)  # a tile's sequence is cut by how many samples a pixel is to have
    monkeypatch.setattr(frame, "FEW_LANES", 0)  # each pass is a launch
    monkeypatch.setattr(Film, "close", interrupted)
    with pytest.raises(Interrupted) as caught:
        tracer.trace(lighting, VIEW)
    buffer = caught.value.buffer
    assert buffer is not None and buffer.spp == 32
    monkeypatch.setattr(Film, "close", close)
    tracer.settings = replace(tracer.settings, spp=32)
    np.testing.assert_array_equal(buffer.beauty, tracer.trace(lighting, VIEW).beauty)
    np.testing.assert_array_equal(buffer.coverage, tracer.trace(lighting, VIEW).coverage)

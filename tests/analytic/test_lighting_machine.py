"""What the tracer does to the machine: compiles once, uses any number of threads alike, refuses what cannot fit."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mirelight.base.errors import RenderError
from mirelight.lighting import Interrupted, Tracer, frame
from mirelight.model import (
    AreaLight,
    Camera,
    DirectionalLight,
    Environment,
    Lighting,
    Material,
    PointLight,
    RenderSettings,
    SpotLight,
    SunLight,
)
from tests.threads import printed

from .lighting_scenes import constant_sky, sphere

VIEW = Camera.look_at([0, 1, 4], [0, 0, 0], 40, 30)
LAMP = PointLight(name="lamp", position=np.array([1.0, 2, 2]), intensity=5.0)


@pytest.mark.parametrize("shiny", [False, True])
def test_a_warm_frame_compiles_nothing_whatever_changes(shiny: bool) -> None:
    """Light kinds and numbers, environments, camera, resolution, samples and bounces are data to the kernel."""
    proxy = replace(sphere(), materials=(Material(roughness=0.3),)) if shiny else sphere()
    tracer = Tracer(proxy, RenderSettings(spp=16), first_inserted=0 if shiny else None)
    import drjit as dr

    tracer.trace(Lighting(lights=(LAMP,)), VIEW)
    dr.set_flag(dr.JitFlag.KernelHistory, True)
    try:
        dr.kernel_history_clear()
        tracer.trace(Lighting(lights=(LAMP,), environment=constant_sky(0.5)), VIEW)
        known = _kernels(dr)
        spot = SpotLight(name="spot", position=np.array([0.0, 3, 0]), direction=np.array([0.0, -1, 0]))
        panel = AreaLight(name="panel", shape="rectangle", world_from_light=np.eye(4), size=(1.0, 1.0))
        sun = SunLight(name="sun", direction=np.array([0.0, -1, 0]))
        sky = Environment(radiance=np.random.default_rng(0).random((16, 32, 3)).astype(np.float32), rotation=10.0)
        crowd = tuple(replace(LAMP, name=str(k)) for k in range(20))
        wide = replace(
            VIEW, fx=20.0, cx=3.0, world_from_camera=Camera.look_at([1, 1, 3], [0, 0, 0], 4, 4).world_from_camera
        )
        changes = (
            (Lighting(), VIEW),
            (Lighting(lights=(replace(LAMP, intensity=1.0, range=3.0),)), VIEW),
            (Lighting(lights=(spot, panel, sun)), VIEW),
            (Lighting(lights=crowd), VIEW),
            (Lighting(lights=(sun,), environment=constant_sky(1.0)), wide),
            (Lighting(lights=(sun,), environment=sky), replace(wide, projection="orthographic")),
            (Lighting(environment=replace(sky, radiance=sky.pixels[:8, :16])), VIEW.resized(61, 47)),
        )
        for number, (lighting, camera) in enumerate(changes):
            tracer.settings = replace(tracer.settings, spp=9 + number, max_depth=1 + number, seed=number)
            tracer.trace(lighting, camera)
        assert _kernels(dr) <= known
    finally:
        dr.set_flag(dr.JitFlag.KernelHistory, False)


def _kernels(dr: object) -> set[object]:
    """Hashes of the compiled kernels launched since the last call."""
    return {entry["hash"] for entry in dr.kernel_history() if "hash" in entry}  # type: ignore[attr-defined]


def test_pictures_are_compared_by_one_kernel_wherever_they_lie_in_memory() -> None:
    import drjit as dr

    from mirelight.base import backend

    backend.mitsuba()
    from mirelight.lighting.kernel.correlation import Correlation, Windows

    rng = np.random.default_rng(0)
    pictures = [np.ones((30, 40, 4), np.float32)] * 2
    column, row = rng.integers(0, 40, 64), rng.integers(0, 30, 64)
    alike = Correlation([VIEW] * 2, pictures, [[1], [0]], np.zeros(64, np.int64), column, row, Windows(1, 0.1, 0.1, 2))
    dr.set_flag(dr.JitFlag.KernelHistory, True)
    try:
        dr.kernel_history_clear()
        for first in range(4):
            depth = np.full(80, 4.0, np.float32)[first : first + 64]
            alike.of(depth, np.tile(np.array([0, 0, 1], np.float32), (64, 1)))
        assert len(_kernels(dr)) == 1
    finally:
        dr.set_flag(dr.JitFlag.KernelHistory, False)


_IN_THREADS = """
import sys, hashlib
import numpy as np
from mirelight.lighting import Tracer
from mirelight.model import *
rng = np.random.default_rng(0)
vertices = rng.uniform(-1, 1, (600, 3)).astype(np.float32)
proxy = ProxyMesh(vertices=vertices, faces=np.arange(600, dtype=np.int32).reshape(200, 3))
sky = Environment(radiance=rng.random((16, 32, 3)).astype(np.float32))
lights = tuple(PointLight(name=str(k), position=rng.uniform(-2, 2, 3), radius=0.1 * (k % 2)) for k in range(4))
settings = RenderSettings(spp=23, max_depth=5, threads=int(sys.argv[1]))
camera = Camera.look_at([0, 1, 4], [0, 0, 0], 96, 64)
buffer = Tracer(proxy, settings).trace(Lighting(lights=lights, environment=sky), camera)
digest = hashlib.sha256()
for array in (buffer.coverage, buffer.depth, buffer.position, buffer.variance, *(x.direct for x in buffer.layers)):
    digest.update(np.ascontiguousarray(array).tobytes())
digest.update(buffer.beauty.tobytes())
print(digest.hexdigest())
"""


def test_the_bits_do_not_depend_on_the_number_of_threads() -> None:
    assert len(printed(_IN_THREADS, "1", "2", "3", "7")) == 1


@pytest.mark.parametrize("settings", [RenderSettings(spp=25), RenderSettings(spp=48, denoise=True)])
def test_passes_that_share_a_launch_are_those_that_have_their_own(
    settings: RenderSettings, monkeypatch: pytest.MonkeyPatch
) -> None:
    tracer, sky = Tracer(sphere(rings=8), settings), Lighting(lights=(LAMP,), environment=constant_sky(0.5))
    shared = tracer.trace(sky, VIEW)
    monkeypatch.setattr(frame, "FEW_LANES", 0)
    alone = tracer.trace(sky, VIEW)
    for name in ("beauty", "coverage", "position", "albedo", "sun_visibility", "ambient_occlusion", "samples"):
        one, other = getattr(shared, name), getattr(alone, name)
        assert (one is None) == (other is None)
        if one is not None:
            np.testing.assert_allclose(one, other, rtol=1e-5, atol=1e-6, err_msg=name)
    assert shared.variance is not None and alone.variance is not None
    np.testing.assert_allclose(shared.variance, alone.variance, rtol=1e-3, atol=1e-7)
    for one, other in zip(shared.layers, alone.layers, strict=True):
        for part in ("half", "quarter", "other_quarter"):
            if getattr(one, part) is not None:
                np.testing.assert_allclose(getattr(one, part), getattr(other, part), rtol=1e-5, atol=1e-6)


def test_a_film_that_cannot_fit_is_refused_before_it_is_allocated() -> None:
    lamps = tuple(replace(LAMP, name=str(k)) for k in range(60))
    huge = VIEW.resized(40_000, 40_000)
    with pytest.raises(RenderError, match="GiB"):
        Tracer(sphere(rings=4), RenderSettings(spp=1)).trace(Lighting(lights=lamps), huge)


def test_an_interrupt_gives_what_there_was(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(frame, "FEW_LANES", 0)  # each pass is a launch
    tracer = Tracer(sphere(rings=8), RenderSettings(spp=160))
    sun = Lighting(lights=(DirectionalLight(name="sun", direction=np.array([0.5, -1, -0.3]), intensity=3.0),))

    def stop(done: int, total: int) -> None:
        if done > 0.3 * total:
            raise KeyboardInterrupt

    with pytest.raises(Interrupted) as caught:
        tracer.trace(sun, VIEW, progress=stop)
    partial = caught.value.buffer
    assert partial is not None and 0 < partial.spp < 160
    whole = tracer.trace(sun, VIEW)
    assert partial.beauty.mean() == pytest.approx(whole.beauty.mean(), rel=0.02)


def test_more_lights_than_layers_share_one() -> None:
    lamps = tuple(replace(LAMP, name=str(k), intensity=5.0 / 70) for k in range(70))
    buffer = Tracer(sphere(rings=12), RenderSettings(spp=16)).trace(
        Lighting(lights=lamps, environment=constant_sky(0.1)), VIEW
    )
    assert [x.name for x in buffer.layers] == ["lights", "environment"]
    one = Tracer(sphere(rings=12), RenderSettings(spp=16)).trace(Lighting(lights=(LAMP,)), VIEW)
    np.testing.assert_allclose(buffer.layers[0].direct, one.layers[0].direct, atol=0.02)
    assert buffer.layers[0].total.mean() == pytest.approx(one.beauty.mean(), rel=0.01)

"""Light between cells, found once for any light: closed forms, other skies, walls that do not leak, the same bits."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mirelight.base.errors import RenderError
from mirelight.lighting import Tracer, transport
from mirelight.model import Camera, CellLight, Environment, Lighting, SunLight, SurfaceCells
from tests.threads import printed

from .lighting_scenes import constant_sky, join, sphere
from .test_surface_cache import SURFACE, fewer, lamp, means, none, room, stage


def test_a_lamp_in_a_gray_ball_is_its_series() -> None:
    """Direct light I / r² on all of the ball, and a / (1 - a) times as much reflected."""
    ball, albedo = sphere(1.0, rings=24), np.array([0.3, 0.6, 0.9])
    tracer = Tracer(replace(ball, albedo=albedo), replace(SURFACE, spp=64))
    view = Camera.look_at([0, 0, 0], [0, 0, 1], 24, 18, yfov=80)
    cells = tracer.cells(0.25)
    cells = fewer(cells, np.linalg.norm(cells.anchors, axis=1) < 1)
    light = Lighting(lights=(lamp((0, 0, 0), 2.0),))
    cache = tracer.fill(cells, light, transport=tracer.transport(cells))
    (filled,) = cache.lights
    direct = 2 / np.pi
    np.testing.assert_allclose(filled.direct.mean(axis=(0, 1)), direct, rtol=0.01)
    reflected = direct * albedo / (1 - albedo)
    np.testing.assert_allclose(filled.indirect.mean(axis=(0, 1)), reflected, rtol=0.015)
    buffer = tracer.trace(light, view, cache=cache)
    np.testing.assert_allclose(buffer.beauty.mean(axis=(0, 1)), reflected, rtol=0.015)


def test_a_white_sky_on_a_white_ball_is_met_and_nothing_is_reflected() -> None:
    ball = replace(sphere(smooth=True), albedo=np.ones(3))
    tracer = Tracer(ball, SURFACE)
    cells = tracer.cells(0.2)
    cells = fewer(cells, np.linalg.norm(cells.anchors, axis=1) > 1)
    (sky,) = tracer.fill(cells, Lighting(environment=constant_sky(0.7)), transport=tracer.transport(cells)).lights
    assert sky.kind == "environment" and sky.first_bounce is not None
    np.testing.assert_allclose(sky.direct + sky.first_bounce, 0.7, rtol=1e-4)
    assert sky.indirect.max() < 1e-6


def test_one_transport_serves_any_sky_and_any_lamp() -> None:
    """Layer by layer the traced frame, for the sky as it is, turned and another one, suns and lamps that come later."""
    proxy, lighting, view = stage()
    tracer = Tracer(proxy, replace(SURFACE, spp=64))
    truth = Tracer(proxy, replace(SURFACE, spp=256, max_depth=24, indirect="traced"))
    cells = tracer.cells()
    between = tracer.transport(cells)
    around = np.asarray(lighting.environment and lighting.environment.radiance).copy()
    around[2, 3] = 60.0  # a small bright spot
    spot = Environment(radiance=around)
    suns = (SunLight(name="sun", direction=np.array([0.5, -0.6, 0.1]), intensity=3.0),)
    for light in (
        lighting,
        Lighting(environment=spot),
        Lighting(lights=suns, environment=replace(spot, rotation=130.0)),
    ):
        made = tracer.trace(light, view, cache=tracer.fill(cells, light, transport=between))
        np.testing.assert_allclose(means(made), means(truth.trace(light, view)), rtol=0.03)


def test_two_halves_tell_the_error() -> None:
    """Half their difference is the deviation of the mean, which a larger fill shows."""
    proxy, lighting, _ = stage()
    tracer = Tracer(proxy, SURFACE)
    cells = tracer.cells(0.2)
    made = tracer.fill(cells, lighting, transport=tracer.transport(cells, 32)).lights
    tracer.settings = replace(tracer.settings, seed=9)
    true = tracer.fill(cells, lighting, transport=tracer.transport(cells, 1024)).lights
    for one, other in zip(made, true, strict=True):
        stated = np.sqrt((np.diff(one.indirect, axis=0) ** 2 / 4).mean())
        off = np.sqrt(((one.indirect.mean(axis=0) - other.indirect.mean(axis=0)) ** 2).mean())
        assert 0.7 < stated / off < 1.5


@pytest.mark.parametrize("thick", [0.001, 0.06])
def test_a_wall_does_not_leak(thick: float) -> None:
    """The dark half of a box is black to the bit, also where rays end on places without a cell."""
    whole, wall = room((-3, 0, -2), (3, 2.5, 2)), room((-thick / 2, -0.1, -2.1), (thick / 2, 2.6, 2.1))
    lit = Camera.look_at([-2.8, 1.8, 1.5], [-0.5, 0, -1], 16, 12, yfov=35)
    dark = Camera.look_at([2.8, 1.8, 1.5], [0.5, 0, -1], 16, 12, yfov=35)
    tracer = Tracer(join(whole, wall), SURFACE)
    cells = tracer.cells(0.3)
    cells = fewer(cells, np.arange(len(cells)) % 4 > 0)
    between = tracer.transport(cells)
    assert len(between.faces) > 0
    light = Lighting(lights=(lamp((-1.5, 1.5, 0)),))
    cache = tracer.fill(cells, light, transport=between)
    assert tracer.trace(light, lit, cache=cache).beauty.min() > 0
    assert not tracer.trace(light, dark, cache=cache).beauty.any()


def test_light_beyond_the_cells_counts() -> None:
    """Cells of a piece of the floor alone: what lies elsewhere sends them its light all the same."""
    proxy, lighting, _ = stage()
    view = Camera.look_at([-1, 2, 1.2], [-1, 0, 1.2001], 24, 18, yfov=25)
    tracer = Tracer(proxy, replace(SURFACE, spp=256))
    cells = tracer.cells()
    cells = fewer(cells, np.all(np.abs(cells.anchors - [-1, 0, 1.2]) < [0.6, 0.1, 0.6], axis=1))
    between = tracer.transport(cells)
    assert len(between.faces) > 0.5 * len(cells)
    made = tracer.trace(lighting, view, cache=tracer.fill(cells, lighting, transport=between))
    traced = Tracer(proxy, replace(SURFACE, spp=256, max_depth=24, indirect="traced")).trace(lighting, view)
    np.testing.assert_allclose(means(made), means(traced), rtol=0.03)


def test_many_cells_have_fewer_rays_and_memory_is_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    proxy, _, _ = stage()
    tracer = Tracer(proxy, SURFACE)
    cells = tracer.cells(0.3)
    assert tracer.transport(cells).target.shape == (256, len(cells))
    monkeypatch.setattr(transport, "MOST_RAYS", 100 * len(cells))
    assert tracer.transport(cells).target.shape == (64, len(cells))
    bound = Tracer(proxy, replace(SURFACE, max_memory=64 * len(cells)))
    with pytest.raises(RenderError, match=r"rays between pieces of the surface .*render.max_memory"):
        bound.transport(cells)


def test_no_cells_or_no_light() -> None:
    proxy, lighting, _ = stage()
    tracer = Tracer(proxy, SURFACE)
    gone = none(tracer.cells(0.3))
    nothing = tracer.fill(gone, lighting, transport=tracer.transport(gone))
    assert [x.direct.shape for x in nothing.lights] == [(2, 0, 3)] * 3
    cells = tracer.cells(0.3)
    assert tracer.fill(cells, Lighting(), transport=tracer.transport(cells)).lights == ()


def filled(lighting: Lighting, seed: int = 0, threads: int | None = None) -> tuple[SurfaceCells, tuple[CellLight, ...]]:
    """Cells and their light from a transport of 32 rays."""
    proxy, _, _ = stage()
    tracer = Tracer(proxy, replace(SURFACE, threads=threads, seed=seed))
    cells = tracer.cells(0.1)
    return cells, tracer.fill(cells, lighting, transport=tracer.transport(cells, 32)).lights


def test_a_lamp_has_the_same_bits_alone_and_among_others() -> None:
    _, lighting, _ = stage()
    together = filled(lighting)[1]
    alone = filled(Lighting(lights=lighting.lights[:1]))[1] + filled(Lighting(environment=lighting.environment))[1]
    for one, other in zip((together[0], together[2]), alone, strict=True):
        assert np.array_equal(one.direct, other.direct) and np.array_equal(one.indirect, other.indirect)
    assert not np.array_equal(filled(lighting, seed=1)[1][0].indirect, together[0].indirect)


_IN_THREADS = """
import hashlib, sys
import numpy as np
from tests.analytic.test_surface_transport import filled, stage
digest = hashlib.sha256()
for light in filled(stage()[1], threads=int(sys.argv[1]))[1]:
    for array in (light.direct, light.first_bounce, light.indirect):
        digest.update(b"" if array is None else np.ascontiguousarray(array).tobytes())
print(digest.hexdigest())
"""


def test_the_bits_do_not_depend_on_the_number_of_threads() -> None:
    assert len(printed(_IN_THREADS, "1", "3")) == 1

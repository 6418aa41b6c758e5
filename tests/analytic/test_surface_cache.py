"""Light on the surface: closed forms, walls of any thickness, and the same bits on any number of threads."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from mirelight.lighting import Tracer
from mirelight.model import (
    Camera,
    Environment,
    Lighting,
    LightingBuffer,
    Material,
    PointLight,
    ProxyMesh,
    RenderSettings,
    SunLight,
    SurfaceCells,
    triangles,
)
from tests.threads import printed

from .lighting_scenes import Array, constant_sky, join, quad, sphere

SURFACE = RenderSettings(spp=16, indirect="surface", max_depth=8)


def room(low: tuple[float, float, float], high: tuple[float, float, float]) -> ProxyMesh:
    """A closed box."""
    a, b = np.array(low), np.array(high)
    centre, half = (a + b) / 2, (b - a) / 2
    x, y, z = np.diag(half)
    return join(*(quad(centre + s * n, u, v) for n, u, v in ((x, y, z), (y, z, x), (z, x, y)) for s in (-1, 1)))


def lamp(position: tuple[float, float, float], intensity: float = 5.0) -> PointLight:
    return PointLight(name="lamp", position=np.array(position), intensity=intensity)


def fewer(cells: SurfaceCells, kept: NDArray[np.bool_]) -> SurfaceCells:
    """Some of them (C,)."""
    starts = np.append(0, np.cumsum(kept))[cells.starts].astype(np.uint32)
    rows = {name: getattr(cells, name)[kept] for name in ("keys", "anchors", "faces", "corners", "normals")}
    return replace(cells, starts=starts, **rows)


def none(cells: SurfaceCells) -> SurfaceCells:
    return fewer(cells, np.zeros(len(cells), bool))


def read(tracer: Tracer, lighting: Lighting, cameras: list[Camera], size: float | None = None) -> list[LightingBuffer]:
    """Every camera's frame from one cache."""
    cache = tracer.fill(tracer.cells(size), lighting, samples=64)
    return [tracer.trace(lighting, x, cache=cache) for x in cameras]


def test_a_glowing_gray_furnace_is_its_series() -> None:
    """Inside a closed box whose walls shine e and reflect a it is e / (1 - a) everywhere."""
    walls = room((-1, -1, -1), (1, 1, 1))
    glow, albedo = np.array([0.5, 1.0, 2.0]), np.array([0.5, 0.6, 0.7])
    glowing = replace(walls, materials=(Material(emissive=glow),), albedo=albedo)
    settings = replace(SURFACE, spp=64)
    view = Camera.look_at([0.3, 0.1, -0.6], [0, -0.3, 1], 24, 18, yfov=80)
    (buffer,) = read(Tracer(glowing, settings), Lighting(), [view], 0.2)
    truth = glow / (1 - albedo)
    np.testing.assert_allclose(buffer.beauty.mean(axis=(0, 1)), truth, rtol=0.008)  # 14 bounces: 0.7^14 is 0.7 %
    np.testing.assert_allclose(buffer.beauty, np.broadcast_to(truth, buffer.beauty.shape), rtol=0.25)


def test_a_white_sky_on_a_ball_is_white_and_none_of_it_is_indirect() -> None:
    ball = replace(sphere(smooth=True), albedo=np.ones(3))
    view = Camera.look_at([0, 0.5, 3], [0, 0, 0], 32, 24)
    lighting = Lighting(environment=constant_sky(0.7))
    (buffer,) = read(Tracer(ball, replace(SURFACE, spp=64)), lighting, [view], 0.2)
    inside = buffer.coverage == 1
    np.testing.assert_allclose(buffer.beauty[inside], 0.7, rtol=0.02)
    assert buffer.layers[0].indirect.max() < 1e-6


@pytest.mark.parametrize(("thick", "size"), [(0.001, 0.3), (0.015, 0.11), (0.25, 0.3)])
def test_a_wall_of_any_thickness_on_a_continuous_floor_does_not_leak(thick: float, size: float) -> None:
    """Two rooms under one box, a wall between, a lamp in one of them: the other is black to the bit."""
    whole, wall = room((-3, 0, -2), (3, 2.5, 2)), room((-thick / 2, -0.1, -2.1), (thick / 2, 2.6, 2.1))
    lit = Camera.look_at([-2.8, 1.8, 1.5], [-0.5, 0, -1], 32, 24, yfov=75)
    dark = Camera.look_at([2.8, 1.8, 1.5], [0.5, 0, -1], 32, 24, yfov=75)
    tracer = Tracer(join(whole, wall), SURFACE)
    lighting = Lighting(lights=(lamp((-1.5, 1.5, 0)),))
    bright, black = read(tracer, lighting, [lit, dark], size)
    assert bright.beauty[bright.coverage > 0].min() > 0
    assert not black.beauty.any()


@pytest.mark.parametrize("gap", [0.0005, 0.01, 0.2])
def test_a_box_in_a_box_keeps_its_light(gap: float) -> None:
    """Sheets without thickness that face the same way, closer than a cell: light of the inner box stays in it."""
    inner, outer = room((-1, -1, -1), (1, 1, 1)), room((-1 - gap, -1 - gap, -1 - gap), (1 + gap,) * 3)
    inside = Camera.look_at([0.5, 0.2, -0.7], [0, -0.2, 1], 32, 24, yfov=80)
    between = Camera.look_at([-1 - gap / 2, -0.5, -0.6], [-1 - gap / 2, 0.2, 0.6], 32, 24, yfov=80, near=1e-5)
    lighting = Lighting(lights=(lamp((0, 0.5, 0)),))
    bright, black = read(Tracer(join(inner, outer), SURFACE), lighting, [inside, between], 0.15)
    assert bright.beauty[bright.coverage > 0].min() > 0
    assert black.coverage.min() > 0 and not black.beauty.any()


def stage() -> tuple[ProxyMesh, Lighting, Camera]:
    """A ball between a floor and two walls under three kinds of light."""
    proxy = join(
        quad([0, 0, 0], [2, 0, 0], [0, 0, 2]),
        quad([0, 1, -2], [2, 0, 0], [0, 1, 0]),
        quad([-2, 1, 0], [0, 1, 0], [0, 0, 2]),
        sphere(0.5, rings=16, centre=(0.2, 0.6, 0.1)),
    )
    sun = SunLight(name="sun", direction=np.array([-0.4, -1, -0.5]), intensity=2.0, angular_diameter=3.0)
    gradient = np.linspace(0.1, 1.0, 8)[:, None, None] * np.array([1.0, 0.8, 0.6])
    sky = Environment(radiance=np.broadcast_to(gradient, (8, 16, 3)).astype(np.float32))
    lighting = Lighting(lights=(lamp((-1.2, 1.4, 1.0), 2.0), sun), environment=sky)
    return replace(proxy, albedo=np.array([0.7, 0.6, 0.5])), lighting, Camera.look_at([2.5, 2, 3], [0, 0.5, 0], 40, 30)


def means(buffer: LightingBuffer) -> Array:
    return np.array([(x.direct.mean(), x.indirect.mean()) for x in buffer.layers])


def test_layers_are_those_of_a_traced_frame() -> None:
    proxy, lighting, view = stage()
    settings = replace(SURFACE, spp=256, max_depth=24)
    traced = Tracer(proxy, replace(settings, indirect="traced")).trace(lighting, view)
    tracer = Tracer(proxy, settings)
    (buffer,) = read(tracer, lighting, [view])
    assert [x.name for x in buffer.layers] == [x.name for x in traced.layers]
    np.testing.assert_allclose(means(buffer), means(traced), rtol=0.03)
    together = Tracer(proxy, tracer.settings, layers=False)
    (summed,) = read(together, lighting, [view])
    np.testing.assert_allclose(summed.beauty.mean(axis=(0, 1)), traced.beauty.mean(axis=(0, 1)), rtol=0.02)


def test_lights_filled_apart_are_those_filled_together() -> None:
    proxy, lighting, view = stage()
    tracer = Tracer(proxy, SURFACE)
    cells = tracer.cells()
    together = tracer.fill(cells, lighting, samples=128)
    parts = [Lighting(lights=(x,)) for x in lighting.lights] + [Lighting(environment=lighting.environment)]
    apart = [tracer.fill(cells, x, samples=128) for x in parts]
    joined = apart[0].joined(apart[1]).joined(apart[2])
    assert [x.name for x in joined.lights] == [x.name for x in together.lights]
    for one, other in zip(joined.lights, together.lights, strict=True):
        assert one.direct.mean() == pytest.approx(other.direct.mean(), rel=0.02)
        assert one.indirect.mean() == pytest.approx(other.indirect.mean(), rel=0.03)
    assert tracer.trace(lighting, view, cache=joined).beauty.mean() > 0
    with pytest.raises(ValueError, match="two lights named 'lamp'"):
        joined.joined(apart[0])
    with pytest.raises(ValueError, match="no light 'sun'"):
        tracer.trace(lighting, view, cache=apart[0])


def test_where_no_cell_is_paths_go_on() -> None:
    """Without a cell the frame is the traced one, but for more rays from first hits."""
    proxy, lighting, view = stage()
    traced = Tracer(proxy, replace(SURFACE, indirect="traced")).trace(lighting, view)
    tracer = Tracer(proxy, SURFACE)
    first = tracer.trace(lighting, view, cache=tracer.fill(none(tracer.cells()), lighting))
    np.testing.assert_allclose(first.beauty.mean(), traced.beauty.mean(), rtol=0.01)


_IN_THREADS = """
import hashlib, sys
from dataclasses import replace
import numpy as np
from mirelight.lighting import Tracer
from tests.analytic.test_surface_cache import SURFACE, stage
proxy, lighting, view = stage()
digest = hashlib.sha256()
tracer = Tracer(proxy, replace(SURFACE, threads=int(sys.argv[1])))
cells = tracer.cells(0.1)
cache = tracer.fill(cells, lighting, samples=64)
buffer = tracer.trace(lighting, view, cache=cache)
arrays = [cells.keys, cells.starts, cells.anchors, cells.faces, cells.corners, buffer.beauty, buffer.variance]
arrays += [y for x in cache.lights for y in (x.direct, x.first_bounce, x.indirect, x.spread) if y is not None]
for array in arrays:
    digest.update(np.ascontiguousarray(array).tobytes())
print(digest.hexdigest())
"""


def test_the_bits_do_not_depend_on_the_number_of_threads() -> None:
    assert len(printed(_IN_THREADS, "1", "2", "3")) == 1


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e5])
def test_a_cell_is_half_as_wide_as_walls_are_thick(scale: float) -> None:
    slab = room((0, 0, 0), (2 * scale, 0.1 * scale, 2 * scale))
    cells = Tracer(slab, SURFACE).cells()
    assert cells.size == pytest.approx(0.05 * scale, rel=0.01)
    assert len(cells) > 100


def outward(box: ProxyMesh) -> ProxyMesh:
    """A box whose faces look out."""
    corners = box.vertices[box.faces].astype(np.float64)
    away = corners.mean(axis=1) - corners.mean(axis=(0, 1))
    inwards = (triangles.crossed(corners) * away).sum(axis=1) < 0
    return replace(box, faces=np.where(inwards[:, None], box.faces[:, ::-1], box.faces))


def test_insides_of_solids_have_no_cell_nor_has_the_underside_of_the_ground() -> None:
    box = outward(room((-0.5, 0, -0.5), (0.5, 0.8, 0.5)))
    ground = quad([0, 0, 0], [0, 0, 4], [4, 0, 0])
    x, y, z = Tracer(join(ground, box), SURFACE).cells(0.2).anchors.T
    inside = (np.abs(x) < 0.45) & (np.abs(z) < 0.45) & (y < 0.75)
    assert len(x) > 1000 and not np.any(inside & (y > 0))
    assert not np.any((y < 0) & ~inside)
    around = np.abs(Tracer(box, SURFACE).cells(0.2).anchors - [0, 0.4, 0]) < [0.49, 0.39, 0.49]
    assert np.all(around, axis=1).any()  # alone it is a room


# --- points ----------------------------------------------------------------------------------------------------------


def on_stage(count: int) -> tuple[Array, Array]:
    """Points of the stage's floor beside the ball, and the way up."""
    rng = np.random.default_rng(5)
    points = np.zeros((count, 3))
    points[:, 0], points[:, 2] = rng.uniform(-1.8, -0.5, count), rng.uniform(0.6, 1.8, count)
    return points, np.tile([0.0, 1.0, 0.0], (count, 1))


@pytest.mark.parametrize("indirect", ["traced", "surface"])
def test_light_on_points_is_that_of_a_frame(indirect: str) -> None:
    """A camera's pixels as points: their irradiance by the albedo is what the camera sees, layer by layer."""
    proxy, lighting, _ = stage()
    view = Camera.look_at([-1, 2, 1.2], [-1, 0, 1.2001], 12, 12, yfov=25)
    tracer = Tracer(proxy, replace(SURFACE, spp=64, indirect=indirect))  # type: ignore[arg-type]
    cache = tracer.fill(tracer.cells(), lighting, samples=256)
    seen = tracer.trace(lighting, view, cache=cache)
    points, normals = (x.reshape(-1, 3).astype(np.float64) for x in (seen.position, seen.geometric_normal))
    found = tracer.point_layers(lighting, points, normals, 64, cache=cache)
    assert found.names == tuple(x.name for x in seen.layers)
    for k, layer in enumerate(seen.layers):
        for part, other in ((found.direct[k], layer.direct), (found.indirect[k], layer.indirect)):
            np.testing.assert_allclose(part.mean(axis=0) * [0.7, 0.6, 0.5] / np.pi, other.mean(axis=(0, 1)), rtol=0.03)


def test_points_in_chunks_are_independent_of_how_many_there_are(monkeypatch: pytest.MonkeyPatch) -> None:
    from mirelight.lighting import points as module

    proxy, lighting, _ = stage()
    tracer = Tracer(proxy, RenderSettings(max_depth=4))
    points, normals = on_stage(700)
    monkeypatch.setattr(module, "CHUNK_BYTES", 256 * 4 * (9 * 3 + 48))
    calls: list[tuple[int, int]] = []
    whole = tracer.point_layers(lighting, points, normals, 16, progress=lambda done, total: calls.append((done, total)))
    start = tracer.point_layers(lighting, points[:512], normals[:512], 16)
    assert whole.direct.shape == (3, 700, 3) and whole.variance is not None and start.variance is not None
    for name in ("direct", "indirect", "variance"):
        assert np.array_equal(getattr(whole, name)[:, :512], getattr(start, name))
    assert calls[-1] == (700 * 16, 700 * 16)
    again = tracer.point_layers(lighting, points[256:], normals[256:], 16)
    assert not np.array_equal(again.indirect, whole.indirect[:, 256:])  # other samples
    nothing = tracer.point_layers(lighting, points[:0], normals[:0], 16)
    assert nothing.total.shape == (0, 3)


def test_the_variance_of_light_on_points_is_their_spread() -> None:
    proxy, lighting, _ = stage()
    tracer = Tracer(proxy, RenderSettings(max_depth=4))
    points, normals = on_stage(200)
    made = []
    for seed in range(24):
        tracer.settings = replace(tracer.settings, seed=seed)
        made.append(tracer.point_layers(lighting, points, normals, 32))
    totals = np.stack([x.direct + x.indirect for x in made]).astype(np.float64)
    spread = totals.var(axis=0, ddof=1).mean(axis=(1, 2))
    stated = np.mean([np.asarray(x.variance) for x in made], axis=(0, 2, 3))
    assert np.all(stated > 0.8 * spread) and np.all(stated < 2.5 * spread)


def test_a_glowing_point_s_own_light_does_not_fall_on_it() -> None:
    """A closed glowing box of albedo a: each wall receives pi e / (1 - a) from the others."""
    walls = room((-1, -1, -1), (1, 1, 1))
    glowing = replace(walls, materials=(Material(emissive=np.array([0.5, 1.0, 2.0])),), albedo=np.full(3, 0.5))
    rng = np.random.default_rng(1)
    points = np.stack([rng.uniform(-0.9, 0.9, 100), np.full(100, -1.0), rng.uniform(-0.9, 0.9, 100)], axis=1)
    tracer = Tracer(glowing, RenderSettings(max_depth=16))
    found = tracer.point_layers(Lighting(), points, np.tile([0.0, 1.0, 0.0], (100, 1)), 64)
    assert found.names == ("emission",)
    np.testing.assert_allclose(found.total.mean(axis=0), 2 * np.pi * np.array([0.5, 1.0, 2.0]), rtol=0.02)

"""Light on the surface where it is hard: materials of every kind, many lamps, soups, tiny and huge scenes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from mirelight.base.errors import RenderError
from mirelight.lighting import Tracer
from mirelight.model import Camera, Lighting, LightingBuffer, Material, PointLight, ProxyMesh, RenderSettings
from mirelight.proxy import make

from ..proxy.clouds import box_shell
from .lighting_scenes import constant_sky, quad, sphere
from .test_surface_cache import SURFACE, lamp, stage


def parts(*meshes: ProxyMesh) -> ProxyMesh:
    """One mesh with normals, texture coordinates and vertex colours, a material for each part."""
    starts = np.cumsum([0] + [len(m.vertices) for m in meshes[:-1]])
    normals = [np.tile([0, 1, 0], (len(m.vertices), 1)) if m.normals is None else m.normals for m in meshes]
    colors = [np.linspace(0.2, 0.9, 3 * len(m.vertices)).reshape(-1, 3) for m in meshes]
    places = [m.vertices[:, [0, 2]] for m in meshes]
    return ProxyMesh(
        vertices=np.concatenate([m.vertices for m in meshes]),
        faces=np.concatenate([m.faces + s for m, s in zip(meshes, starts, strict=True)]).astype(np.int32),
        normals=np.concatenate(normals).astype(np.float32),
        uvs=np.concatenate(places).astype(np.float32),
        vertex_colors=np.concatenate(colors).astype(np.float32),
        face_materials=np.concatenate([np.full(len(m.faces), i) for i, m in enumerate(meshes)]).astype(np.int32),
        albedo=None,
    )


def agree(proxy: ProxyMesh, lighting: Lighting, view: Camera, tolerance: float, spp: int = 128) -> LightingBuffer:
    """Assert that read and traced means agree, of the whole picture and of its quarters."""
    settings = RenderSettings(spp=spp, max_depth=24)
    traced = Tracer(proxy, settings, layers=False, aovs=False).trace(lighting, view)
    tracer = Tracer(proxy, replace(settings, indirect="surface"), layers=False, aovs=False)
    read = tracer.trace(lighting, view, cache=tracer.fill(tracer.cells(), lighting, samples=spp))
    for rows in np.array_split(np.arange(view.height), 2):
        for columns in np.array_split(np.arange(view.width), 2):
            block = np.ix_(rows, columns)
            mine, other = read.beauty[block].mean(axis=(0, 1)), traced.beauty[block].mean(axis=(0, 1))
            np.testing.assert_allclose(mine, other, rtol=tolerance)
    assert np.all(read.layers[0].indirect.mean(axis=(0, 1)) > 0)
    return read


def test_textures_smooth_normals_vertex_colours_and_glow_together() -> None:
    rng = np.random.default_rng(2)
    checker = rng.uniform(0.1, 1, (8, 8, 3)).astype(np.float32)
    floor, ball = quad([0, 0, 0], [0, 0, 2], [2, 0, 0]), sphere(0.6, rings=12, smooth=True, centre=(0, 0.7, 0))
    wall = replace(quad([0, 1, -2], [2, 0, 0], [0, 1, 0]), normals=np.tile([0, 0, 1], (4, 1)).astype(np.float32))
    shapes = parts(floor, ball, wall)
    materials = (
        Material(base_color_texture=checker),
        Material(base_color=np.array([0.9, 0.5, 0.3])),
        Material(emissive=np.array([0.1, 0.2, 0.4])),
    )
    view = Camera.look_at([2.0, 2.2, 3], [0, 0.4, 0], 32, 24)
    lighting = Lighting(lights=(lamp((-1.2, 1.4, 1.0), 3.0),), environment=constant_sky(0.2))
    agree(replace(shapes, materials=materials), lighting, view, 0.03)


def test_a_hundred_lamps() -> None:
    proxy, _, view = stage()
    rng = np.random.default_rng(3)
    places = rng.uniform([-1.8, 0.2, -1.8], [1.8, 1.8, 1.8], (100, 3))
    colors = rng.uniform(0.2, 1, (100, 3))
    lamps = tuple(
        PointLight(name=f"{k}", position=p, color=c, intensity=0.2, range=1.5)
        for k, (p, c) in enumerate(zip(places, colors, strict=True))
    )
    agree(proxy, Lighting(lights=lamps), view, 0.03)


def test_a_proxy_made_from_splats() -> None:
    made = make(box_shell(2.0, 0.2, thin=0.2)).mesh
    view = Camera.look_at([0.3, 0.2, 0.6], [-0.2, -0.4, -1], 32, 24, yfov=75)
    agree(made, Lighting(lights=(lamp((0.2, 0.4, 0.1)),)), view, 0.04, spp=64)


@pytest.mark.parametrize("scale", [2.0**-10, 2.0**20])
def test_a_scene_of_any_size_has_the_same_light(scale: float) -> None:
    """To float rounding, where everything is a power of two larger or smaller."""

    def seen(by: float) -> LightingBuffer:
        proxy, lighting, view = stage()
        matrix = np.array(view.world_from_camera)
        matrix[:3, 3] *= by
        lights = lamp((-1.2 * by, 1.4 * by, by), 2.0 * by**2), lighting.lights[1]
        small = replace(proxy, vertices=proxy.vertices * np.float32(by))
        camera = replace(view, world_from_camera=matrix, near=view.near * by)
        tracer = Tracer(small, SURFACE)
        cells = tracer.cells()
        assert len(cells) > 500
        lit = replace(lighting, lights=lights)
        return tracer.trace(lit, camera, cache=tracer.fill(cells, lit, samples=64))

    one, other = seen(1.0), seen(scale)
    off = np.abs(one.beauty - other.beauty).max(axis=-1) > 1e-3 * one.beauty.max()
    assert off.mean() < 0.01
    np.testing.assert_allclose(other.beauty.mean(axis=(0, 1)), one.beauty.mean(axis=(0, 1)), rtol=1e-3)


def soup(count: int) -> ProxyMesh:
    """Triangles strewn about a ball's surface, none sharing a vertex."""
    rng = np.random.default_rng(4)
    middles = rng.normal(size=(count, 3))
    middles /= np.linalg.norm(middles, axis=1, keepdims=True)
    corners = middles[:, None] + rng.normal(0, 4 / np.sqrt(count), (count, 3, 3))
    faces = np.arange(3 * count, dtype=np.int32).reshape(-1, 3)
    return ProxyMesh(vertices=corners.reshape(-1, 3).astype(np.float32), faces=faces)


def test_more_unconnected_triangles_than_there_may_be_pieces() -> None:
    proxy = soup(400_000)
    view = Camera.look_at([0, 0, 3], [0, 0, 0], 32, 24)
    tracer = Tracer(proxy, replace(SURFACE, spp=32))
    lighting = Lighting(lights=(lamp((1.5, 1.5, 1.5)),))
    assert 1000 < len(tracer.cells()) <= 2**18
    cells = tracer.cells(0.3)
    read = tracer.trace(lighting, view, cache=tracer.fill(cells, lighting, samples=32))
    tracer.settings = replace(tracer.settings, indirect="traced")
    traced = tracer.trace(lighting, view)
    inside = traced.coverage == 1
    np.testing.assert_allclose(read.beauty[inside].mean(axis=0), traced.beauty[inside].mean(axis=0), rtol=0.05)


def test_a_frame_that_sees_nothing_is_dark_and_one_beside_it_is_not() -> None:
    proxy, lighting, view = stage()
    away = Camera.look_at([0, 5, 0], [0, 10, 0.1], 16, 12)
    tracer = Tracer(proxy, SURFACE)
    cache = tracer.fill(tracer.cells(), lighting, samples=32)
    assert not tracer.trace(lighting, away, cache=cache).beauty.any()
    assert tracer.trace(lighting, view, cache=cache).beauty.any()


def test_light_that_does_not_fit_in_memory_is_refused_in_a_line(monkeypatch: pytest.MonkeyPatch) -> None:
    proxy, lighting, view = stage()
    tracer = Tracer(proxy, SURFACE)
    cells = tracer.cells()
    cache = tracer.fill(cells, lighting, samples=32)
    allowed = 900 * len(cells)
    monkeypatch.setattr("mirelight.lighting.develop.free_memory", lambda: allowed)
    calls: list[Callable[[], object]] = [
        lambda: tracer.fill(cells, lighting),
        lambda: tracer.trace(lighting, view, cache=cache),
    ]
    for refused in calls:
        with pytest.raises(
            RenderError, match=r"(light of 3 layers on|rays between) .*pieces of the surface needs? .* free"
        ):
            refused()
    with pytest.raises(RenderError, match=r"finding the pieces .* takes [0-9,]+ places, which need .* are free"):
        tracer.cells()
    tracer.settings = replace(tracer.settings, max_memory=2**40)
    assert len(tracer.cells()) == len(cells)
    monkeypatch.undo()
    tracer.settings = replace(tracer.settings, max_memory=allowed)
    for refused in (*calls, lambda: tracer.cells()):
        with pytest.raises(RenderError, match=r"needs? [0-9.]+ MiB,? and [0-9.]+ MiB may be used \(render\.max_memory"):
            refused()

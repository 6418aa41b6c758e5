"""The engine's light model as a tracer: shadows, layers, colours, cameras; what it shares with the path tracer."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mirelight.lighting import EngineTracer, Tracer, trace
from mirelight.lighting.engine.raster import culling_warnings, seen_from_behind
from mirelight.model import (
    Camera,
    DirectionalLight,
    Environment,
    Lighting,
    LightingBuffer,
    Material,
    PointLight,
    ProxyMesh,
    RenderSettings,
    SpotLight,
    playcanvas_lights,
)

SETTINGS = RenderSettings(profile="playcanvas", threads=1)
ABOVE = Camera.look_at((0, 8, 0), (0, 0, 0), 80, 80, yfov=60)
DOWN = DirectionalLight(name="sun", direction=np.array([0.0, -1.0, 0.0]), intensity=np.pi)


def quads(*corners: list[tuple[float, float, float]]) -> ProxyMesh:
    """Quads, each by four corners counter-clockwise, albedo 0.5."""
    faces = np.concatenate([np.array([[0, 1, 2], [0, 2, 3]]) + 4 * k for k in range(len(corners))])
    return ProxyMesh(vertices=np.asarray(corners, np.float32).reshape(-1, 3), faces=faces.astype(np.int32))


def level(size: float, height: float) -> list[tuple[float, float, float]]:
    """A square that faces up."""
    return [(-size, height, -size), (-size, height, size), (size, height, size), (size, height, -size)]


def lit(proxy: ProxyMesh, *lights: object, **changed: object) -> LightingBuffer:
    return trace(proxy, Lighting(lights=lights, **changed), ABOVE, SETTINGS)  # type: ignore[arg-type]


def test_shadows_are_exact() -> None:
    """A lamp above a small roof: its shadow on the floor by similar triangles, hard and without bias."""
    proxy = quads(level(5, 0), level(0.5, 2.0)[::-1])  # the roof faces down, so the camera above sees through it
    lamp = PointLight(name="lamp", position=np.array([0.0, 6.0, 0.0]), intensity=100.0)
    buffer = lit(proxy, lamp)
    on_floor = (buffer.position[..., 1] < 0.01) & (buffer.coverage > 0)
    furthest = np.abs(buffer.position[..., [0, 2]]).max(axis=-1)
    edge = 0.5 * 6 / 4
    dark, bright = on_floor & (furthest < edge - 1e-4), on_floor & (furthest > edge + 1e-4)
    assert dark.sum() > 20 and bright.sum() > 1000
    assert buffer.beauty[dark].max() == 0
    assert buffer.beauty[bright].min() > 0
    np.testing.assert_array_equal(lit(proxy, replace(lamp, shadows=False)).beauty[bright], buffer.beauty[bright])
    assert lit(proxy, replace(lamp, shadows=False)).beauty[dark].min() > 0


def test_no_shadow_speckles_along_a_fold() -> None:
    """Pixels on the crease of a trough lie past their face's edge by a share of a pixel: they are not in its shadow."""
    left = [(-3.0, 1.0, -3.0), (-3.0, 1.0, 3.0), (0.013, 0.0, 3.0), (0.013, 0.0, -3.0)]
    right = [(0.013, 0.0, -3.0), (0.013, 0.0, 3.0), (3.0, 1.0, 3.0), (3.0, 1.0, -3.0)]
    for turn in (0.0, 0.3, 1.1):
        eye = (8 * np.sin(turn) * 0.2, 8.0, 0.5 * np.cos(turn))
        camera = Camera.look_at(eye, (0, 0, 0), 120, 120, yfov=40)
        buffer = trace(quads(left, right), Lighting(lights=(DOWN,)), camera, SETTINGS)
        assert buffer.beauty[buffer.coverage == 1].min() > 0.4


def test_every_light_has_a_layer_and_groups_share_one() -> None:
    floor = quads(level(5, 0))
    lamps = [PointLight(name=f"lamp{k}", position=np.array([k, 2.0, 0.0]), intensity=10.0 + k) for k in range(3)]
    sky = Environment(name="sky", radiance=np.full((1, 1, 3), 0.2, np.float32))
    together = lit(floor, *lamps, environment=sky)
    assert [layer.name for layer in together.layers] == ["lamp0", "lamp1", "lamp2", "sky"]
    for layer, lamp in zip(together.layers, lamps, strict=False):
        np.testing.assert_array_equal(layer.direct, lit(floor, lamp).beauty)
    np.testing.assert_allclose(together.layers[3].direct, 0.5 * 0.2, rtol=1e-6)
    grouped = lit(floor, replace(lamps[0], group="keys"), lamps[1], replace(lamps[2], group="keys"), environment=sky)
    assert [layer.name for layer in grouped.layers] == ["keys", "lamp1", "sky"]
    np.testing.assert_allclose(grouped.beauty, together.beauty, rtol=1e-6)
    sum_alone = EngineTracer(floor, SETTINGS, layers=False).trace(Lighting(lights=tuple(lamps), environment=sky), ABOVE)
    assert [layer.name for layer in sum_alone.layers] == ["beauty"]
    np.testing.assert_allclose(sum_alone.beauty, together.beauty, rtol=1e-6)


def test_dimmed_layers_are_a_fresh_render() -> None:
    floor = quads(level(5, 0))
    a = PointLight(name="a", position=np.array([1.0, 2.0, 0.0]), intensity=300.0)
    b = SpotLight(name="b", position=np.array([0.0, 3.0, 1.0]), direction=np.array([0, -1, 0]), intensity=900.0)
    dimmed = lit(floor, a, b).reweighted({"a": 0.5, "b": [2, 1, 0]})
    fresh = lit(floor, replace(a, intensity=150.0), replace(b, color=np.array([2.0, 1.0, 0.0])))
    np.testing.assert_allclose(dimmed.beauty, fresh.beauty, rtol=1e-5)
    assert dimmed.variance is not None and dimmed.variance.max() == 0


def test_its_directional_light_is_the_path_tracers_direct_light() -> None:
    """Where nothing but units stands between both, they agree."""
    proxy = quads(level(5, 0), level(1, 1.5))
    sun = DirectionalLight(
        name="sun", direction=np.array([0.3, -1.0, 0.2]), intensity=2.0, color=np.array([1, 0.5, 0.2])
    )
    ours = lit(proxy, sun)
    paths = Tracer(proxy, RenderSettings(spp=16, max_depth=1)).trace(Lighting(lights=(sun,)), ABOVE)
    inside = paths.coverage == 1
    difference = np.abs(ours.beauty - paths.beauty)[inside].max(axis=1)
    assert np.median(difference) < 1e-6
    assert np.mean(difference > 1e-3) < 0.06  # pixels on edges, which paths average over
    for aov in ("position", "normal", "geometric_normal", "albedo"):
        assert np.median(np.abs(getattr(ours, aov) - getattr(paths, aov))[inside]) < 1e-3
    assert np.median(np.abs(ours.depth - paths.depth)[inside]) < 1e-3


def test_colours_of_the_file() -> None:
    floor = level(5, 0)
    texture = np.zeros((2, 2, 3), np.float32)
    texture[:, 0], texture[:, 1] = (1, 0.5, 0.25), (0.25, 0.5, 1)
    proxy = replace(
        quads(floor),
        uvs=np.array([[0, 0], [0, 1], [1, 1], [1, 0]], np.float32),
        materials=(Material(base_color=np.array([0.8, 0.8, 0.4]), base_color_texture=texture),),
        albedo=None,
    )
    buffer = lit(proxy, DOWN)
    left, right = buffer.beauty[40, 20], buffer.beauty[40, 60]  # texel centres lie a quarter in, at x = -2.5 and 2.5
    assert buffer.position[40, 20, 0] < 0 < buffer.position[40, 60, 0]
    assert left[0] > 2 * left[2] and right[2] > right[0]
    np.testing.assert_allclose(buffer.beauty, buffer.albedo, rtol=1e-5)
    paths = Tracer(proxy, RenderSettings(spp=4, max_depth=1)).trace(Lighting(lights=(DOWN,)), ABOVE)
    assert np.median(np.abs(buffer.beauty - paths.beauty)) < 2e-3


def test_back_faces_are_culled_and_block_light() -> None:
    lid = level(1, 2.0)[::-1]  # faces down: not seen from above, but in the light's way
    buffer = lit(quads(level(5, 0), lid), DOWN)
    assert buffer.depth.max() == pytest.approx(8, rel=0.01)
    shadow = np.abs(buffer.position[..., [0, 2]]).max(axis=-1) < 0.99
    assert buffer.beauty[shadow].max() == 0
    assert buffer.coverage[shadow].min() == 1


def test_a_proxy_seen_from_behind_is_warned_of() -> None:
    floor = quads(level(5, 0))
    assert culling_warnings(floor, [ABOVE]) == ()
    turned = replace(floor, faces=floor.faces[:, ::-1])
    (line,) = culling_warnings(turned, [replace(ABOVE, name="drone")])
    assert line.startswith("100% of what drone sees of the proxy is its back")
    half = quads(level(5, 0), level(2, 1)[::-1])
    assert 0.1 < seen_from_behind(half, ABOVE) < 0.6
    assert seen_from_behind(half, Camera.look_at((0, -8, 0), (0, 0, 0), 80, 80, yfov=60)) > 0.6
    assert culling_warnings(floor, [Camera.look_at((0, 8, 0), (0, 16, 0), 16, 12)]) == ()


def test_nothing_to_see_and_nothing_at_all() -> None:
    away = Camera.look_at((0, 8, 0), (0, 16, 0), 16, 12)
    buffer = trace(quads(level(5, 0)), Lighting(lights=(DOWN,)), away, SETTINGS)
    assert buffer.coverage.max() == 0 and buffer.beauty.max() == 0
    empty = ProxyMesh(vertices=np.zeros((0, 3), np.float32), faces=np.zeros((0, 3), np.int32))
    lamp = PointLight(name="lamp", position=np.zeros(3))
    buffer = trace(empty, Lighting(lights=(DOWN, lamp)), away, SETTINGS)
    assert buffer.coverage.max() == 0
    assert [layer.name for layer in buffer.layers] == ["sun", "lamp"]


def test_same_bits_whatever_the_threads() -> None:
    proxy = quads(level(5, 0), level(1, 1.5), level(0.5, 3))
    lamp = PointLight(name="lamp", position=np.array([0.3, 6.0, 0.1]), intensity=30.0)
    one, two = (
        trace(proxy, Lighting(lights=(lamp,)), ABOVE, replace(SETTINGS, threads=threads)).beauty for threads in (1, 2)
    )
    np.testing.assert_array_equal(one, two)


def test_an_orthographic_camera_is_rendered_and_warned_of() -> None:
    flat = replace(ABOVE, name="plan", projection="orthographic", fx=8.0, fy=8.0)
    buffer = trace(quads(level(2, 0)), Lighting(lights=(DOWN,)), flat, SETTINGS)
    assert buffer.coverage.sum() == pytest.approx(32 * 32, abs=70)
    np.testing.assert_allclose(buffer.beauty[buffer.coverage == 1], 0.5, rtol=1e-6)
    (said,) = playcanvas_lights.camera_warnings(flat)
    assert "plan is orthographic" in said


def test_the_files_one_colour_where_it_has_no_texture() -> None:
    """`albedo = "file"` on a proxy without materials: one gray for all points."""
    plain = replace(quads(level(5, 0), level(1, 1.5)), albedo=None)
    lamp = PointLight(name="lamp", position=np.array([0.0, 4.0, 0.0]), intensity=30.0)
    buffer = lit(plain, DOWN, lamp)
    own = buffer.albedo[buffer.coverage == 1]
    assert own.min() == own.max() > 0
    same = lit(replace(plain, albedo=np.full(3, own[0, 0])), DOWN, lamp)
    np.testing.assert_allclose(buffer.beauty, same.beauty, rtol=1e-6)
    away = Camera.look_at((0, 8, 0), (0, 16, 0), 16, 12)
    assert trace(plain, Lighting(lights=(DOWN, lamp)), away, SETTINGS).coverage.max() == 0

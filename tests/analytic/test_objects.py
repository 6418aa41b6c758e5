"""Inserted objects: glTF's reflection model against its formulas, and lamps that mirrors show."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from mirelight.base.errors import InputError
from mirelight.lighting import Tracer
from mirelight.lighting.objects import inserted
from mirelight.model import (
    AreaLight,
    Deferred,
    DirectionalLight,
    Environment,
    Inserted,
    Light,
    Lighting,
    LightingBuffer,
    Material,
    ProxyMesh,
    RenderSettings,
    SunLight,
)

from .lighting_scenes import FLOOR, Array, constant_sky, overhead

CAMERA = overhead(24, 16, extent=12.0)
DOWN = np.array([0.0, -1.0, 0.0])


def plate(y: float = 1.0, size: float = 3.0, **finish: object) -> Inserted:
    """A square that faces up, with a finish, over the middle of the floor."""
    corners = np.array([[-1, 0, -1], [-1, 0, 1], [1, 0, 1], [1, 0, -1]], np.float32) * np.float32(size)
    mesh = ProxyMesh(
        vertices=corners + np.array([0, y, 0], np.float32),
        faces=np.array([[0, 1, 2], [0, 2, 3]], np.int32),
        materials=(Material(**finish),),  # type: ignore[arg-type]
        albedo=None,
    )
    return Inserted(name="plate", mesh=Deferred("plate", lambda: mesh))


def lit(one: Inserted, *lights: Light, sky: Environment | None = None, spp: int = 16, depth: int = 1) -> LightingBuffer:
    placed = inserted([one], replace(FLOOR, albedo=np.full(3, 0.5)))
    tracer = Tracer(placed.mesh, RenderSettings(spp=spp, max_depth=depth), first_inserted=placed.first)
    return tracer.trace(Lighting(name="one", lights=lights, environment=sky), CAMERA)


def shown(buffer: LightingBuffer) -> NDArray[np.float32]:
    """(3,) mean radiance of the plate."""
    assert buffer.objects is not None
    return np.asarray(buffer.objects.beauty.sum((0, 1)) / buffer.objects.coverage.sum())


def lobe(roughness: float, n: Array, v: Array, wi: Array) -> Array:
    """glTF 2.0, appendix B.3.2, of directions (..., 3); separable masking and shadowing."""
    a2 = np.float64(roughness) ** 4
    h = (v + wi) / np.linalg.norm(v + wi, axis=-1, keepdims=True)
    nl, nv, nh = wi @ n, v @ n, h @ n
    d = a2 / (np.pi * (nh**2 * (a2 - 1) + 1) ** 2)
    g = 2 * nl / (nl + np.sqrt(a2 + (1 - a2) * nl**2)) * (2 * nv / (nv + np.sqrt(a2 + (1 - a2) * nv**2)))
    return np.asarray(d * g / (4 * nl * nv))


def brdf(
    base: Array,
    metallic: float,
    roughness: float,
    n: Array,
    v: Array,
    wi: Array,
    above: Array | float = 0.04,
    weight: float = 1.0,
) -> Array:
    """glTF 2.0, appendix B.3.5, with the reflectances of KHR_materials_specular."""
    h = (v + wi) / np.linalg.norm(v + wi, axis=-1, keepdims=True)
    vh = np.sum(v * h, -1)
    f0 = above + (base - above) * metallic
    fresnel = f0 + (weight + (1 - weight) * metallic - f0) * (1 - vh)[..., None] ** 5
    return np.asarray((1 - fresnel) * base * (1 - metallic) / np.pi + fresnel * lobe(roughness, n, v, wi)[..., None])


BASE = np.array([0.8, 0.5, 0.2])


@pytest.mark.parametrize("metallic", [0.0, 0.4, 1.0])
@pytest.mark.parametrize("roughness", [0.25, 0.6, 1.0])
@pytest.mark.parametrize("angle", [0.0, 35.0, 80.0])
def test_a_directional_light_is_reflected_as_the_appendix_of_gltf_says(
    metallic: float, roughness: float, angle: float
) -> None:
    to_light = np.array([np.sin(np.radians(angle)), np.cos(np.radians(angle)), 0.0])
    light = DirectionalLight(name="key", direction=-to_light, intensity=3.0)
    measured = shown(lit(plate(base_color=BASE, metallic=metallic, roughness=roughness), light))
    truth = 3 * to_light[1] * brdf(BASE, metallic, roughness, -DOWN, -DOWN, to_light[None])[0]
    np.testing.assert_allclose(measured, truth, rtol=2e-4)


@pytest.mark.parametrize(("metallic", "roughness"), [(0.0, 0.3), (0.0, 1.0), (0.5, 0.15), (1.0, 0.5), (1.0, 0.9)])
def test_a_constant_sky_is_reflected_by_the_integral_of_the_model(metallic: float, roughness: float) -> None:
    z, phi = np.meshgrid((np.arange(4000) + 0.5) / 4000, (np.arange(64) + 0.5) / 64 * 2 * np.pi, indexing="ij")
    r = np.sqrt(1 - z**2)
    wi = np.stack([r * np.cos(phi), z, r * np.sin(phi)], -1)
    truth = (brdf(BASE, metallic, roughness, -DOWN, -DOWN, wi) * z[..., None]).mean((0, 1)) * 2 * np.pi
    one = plate(base_color=BASE, metallic=metallic, roughness=roughness)
    measured = shown(lit(one, sky=constant_sky(1.0), spp=256))
    np.testing.assert_allclose(measured, truth, rtol=0.01)


COATED = {"base_color": BASE, "roughness": 0.7, "clearcoat": 0.8, "clearcoat_roughness": 0.4}


def coated(v: Array, wi: Array) -> Array:
    """KHR_materials_clearcoat over the appendix's model."""
    k = 0.8 * (0.04 + 0.96 * (1 - np.sum(v * -DOWN, -1)) ** 5)
    return np.asarray((1 - k) * brdf(BASE, 0, 0.7, -DOWN, v, wi) + k * lobe(0.4, -DOWN, v, wi)[..., None])


def test_reflectances_and_lacquer_are_those_of_the_extensions() -> None:
    to_light = np.array([np.sin(np.radians(35)), np.cos(np.radians(35)), 0.0])
    light = DirectionalLight(name="key", direction=-to_light, intensity=3.0)
    tint, up = np.array([0.6, 0.3, 0.1]), -DOWN
    measured = shown(lit(plate(base_color=BASE, roughness=0.5, specular=tint * 0.7, specular_weight=0.7), light))
    truth = 3 * to_light[1] * brdf(BASE, 0, 0.5, up, up, to_light[None], tint * 0.7, 0.7)[0]
    np.testing.assert_allclose(measured, truth, rtol=2e-4)
    measured = shown(lit(plate(**COATED), light))  # type: ignore[arg-type]
    np.testing.assert_allclose(measured, 3 * to_light[1] * coated(up, to_light[None])[0], rtol=2e-4)
    z, phi = np.meshgrid((np.arange(2000) + 0.5) / 2000, (np.arange(64) + 0.5) / 64 * 2 * np.pi, indexing="ij")
    r = np.sqrt(1 - z**2)
    wi = np.stack([r * np.cos(phi), z, r * np.sin(phi)], -1)
    measured = shown(lit(plate(**COATED), sky=constant_sky(1.0), spp=256))  # type: ignore[arg-type]
    np.testing.assert_allclose(measured, (coated(up, wi) * z[..., None]).mean((0, 1)) * 2 * np.pi, rtol=0.01)


def mapped(texture: Array, **finish: object) -> Inserted:
    """The plate with texture coordinates, u along +x and v along +z."""
    one = plate().mesh.value
    uvs = (one.vertices[:, [0, 2]] / 6 + 0.5).astype(np.float32)
    name = "normal_texture" if "base_color" in finish else "alpha_texture"
    material = Material(**{name: np.asarray(texture, np.float32), **finish})  # type: ignore[arg-type]
    mesh = replace(one, uvs=uvs, materials=(material,))
    return Inserted(name="plate", mesh=Deferred("mapped", lambda: mesh))


def test_maps_turn_normals_along_u_and_against_v() -> None:
    turned = np.array([0.3, 0.4, np.sqrt(0.75)])
    n = np.array([0.3, turned[2], -0.4])  # u is +x, v is +z, and the map's second axis goes against it
    to_light = np.array([0.6, 0.8, 0.0])
    light = DirectionalLight(name="key", direction=-to_light, intensity=3.0)
    one = mapped(np.tile((turned + 1) / 2, (2, 2, 1)), base_color=BASE, roughness=0.6)
    truth = 3 * (to_light @ n) * brdf(BASE, 0, 0.6, n, -DOWN, to_light[None])[0]
    np.testing.assert_allclose(shown(lit(one, light)), truth, rtol=1e-3)


def test_what_alpha_cuts_away_is_not_there_and_casts_no_shadow() -> None:
    left = np.concatenate([np.ones((4, 2, 3)), np.zeros((4, 2, 3))], axis=1)
    light = DirectionalLight(name="key", direction=DOWN, intensity=3.0)
    whole, half = lit(plate(), light), lit(mapped(left, cutoff=0.5), light)
    assert whole.objects is not None and half.objects is not None
    np.testing.assert_allclose(half.objects.coverage.sum(), whole.objects.coverage.sum() / 2, rtol=0.02)
    lit_floor = half.beauty[half.coverage == 1].max(axis=-1)
    np.testing.assert_allclose(lit_floor, 3 * 0.5 / np.pi, rtol=1e-5)  # no shadow lies where nothing is above
    veil = lit(mapped(np.ones((2, 2, 3)), alpha=0.25), light, spp=64)
    assert veil.objects is not None
    np.testing.assert_allclose(veil.objects.coverage.sum(), whole.objects.coverage.sum() / 4, rtol=0.05)
    seen = whole.objects.coverage == 1
    np.testing.assert_allclose(veil.beauty[seen].mean(), 0.75**2 * 3 * 0.5 / np.pi, rtol=0.05)


def test_thin_glass_mirrors_by_fresnel_and_lets_the_rest_through_in_its_colour() -> None:
    light = DirectionalLight(name="key", direction=DOWN, intensity=3.0)
    pane = plate(base_color=BASE, roughness=0.0, transmission=0.9)
    made = lit(pane, light, sky=constant_sky(0.25), spp=256)
    assert made.objects is not None
    passed = 0.9 * 0.96 * BASE
    inside = made.objects.coverage > 0
    inside &= inside[::-1, ::-1]
    share = made.objects.coverage[inside].mean()
    np.testing.assert_allclose(share, 1 - passed.max(), rtol=0.02)
    sun = next(x for x in made.layers if x.name == "key").total
    np.testing.assert_allclose(sun[inside].mean(0), passed**2 * 3 * 0.5 / np.pi, rtol=0.03)  # down, and up again
    mirrored = next(x for x in made.objects.layers if x.name != "key").total[inside].mean(0)
    np.testing.assert_allclose(mirrored, 0.25 * (0.04 + 0.1 * 0.96 * BASE), rtol=0.05)


def test_textures_of_layers_multiply_their_factors() -> None:
    light = DirectionalLight(name="key", direction=np.array([-0.6, -0.8, 0.0]), intensity=3.0)
    shares = np.array([0.5, 0.25, 1.0, 0.5])
    by_texture = mapped(
        np.full((2, 2, 3), (0.5, 0.5, 1.0)),
        base_color=BASE,
        roughness=0.5,
        specular_texture=np.tile(shares, (2, 2, 1)).astype(np.float32),
        layer_texture=np.full((2, 2, 3), (0.5, 0.25, 1.0), np.float32),
        clearcoat=0.8,
        clearcoat_roughness=0.8,
    )
    by_factor = plate(
        base_color=BASE,
        roughness=0.5,
        specular=0.04 * shares[:3] * 0.5,
        specular_weight=0.5,
        clearcoat=0.4,
        clearcoat_roughness=0.2,
    )
    np.testing.assert_allclose(shown(lit(by_texture, light)), shown(lit(by_factor, light)), rtol=1e-4)


def test_a_mirror_shows_the_sky_and_no_more() -> None:
    measured = shown(lit(plate(base_color=np.ones(3), metallic=1.0, roughness=0.0), sky=constant_sky(2.0)))
    np.testing.assert_allclose(measured, 2.0, rtol=1e-3)


@pytest.mark.parametrize("roughness", [0.0, 0.1])
def test_mirrors_show_suns_and_area_lamps_with_their_radiance(roughness: float) -> None:
    """Straight above the plate, seen from there: what covers the whole lobe is seen at its own radiance."""
    finish = {"base_color": np.ones(3), "metallic": 1.0, "roughness": roughness}
    sun = SunLight(name="sun", direction=DOWN, intensity=5.0, angular_diameter=120.0)
    measured = shown(lit(plate(**finish), sun, spp=64))  # type: ignore[arg-type]
    np.testing.assert_allclose(measured, 5 / (np.pi * np.sin(np.radians(60)) ** 2), rtol=0.01)
    pose = np.eye(4)
    pose[:3, 0], pose[:3, 1], pose[:3, 2], pose[:3, 3] = [1, 0, 0], [0, 0, -1], [0, 1, 0], [0, 200, 0]
    for shape in ("rectangle", "disk"):
        lamp = AreaLight(name="lamp", world_from_light=pose, size=(900.0, 900.0), shape=shape, intensity=7.0)
        measured = shown(lit(plate(**finish), lamp, spp=64))  # type: ignore[arg-type]
        np.testing.assert_allclose(measured, 7.0, rtol=0.01, err_msg=shape)


def test_light_on_objects_and_beside_them_is_kept_apart() -> None:
    sun = DirectionalLight(name="sun", direction=np.array([0.6, -0.8, 0.0]), intensity=2.0)
    buffer, bare = (
        lit(plate(), sun),
        Tracer(FLOOR, RenderSettings(spp=16, max_depth=1)).trace(Lighting(name="one", lights=(sun,)), CAMERA),
    )
    assert buffer.objects is not None
    np.testing.assert_array_equal(buffer.coverage + buffer.objects.coverage, 1)
    objects = buffer.objects.coverage
    inside, outside = objects == 1, objects == 0
    np.testing.assert_array_equal(buffer.samples, np.where(outside, 16, 32))
    np.testing.assert_allclose(buffer.objects.depth[inside], 99 - CAMERA.near + CAMERA.near, rtol=1e-5)
    np.testing.assert_allclose(buffer.depth[outside], 100, rtol=1e-5)
    assert not buffer.objects.beauty[outside].any() and not buffer.beauty[inside].any()
    shadow = outside & (buffer.beauty[..., 0] == 0)  # 0.75 to the right of the plate
    assert shadow.any() and shadow.sum() < outside.sum() / 2
    np.testing.assert_allclose(buffer.beauty[outside & ~shadow].max(), bare.beauty.max(), rtol=1e-5)


def test_a_noise_target_is_reached_on_objects_too() -> None:
    sun = SunLight(name="sun", direction=np.array([0.6, -0.8, 0.0]), intensity=2.0, angular_diameter=30.0)
    placed = inserted([plate(base_color=BASE, roughness=0.5)], replace(FLOOR, albedo=np.full(3, 0.5)))

    def light(**how: object) -> LightingBuffer:
        settings = RenderSettings(max_depth=1, **how)  # type: ignore[arg-type]
        tracer = Tracer(placed.mesh, settings, first_inserted=placed.first)
        return tracer.trace(Lighting(name="one", lights=(sun,), environment=constant_sky(0.3)), CAMERA)

    made, truth = light(noise=0.015, spp=32), light(spp=512)
    assert made.objects is not None and truth.objects is not None and made.samples is not None
    found, true = (x.beauty.astype(np.float64) + x.objects.beauty for x in (made, truth))  # type: ignore[union-attr]
    error = np.sqrt(((found - true) ** 2 / (true**2 + 0.01 * true.mean() ** 2)).mean())
    assert 0.005 < error < 0.02
    assert len(np.unique(made.samples)) > 1


def test_dropped_objects_stand_on_the_proxy_by_their_lowest_vertices() -> None:
    high = replace(plate(y=7.0), drop=True)
    placed = inserted([high], FLOOR)
    assert placed.mesh.vertices[placed.mesh.faces[placed.first :]][..., 1].max() == 0
    np.testing.assert_allclose(placed.boxes[0], np.diag([6.0, 0, 6, 1]), atol=1e-6)
    below = replace(plate(y=-2.0), drop=True)  # sunk into the ground: nothing lies under it
    with pytest.raises(InputError, match="nothing of the proxy lies under 'plate' to drop it on"):
        inserted([below], FLOOR)
    aside = FLOOR.vertices + np.array([500, 0, 0], np.float32)
    with pytest.raises(InputError, match="nothing of the proxy"):
        inserted([high], replace(FLOOR, vertices=aside))


def test_tilted_objects_lie_along_the_ground_under_them() -> None:
    slope = replace(FLOOR, vertices=FLOOR.vertices + FLOOR.vertices[:, :1] * np.array([0, 0.25, 0], np.float32))
    with_normals = replace(plate(y=7.0).mesh.value, normals=np.tile(np.array([[0, 1, 0]], np.float32), (4, 1)))
    one = Inserted(name="plate", mesh=Deferred("tilted", lambda: with_normals), drop="tilt")
    placed = inserted([one], slope)
    corners = placed.mesh.vertices[placed.mesh.faces[placed.first :]]
    np.testing.assert_allclose(corners[..., 1], 0.25 * corners[..., 0], atol=1e-5)
    assert placed.mesh.normals is not None
    up = np.array([-0.25, 1, 0]) / np.hypot(0.25, 1)
    np.testing.assert_allclose(placed.mesh.normals[-4:], np.tile(up, (4, 1)), atol=1e-6)
    np.testing.assert_allclose(placed.boxes[0][:3, 0], [6 * up[1], 6 * 0.25 * up[1], 0], atol=1e-5)
    upright = inserted([replace(one, drop=True)], slope)  # by its highest contact
    assert np.ptp(upright.mesh.vertices[-4:, 1]) == 0 and upright.mesh.vertices[-1, 1] == 0.75


def test_an_object_on_a_flat_proxy_keeps_its_own_normals_and_colours(tmp_path: Path) -> None:
    one = plate().mesh.value
    smooth = replace(one, normals=np.tile(np.array([[0, 1, 0]], np.float32), (4, 1)))
    placed = inserted([Inserted(name="p", mesh=Deferred("p", lambda: smooth))], FLOOR)
    mesh = placed.mesh
    assert placed.first == 2 and mesh.normals is not None and not mesh.normals[:4].any()
    assert mesh.vertex_colors is not None
    np.testing.assert_allclose(mesh.vertex_colors[:4], 0.5)
    np.testing.assert_allclose(mesh.vertex_colors[4:], 1.0)

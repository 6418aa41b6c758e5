"""Our loop against Mitsuba's `path` with emitter plugins: every light kind and every kind of proxy shading."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import path_oracle as oracle
import pytest
from ztest import Array, worst_and_allowed

from mirelight.base import backend, conventions
from mirelight.lighting import Tracer
from mirelight.lighting.frame import FrameInProgress
from mirelight.model import (
    AreaLight,
    Camera,
    DirectionalLight,
    Environment,
    IesProfile,
    Light,
    Lighting,
    Material,
    PointLight,
    ProxyMesh,
    RenderSettings,
    SpotLight,
    SunLight,
    TubeLight,
    Wrap,
)
from mirelight.model.ies import AROUND, DOWN

SEEDS, SPP = 24, 16
VIEW = Camera.look_at([0.3, 1.5, 4], [0, 0, 0], 64, 48)


def _quad(centre: list[float], x: list[float], y: list[float]) -> Array:
    c, e, f = np.array(centre), np.array(x), np.array(y)
    return np.array([c - e - f, c + e - f, c + e + f, c - e + f])


def _ball(rings: int) -> tuple[Array, list[list[int]]]:
    t, f = np.meshgrid(np.linspace(0, np.pi, rings + 1), np.arange(2 * rings) * np.pi / rings, indexing="ij")
    points = np.stack([np.sin(t) * np.cos(f), np.cos(t), np.sin(t) * np.sin(f)], axis=-1).reshape(-1, 3)
    n = 2 * rings
    faces = [
        face
        for i in range(rings)
        for j in range(n)
        for face in (
            [i * n + j, i * n + (j + 1) % n, i * n + n + j],
            [i * n + (j + 1) % n, i * n + n + (j + 1) % n, i * n + n + j],
        )
    ]
    return points, faces


def _stage(rings: int = 16) -> ProxyMesh:
    """A ball on a floor before a wall; every vertex has a normal, a texture coordinate and a colour."""
    ball, faces = _ball(rings)
    floor, wall = _quad([0, -0.5, 0], [2.5, 0, 0], [0, 0, -2.5]), _quad([0, 1, -1.2], [2.5, 0, 0], [0, 1.5, 0])
    start = len(ball)
    faces = [f for f in faces if len({tuple(np.round(ball[k], 6)) for k in f}) == 3]
    faces += [[start, start + 1, start + 2], [start, start + 2, start + 3]]
    faces += [[start + 4, start + 5, start + 6], [start + 4, start + 6, start + 7]]
    vertices = np.concatenate([ball * 0.5, floor, wall])
    normals = np.concatenate([ball, np.tile([0, 1.0, 0], (4, 1)), np.tile([0, 0, 1.0], (4, 1))])
    return ProxyMesh(
        vertices=vertices.astype(np.float32),
        faces=np.asarray(faces, np.int32),
        normals=normals.astype(np.float32),
        uvs=np.ascontiguousarray(vertices[:, :2] * 1.3 + 0.2, dtype=np.float32),
        vertex_colors=np.clip(np.abs(vertices) / 2.5 + 0.1, 0, 0.9).astype(np.float32),
        materials=(Material(), Material(emissive=np.array([1.0, 0.5, 0.2]))),
        face_materials=np.zeros(len(faces), np.int32),
    )


STAGE = _stage()
FLAT = replace(STAGE, normals=None)
KEY = PointLight(name="point", position=np.array([1.2, 1.8, 1.5]), intensity=4.0)


def _panel(shape: str) -> AreaLight:
    matrix = np.array([[1, 0, 0, 1.6], [0, 0, 1, 2.2], [0, -1, 0, 0.5], [0, 0, 0, 1]], np.float64)
    size = (1.0, 0.5) if shape == "rectangle" else (0.8, 0.8)
    return AreaLight(name=shape, shape=shape, world_from_light=matrix, size=size, intensity=6.0)  # type: ignore[arg-type]


def _tube() -> TubeLight:
    pose = conventions.look_at([1.6, 1.7, 0.5], [2.0, 2.2, -0.4])
    return TubeLight(name="tube", world_from_light=pose, length=1.4, radius=0.12, intensity=6.0)


def _sky(rows: int = 128) -> Environment:
    v, u = np.meshgrid((np.arange(rows) + 0.5) / rows, (np.arange(2 * rows) + 0.5) / (2 * rows), indexing="ij")
    theta, phi = np.pi * v, 2 * np.pi * (u - 0.5)
    way = np.stack([np.cos(phi) * np.sin(theta), np.cos(theta), np.sin(phi) * np.sin(theta)], axis=-1)
    sun = 60 * np.exp(40 * (way @ (np.array([0.6, 0.6, 0.53]) / np.linalg.norm([0.6, 0.6, 0.53])) - 1))
    radiance = 0.3 + 0.3 * way[..., 1:2] + 0.1 * way + sun[..., None] * np.array([1.0, 0.9, 0.7])
    return Environment(radiance=np.maximum(radiance, 0).astype(np.float32), rotation=25.0)


@pytest.fixture(autouse=True)
def _noise_is_told_by_seeds(monkeypatch: pytest.MonkeyPatch) -> None:
    """Not by second samples, which no picture holds."""
    monkeypatch.setattr(FrameInProgress, "sample_again", lambda *_: None)


def our_pictures(proxy: ProxyMesh, lighting: Lighting, max_depth: int, *, layers: bool = True) -> Array:
    tracer = Tracer(proxy, RenderSettings(spp=SPP, max_depth=max_depth), layers=layers)
    out = []
    for seed in range(SEEDS):
        tracer.settings = replace(tracer.settings, seed=seed + 1)
        out.append(tracer.trace(lighting, VIEW).beauty.astype(np.float64))
    return np.stack(out)


def path_pictures(proxy: ProxyMesh, lighting: Lighting, max_depth: int, *, hide_lights: bool = True) -> Array:
    mi = backend.mitsuba("llvm_ad_rgb")
    world = oracle.scene(mi, proxy, lighting, VIEW)
    out = []
    for seed in range(SEEDS):
        picture, _ = oracle.path_beauty(
            mi, world, spp=SPP, max_depth=max_depth, seed=7000 + seed, hide_lights=hide_lights
        )
        out.append(picture.astype(np.float64))
    return np.stack(out)


def same(proxy: ProxyMesh, lighting: Lighting, max_depth: int, *, hide_lights: bool = True) -> None:
    ours = our_pictures(proxy, lighting, max_depth)
    theirs = path_pictures(proxy, lighting, max_depth, hide_lights=hide_lights)
    worst, allowed = worst_and_allowed(ours, theirs)
    assert worst < allowed, f"|t| = {worst:.2f}, chance allows {allowed:.2f}"
    assert ours.mean() == pytest.approx(theirs.mean(), rel=0.01)


MEASURED = IesProfile(  # lopsided, and slanted
    share=(
        (0.5 + 0.5 * np.cos(np.linspace(0, np.pi, DOWN)) ** 2)
        * (0.6 + 0.4 * np.cos(np.arange(AROUND) * (2 * np.pi / AROUND) - 0.7))[:, None]
    ).astype(np.float32),
    nadir=np.array([-0.6, -0.8, 0.0]),
    zero=np.array([0.0, 0.0, 1.0]),
)
SPOT = SpotLight(
    name="s",
    position=np.array([1.0, 2, 2]),
    direction=np.array([-0.5, -1, -1]),
    intensity=9.0,
    range=6.0,
    inner_cone_angle=0.2,
    outer_cone_angle=0.6,
)
LIGHTS: dict[str, tuple[Light, int]] = {
    "directional": (DirectionalLight(name="d", direction=np.array([-0.5, -1, -0.4]), intensity=2.0), 4),
    "point": (KEY, 4),
    "point with range": (replace(KEY, range=3.5), 4),
    "measured point": (replace(KEY, profile=MEASURED), 4),
    "spot": (SPOT, 4),
    "spot with the engine's cone": (replace(SPOT, cone="playcanvas"), 4),
    "sun": (SunLight(name="u", direction=np.array([-0.5, -1, -0.4]), intensity=2.0, angular_diameter=12.0), 4),
    # shapes block light in `path` and not in ours: direct light only
    "ball": (PointLight(name="b", position=np.array([1.2, 1.6, 1.0]), intensity=4.0, radius=0.25), 1),
    "rectangle": (_panel("rectangle"), 1),
    "disk": (_panel("disk"), 1),
    "sphere": (_panel("sphere"), 1),
    "tube": (_tube(), 1),
}


@pytest.mark.parametrize("kind", LIGHTS)
def test_every_kind_of_light(kind: str) -> None:
    light, max_depth = LIGHTS[kind]
    same(FLAT, Lighting(lights=(light,)), max_depth)


def test_an_environment_map_and_a_constant_one() -> None:
    same(FLAT, Lighting(environment=_sky()), 4)
    same(FLAT, Lighting(environment=Environment(radiance=np.full((1, 1, 3), 0.7, np.float32))), 4)


def test_several_lights_and_the_sky_together() -> None:
    lights = tuple(light for light, depth in LIGHTS.values() if depth == 4)
    same(FLAT, Lighting(lights=lights, environment=_sky()), 5)


def test_vertex_colours() -> None:
    same(replace(FLAT, albedo=None, materials=(Material(),)), Lighting(lights=(KEY,)), 4)


@pytest.mark.parametrize("wrap", ["repeat", "mirror", "clamp"])
def test_a_base_colour_texture_wraps_and_has_its_first_row_at_v_0(wrap: Wrap) -> None:
    pixels = np.random.default_rng(3).random((5, 9, 3)).astype(np.float32)
    material = Material(base_color=np.array([1.0, 0.7, 0.4]), base_color_texture=pixels, base_color_wrap=(wrap, wrap))
    proxy = replace(FLAT, albedo=None, vertex_colors=None, materials=(material,))
    same(proxy, Lighting(lights=(KEY,)), 3)


def glowing_wall(material: Material) -> ProxyMesh:
    """The wall glows; its back is not seen, where Mitsuba's emitters are dark and ours are not."""
    which = STAGE.face_materials
    assert which is not None
    glowing = which.copy()
    glowing[-2:] = 1
    return replace(FLAT, face_materials=glowing, materials=(Material(), material))


def test_an_emissive_material() -> None:
    same(glowing_wall(STAGE.materials[1]), Lighting(), 3, hide_lights=False)


def test_an_emissive_texture() -> None:
    """Half of it black. It covers the wall once: Mitsuba samples a textured emitter by its texture, untiled."""
    pixels = np.random.default_rng(5).random((7, 12, 3)).astype(np.float32) ** 4
    pixels[:, :5] = 0
    proxy = glowing_wall(Material(emissive=np.array([3.0, 2.0, 1.0]), emissive_texture=pixels))
    assert proxy.uvs is not None
    uvs = proxy.uvs.copy()
    uvs[-4:] = [[0, 1], [1, 1], [1, 0], [0, 0]]
    same(replace(proxy, uvs=uvs), Lighting(), 3, hide_lights=False)


def test_smooth_normals_of_a_fine_mesh() -> None:
    """`path` darkens facets at the terminator and we do not; on fine facets that is below the noise."""
    fine = _stage(rings=96)
    same(fine, Lighting(lights=(KEY,)), 2)


def test_the_test_would_see_a_bias_of_two_percent() -> None:
    lighting = Lighting(lights=(KEY,), environment=_sky())
    ours, theirs = our_pictures(FLAT, lighting, 4), path_pictures(FLAT, lighting, 4)
    worst, allowed = worst_and_allowed(ours * 1.02, theirs)
    assert worst > allowed


@pytest.mark.parametrize("reach", [4.0, np.inf])
def test_a_picked_light_is_as_right_as_all_of_them(reach: float) -> None:
    """Above a dozen lights each hit weighs the brightest and some of the rest; the mean stays that of all."""
    rng = np.random.default_rng(11)
    lamps = tuple(
        PointLight(name=f"lamp {k}", position=p, color=rng.random(3), intensity=0.3, range=reach)
        for k, p in enumerate(rng.uniform([-2, 0, -1], [2, 2, 2], (40, 3)))
    )
    together = our_pictures(FLAT, Lighting(lights=lamps), 4)
    parts = sum(our_pictures(FLAT, Lighting(lights=lamps[k : k + 10]), 4) for k in range(0, 40, 10))
    worst, allowed = worst_and_allowed(together, np.asarray(parts))
    assert worst < allowed


def test_the_sum_alone_is_as_right_as_the_layers() -> None:
    """Without layers the later hits sample one light of a dozen; every kind of them and the sky."""
    lights = tuple(light for light, _ in LIGHTS.values())
    lighting = Lighting(lights=lights, environment=_sky())
    alone, together = our_pictures(FLAT, lighting, 5, layers=False), our_pictures(FLAT, lighting, 5)
    assert not np.array_equal(alone, together)
    worst, allowed = worst_and_allowed(alone, together)
    assert worst < allowed

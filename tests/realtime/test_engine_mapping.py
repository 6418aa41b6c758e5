"""The table of physical and engine units, both ways, against the physical formulas themselves."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mirelight.base import conventions
from mirelight.lighting import trace
from mirelight.lighting.engine.raster import Rasterised, rasterise
from mirelight.model import (
    F32,
    AreaLight,
    Camera,
    DirectionalLight,
    Environment,
    Falloff,
    Light,
    Lighting,
    Material,
    PointLight,
    ProxyMesh,
    RenderSettings,
    SpotLight,
    SunLight,
    playcanvas_lights,
)
from mirelight.model.playcanvas_lights import EngineLight, EngineLighting

from .engine_cases import from_engine

ALBEDO = np.array([0.5, 0.3, 0.8])
FLOOR = ProxyMesh(
    vertices=np.array([[-40, 0, -40], [-40, 0, 40], [40, 0, 40], [40, 0, -40]], dtype=np.float32),
    faces=np.array([[0, 1, 2], [0, 2, 3]], dtype=np.int32),
)
CAMERA = Camera.look_at((3, 20, 5), (0, 0, 0), 48, 36, yfov=60)
SURFACE = rasterise(FLOOR, CAMERA)


def engine_radiance(light: Light | Environment) -> F32:
    """(H, W, 3) what the engine shows of a physical light on the floor, by the table."""
    lights = () if isinstance(light, Environment) else (light,)
    environment = light if isinstance(light, Environment) else None
    lit = Lighting(lights=lights, environment=environment)
    return trace(replace(FLOOR, albedo=ALBEDO), lit, CAMERA, RenderSettings(profile="playcanvas")).beauty


def towards(position: tuple[float, float, float], surface: Rasterised = SURFACE) -> tuple[F32, F32]:
    """Unit vectors to a position and the distance, per pixel."""
    way = np.asarray(position) - surface.position
    distance = np.linalg.norm(way, axis=-1)
    return way / distance[..., None], distance


def test_directional_light_is_exact() -> None:
    light = DirectionalLight(name="a", direction=(0.3, -1, 0.2), color=(1, 0.5, 0.2), intensity=7.0)  # type: ignore[arg-type]
    cosine = -light.direction[1]
    expected = ALBEDO / math.pi * light.color * 7.0 * cosine
    np.testing.assert_allclose(engine_radiance(light)[SURFACE.coverage], expected[None].repeat(48 * 36, 0), rtol=1e-5)


@pytest.mark.parametrize("intensity", [2.0, 300.0, 50_000.0])  # below and above the engine's threshold of 1
def test_point_light_is_exact_but_for_the_falloffs_one(intensity: float) -> None:
    place = (1.0, 4.0, -2.0)
    light = PointLight(name="a", position=np.array(place), color=np.array([0.2, 1, 0.6]), intensity=intensity)
    way, d = towards(place)
    physical = (ALBEDO / math.pi * light.color * intensity) * (way[..., 1] / d**2)[..., None]
    np.testing.assert_allclose(engine_radiance(light), physical * (d**2 / (d**2 + 1))[..., None], rtol=1e-4)


def test_range_window_is_the_physical_one_squared() -> None:
    place = (0.0, 5.0, 0.0)
    _, d = towards(place)
    near = engine_radiance(PointLight(name="a", position=np.array(place), intensity=90, range=20.0))
    endless = engine_radiance(PointLight(name="a", position=np.array(place), intensity=90))
    window = np.clip(1 - (d / 20) ** 4, 0, 1)
    np.testing.assert_allclose(near, endless * (window**2)[..., None], rtol=1e-3, atol=1e-7)


def test_spot_has_the_same_cone() -> None:
    place, axis = (0.0, 10.0, 0.0), conventions.unit((0.1, -1.0, 0.0))
    inner, outer = math.radians(12), math.radians(25)
    spot = SpotLight(
        name="a",
        position=np.array(place),
        direction=axis,
        intensity=500,
        inner_cone_angle=inner,
        outer_cone_angle=outer,
    )
    way, _ = towards(place)
    cosine = -(way @ axis)
    full = engine_radiance(PointLight(name="a", position=np.array(place), intensity=500))
    found = engine_radiance(spot)
    inside, outside = cosine > math.cos(inner), cosine < math.cos(outer)
    assert inside.any() and outside.any()
    np.testing.assert_allclose(found[inside], full[inside], rtol=1e-5)
    assert found[outside].max() < 1e-6


def test_environment_is_exact_but_for_prefiltering() -> None:
    rows = np.cos(np.pi * (np.arange(128) + 0.5) / 128)
    gradient = np.broadcast_to((1 + rows)[:, None, None], (128, 256, 3)).astype(np.float32)
    found = engine_radiance(Environment(radiance=gradient, intensity=0.4))
    np.testing.assert_allclose(found, np.broadcast_to(ALBEDO * 0.4 * 5 / 3, found.shape), rtol=0.03)


def test_sun_is_a_directional_light_with_soft_shadows() -> None:
    engine, _ = playcanvas_lights.to_engine(
        Lighting(lights=(SunLight(name="s", direction=np.array([0, -1, 0])),)), FLOOR
    )
    (light,) = engine.lights
    assert (light.kind, light.cast_shadows) == ("directional", True)
    assert light.penumbra == pytest.approx(math.radians(0.53))


@pytest.mark.parametrize(
    ("shape", "projected"), [("rectangle", 0.12), ("disk", math.pi * 0.03), ("sphere", math.pi * 0.01)]
)
def test_area_lights_keep_their_far_light_and_are_warned_of(shape: str, projected: float) -> None:
    size = {"rectangle": (0.3, 0.4), "disk": (0.3, 0.4), "sphere": (0.2, 0.2)}[shape]
    pose = conventions.compose((0, 20, 0), conventions.rotation_from_euler((-90, 0, 0)))  # its -Z points down
    light = AreaLight(name="panel", shape=shape, world_from_light=pose, size=size, intensity=900)  # type: ignore[arg-type]
    engine, warnings = playcanvas_lights.to_engine(Lighting(lights=(light,)), FLOOR, shadows=False)
    (punctual,) = engine.lights
    on_axis = punctual.linear_color * playcanvas_lights.INVERSE_SQUARED_GAIN * math.pi
    np.testing.assert_allclose(on_axis, 900 * projected, rtol=1e-6)
    assert "panel" in warnings[0]


def test_what_the_engine_cannot_hold_is_warned_of() -> None:
    sky = np.ones((4, 8, 3), dtype=np.float32)
    sky[0] = 5000
    lamp = PointLight(name="lamp", position=np.zeros(3), range=5.0, radius=0.1)
    _, warnings = playcanvas_lights.to_engine(Lighting(lights=(lamp,), environment=Environment(radiance=sky)), FLOOR)
    said = "\n".join(warnings)
    for part in ("lamp: the engine has no radius", "lamp: the engine squares", "5e+03", "casts no shadows"):
        assert part in said
    sun = DirectionalLight(name="d", direction=np.array([0, -1, 0]))
    _, none = playcanvas_lights.to_engine(Lighting(lights=(sun,)), FLOOR)
    assert none == ()


def test_surfaces_that_glow_are_warned_of() -> None:
    glowing = replace(FLOOR, materials=(Material(emissive=np.ones(3)),))
    (line,) = playcanvas_lights.to_engine(Lighting(), glowing)[1]
    assert "glow" in line
    assert playcanvas_lights.to_engine(Lighting(), FLOOR)[1] == ()


def test_near_lights_are_warned_of() -> None:
    def said(height: float, falloff: Falloff | None = None) -> tuple[str, ...]:
        lamp = PointLight(name="lamp", position=np.array([40, height, 40]), falloff=falloff)  # above a corner
        return playcanvas_lights.to_engine(Lighting(lights=(lamp,)), FLOOR)[1]

    (line,) = said(1.0)
    assert "50%" in line
    assert said(8.0) == ()
    assert said(1.0, "inverse-squared") == ()  # written in the engine's terms: nothing is lost


@pytest.mark.parametrize("away", [3.0, 300.0])
def test_a_light_without_range_reaches_everything(away: float) -> None:
    lamp = PointLight(name="lamp", position=np.array([0.0, away, 0.0]), intensity=1e5)
    _, d = towards((0.0, away, 0.0))
    expected = ALBEDO / math.pi * 1e5 * (away / d / (d**2 + 1))[..., None]
    np.testing.assert_allclose(engine_radiance(lamp), expected, rtol=1e-3)


# --- and back --------------------------------------------------------------------------------------------------------

COLOURS = st.tuples(*[st.floats(0.01, 1.0)] * 3)


@given(st.floats(0.01, 1e5), COLOURS)
def test_colour_and_intensity_come_back(intensity: float, color: tuple[float, float, float]) -> None:
    wanted = intensity * np.asarray(color)
    encoded, engine_intensity = playcanvas_lights.engine_color(wanted)
    light = EngineLight(name="a", kind="omni", color=encoded, intensity=engine_intensity)
    np.testing.assert_allclose(light.linear_color, wanted, rtol=1e-9)
    assert engine_intensity >= 1
    assert encoded.max() <= 1 + 1e-12


@given(st.floats(-720, 720))
def test_rotation_comes_back(rotation: float) -> None:
    back = playcanvas_lights.engine_rotation(playcanvas_lights.engine_rotation(rotation))
    assert math.cos(math.radians(back - rotation)) == pytest.approx(1)


def test_lights_come_back() -> None:
    lights: tuple[Light, ...] = (
        DirectionalLight(name="d", direction=np.array([0.2, -1, 0]), color=np.array([1, 0.5, 0.25]), intensity=3.0),
        PointLight(name="p", position=np.array([1, 2, 3]), color=np.array([0.5, 1, 0.5]), intensity=80.0, range=9.0),
        SpotLight(
            name="s",
            position=np.array([1, 2, 3]),
            direction=np.array([0, 0, -1]),
            intensity=0.5,
            range=7.0,
            inner_cone_angle=0.2,
            outer_cone_angle=0.6,
        ),
    )
    engine, _ = playcanvas_lights.to_engine(Lighting(lights=lights), FLOOR, shadows=False)
    back, warnings = from_engine(engine)
    assert warnings == ()
    for before, after in zip(lights, back.lights, strict=True):
        assert type(before) is type(after)
        np.testing.assert_allclose(after.color * after.intensity, before.color * before.intensity, rtol=1e-6)
        for name in ("position", "direction", "range", "inner_cone_angle", "outer_cone_angle"):
            if hasattr(before, name):
                np.testing.assert_allclose(getattr(after, name), getattr(before, name), rtol=1e-9)


@pytest.mark.parametrize("kind", ["omni", "spot", "directional"])
@pytest.mark.parametrize("falloff", ["linear", "inverse-squared"])
@pytest.mark.parametrize("intensity", [0.4, 3.0])
def test_the_engines_lights_come_back(kind: Any, falloff: Falloff, intensity: float) -> None:
    before = EngineLight(
        name="a",
        kind=kind,
        color=np.array([0.9, 0.5, 0.2]),
        intensity=intensity,
        position=np.array([1.0, 2.0, 3.0]),
        direction=np.array([0.0, -1.0, 0.0]),
        range=7.0,
        falloff=falloff,
        inner_cone_angle=20.0,
        outer_cone_angle=45.0,
        cast_shadows=True,
    )
    physical, _ = from_engine(EngineLighting(lights=(before,)))
    engine, warnings = playcanvas_lights.to_engine(physical, FLOOR)
    (after,) = engine.lights
    assert warnings == ()
    np.testing.assert_allclose(after.linear_color, before.linear_color, rtol=1e-9)
    assert (after.kind, after.cast_shadows) == (before.kind, True)
    if kind != "directional":
        assert after.falloff == before.falloff
        assert after.range == pytest.approx(before.range)
        np.testing.assert_allclose(after.position, before.position)
    if kind == "spot":
        assert (after.inner_cone_angle, after.outer_cone_angle) == pytest.approx((20.0, 45.0))


def test_linear_falloff_is_equal_at_half_the_range() -> None:
    lamp = EngineLight(name="lamp", kind="omni", intensity=4.0, range=6.0)
    back, (said,) = from_engine(EngineLighting(lights=(lamp,)))
    light = back.lights[0]
    assert isinstance(light, PointLight)
    # engine: L (1 - d / R) albedo; physical: I / d² (1 - (d / R)^4) albedo / pi
    assert light.intensity / 3.0**2 / math.pi * (1 - 0.5**4) == pytest.approx(4.0 * 0.5)
    assert "linear falloff" in said


def test_ambient_becomes_a_constant_environment_and_comes_back() -> None:
    ambient = np.array([0.5, 0.2, 0.1])
    back, _ = from_engine(EngineLighting(ambient=ambient))
    assert back.environment is not None
    np.testing.assert_allclose(back.environment.pixels[0, 0], ambient**2.2, rtol=1e-6)
    engine, _ = playcanvas_lights.to_engine(back, FLOOR, shadows=False)
    assert engine.environment is None
    np.testing.assert_allclose(engine.ambient, ambient, rtol=1e-6)

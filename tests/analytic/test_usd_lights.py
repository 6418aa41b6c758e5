"""Every light of UsdLux beside the closed form that its documentation gives: within 0.5 %."""

from __future__ import annotations

import math
import sys
from pathlib import Path

import numpy as np
import pytest

from mirelight.base.errors import InputError
from mirelight.io.usd.lights import UsdLights, read_lights
from mirelight.model import F64, AreaLight, DirectionalLight, Light, PointLight, SpotLight, SunLight, TubeLight, cones

from .test_tube import facets

sys.path.append(str(Path(__file__).parents[2] / "scripts"))
pytest.importorskip("pxr")
from bench.usd import FAR, HEAD, LUMINANCE, STAGE, closed_forms, light_prim


@pytest.fixture(scope="module", params=[(1.0, "Y"), (0.01, "Z")], ids=["metres", "centimetres"])
def found(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[UsdLights, float]:
    unit, up = request.param
    path = tmp_path_factory.mktemp("lights") / "lights.usda"
    path.write_text(HEAD.format(unit=unit, up=up) + STAGE)
    return read_lights(path), unit


def _irradiance(light: Light, way: F64, far: float) -> float:
    """On what faces the origin of a light at the origin, from a distance `far` along a unit `way`."""
    point = way * far
    strength = light.intensity
    match light:
        case DirectionalLight() | SunLight():
            return strength * max(float(light.direction @ way), 0)
        case PointLight() | SpotLight():
            share = 1.0 if light.profile is None else float(light.profile.toward(way))
            if isinstance(light, SpotLight):
                angles = light.inner_cone_angle, light.outer_cone_angle
                share *= float(cones.share(light.cone, *angles, light.direction @ way))
            return strength * share / far**2
        case AreaLight(shape="sphere"):
            return strength * math.pi * (light.size[0] / 2 / far) ** 2
        case TubeLight():
            return strength * sum(_projected(x, point, way) for x in facets(light, 64))
        case AreaLight():
            return strength * _projected(light, point, way)


def _projected(light: AreaLight, point: F64, way: F64) -> float:
    """Projected solid angle (sr) of a flat light, by quadrature over its surface."""
    nodes, weights = np.polynomial.legendre.leggauss(24)
    if light.shape == "disk":
        r, w = (nodes + 1) / 2 * light.size[0] / 2, weights / 2 * light.size[0] / 2
        turns = np.arange(48) * 2 * math.pi / 48
        x, y = r[:, None] * np.cos(turns), r[:, None] * np.sin(turns)
        area = (w * r)[:, None] * np.full(48, 2 * math.pi / 48)
    else:
        x, y = np.broadcast_arrays(nodes[:, None] * light.size[0] / 2, nodes * light.size[1] / 2)
        area = weights[:, None] * weights * light.size[0] * light.size[1] / 4
    pose = light.world_from_light
    places = x[..., None] * pose[:3, 0] + y[..., None] * pose[:3, 1] + pose[:3, 3]
    back = places - point
    square = (back**2).sum(-1)
    leaving = np.maximum((back @ pose[:3, 2]), 0)  # it shines along -Z
    arriving = np.maximum(-(back @ way), 0)
    return float((area * leaving * arriving / square**2).sum())


def test_each_light_gives_the_irradiance_of_its_closed_form(found: tuple[UsdLights, float]) -> None:
    lights, unit = found
    # The receiver is along the stage's -Z: that is -Z of Y-up stages and down of Z-up ones.
    way = np.array([0.0, 0.0, -1.0]) if unit == 1 else np.array([0.0, -1.0, 0.0])
    for name, wanted in closed_forms():
        own = [x for x in lights.lights if x.name == name or x.group == name]
        assert own, name
        got = sum(_irradiance(x, way, FAR * unit) for x in own)
        assert got == pytest.approx(wanted, rel=5e-3), name
    assert lights.environment is not None
    np.testing.assert_allclose(lights.environment, [[[LUMINANCE, LUMINANCE / 2, LUMINANCE / 4]]], rtol=1e-6)


def test_shaping_follows_the_angle(found: tuple[UsdLights, float]) -> None:
    lights, unit = found
    names = {x.name: x for x in lights.lights}
    down, side = (np.array([0.0, 0.0, -1.0]), np.array([1.0, 0.0, 0.0]))
    if unit != 1:
        down = np.array([0.0, -1.0, 0.0])

    def at(name: str, degrees: float) -> float:
        way = math.cos(math.radians(degrees)) * down + math.sin(math.radians(degrees)) * side
        return _irradiance(names[name], way, 1.0) / _irradiance(names[name], down, 1.0)

    assert at("cone", 19.9) == pytest.approx(1)
    assert at("cone", 20.1) == 0
    assert at("soft", 20) == pytest.approx(1)
    assert at("soft", 30) == pytest.approx(0.5, rel=5e-3)
    assert at("soft", 41) == 0
    assert at("focused", 35) == pytest.approx(math.cos(math.radians(35)) ** 5, rel=5e-3)
    assert lights.notes == ("/warm: light linking, which is not followed; it lights everything",)
    assert names["warm"].color[0] == 1 > names["warm"].color[1] > names["warm"].color[2]


@pytest.mark.parametrize(
    ("body", "said"),
    [
        (
            light_prim("RectLight", "flat", "float inputs:width = 0\nbool inputs:normalize = 1"),
            "/flat: a light of no size",
        ),
        (light_prim("DomeLight", "sky", "asset inputs:texture:file = @gone.exr@"), "/sky: there is no file 'gone.exr'"),
        (light_prim("SphereLight", "odd", "color3f inputs:color = (nan, 0, 0)"), "/odd: light of"),
    ],
)
def test_a_light_that_cannot_be_used_is_named_by_its_prim(tmp_path: Path, body: str, said: str) -> None:
    path = tmp_path / "lights.usda"
    path.write_text(HEAD.format(unit=1, up="Y") + body)
    with pytest.raises(InputError, match=said):
        read_lights(path)

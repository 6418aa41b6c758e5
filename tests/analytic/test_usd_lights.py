"""Every light of UsdLux beside the closed form that its documentation gives: within 0.5 %."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from mirelight.base.errors import InputError
from mirelight.io.usd.lights import UsdLights, read_lights
from mirelight.model import F64, AreaLight, DirectionalLight, Light, PointLight, SpotLight, SunLight, cones

pytest.importorskip("pxr")

_HEAD = '#usda 1.0\n(\n    metersPerUnit = {unit}\n    upAxis = "{up}"\n)\n'
_FAR = 3.0  # units from each light to what it lights, along its -Z
_COMMON = "float inputs:intensity = 2\nfloat inputs:exposure = 3\nfloat inputs:diffuse = 0.5\n"
_L = 2 * 2**3 * 0.5  # cd/m²
_TUBE = "float inputs:length = 1.5\nfloat inputs:radius = 0.2"
_WARM = "float inputs:radius = 0.4\nbool inputs:enableColorTemperature = 1\nfloat inputs:colorTemperature = 3000"
_SHAPED = '(\nprepend apiSchemas = ["ShapingAPI"]\n)'


def _def(kind: str, name: str, body: str, api: str = "") -> str:
    return f'def {kind} "{name}" {api}\n{{\n{_COMMON}{body}\n}}\n'


_STAGE = "".join(
    [
        _def("DistantLight", "sun", "float inputs:angle = 2"),
        _def("DistantLight", "sun_lux", "float inputs:angle = 2\nbool inputs:normalize = 1"),
        _def("DistantLight", "parallel", "float inputs:angle = 0"),
        _def("SphereLight", "ball", "float inputs:radius = 0.4"),
        _def("SphereLight", "ball_power", "float inputs:radius = 0.4\nbool inputs:normalize = 1"),
        _def("SphereLight", "dot", "float inputs:radius = 0.4\nbool treatAsPoint = 1"),
        _def("SphereLight", "dot_power", "float inputs:radius = 0\nbool treatAsPoint = 1\nbool inputs:normalize = 1"),
        _def("DiskLight", "disk", "float inputs:radius = 0.7"),
        _def("DiskLight", "disk_power", "float inputs:radius = 0.7\nbool inputs:normalize = 1"),
        _def("RectLight", "rect", "float inputs:width = 2\nfloat inputs:height = 1"),
        _def("RectLight", "rect_power", "float inputs:width = 2\nfloat inputs:height = 1\nbool inputs:normalize = 1"),
        _def("CylinderLight", "tube", _TUBE),
        _def(
            "CylinderLight",
            "tube_power",
            "float inputs:length = 1.5\nfloat inputs:radius = 0.2\nbool inputs:normalize = 1",
        ),
        _def("SphereLight", "cone", "float inputs:radius = 0.1\nfloat inputs:shaping:cone:angle = 20", _SHAPED),
        _def(
            "SphereLight",
            "soft",
            "float inputs:radius = 0.1\nfloat inputs:shaping:cone:angle = 40\nfloat inputs:shaping:cone:softness = 0.5",
            _SHAPED,
        ),
        _def("DiskLight", "focused", "float inputs:radius = 0.1\nfloat inputs:shaping:focus = 4", _SHAPED),
        _def(
            "SphereLight",
            "warm",
            "float inputs:radius = 0.4\nbool inputs:enableColorTemperature = 1\nfloat inputs:colorTemperature = 3000",
        ),
        _def("DomeLight", "dome", "color3f inputs:color = (1, 0.5, 0.25)"),
    ]
)


@pytest.fixture(scope="module", params=[(1.0, "Y"), (0.01, "Z")], ids=["metres", "centimetres"])
def found(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[UsdLights, float]:
    unit, up = request.param
    path = tmp_path_factory.mktemp("lights") / "lights.usda"
    path.write_text(_HEAD.format(unit=unit, up=up) + _STAGE)
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


def _closed_forms() -> Iterator[tuple[str, float]]:
    """Irradiance at `_FAR` along -Z, by the light's name, in a stage's own units."""
    d = _FAR
    half = math.radians(1)
    yield "sun", _L * math.pi * math.sin(half) ** 2
    yield "sun_lux", _L
    yield "parallel", _L
    ball = math.pi * (0.4 / d) ** 2
    yield "ball", _L * ball
    yield "ball_power", _L / (4 * math.pi * 0.4**2) * ball
    yield "dot", _L * ball
    yield "dot_power", _L / 4 / d**2
    disk = math.pi * 0.7**2 / (0.7**2 + d**2)
    yield "disk", _L * disk
    yield "disk_power", _L / (math.pi * 0.7**2) * disk
    a, b = 1 / d, 0.5 / d
    p, q = math.hypot(1, a), math.hypot(1, b)
    rect = 2 * (a / p * math.atan(b / p) + b / q * math.atan(a / q))
    yield "rect", _L * rect
    yield "rect_power", _L / 2 * rect
    tube = _tube(1.5, 0.2, d)
    yield "tube", _L * tube
    yield "tube_power", _L / (2 * math.pi * 0.2 * 1.5) * tube
    yield "cone", _L * math.pi * (0.1 / d) ** 2
    yield "soft", _L * math.pi * (0.1 / d) ** 2
    yield "focused", _L * math.pi * 0.1**2 / d**2


def _tube(length: float, radius: float, far: float) -> float:
    """Projected solid angle of a cylinder's side from beside its middle, by quadrature over what is seen of it."""
    nodes, weights = np.polynomial.legendre.leggauss(64)
    edge = math.acos(radius / far)
    phi, x = nodes[:, None] * edge, nodes * length / 2
    across, toward = radius * np.sin(phi), far - radius * np.cos(phi)
    square = x**2 + across**2 + toward**2
    leaving = toward * np.cos(phi) - across * np.sin(phi)
    area = weights[:, None] * edge * radius * weights * length / 2
    return float((area * leaving * toward / square**2).sum())


def test_each_light_gives_the_irradiance_of_its_closed_form(found: tuple[UsdLights, float]) -> None:
    lights, unit = found
    # The receiver is along the stage's -Z: that is -Z of Y-up stages and down of Z-up ones.
    way = np.array([0.0, 0.0, -1.0]) if unit == 1 else np.array([0.0, -1.0, 0.0])
    for name, wanted in _closed_forms():
        own = [x for x in lights.lights if x.name == name or x.group == name]
        assert own, name
        got = sum(_irradiance(x, way, _FAR * unit) for x in own)
        assert got == pytest.approx(wanted, rel=5e-3), name
    assert lights.environment is not None
    np.testing.assert_allclose(lights.environment, [[[_L, _L / 2, _L / 4]]], rtol=1e-6)


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
    assert names["warm"].color[0] == 1 > names["warm"].color[1] > names["warm"].color[2]


@pytest.mark.parametrize(
    ("body", "said"),
    [
        (_def("RectLight", "flat", "float inputs:width = 0\nbool inputs:normalize = 1"), "/flat: a light of no size"),
        (_def("DomeLight", "sky", "asset inputs:texture:file = @gone.exr@"), "/sky: there is no file 'gone.exr'"),
        (_def("SphereLight", "odd", "color3f inputs:color = (nan, 0, 0)"), "/odd: light of"),
    ],
)
def test_a_light_that_cannot_be_used_is_named_by_its_prim(tmp_path: Path, body: str, said: str) -> None:
    path = tmp_path / "lights.usda"
    path.write_text(_HEAD.format(unit=1, up="Y") + body)
    with pytest.raises(InputError, match=said):
        read_lights(path)

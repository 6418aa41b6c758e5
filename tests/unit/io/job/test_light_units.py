"""`unit`, `kelvin` and `cone` of a job's lights, against sums over directions and areas."""

from __future__ import annotations

import math

import numpy as np
import pytest

import mirelight
from mirelight.base import colour
from mirelight.model import AreaLight, Light, PointLight, SpotLight

from .conftest import Complaints, WriteJob

SCENE = 'splats = "splats.ply"\nproxy = "proxy.glb"\n'
SPOT = 'type = "spot"\nposition = [0, 3, 0]\ntarget = [0, 0, 0]\n'
AREA = 'type = "area"\nposition = [0, 3, 0]\n'


def light(write_job: WriteJob, text: str) -> Light:
    return mirelight.load(write_job(f"{SCENE}[[lights]]\n{text}\n")).lightings[0].lights[0]


def sphere_mean(share: object) -> float:
    """Mean of a function of the cosine over all directions."""
    cosines = (np.arange(200_000) + 0.5) / 100_000 - 1
    return float(np.mean(share(cosines)))  # type: ignore[operator]


@pytest.mark.parametrize("kind", ["directional", "sun"])
@pytest.mark.parametrize("unit", ["lux", "watt"])
def test_a_suns_watts_per_square_metre_are_its_lux(write_job: WriteJob, kind: str, unit: str) -> None:
    found = light(write_job, f'type = "{kind}"\ndirection = [0, -1, 0]\nintensity = 3\nunit = "{unit}"')
    assert found.intensity == 3


@pytest.mark.parametrize(
    ("head", "names"),
    [
        ('type = "sun"\ndirection = [0, -1, 0]', (("lux", "lx"), ("watt", "W/m²", "W/m2", "watts"))),
        (
            'type = "point"\nposition = [0, 1, 0]',
            (("candela", "cd"), ("lumen", "lm", "lumens"), ("watt", "W", "watts")),
        ),
        (AREA + "target = [0, 0, 0]", (("nit", "nits", "cd/m²", "cd/m2"), ("candela", "cd"), ("lumen", "lm"))),
    ],
)
def test_units_have_the_names_that_people_write(
    write_job: WriteJob, head: str, names: tuple[tuple[str, ...], ...]
) -> None:
    for same in names:
        found = {light(write_job, f'{head}\nintensity = 30\nunit = "{name}"').intensity for name in same}
        assert len(found) == 1


@pytest.mark.parametrize("unit", ["lumen", "watt"])
def test_a_lamp_shines_all_around(write_job: WriteJob, unit: str) -> None:
    found = light(write_job, f'type = "point"\nposition = [0, 1, 0]\nintensity = 800\nunit = "{unit}"')
    assert isinstance(found, PointLight) and found.intensity == pytest.approx(800 / (4 * math.pi))
    assert found.intensity == pytest.approx(63.66, abs=0.01)  # docs/explanation/lighting.md: 64 cd


def test_a_spots_lumens_go_into_its_cone(write_job: WriteJob) -> None:
    angles = 'inner_cone_angle = 12\nouter_cone_angle = 34\nintensity = 500\nunit = "lumen"'
    low, high = math.cos(math.radians(34)), math.cos(math.radians(12))

    def t(cosine: np.ndarray) -> np.ndarray:
        return np.clip((cosine - low) / (high - low), 0, 1)

    squared = light(write_job, SPOT + angles)
    assert squared.intensity * 4 * math.pi * sphere_mean(lambda c: t(c) ** 2) == pytest.approx(500, rel=1e-4)
    smooth = light(write_job, f'{SPOT}{angles}\ncone = "playcanvas"')
    assert isinstance(smooth, SpotLight) and smooth.cone == "playcanvas"
    assert smooth.intensity * 4 * math.pi * sphere_mean(lambda c: t(c) ** 2 * (3 - 2 * t(c))) == pytest.approx(
        500, rel=1e-4
    )


def test_a_spots_watts_do_not_go_with_its_cone(write_job: WriteJob) -> None:
    """As Blender has it: a narrower spot is not brighter."""
    for angle in (5, 80):
        found = light(write_job, f'{SPOT}outer_cone_angle = {angle}\nintensity = 100\nunit = "watt"')
        assert found.intensity == pytest.approx(100 / (4 * math.pi))


@pytest.mark.parametrize(
    ("shape", "size", "unit", "nits"),
    [
        ("rectangle", "[2, 0.5]", "nit", 100),
        ("rectangle", "[2, 0.5]", "candela", 100 / 1.0),
        ("rectangle", "[2, 0.5]", "lumen", 100 / (math.pi * 1.0)),
        ("rectangle", "[2, 0.5]", "watt", 100 / (math.pi * 1.0)),
        ("disk", "2", "candela", 100 / math.pi),
        ("disk", "2", "lumen", 100 / math.pi**2),
        ("disk", "2", "watt", 100 / math.pi**2),
        ("sphere", "2", "candela", 100 / math.pi),
        ("sphere", "2", "lumen", 100 / (4 * math.pi**2)),
        ("sphere", "2", "watt", 100 / (4 * math.pi) / math.pi),  # Blender's lamp of radius 1: P / 4 pi candela
    ],
)
def test_glowing_surfaces_obey_lambert(write_job: WriteJob, shape: str, size: str, unit: str, nits: float) -> None:
    """Flux of a flat one: pi times its area a nit. Sizes: one square metre, a disc and a ball of radius 1."""
    aim = "" if shape == "sphere" else "target = [0, 0, 0]\n"
    found = light(write_job, f'{AREA}{aim}shape = "{shape}"\nsize = {size}\nintensity = 100\nunit = "{unit}"')
    assert isinstance(found, AreaLight) and found.intensity == pytest.approx(nits)


def test_kelvin_is_a_colour_that_changes_no_strength(write_job: WriteJob) -> None:
    found = light(write_job, 'type = "point"\nposition = [0, 1, 0]\nkelvin = 3200')
    r, g, b = found.color
    assert float(colour.luminance(found.color)) == pytest.approx(1.0)
    assert r > g > b > 0 and r / b > 2
    day = light(write_job, 'type = "sun"\ndirection = [0, -1, 0]\nkelvin = 6500')
    np.testing.assert_allclose(day.color, 1.0, atol=0.06)  # a black body, not daylight: a little redder than white


def test_blenders_cone(write_job: WriteJob) -> None:
    found = light(write_job, f'{SPOT}outer_cone_angle = 30\ncone = "blender"\nblend = 0.4')
    assert isinstance(found, SpotLight) and found.cone == "playcanvas"
    c = math.cos(math.radians(30))
    assert math.cos(found.inner_cone_angle) == pytest.approx(c + 0.4 * (1 - c))
    new = light(write_job, f'{SPOT}outer_cone_angle = 30\ncone = "blender"')
    assert isinstance(new, SpotLight)
    assert math.cos(new.inner_cone_angle) == pytest.approx(c + 0.15 * (1 - c))
    half = math.radians(30)
    pasted = f"spot = {{ innerConeAngle = {0.6 * half}, outerConeAngle = {half} }}"
    again = light(write_job, f'{SPOT}{pasted}\ncone = "blender"')  # as its exporter writes blend 0.4
    assert isinstance(again, SpotLight)
    assert again.inner_cone_angle == pytest.approx(found.inner_cone_angle)


def test_a_hard_cone_of_blender_is_taken(write_job: WriteJob) -> None:
    hard = light(write_job, f'{SPOT}outer_cone_angle = 30\ncone = "blender"\nblend = 0\nintensity = 10\nunit = "lumen"')
    assert hard.intensity == pytest.approx(10 / (2 * math.pi * (1 - math.cos(math.radians(30)))), rel=1e-4)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('type = "point"\nposition = [0, 1, 0]\nunit = "lux"', 'unit: \'lux\'; give one of "candela", "lumen", "watt"'),
        ('type = "sun"\ndirection = [0, -1, 0]\nunit = "lumen"', 'unit: \'lumen\'; give one of "lux", "watt"'),
        (f'{AREA}target = [0, 0, 0]\nunit = "lux"', 'give one of "nit", "candela", "lumen", "watt"'),
        ('type = "sun"\ndirection = [0, -1, 0]\nkelvin = 500', "kelvin: 500; give a number of at least 1000"),
        (
            'type = "point"\nposition = [0, 1, 0]\nkelvin = 3200\ncolor = [1, 1, 1]',
            "kelvin: both color and kelvin are given; keep one of them (color or kelvin)",
        ),
        (f"{SPOT}blend = 0.2", 'blend: a blend without Blender\'s cone; add cone = "blender"'),
        (
            f'{SPOT}cone = "blender"\ninner_cone_angle = 3',
            "inner_cone_angle: an inner angle of Blender's cone; give blend",
        ),
        (f'{SPOT}cone = "blender"\nblend = 1.5', "blend: 1.5; give a number of at most 1"),
        (f'{SPOT}cone = "blender"\nblend = 1\nspot = {{}}', "blend: both blend and spot are given"),
        (f'{SPOT}cone = "khronos"', "cone: 'khronos'"),
        (f'{AREA}target = [0, 0, 0]\nsize = 1e-200\nunit = "lumen"', "intensity: inf cd/m², more than 1e+12"),
        (f'{SPOT}outer_cone_angle = 1e-7\nunit = "lumen"\nintensity = 1e9', "cd, more than 1e+12; give less"),
    ],
)
def test_wrong_units_and_cones_are_said(complaints: Complaints, text: str, said: str) -> None:
    (line,) = complaints(f"{SCENE}[[lights]]\n{text}\n")
    assert said in line


def test_a_sweep_over_kelvin_and_lumens(write_job: WriteJob) -> None:
    lamp = '[[lights]]\ntype = "point"\nname = "key"\nposition = [0, 1, 0]\nunit = "lumen"\n'
    axes = '[[sweep.axes]]\nfield = "lights.key.kelvin"\nvalues = [2700, 6500]\n'
    axes += '[[sweep.axes]]\nfield = "lights.key.intensity"\nvalues = [100, 200]\n'
    lightings = mirelight.load(write_job(SCENE + lamp + axes)).lightings
    assert [x.lights[0].intensity * 4 * math.pi for x in lightings] == pytest.approx([100, 200, 100, 200])
    assert lightings[0].lights[0].color[0] > lightings[2].lights[0].color[0]

"""Lamps found from what they light: a yard at night, painted under one lamp and a faint sky."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from mirelight.estimate import Estimate, estimate, lamps, lighting_of, transport
from mirelight.estimate.describe import described
from mirelight.estimate.tuning import TUNING
from mirelight.io import job
from mirelight.io.environment import write_environment
from mirelight.io.job.captured_text import captured_text
from mirelight.model import F64, AreaLight, Environment, EstimatedSky, Lighting, PointLight, digest

from .test_estimate import SETTINGS, painted, yard

pytestmark = pytest.mark.usefixtures("toys")

LAMP_JOB = """
lights = [{ type = "sun", direction = [0, -1, 0], intensity = 1 }]
cameras = [{ position = [1, 1, 1], target = [0, 0, 0] }]
"""
AT = np.array([1.0, 1.3, 1.0])
NIGHT = Lighting(
    lights=(PointLight(name="lamp", position=AT, intensity=3.0),),
    environment=Environment(radiance=np.full((1, 1, 3), 0.05, np.float32)),
)


def facing_down(position: F64) -> F64:
    """The pose of a lamp there that shines along -Y."""
    pose = np.eye(4)
    pose[:3, :3] = [[1, 0, 0], [0, 0, 1], [0, -1, 0]]
    pose[:3, 3] = position
    return pose


@cache
def found() -> Estimate:
    return estimate(painted(yard(), NIGHT, 1800), yard(), SETTINGS)


def test_a_lamp_is_found_where_it_hangs_with_its_strength() -> None:
    assert len(found().lamps) >= 1
    assert not found().sun.any()
    lamp = found().lamps[0]
    assert np.linalg.norm(lamp[:3] - AT) < 0.15  # of a yard of 6 x 6
    assert 0.7 < lamp[3:].mean() / 3.0 < 1.4
    assert len(found().confidence.lamps_gain) == len(found().lamps)
    assert any(line.startswith("lamp         at") for line in described(found()))
    weak = replace(found(), confidence=replace(found().confidence, lamps_gain=(0.005,) * len(found().lamps)))
    assert any(line.startswith("lamp         a weak one, perhaps none: at") for line in described(weak))


def test_a_lamps_light_falls_with_distance_and_stops_at_walls() -> None:
    """Irradiance / pi is I cos / (pi d^2), against the lighting pass's own point light."""
    from mirelight.lighting import Tracer

    places = transport.places_of(painted(yard(), NIGHT, 700), yard(), SETTINGS)
    column = lamps.lit(places, AT[None])[0]
    tracer = Tracer(yard(), replace(SETTINGS, max_depth=1), layers=False, aovs=False)
    size = np.linalg.norm(np.subtract(*yard().bounds))
    points = places.points - TUNING.place_lift * size * places.normals
    alone = Lighting(lights=(PointLight(name="lamp", position=AT, intensity=1.0),))
    true = tracer.point_layers(alone, points, places.normals, 1).total[:, 0]
    assert (column > 0).mean() > 0.3
    same = (column > 0) == (true > 0)
    assert same.mean() > 0.99
    np.testing.assert_allclose(column[same], true[same], rtol=0.02, atol=1e-4)


OFF = np.array([-1.0, 1.3, -1.0])
PLACES = (
    PointLight(name="desk", position=AT, intensity=40.0, color=np.array([1.0, 0.2, 0.1])),
    AreaLight(name="panel", shape="disk", world_from_light=facing_down(OFF), size=(0.3, 0.3)),
)


@cache
def named() -> Estimate:
    return estimate(painted(yard(), NIGHT, 1200), yard(), SETTINGS, lights=PLACES)


def test_lamps_whose_places_are_known_come_out_with_their_strengths() -> None:
    """One shone, the other was off; what their file says of colour and intensity counts for nothing."""
    desk, panel = named().named
    assert isinstance(desk, PointLight) and isinstance(panel, AreaLight)
    np.testing.assert_array_equal(desk.position, AT)
    assert 0.8 < (desk.color * desk.intensity).mean() / 3.0 < 1.25
    assert (desk.color * desk.intensity).min() > 0.9 * (desk.color * desk.intensity).max()
    sent = panel.intensity * np.pi * 0.15**2  # candela, straight down
    assert sent < 0.05 * desk.intensity
    assert not len(named().lamps)
    assert not named().sun.any()
    assert any(line.startswith("light        desk: ") and line.endswith(" candela") for line in described(named()))
    assert any("panel: " in line and line.endswith(" cd/m²") for line in described(named()))


def test_named_lamps_are_kept_and_written_with_the_rest(tmp_path: Path) -> None:
    light = lighting_of(named().packed(), PLACES)
    assert [x.name for x in light.lights] == ["sun", "desk", "panel"]
    assert {x.group or x.name for x in light.lights} == {"sun"}  # one layer, whatever was found
    for name in ("a.ply", "a.glb"):
        (tmp_path / name).write_bytes(b"")
    write_environment(tmp_path / "captured.exr", named().radiance.astype(np.float32))
    head = 'splats = "a.ply"\nproxy = "a.glb"\nresolution = [4, 4]\n' + LAMP_JOB
    (tmp_path / "pasted.toml").write_text(head + captured_text(light, "captured.exr", []))
    pasted = job.load(tmp_path / "pasted.toml").captured
    assert pasted is not None
    for found, again in zip(named().named, pasted.lights, strict=True):
        np.testing.assert_allclose(again.color * again.intensity, found.color * found.intensity, rtol=1e-4)
        assert replace(again, color=found.color, intensity=found.intensity).name == found.name
    panel = pasted.lights[1]
    assert isinstance(panel, AreaLight)
    np.testing.assert_allclose(panel.world_from_light[:3, 2:], facing_down(OFF)[:3, 2:], atol=1e-6)


def test_a_job_names_lamps_of_an_estimate(tmp_path: Path) -> None:
    """Their intensities and colours are no part of what is asked."""
    for name in ("a.ply", "a.glb"):
        (tmp_path / name).write_bytes(b"")
    head = 'splats = "a.ply"\nproxy = "a.glb"\nresolution = [4, 4]\n' + LAMP_JOB + "[captured]\nestimate = true\n"
    asked = []
    for strength in (1, 70):
        lamp = f'type = "point", position = [0, 2, 0], intensity = {strength}'
        (tmp_path / "job.toml").write_text(
            f'{head}lights = [{{ {lamp}, name = "sun" }}, {{ {lamp}, name = "desk" }}]\n'
        )
        captured = job.load(tmp_path / "job.toml").captured
        assert captured is not None and isinstance(captured.sky, EstimatedSky) and not captured.lights
        asked.append(captured.sky)
        assert [x.name for x in captured.sky.lights] == ["sun-2", "desk"]  # "sun" is the estimate's own
    assert digest(asked[0].lights) == digest(asked[1].lights)


def test_lamps_are_kept_and_written_with_the_rest(tmp_path: Path) -> None:
    light = lighting_of(found().packed())
    assert light.environment is not None
    np.testing.assert_array_equal(light.environment.pixels, found().radiance.astype(np.float32))
    assert {x.group or x.name for x in light.lights} == {"sun"}  # one layer, whatever was found
    lamp = light.lights[1]
    assert isinstance(lamp, PointLight)
    np.testing.assert_allclose(lamp.color * lamp.intensity, found().lamps[0, 3:])
    write_environment(tmp_path / "captured.exr", light.environment.pixels)
    text = (
        'splats = "a.ply"\nproxy = "a.glb"\nresolution = [4, 4]\n'
        + LAMP_JOB
        + captured_text(light, "captured.exr", ["found"])
    )
    (tmp_path / "pasted.toml").write_text(text)
    for name in ("a.ply", "a.glb"):
        (tmp_path / name).write_bytes(b"")
    pasted = job.load(tmp_path / "pasted.toml").captured
    assert pasted is not None
    again = pasted.lights[0]
    assert isinstance(again, PointLight)
    np.testing.assert_allclose(again.position, lamp.position, rtol=1e-5)
    np.testing.assert_allclose(again.color * again.intensity, lamp.color * lamp.intensity, rtol=1e-4)

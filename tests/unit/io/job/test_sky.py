"""A sky by place and time: the sun's position against published values, north and rotation, names of its layers."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta, timezone

import numpy as np
import pytest

from mirelight.apps.inspect.facts import lighting_facts
from mirelight.base.errors import InputError
from mirelight.io import job
from mirelight.io.job.moon import moon
from mirelight.io.job.sun_position import of_direction, sun_position, to_sun
from mirelight.model import DirectionalLight, SkyModel, SunLight

from .conftest import WriteJob

SCENE = 'splats = "splats.ply"\nproxy = "proxy.glb"\n'


def test_the_example_of_nrels_solar_position_algorithm() -> None:
    """Reda and Andreas, NREL/TP-560-34302, A5.1: topocentric azimuth 194.34024, zenith 50.11162 degrees. That zenith
    holds 0.0163 degrees of refraction, which is left out here."""
    time = datetime(2003, 10, 17, 12, 30, 30, tzinfo=timezone(timedelta(hours=-7)))
    elevation, azimuth = sun_position(39.742476, -105.1786, time)
    assert elevation == pytest.approx(90 - 50.11162 - 0.0163, abs=0.01)
    assert azimuth == pytest.approx(194.34024, abs=0.01)


def test_the_suns_declination_is_its_height_at_the_pole() -> None:
    """Meeus, Astronomical Algorithms, example 25.a: 1992 October 13, 0h TD, apparent declination -7.78507 degrees."""
    elevation, _ = sun_position(90, 0, datetime(1992, 10, 13, tzinfo=UTC) - timedelta(seconds=59))
    assert elevation == pytest.approx(-7.78507, abs=0.01)


def test_the_day_goes_from_east_over_south_to_west_in_the_north_and_over_north_in_the_south() -> None:
    day = [datetime(2026, 3, 20, hour, tzinfo=UTC) for hour in (7, 12, 17)]
    assert [round(sun_position(45, 0, t)[1] / 90) for t in day] == [1, 2, 3]
    assert [round(sun_position(-45, 0, t)[1] / 90) % 4 for t in day] == [1, 0, 3]


def test_north_is_minus_z_and_east_plus_x() -> None:
    for azimuth, axis in ((0, [0, 0, -1]), (90, [1, 0, 0]), (180, [0, 0, 1]), (270, [-1, 0, 0])):
        np.testing.assert_allclose(to_sun(0, azimuth), axis, atol=1e-12)
    np.testing.assert_allclose(to_sun(90, 77), [0, 1, 0], atol=1e-12)
    np.testing.assert_allclose(to_sun(0, 90, rotation=90), [0, 0, -1], atol=1e-12)  # +X goes to -Z, as a map's light


def test_a_direction_and_where_it_points_are_the_same() -> None:
    for elevation, azimuth in ((12, 270), (-30, 45), (40, 181)):
        assert of_direction(3 * to_sun(elevation, azimuth)) == pytest.approx((elevation, azimuth))


@pytest.mark.parametrize("kind", ["sun", "directional"])
def test_a_sun_by_elevation_and_azimuth_stands_where_the_skys_does(write_job: WriteJob, kind: str) -> None:
    text = f'''\
lights = [
    {{ type = "{kind}", elevation = 30, azimuth = 250 }},
    {{ type = "{kind}", elevation = 30 }},
    {{ type = "{kind}", direction = [0, -1, 0] }},
]
[environment]
sky = {{ elevation = 30, azimuth = 250 }}
'''
    lighting = job.load(write_job(SCENE + text)).lightings[0]
    assert isinstance(lighting.sky, SkyModel)
    ways = [light.direction for light in lighting.lights if isinstance(light, DirectionalLight | SunLight)]
    np.testing.assert_allclose(ways[0], -lighting.sky.to_sun, atol=1e-12)
    np.testing.assert_allclose(ways[1], -to_sun(30, 180), atol=1e-12)
    np.testing.assert_allclose(ways[2], [0, -1, 0])


def test_a_sky_is_a_sun_and_a_sky_beside_the_jobs_lights(write_job: WriteJob) -> None:
    text = """\
lights = [{ type = "sun", direction = [0, -1, 0] }]
[environment]
sky = { latitude = 39.742476, longitude = -105.1786, time = 2003-10-17T12:30:30-07:00, turbidity = 5, albedo = 0.1 }
intensity = 1e-5
rotation = 14.34
"""
    lighting = job.load(write_job(SCENE + text)).lightings[0]
    assert lighting.layer_names == ("sun-2", "sun", "sky") and lighting.environment is None
    sky = lighting.sky
    assert (
        isinstance(sky, SkyModel) and (sky.turbidity, sky.intensity) == (5, 1e-5) and sky.albedo.tolist() == [0.1] * 3
    )
    height = np.radians(39.872)
    np.testing.assert_allclose(sky.to_sun, [0, np.sin(height), np.cos(height)], atol=2e-4)


def test_a_time_may_be_set_on_the_command_line(write_job: WriteJob) -> None:
    path = write_job(SCENE + "environment = { sky = { latitude = 0, longitude = 0, time = 2026-03-20T12:00:00Z } }\n")
    noon = job.load(path).lightings[0].sky
    later = job.load(path, ["environment.sky.time=2026-03-20T15:00:00Z"]).lightings[0].sky
    assert isinstance(noon, SkyModel) and isinstance(later, SkyModel)
    assert noon.to_sun[1] > 0.99 and later.to_sun[1] == pytest.approx(np.cos(np.radians(43)), abs=0.01)
    assert later.to_sun[0] < 0  # west


def test_inspect_says_where_the_sun_is(write_job: WriteJob) -> None:
    path = write_job(SCENE + "environment = { sky = { elevation = 30, turbidity = 4 }, intensity = 2 }\n")
    facts = lighting_facts(job.load(path).lightings[0])
    assert facts.environment is None and facts.sky is not None
    assert (facts.sky.elevation, facts.sky.turbidity, facts.sky.intensity) == (30, 4, 2)
    assert facts.sky.to_sun == pytest.approx((0, 0.5, 0.866025), abs=1e-6)


def test_the_moon_of_meeus() -> None:
    """Astronomical Algorithms, examples 47.a and 48.a: 1992 April 12, 0h TD, declination 13.7684, parallax 0.99199,
    phase angle 69.0756 degrees."""
    time = datetime(1992, 4, 12, tzinfo=UTC) - timedelta(seconds=59)
    found = moon(90, 0, time)
    assert found.elevation == pytest.approx(13.7684 - 0.99199 * np.cos(np.radians(13.7684)), abs=0.3)
    assert found.phase == pytest.approx(69.0756, abs=0.5)
    assert found.diameter == pytest.approx(2 * 0.272481 * 0.99199, abs=0.002)


def test_moonlight_by_phase_and_height() -> None:
    """The total eclipse of 2025 September 7, 18:12 UTC, was overhead in the Indian Ocean; the last quarter
    came on the 14th, 10:33 UTC."""
    full = moon(-5.4, 86.5, datetime(2025, 9, 7, 18, 12, tzinfo=UTC))
    assert full.phase < 1.5 and full.elevation > 85
    assert 0.2 < full.lux < 0.26
    low = moon(-5.4, 26.5, datetime(2025, 9, 7, 18, 12, tzinfo=UTC))
    assert 25 < low.elevation < 35 and 0.75 < low.lux / full.lux < 0.9
    half = moon(25, -68, datetime(2025, 9, 14, 10, 33, tzinfo=UTC))
    assert 88 < half.phase < 92 and half.elevation > 75 and 0.05 < half.lux / full.lux < 0.13


def test_a_moon_in_a_job(write_job: WriteJob) -> None:
    text = 'lights = [{ type = "moon", latitude = -5.4, longitude = 86.5, time = 2025-09-07T18:12:00Z }]\n'
    (light,) = job.load(write_job(SCENE + text)).lightings[0].lights
    assert isinstance(light, SunLight) and light.name == "moon"
    assert light.direction[1] < -0.99 and 0.2 < light.intensity < 0.26 and light.color[0] > light.color[2]
    down = write_job(SCENE + text.replace("T18", "T06"))
    with pytest.raises(InputError, match=r"lights\[0\].time: the moon is .* degrees below the horizon then"):
        job.load(down)

"""IES profiles: read, traced, and held against tables written here."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

import mirelight
from mirelight.base.errors import InputError, MirelightError
from mirelight.dataset import rig
from mirelight.io import records
from mirelight.io.ies import read_ies
from mirelight.lighting import Tracer
from mirelight.model import IesProfile, Lighting, PointLight, ProxyMesh, RenderSettings, SpotLight, cones, digest
from mirelight.model.cones import ConeLaw
from mirelight.model.playcanvas_lights import to_engine

from .lighting_scenes import FLOOR, Array, floor_mean, join, overhead, quad, render

FULL = np.arange(0.0, 181.0, 10.0)
HALF = np.arange(0.0, 91.0, 5.0)
GRAY = 0.5 / np.pi
Candela = Callable[[Array, Array], Array]  # of vertical and horizontal angles in degrees


def plain(theta: Array, phi: Array) -> Array:
    return np.asarray(100 + 0 * theta + 0 * phi)


def quarters(theta: Array, phi: Array) -> Array:
    """Alike in four quarters, dark above."""
    return np.asarray(np.where(theta <= 90, 400 * np.cos(np.radians(theta)) * (2 + np.cos(np.radians(2 * phi))), 0))


def halves(theta: Array, phi: Array) -> Array:
    """Alike on both sides of the plane 0-180."""
    return np.asarray((1 + np.cos(np.radians(theta)) ** 2) * (150 + 100 * np.cos(np.radians(phi))))


def lopsided(theta: Array, phi: Array) -> Array:
    return np.asarray((1.5 + np.cos(np.radians(theta))) * (150 + 100 * np.cos(np.radians(phi - 40))))


def text(candela: Candela, vertical: Array, horizontal: Array, **more: float) -> str:
    """A file of these candela, with a multiplier and a ballast that leave them as they are."""
    given = {"multiplier": 0.5, "ballast": 2.0, "kind": 1.0} | more
    values = candela(*np.meshgrid(vertical, horizontal))
    rows = [" ".join(f"{x:.8g}" for x in row) for row in (vertical, horizontal, *values)]
    head = f"1 1000 {given['multiplier']} {len(vertical)} {len(horizontal)} {given['kind']:.0f} 2 0.1 0.1 0"
    return "\n".join(["IESNA:LM-63-2002", "[TEST] one", "TILT=NONE", head, f"{given['ballast']} 1.0 40", *rows, ""])


CASES: dict[str, tuple[Candela, Array, Array]] = {
    "one plane": (plain, FULL, np.array([0.0])),
    "quarters": (quarters, HALF, np.arange(0.0, 91.0, 7.5)),
    "halves": (halves, FULL, np.arange(0.0, 181.0, 10.0)),
    "all around": (lopsided, FULL, np.arange(0.0, 361.0, 15.0)),
    "not closed": (lopsided, FULL, np.arange(0.0, 346.0, 15.0)),
    "across": (lambda t, p: halves(t, p + 90), FULL, np.arange(90.0, 271.0, 10.0)),
}


def profile(path: Path, **turned: Array) -> tuple[IesProfile, float]:
    found = read_ies(path)
    return IesProfile(share=found.share, **turned), found.peak


def directions(count: int) -> Array:
    """Spread evenly over the sphere."""
    i = np.arange(count) + 0.5
    z, a = 1 - 2 * i / count, np.pi * (1 + 5**0.5) * i
    return np.stack([np.sqrt(1 - z**2) * np.cos(a), z, np.sqrt(1 - z**2) * np.sin(a)], axis=-1)


def angles(way: Array) -> tuple[Array, Array]:
    """Vertical and horizontal angles in degrees of a lamp that hangs straight, plane 0 along +X, 90 along -Z."""
    return np.degrees(np.arccos(-way[:, 1])), np.degrees(np.arctan2(-way[:, 2], way[:, 0])) % 360


@pytest.mark.parametrize("name", CASES)
def test_every_symmetry_is_filled_in(name: str, tmp_path: Path) -> None:
    """The functions are smooth, so that their tables, bilinear, are within 2 % of them."""
    candela, vertical, horizontal = CASES[name]
    path = tmp_path / "a.ies"
    path.write_text(text(candela, vertical, horizontal))
    found, peak = profile(path)
    ways = directions(4000)
    truth = candela(*angles(ways))
    assert peak == pytest.approx(truth.max(), rel=0.01)
    away_from_edge = np.abs(angles(ways)[0] - 90) > 5
    np.testing.assert_allclose(
        (found.toward(ways) * peak)[away_from_edge], truth[away_from_edge], atol=0.02 * truth.max()
    )
    assert found.solid_angle * peak == pytest.approx(4 * math.pi * truth.mean(), rel=0.01)


def test_the_traced_light_is_the_table_and_its_power_the_lumens(tmp_path: Path) -> None:
    """A lamp in the middle of a cube: every point gets candela, cosine and distance; all walls together get its lumens,
    of which a spot's cone and a bare lamp know their own."""
    path = tmp_path / "a.ies"
    path.write_text(text(lopsided, FULL, np.arange(0.0, 361.0, 15.0)))
    found, peak = profile(path)
    grid = (np.arange(40) + 0.5) / 20 - 1
    u, v = (x.ravel() for x in np.meshgrid(grid, grid))
    walls, points, normals = [], [], []
    for axis in range(3):
        for side in (-1.0, 1.0):
            n, e, f = side * np.eye(3)[axis], np.eye(3)[(axis + 1) % 3], np.eye(3)[(axis + 2) % 3]
            walls.append(quad(n, e, f))
            points.append(n + u[:, None] * e + v[:, None] * f)
            normals.append(np.broadcast_to(-n, (len(u), 3)))
    at, facing = np.concatenate(points), np.concatenate(normals)
    tracer = Tracer(join(*walls), RenderSettings(spp=4, max_depth=1))
    d = np.linalg.norm(at, axis=1)
    cosine = -(at * facing).sum(axis=1) / d

    def walls_get(lamp: PointLight | SpotLight) -> Array:
        return tracer.point_layers(Lighting(lights=(lamp,)), at, facing, 4).direct[0, :, 1].astype(np.float64)

    middle = np.zeros(3)
    light = walls_get(PointLight(name="lamp", position=middle, intensity=700.0, profile=found))
    np.testing.assert_allclose(light, 700 * found.toward(at / d[:, None]) * cosine / d**2, rtol=2e-3)
    np.testing.assert_allclose(light, 700 * lopsided(*angles(at / d[:, None])) / peak * cosine / d**2, rtol=0.03)
    assert light.mean() * 24 == pytest.approx(700 * found.solid_angle, rel=2e-3)
    bare = walls_get(PointLight(name="bare", position=middle, intensity=700.0))
    assert bare.mean() * 24 == pytest.approx(700 * 4 * math.pi, rel=2e-3)
    law: ConeLaw
    for law in ("khr", "playcanvas"):
        spot = SpotLight(name="s", position=middle, direction=np.array([0.3, -1.0, 0.2]), intensity=700.0, cone=law)
        expected = 700 * cones.solid_angle(law, spot.inner_cone_angle, spot.outer_cone_angle)
        assert walls_get(spot).mean() * 24 == pytest.approx(expected, rel=3e-3)
        along = spot.direction
        both = replace(spot, profile=IesProfile(share=found.share, nadir=along, zero=np.cross(along, [1.0, 0, 0])))
        assert both.profile is not None
        ways = at / d[:, None]
        cone = partial(cones.share, law, spot.inner_cone_angle, spot.outer_cone_angle)
        light = walls_get(both)
        np.testing.assert_allclose(
            light, 700 * both.profile.toward(ways) * cone(ways @ along) * cosine / d**2, rtol=3e-3, atol=1e-2
        )
        assert light.mean() * 24 == pytest.approx(700 * both.profile.solid_angle_in(cone), rel=3e-3)


def test_on_a_floor_turned_lamps_keep_their_table(tmp_path: Path) -> None:
    """Nadir along a slanted way and plane 0 across it; beside it a lamp without a profile, and one with another."""
    path = tmp_path / "a.ies"
    path.write_text(text(halves, FULL, np.arange(0.0, 181.0, 10.0)))
    nadir, zero = np.array([0.6, -0.8, 0.0]), np.array([0.0, 0.0, 1.0])
    found, peak = profile(path, nadir=nadir, zero=zero)
    lamp = PointLight(name="lamp", position=np.array([0.0, 4, 0]), intensity=peak, profile=found)
    camera = overhead(48, 32, extent=12.0)

    def brightness(points: Array) -> Array:
        way = points - lamp.position
        d2 = (way**2).sum(axis=-1)
        way = way / np.sqrt(d2)[..., None]
        up = -nadir
        theta = np.degrees(np.arccos(way @ nadir))
        phi = np.degrees(np.arctan2(way @ np.cross(up, zero), way @ zero)) % 360
        return np.asarray(GRAY * halves(theta, phi) * -way[..., 1] / d2)

    truth = floor_mean(camera, brightness)
    np.testing.assert_allclose(render(FLOOR, camera, lamp, spp=64).beauty[..., 1], truth, rtol=0.02)
    path.write_text(text(quarters, HALF, np.arange(0.0, 91.0, 7.5)))
    other, _ = profile(path)
    beside = PointLight(name="other", position=np.array([2.0, 3, 1]), intensity=9.0, profile=other)
    bare = PointLight(name="bare", position=np.array([-2.0, 3, 1]), intensity=9.0)
    together = render(FLOOR, camera, bare, lamp, beside, spp=64)
    apart = [render(FLOOR, camera, x, spp=64).beauty for x in (bare, lamp, beside)]
    np.testing.assert_allclose(together.beauty, sum(apart), rtol=1e-4)


# --- files and jobs --------------------------------------------------------------------------------------------------

GOOD = text(plain, FULL, np.array([0.0]))


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ("", "no line TILT="),
        ("IESNA:LM-63-2002\n1 2 3\n", "no line TILT="),
        (GOOD.replace("TILT=NONE", "TILT=lamp.tlt"), "its tilt stands in another file"),
        (text(plain, FULL, np.array([0.0]), kind=2), "photometry of type B; only type C"),
        (GOOD.rsplit(" ", 3)[0], "numbers after TILT, and more are promised"),
        (GOOD.replace(" 19 1 1 2 ", " 19 1e9 1 2 "), "1e+09 horizontal angles"),
        (GOOD.replace(" 19 1 1 2 ", " -3 1 1 2 "), "-3 vertical angles"),
        (GOOD.replace(" 19 1 1 2 ", " nan 1 1 2 "), "numbers that are not finite"),
        (GOOD.replace("0 10 20", "0 20 10"), "angles that do not rise"),
        (GOOD.replace("100 100", "100 -1"), "candela that are negative"),
        (GOOD.replace("100 100", "100 1e300"), "candela that are negative or too large"),
        (text(lambda t, p: 0 * t, FULL, np.array([0.0])), "without light"),
        (GOOD.replace("100 100", "100 one"), "words where numbers"),
        (text(plain, FULL, np.array([30.0, 60.0])), "horizontal angles from 30 to 60"),
    ],
)
def test_broken_files_are_one_line(content: str, said: str, tmp_path: Path) -> None:
    path = tmp_path / "a.ies"
    path.write_text(content)
    with pytest.raises(InputError) as told:
        read_ies(path)
    assert said in str(told.value) and str(path) in str(told.value) and "\n" not in str(told.value)


@pytest.mark.parametrize(
    ("edition", "peak"),
    [
        ("IES:LM-63-2019", 90.0),  # 1.10000: made from an accredited test, and no factor
        ("ies:lm-63-2019", 90.0),
        ("IESNA:LM-63-2002", 99.0),
        ("IESNA:LM-63-1995", 99.0),
        ("IESNA91", 99.0),
        ("[TEST] of 1986, which has no line of its own", 99.0),
    ],
)
def test_the_number_behind_the_ballast_is_a_factor_before_2019_alone(edition: str, peak: float, tmp_path: Path) -> None:
    path = tmp_path / "a.ies"
    lines = [edition, "TILT=NONE", "1 1000 1 2 1 1 2 0 0 0", "0.9 1.10000 40", "0 90", "0", "100 100", ""]
    path.write_text("\n".join(lines))
    assert read_ies(path).peak == pytest.approx(peak)


def test_bytes_that_are_no_text_and_tilts_that_are_inside(tmp_path: Path) -> None:
    path = tmp_path / "a.ies"
    path.write_bytes(bytes(range(256)) * 50)
    with pytest.raises(InputError, match="no line TILT="):
        read_ies(path)
    path.write_text(GOOD.replace("TILT=NONE", "TILT=INCLUDE\n1\n3\n0 45 90\n1 .9 .8").replace("\n", "\r\n"))
    found = read_ies(path)
    assert found.peak == 100 and (found.share == 1).all()


def job(folder: Path, lamp: str) -> Path:
    (folder / "a.ies").write_text(GOOD)
    (folder / "a.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    path = folder / "job.toml"
    camera = "cameras = [{ position = [0, 0, 5], target = [0, 0, 0] }]"
    path.write_text(f'proxy = "a.obj"\n{camera}\n[[lights]]\ntype = "point"\nposition = [0, 3, 0]\n{lamp}\n')
    return path


@pytest.mark.parametrize(
    ("more", "candela"),
    [("", 100.0), ("intensity = 7", 7.0), ('intensity = 500\nunit = "lumen"', 500 / (4 * math.pi))],
)
def test_a_job_takes_the_files_candela_or_its_own(tmp_path: Path, more: str, candela: float) -> None:
    loaded = mirelight.load(job(tmp_path, f'ies = "a.ies"\ndirection = [1, -1, 0]\nturn = 90\n{more}'))
    (lamp,) = loaded.lightings[0].lights
    assert isinstance(lamp, PointLight) and lamp.profile is not None and "a.ies" in loaded.inputs
    assert lamp.intensity == pytest.approx(candela, rel=1e-4)
    np.testing.assert_allclose(lamp.profile.nadir, np.array([1, -1, 0]) / 2**0.5)
    np.testing.assert_allclose(lamp.profile.zero, [0, 0, -1], atol=1e-12)  # from plane 0 along +X to plane 90


@pytest.mark.parametrize(
    ("lamp", "said"),
    [
        ('ies = "gone.ies"', "there is no file 'gone.ies'"),
        ('ies = "a.obj"', "no line TILT="),
        ("turn = 3", "turn: turn of a light that is the same all around; leave it out, or add ies"),
        ('ies = "a.ies"\nunit = "watt"', "unit: watt of a measured light"),
    ],
)
def test_wrong_lamps_are_said(tmp_path: Path, lamp: str, said: str) -> None:
    with pytest.raises(MirelightError) as told:
        mirelight.load(job(tmp_path, lamp))
    assert said in str(told.value)


def test_a_data_set_keeps_the_table(tmp_path: Path) -> None:
    path = tmp_path / "a.ies"
    path.write_text(text(lopsided, FULL, np.arange(0.0, 361.0, 15.0)))
    lamp = PointLight(name="lamp", position=np.zeros(3), profile=profile(path, zero=np.array([0.0, 0.0, 1.0]))[0])
    again = records.made(PointLight, json.loads(json.dumps(records.packed(lamp))))
    assert digest(again) == digest(lamp)


def test_a_spot_takes_a_file_along_its_axis_and_lumens_through_its_cone(tmp_path: Path) -> None:
    spot = job(tmp_path, 'ies = "a.ies"\nintensity = 500\nunit = "lumen"\nouter_cone_angle = 30\nturn = 90')
    spot.write_text(spot.read_text().replace('"point"', '"spot"\ntarget = [3, 0, 0]'))
    (lamp,) = mirelight.load(spot).lightings[0].lights
    assert isinstance(lamp, SpotLight) and lamp.profile is not None
    np.testing.assert_allclose(lamp.profile.nadir, np.array([1, -1, 0]) / 2**0.5)
    np.testing.assert_allclose(lamp.profile.zero, [0, 0, -1], atol=1e-12)
    whole = cones.solid_angle("khr", 0.0, math.radians(30))  # the file is the same all around
    assert lamp.intensity == pytest.approx(500 / whole, rel=1e-3)
    _, said = to_engine(
        Lighting(lights=(lamp,)), ProxyMesh(vertices=np.eye(3, dtype=np.float32), faces=np.array([[0, 1, 2]]))
    )
    assert any("no IES profile" in line and "cone" in line for line in said)
    for line in ("turn = 5", 'ies = "a.ies"\nunit = "watt"'):
        wrong = job(tmp_path, line)
        wrong.write_text(wrong.read_text().replace('"point"', '"spot"\ntarget = [3, 0, 0]'))
        with pytest.raises(InputError, match=r"lights\[0\]\.(turn|unit)"):
            mirelight.load(wrong)


def test_lights_json_holds_the_table_in_the_data_sets_axes(tmp_path: Path) -> None:
    path = tmp_path / "a.ies"
    path.write_text(text(lopsided, FULL, np.arange(0.0, 361.0, 15.0)))
    found, _ = profile(path, zero=np.array([0.0, 0.0, 1.0]))
    world = np.diag([2.0, 2.0, 2.0, 1.0]) @ np.array([[1.0, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]])
    cone = SpotLight(name="s", position=np.zeros(3), direction=np.array([0.0, -1, 0]), cone="playcanvas", profile=found)
    written = rig._light(cone, world)
    np.testing.assert_allclose(written["ies"]["nadir"], [0, 0, -1], atol=1e-12)
    np.testing.assert_allclose(written["ies"]["zero"], [0, -1, 0], atol=1e-12)
    assert written["cone"] == "playcanvas"
    np.testing.assert_allclose(written["ies"]["share"], found.share, atol=1e-5)
    again = records.made(SpotLight, json.loads(json.dumps(records.packed(cone))))
    assert digest(again) == digest(cone)
    path.write_text(GOOD)
    alike = PointLight(name="p", position=np.zeros(3), profile=profile(path)[0])
    assert len(rig._light(alike, world)["ies"]["share"]) == 1
    assert "ies" not in rig._light(replace(alike, profile=None), world)

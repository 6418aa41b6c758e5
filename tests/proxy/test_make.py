"""Proxies of splats whose surface is known exactly, and captures that have none."""

from __future__ import annotations

import importlib
import warnings
from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from mirelight.base.errors import InputError
from mirelight.lighting.sight import Sight
from mirelight.model import Camera, ProxyMesh, SplatCloud
from mirelight.proxy import MadeProxy, ProxySettings, make
from mirelight.proxy.capture import look_at_capture
from mirelight.proxy.depth import footprint
from mirelight.proxy.tuning import TUNING

from .clouds import ball, box_shell, fog, joined

BALL = 12_000  # splats


def trained(cloud: SplatCloud) -> SplatCloud:
    """As an optimiser leaves them: what is behind a splat shows through."""
    return replace(cloud, opacities=np.full(len(cloud), 0.8, np.float32))


@cache
def made_ball() -> MadeProxy:
    return make(trained(ball(BALL)))


def volume(mesh: ProxyMesh) -> float:
    """Of a closed mesh; positive where its faces look outwards."""
    a, b, c = (mesh.vertices[mesh.faces[:, k]].astype(np.float64) for k in range(3))
    return float((a * np.cross(b, c)).sum() / 6)


def test_a_ball_of_splats_becomes_a_ball() -> None:
    mesh = made_ball().mesh
    assert made_ball().method == "depth" and made_ball().guessed == 0
    radius = np.linalg.norm(mesh.vertices.astype(np.float64), axis=1)
    spacing = np.sqrt(4 * np.pi / BALL)
    assert np.abs(radius - 1).max() < spacing  # discs stand out of a ball, by a part of their size
    assert volume(mesh) == pytest.approx(4 / 3 * np.pi, rel=0.06)


def test_a_ball_is_covered_without_gaps_and_leaks() -> None:
    quality = made_ball().quality
    assert quality.uncovered < 0.06  # discs stand out of the ball's outline by a part of their size, the mesh does not
    assert quality.leaks < 0.01
    assert quality.gap_median < 0.002 * quality.size
    assert quality.fits


def test_what_lies_closer_than_two_pixels_has_cells_of_their_size(monkeypatch: pytest.MonkeyPatch) -> None:
    making = importlib.import_module("mirelight.proxy.make")
    monkeypatch.setattr(making, "TUNING", replace(TUNING, view_pixels=48, make_fewest_pixels=48))
    side = 0.6 * 2 * 2 / 48  # of a cell, of a ball of radius 1
    found = len(make(ball(6000)).mesh.faces) * side**2 / (2 * 4 * np.pi)
    assert 0.6 < found < 1.3  # 2.9 by how close they lie


@pytest.mark.parametrize(("thick", "discs"), [(0.0, True), (0.3, False)])
def test_flat_splats_are_discs_where_hardly_any_is_thick(thick: float, discs: bool) -> None:
    cloud = ball(thin=0.05)
    scales = cloud.scales.copy()
    scales[: int(thick * len(cloud)), 2] *= 10
    assert look_at_capture(replace(cloud, scales=scales), "ball").surfels == discs


@pytest.mark.parametrize("unlike", ["turned", "at all heights"])
def test_flat_splats_about_a_surface_are_no_discs(unlike: str) -> None:
    cloud, rng = ball(thin=0.01), np.random.default_rng(0)
    if unlike == "turned":  # as optimisers that flatten splats leave them (2DGS)
        turned = rng.normal(size=cloud.quats.shape)
        cloud = replace(cloud, quats=(turned / np.linalg.norm(turned, axis=1, keepdims=True)).astype(np.float32))
    else:
        spacing = look_at_capture(cloud, "ball").spacing
        heights = rng.normal(size=(len(cloud), 1)) * spacing
        cloud = replace(cloud, means=(cloud.means * (1 + heights)).astype(np.float32))
    assert not look_at_capture(cloud, "ball").surfels


def test_the_side_of_a_pixel_where_points_lie() -> None:
    camera = Camera.look_at((0, 0, 5), (0, 0, 0), 100, 50, yfov=60)
    there = np.array([[0, 0, 0], [0.5, 0, 0], [0, 0, 9], [50, 0, 0]], np.float32)  # one behind it, one beside it
    assert footprint([camera], there) == pytest.approx(5 / camera.fx)
    assert footprint([camera], there[2:]) == 0


def test_the_same_bits_on_any_number_of_threads_and_far_from_the_origin_at_its_place() -> None:
    away = ball(800, centre=(300, -20, 5))
    one, two = (make(away, ProxySettings(threads=n)).mesh for n in (1, 2))
    np.testing.assert_array_equal(one.vertices, two.vertices)
    np.testing.assert_array_equal(one.faces, two.faces)
    np.testing.assert_allclose((one.bounds[0] + one.bounds[1]) / 2, (300, -20, 5), atol=0.03)


def test_fewer_triangles_are_still_the_ball() -> None:
    mesh = make(trained(ball(BALL)), ProxySettings(triangles=2000)).mesh
    assert 1000 < len(mesh.faces) <= 2100
    assert volume(mesh) == pytest.approx(volume(made_ball().mesh), rel=0.01)
    assert np.linalg.norm(mesh.vertices, axis=1).min() > 0.98


def test_a_floor_seen_from_both_sides_is_one_sheet_under_what_stands_on_it() -> None:
    """A thin floor averages to nothing if both its sides count."""
    floor = box_shell(4, 0.05, thin=0.3, faces=(2,))
    box = box_shell(1, 0.05, thin=0.3)
    cloud = joined(floor, moved(box, (0, -1.4, 0)))
    quality = make(cloud).quality
    assert quality.uncovered < 0.08
    assert quality.gap_median < 0.004 * quality.size


def test_what_stands_in_a_closed_room_is_there() -> None:
    """No view from around sees it, so views from inside are taken."""
    room = box_shell(4, 0.07, thin=0.3)
    table = box_shell(1, 0.05, thin=0.3)
    mesh = make(trained(joined(room, moved(table, (0.3, -1.4, 0.2))))).mesh
    inner = np.abs(mesh.vertices - np.array((0.3, -1.4, 0.2))).max(axis=1)
    top = (inner < 0.6) & (mesh.vertices[:, 1] > -0.95) & (mesh.vertices[:, 1] < -0.85)
    assert top.sum() > 50
    ways = np.array([[x, y, z] for x in (-0.3, 0.1, 0.3) for y in (-0.3, 0.1, 0.3) for z in (-1.0, 1.0)])
    eye = np.array((-1.0, 0.6, -1.1))
    for axis in range(3):  # walls where they are, seen from within
        face, distance = Sight(mesh).first_hits(eye, np.roll(ways, axis + 1, axis=1))
        assert (face >= 0).all()
        hit = eye + np.roll(ways, axis + 1, axis=1) * distance[:, None]
        np.testing.assert_allclose(np.abs(hit).max(axis=1), 2, atol=0.07)  # a spacing
    down = Sight(mesh).first_hits(np.array((0.3, 1.0, 0.2)), np.array([[0.0, -1.0, 0.0]]))[1]
    assert down[0] == pytest.approx(1.9, abs=0.05)


def moved(cloud: SplatCloud, by: tuple[float, float, float]) -> SplatCloud:
    return replace(cloud, means=cloud.means + np.array(by, np.float32))


# --- captures without a surface --------------------------------------------------------------------------------------


def scaled(cloud: SplatCloud, by: float) -> SplatCloud:
    return replace(cloud, means=cloud.means * np.float32(by), scales=cloud.scales * np.float32(by))


BAD: dict[str, tuple[Callable[[], SplatCloud], str]] = {
    "two splats": (lambda: ball(2), "2 splats, too few"),
    "all transparent": (lambda: replace(ball(), opacities=np.zeros(4000, np.float32)), "0 of 4000 splats show"),
    "a million units away": (lambda: ball(centre=(1e6, 0, 0)), "from the origin"),
    "all in one place": (lambda: replace(ball(), means=np.ones((4000, 3), np.float32)), "in one place"),
    "fog": (lambda: fog(0.05), "no surface"),
    "next to no size": (lambda: scaled(ball(), 1e-18), "it is 5.17e-18 units in size; scale it up"),
    "splats of no size": (lambda: replace(ball(), scales=np.full((4000, 3), 1e-20, np.float32)), "no surface"),
}


@pytest.mark.parametrize("case", BAD)
def test_a_capture_without_surface_is_refused_in_one_line(case: str) -> None:
    cloud, said = BAD[case]
    with pytest.raises(InputError, match=said) as caught, warnings.catch_warnings(action="error"):
        make(cloud(), source="capture.ply")
    assert str(caught.value).startswith("capture.ply: ")
    assert "\n" not in str(caught.value)

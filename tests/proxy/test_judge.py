"""A mesh judged against its splats: right, turned, moved, scaled, with holes."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from mirelight.base import conventions
from mirelight.cli.proxy import table
from mirelight.io.mesh import transform
from mirelight.model import Camera, ProxyMesh, SplatCloud
from mirelight.proxy import judge
from mirelight.proxy.advice import best_guess
from mirelight.proxy.capture import look_at_capture
from mirelight.proxy.views import turned

from .clouds import on_surface
from .looked_at import once
from .meshes import split

CORNERS = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
SIDES = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
BLOCKS = (
    ((0.2, 0.1, -0.3), (2.0, 0.5, 0.8)),
    ((0.2, 0.6, -0.3), (0.4, 1.2, 0.8)),
)  # an L that no half turn maps to itself


@pytest.fixture(autouse=True, scope="module")
def _looked_at_once() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        once(patch)
        yield


def mesh() -> ProxyMesh:
    """Two boxes: corner and size."""
    quads = np.array(SIDES)
    faces = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    vertices = np.concatenate([np.array(low) + CORNERS * size for low, size in BLOCKS])
    both = np.concatenate([faces, faces + 8])
    return ProxyMesh(vertices=vertices.astype(np.float32), faces=both.astype(np.int32))


@cache
def splats(thin: float = 0.2) -> SplatCloud:
    """Flat splats all over both boxes."""
    step = 0.04
    points, normals = [], []
    for low, size in BLOCKS:
        for axis in range(3):
            others = [k for k in range(3) if k != axis]
            u, v = np.meshgrid(*(np.arange(step / 2, size[k], step) for k in others), indexing="ij")
            for end in (0.0, 1.0):
                p = np.empty((u.size, 3))
                p[:, others[0]], p[:, others[1]], p[:, axis] = u.ravel(), v.ravel(), end * size[axis]
                n = np.zeros_like(p)
                n[:, axis] = 1
                points.append(p + low)
                normals.append(n)
    return on_surface(np.concatenate(points), np.concatenate(normals), 0.6 * step, thin=thin)


def test_the_right_mesh_fits() -> None:
    quality = judge(splats(), mesh())
    assert quality.uncovered < 0.06
    assert quality.gap_median < 1e-3 * quality.size
    assert quality.leaks < 0.01
    assert quality.fits
    assert quality.triangles == 24


@pytest.mark.parametrize("turn", [(180, 0, 0), (0, 180, 0), (0, 0, 180), (90, 0, 0), (0, 0, -90)])
def test_a_turned_mesh_is_told_how_to_turn_back(turn: tuple[int, int, int]) -> None:
    back = conventions.compose(rotation=conventions.rotation_from_euler(turn).T)
    quality = judge(splats(), transform(mesh(), back))
    assert quality.uncovered > 0.2
    assert f"rotation_euler = [{turn[0]}, {turn[1]}, {turn[2]}]" in quality.advice[-1]


@pytest.mark.parametrize("turn", [(180, 0, 0), (0, 180, 0), (0, 0, 180), (0, 90, 0)])
def test_a_turn_is_found_though_much_of_the_mesh_was_never_captured(turn: tuple[int, int, int]) -> None:
    """A wall behind the camera: two fifths of the mesh's area, with no splat near it."""
    wall = np.array([(-1, 0, 3.5), (2, 0, 3.5), (2, 2, 3.5), (-1, 2, 3.5)], np.float32)
    faces = np.concatenate([mesh().faces, 16 + np.array([(0, 1, 2), (0, 2, 3)], np.int32)])
    right = ProxyMesh(vertices=np.concatenate([mesh().vertices, wall]), faces=faces)
    wrong = transform(right, conventions.compose(rotation=conventions.rotation_from_euler(turn).T))
    capture = look_at_capture(splats(), "splats")
    pose = best_guess(capture, wrong.vertices - capture.middle, wrong.faces.astype(np.int64))
    back = turned(wrong.vertices - capture.middle, pose[:3, :3]) + pose[:3, 3] + capture.middle
    np.testing.assert_allclose(back, right.vertices, atol=1e-5)


def test_a_mesh_in_centimetres_is_told_its_scale() -> None:
    quality = judge(splats(), transform(mesh(), conventions.compose(scale=100)))
    assert "scale = 0.01" in quality.advice[-1]


def test_a_moved_mesh_is_told_by_how_much() -> None:
    quality = judge(splats(), transform(mesh(), conventions.compose((1.5, 0, -0.5))))
    assert "moved: try transform.translation = [-1.5" in quality.advice[-1]


def test_a_mesh_of_something_else_is_not_explained_away() -> None:
    flat = np.array([[-9, 0.3, -9], [9, 0.3, -9], [9, 0.3, 9], [-9, 0.3, 9]], np.float32)
    quality = judge(splats(), ProxyMesh(vertices=flat, faces=np.array([[0, 1, 2], [0, 2, 3]], np.int32)))
    assert quality.leaks > 0.3
    assert "nothing simple explains it" in quality.advice[-1]
    (fitted,), (made,) = ([x for x in table(quality, own=own) if "see the heat map" in x] for own in (False, True))
    assert "leave out --fit" in fitted and "--fit" not in made  # what was done is not what to try


def test_what_is_missing_counts_as_uncovered() -> None:
    whole = mesh()
    lower = replace(whole, faces=whole.faces[:12])
    quality = judge(splats(), lower)
    assert 0.2 < quality.uncovered < 0.7
    assert "off the proxy" in quality.advice[0]


def test_a_rough_mesh_is_told_to_wave() -> None:
    """Where it lies is right in the mean; its normals are not."""
    sides = [Camera.look_at(way, (1.2, 0.6, 0.1), 160, 90, yfov=40) for way in ((1.2, 1.5, 5), (1.2, 5, 2), (6, 3, 3))]
    fine = split(mesh(), 4)
    _, place = np.unique(fine.vertices, axis=0, return_inverse=True)
    noise = np.random.default_rng(0).normal(size=(int(place.max()) + 1, 3))[place.ravel()]
    rough = replace(fine, vertices=(fine.vertices + 0.02 * noise).astype(np.float32))
    right, wrong = (judge(splats(), x, sides) for x in (fine, rough))
    assert right.wavy < 0.5 and right.fits
    assert wrong.wavy > 10 and "it waves" in wrong.advice[0]


def test_pictures_tell_where_a_mesh_is_off() -> None:
    """Patchy splats, as seen from six places, and a mesh that stands 1.1 % of the size behind them.

    Discs cover those behind them, so pictures agree a third of a spacing before their plane.
    """
    cloud = splats()
    patches = np.sin(cloud.means @ np.random.default_rng(0).normal(0, 18, (3, 12))).sum(axis=1)[:, None, None]
    cloud = replace(cloud, sh=(0.4 * patches * np.ones((1, 1, 3))).astype(np.float32))
    eyes = [(1.2 + x, 1 + y, 4) for x in (-2, 0, 2) for y in (0, 2)]
    took = [Camera.look_at(eye, (1.2, 0.4, 0.5), 192, 108, yfov=25) for eye in eyes]
    right, off = (
        judge(cloud, transform(mesh(), conventions.compose((0, 0, z))), took[:1], captured=took).pictures
        for z in (0.0, -0.03)
    )
    assert off.explained < right.explained - 0.05
    assert off.apart == pytest.approx(right.apart + 0.03, abs=0.012)
    assert off.splats_apart == right.splats_apart  # which no mesh is in


def test_a_mesh_without_faces_covers_nothing() -> None:
    quality = judge(splats(), replace(mesh(), faces=np.zeros((0, 3), np.int32)))
    assert quality.uncovered == 1
    assert np.isnan(quality.gap_median)
    assert quality.advice


@pytest.mark.parametrize("projection", ["perspective", "orthographic"])
def test_the_gap_is_the_distance_along_the_view(projection: str) -> None:
    """Seen head on, a mesh 0.1 before the splats has a gap of 0.1 where splats are not hidden by nearer ones."""
    camera = Camera.look_at((1.2, 0.35, 9), (1.2, 0.35, 0), 200, 200, yfov=20)
    if projection == "orthographic":
        camera = replace(camera, projection="orthographic", fx=60.0, fy=60.0)
    quality = judge(splats(), transform(mesh(), conventions.compose((0, 0, 0.1))), [camera])
    assert quality.views == 1
    assert quality.gap_median == pytest.approx(0.1, rel=0.03)


def test_the_heat_map_shows_every_view() -> None:
    quality = judge(splats(), replace(mesh(), faces=mesh().faces[:12]))
    red = (quality.heat[..., 0] > 180) & (quality.heat[..., 1] < 100) & (quality.heat[..., 2] < 100)
    height, width = quality.heat.shape[:2]
    assert quality.views == 12
    for row in range(3):
        assert red[row * height // 3 : (row + 1) * height // 3].any()
    assert red[:, : width // 4].any()


def test_splats_that_float_are_told_though_the_mesh_fits() -> None:
    cloud = splats()
    rng = np.random.default_rng(0)
    low, high = cloud.means.min(axis=0) - 0.5, cloud.means.max(axis=0) + 0.5
    rows = rng.integers(0, len(cloud), 2 * len(cloud))
    every = np.concatenate([np.arange(len(cloud)), rows])
    veil = np.concatenate([np.ones(len(cloud)), np.full(len(rows), 0.06)])  # fog that hides nothing
    means = np.concatenate([cloud.means, rng.uniform(low, high, (len(rows), 3)).astype(np.float32)])
    fog = replace(
        cloud,
        means=means,
        opacities=(cloud.opacities[every] * veil).astype(np.float32),
        quats=cloud.quats[every],
        scales=cloud.scales[every],
        sh=cloud.sh[every],
    )
    assert judge(cloud, mesh()).fits
    quality = judge(fog, mesh())
    assert "of the splats float" in quality.advice[-1]

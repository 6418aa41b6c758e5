"""A mesh that misfits is moved onto its splats: discs, and what an optimiser makes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from mirelight.base import conventions
from mirelight.base.errors import InputError
from mirelight.io.mesh import transform
from mirelight.model import Camera, ProxyMesh, SplatCloud
from mirelight.proxy import register

from .clouds import box_shell, on_surface, sphere_points
from .meshes import split
from .test_judge import mesh, splats

DISC = 0.1  # of their size: splats so thin are discs, and vertices go to their planes


def off(found: ProxyMesh, right: ProxyMesh) -> float:
    return float(np.linalg.norm(found.vertices.astype(np.float64) - right.vertices, axis=1).max())


POSES: dict[str, NDArray[np.float64]] = {
    "one percent to the side": conventions.compose((0.02, 0.015, -0.01)),
    "half a turn": conventions.compose(rotation=conventions.rotation_from_euler((180, 0, 0))),
    "centimetres": conventions.compose(scale=100),
    "three degrees and two percent": conventions.compose(
        (0.03, 0, 0.02), rotation=conventions.rotation_from_euler((2, 3, -1)), scale=1.02
    ),
}


@pytest.mark.parametrize("pose", POSES)
def test_a_mesh_in_the_wrong_place_comes_back(pose: str) -> None:
    right = split(mesh(), 3)
    found = register(splats(DISC), transform(right, POSES[pose]))
    assert off(transform(right, POSES[pose]), right) > 0.02
    assert off(found, right) < 0.006  # a sixth of the splats' spacing


def test_a_mesh_in_its_place_stays() -> None:
    right = split(mesh(), 2)
    assert off(register(splats(DISC), right), right) < 0.003


@pytest.mark.parametrize("way", (0.06, -0.06))
def test_a_swollen_mesh_shrinks_and_a_shrunk_one_swells(way: float) -> None:
    """Every surface stands off by as much, which no scale and no move of the whole undoes."""
    right = split(mesh(), 3)
    at, place = np.unique(right.vertices, axis=0, return_inverse=True)
    a, b, c = (right.vertices[right.faces[:, k]].astype(np.float64) for k in range(3))
    normals = np.zeros((len(at), 3))
    for k in range(3):
        np.add.at(normals, place.ravel()[right.faces[:, k]], np.cross(b - a, c - a))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    swollen = (right.vertices + way * normals[place.ravel()]).astype(np.float32)
    found = register(splats(DISC), replace(right, vertices=swollen))
    apart = np.linalg.norm(found.vertices.astype(np.float64) - right.vertices, axis=1)
    assert np.quantile(apart, 0.75) < 0.01  # a quarter of the splats' spacing; edges have no one normal


def test_large_triangles_are_moved_as_a_whole() -> None:
    """The corners of a box of twelve triangles look at three sides, and each by itself would be led astray."""
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], np.float32)
    sides = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    right = ProxyMesh(
        vertices=corners,
        faces=np.array([t for a, b, c, d in sides for t in ((a, b, c), (a, c, d))], np.int32),
    )
    found = register(box_shell(2, 0.08, thin=0.05), transform(right, POSES["one percent to the side"]))
    assert off(found, right) < 0.008  # a tenth of the splats' spacing


def test_a_dented_ball_becomes_round() -> None:
    n = sphere_points(6000)
    cloud = on_surface(n, n, 0.03, thin=0.1)
    from scipy.spatial import ConvexHull

    v = sphere_points(1500)
    faces = ConvexHull(v).simplices.astype(np.int32)
    dented = v * (1 + 0.04 * np.sin(5 * v[:, :1]) * np.cos(4 * v[:, 1:2]))
    found = register(cloud, ProxyMesh(vertices=dented.astype(np.float32), faces=faces))
    radius = np.linalg.norm(found.vertices, axis=1)
    assert np.abs(np.linalg.norm(dented, axis=1) - 1).max() > 0.03
    assert np.abs(radius - 1).max() < 0.01  # a fifth of the splats' spacing


def test_seams_do_not_tear_and_attributes_stay() -> None:
    right = split(mesh(), 2)
    uvs = np.random.default_rng(0).random((len(right.vertices), 2)).astype(np.float32)
    moved = transform(replace(right, uvs=uvs), POSES["one percent to the side"])
    found = register(splats(DISC), moved)
    np.testing.assert_array_equal(found.faces, moved.faces)
    np.testing.assert_array_equal(found.uvs, uvs)
    _, before = np.unique(moved.vertices, axis=0, return_inverse=True)
    for place in range(0, int(before.max()), 37):
        own = found.vertices[before.ravel() == place]
        assert (own == own[0]).all()


def test_a_mesh_without_area_is_refused() -> None:
    flat = ProxyMesh(vertices=np.zeros((3, 3), np.float32), faces=np.array([[0, 1, 2]], np.int32))
    with pytest.raises(InputError, match="without area"):
        register(splats(DISC), flat)


def test_a_swollen_mesh_shrinks_onto_what_cameras_see_through_a_fog() -> None:
    """Blobs on a long ellipsoid, faint ones all through it, and a mesh that stands off by a tenth of its thickness."""
    from scipy.spatial import ConvexHull

    ball, long = sphere_points(1500), np.array([2.0, 0.5, 0.7])
    n = ball / long
    n /= np.linalg.norm(n, axis=1, keepdims=True)
    skin = on_surface(ball * long, n, 0.06, thin=0.3)
    inside = np.random.default_rng(0).uniform(0, 0.8, (1500, 1)) * ball * long
    fog = on_surface(inside, n, 0.05, thin=0.8, opacity=0.1)
    cloud = SplatCloud(
        means=np.concatenate([skin.means, fog.means]),
        quats=np.concatenate([skin.quats, fog.quats]),
        scales=np.concatenate([skin.scales, fog.scales]),
        opacities=np.concatenate([skin.opacities, fog.opacities]),
        sh=np.concatenate([skin.sh, fog.sh]),
    )
    faces = ConvexHull(ball).simplices
    corners = ball[faces]
    inward = (np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) * corners[:, 0]).sum(axis=1) < 0
    faces[inward] = faces[inward][:, ::-1]
    swollen = ProxyMesh(vertices=(ball * long + 0.05 * n).astype(np.float32), faces=faces.astype(np.int32))
    cameras = [Camera.look_at(6 * way, (0, 0, 0), 96, 64, yfov=30) for way in np.concatenate([np.eye(3), -np.eye(3)])]
    found = register(cloud, swollen, cameras=cameras)
    apart = ((found.vertices - ball * long) * n).sum(axis=1)
    assert np.abs(apart).max() < 0.015

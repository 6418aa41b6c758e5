"""Normals and areas of triangles, against NumPy's own cross product and by hand."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from mirelight.model import triangles


@pytest.mark.parametrize("kind", [np.float32, np.float64])
def test_normals_are_cross_products_to_the_bit(kind: Any) -> None:
    corners = np.random.default_rng(0).normal(size=(1000, 3, 3)).astype(kind)
    found = triangles.crossed(corners)
    assert found.dtype == kind
    np.testing.assert_array_equal(found, np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]))
    np.testing.assert_allclose(np.linalg.norm(triangles.normals(corners), axis=1), 1, rtol=1e-6)


@pytest.mark.parametrize("kind", [np.float32, np.float64])
def test_a_right_triangle_one_without_area_and_none(kind: Any) -> None:
    corners = np.array([[[1, 1, 1], [4, 1, 1], [1, 5, 1]], [[0, 0, 0], [1, 1, 1], [3, 3, 3]]], kind)
    np.testing.assert_array_equal(triangles.areas(corners), [6, 0])
    np.testing.assert_array_equal(triangles.normals(corners), [[0, 0, 1], [0, 0, 0]])
    assert triangles.areas(corners[:0]).shape == (0,)


def test_distances_are_those_of_the_closest_points() -> None:
    """Against trimesh's; slivers, segments and single points among them."""
    from trimesh.triangles import closest_point

    rng = np.random.default_rng(1)
    corners = rng.normal(size=(3000, 3, 3))
    corners[:500, 2] = corners[:500, 0] + 1e-9 * rng.normal(size=(500, 3))
    corners[500:700, 1] = corners[500:700, 0]
    corners[700:800] = corners[700:800, :1]
    for point in rng.normal(scale=2, size=(8, 3)):
        true = np.linalg.norm(closest_point(corners, np.broadcast_to(point, (len(corners), 3))) - point, axis=1)
        np.testing.assert_allclose(triangles.distances_to(corners, point), true, atol=1e-6)
    flat = np.array([[[0, 0, 0], [1, 0, 0], [0, 1, 0]]], float)
    assert triangles.distances_to(flat, np.array([0.2, 0.2, -3.0])) == 3

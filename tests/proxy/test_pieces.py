"""Which points on a plane are a surface of it, and which a slice of what is round or rough."""

from __future__ import annotations

import numpy as np
import pytest

from mirelight.model import F64
from mirelight.proxy.pieces import Points, surface_rows

TOLERANCE = 0.01
SIDE = np.linspace(-0.4, 0.4, 161)
UP = np.array([0.0, 0, 1])


def of_heights(height: F64, noise: float = 0.0) -> Points:
    """Points over a grid of 0.8 a side at heights (161, 161), in tolerances, with the normals of those."""
    z = TOLERANCE * height
    steep = np.stack([-np.gradient(z, SIDE, axis=0), -np.gradient(z, SIDE, axis=1), np.ones_like(z)], axis=-1)
    normal = (steep / np.linalg.norm(steep, axis=-1, keepdims=True)).reshape(-1, 3)
    x, y = np.meshgrid(SIDE, SIDE, indexing="ij")
    z = z + TOLERANCE * noise * np.random.default_rng(1).uniform(-1, 1, z.shape)
    return Points(np.stack([x, y, z], axis=-1).reshape(-1, 3), normal, np.ones(z.size))


def share(points: Points, offset: float = 0.0) -> float:
    """Of the points about the plane z = offset tolerances, those that are a surface of it."""
    near = np.abs(points.at[:, 2] - offset * TOLERANCE) < TOLERANCE
    rows = np.flatnonzero(near & (points.normal[:, 2] > 0.85))
    return len(surface_rows(points, rows, UP, offset * TOLERANCE, TOLERANCE)) / max(len(rows), 1)


def away() -> F64:
    """(161, 161) distance from the middle, in tolerances."""
    return np.hypot(*np.meshgrid(SIDE, SIDE, indexing="ij")) / TOLERANCE


def test_a_rough_wall_is_one() -> None:
    assert share(of_heights(0 * away(), noise=0.8)) == 1


@pytest.mark.parametrize("radius", [40.0, 100.0])
def test_a_slice_of_a_ball_is_none(radius: float) -> None:
    ball = np.sqrt(np.maximum(radius**2 - away() ** 2, 0.3 * radius**2)) - radius
    assert share(of_heights(ball), offset=-0.5) == 0


def test_a_slice_of_a_beard_is_none_and_a_table_of_its_size_is_one() -> None:
    """Both as rough, and as even; one goes on at a slope of 30 degrees where the other ends."""
    bump = 0.5 * np.sin(0.8 * np.broadcast_to(SIDE[:, None] / TOLERANCE, (161, 161)))
    beard = of_heights(np.where(away() < 15, bump, -0.58 * (away() - 15)))
    table = of_heights(np.where(away() < 15, bump, -40.0))
    assert share(beard) < 0.05
    assert share(table) > 0.8


def test_what_is_large_and_level_is_a_surface_whatever_goes_on_around_it() -> None:
    """A lawn that falls off to all sides."""
    assert share(of_heights(np.where(away() < 36, 0.0, -0.4 * (away() - 36)), noise=0.5)) > 0.9


def test_a_wide_table_that_sags_is_a_surface_and_a_small_one_bent_as_much_is_none() -> None:
    sag = 0.9 * (away() / 40) ** 2
    finer = of_heights(sag / 4)  # four times as many tolerances wide
    rows = np.arange(len(finer.at))
    assert share(of_heights(sag), offset=0.6) == 0
    assert len(surface_rows(finer, rows, UP, 0.15 * TOLERANCE, TOLERANCE / 4)) == len(rows)

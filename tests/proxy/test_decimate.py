"""Fewer triangles: what is flat goes first and for nothing; rims, doors, bars and closed shapes stay."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from mirelight.proxy.decimate import decimated
from mirelight.proxy.types import Soup

F64 = NDArray[np.float64]
N = 20


def sheet(door: bool = False) -> Soup:
    """A wall of one unit in the plane z = 0, N cells along each side; with a door, four cells wide, without those."""
    x = np.linspace(0, 1, N + 1)
    u, v = np.meshgrid(x, x, indexing="ij")
    points = np.stack([u.ravel(), v.ravel(), np.zeros(u.size)], axis=1)
    i, j = (a.ravel() for a in np.meshgrid(np.arange(N), np.arange(N), indexing="ij"))
    kept = ~((i >= 8) & (i < 12) & (j >= 4) & (j < 12)) if door else i >= 0
    a, b = (i * (N + 1) + j)[kept], ((i + 1) * (N + 1) + j)[kept]
    return Soup(points, np.concatenate([np.stack([a, b, b + 1], axis=1), np.stack([a, b + 1, a + 1], axis=1)]))


def box(extent: tuple[float, float, float], at: tuple[float, float, float] = (0, 0, 0), rounds: int = 3) -> Soup:
    import trimesh

    made = trimesh.creation.box(extent)
    for _ in range(rounds):
        made = made.subdivide()
    return Soup(np.asarray(made.vertices, np.float64) + at, np.asarray(made.faces, np.int64))


def ball(rounds: int) -> Soup:
    import trimesh

    made = trimesh.creation.icosphere(rounds)
    return Soup(np.asarray(made.vertices, np.float64), np.asarray(made.faces, np.int64))


def corners(soup: Soup) -> tuple[F64, F64, F64]:
    a, b, c = (soup.vertices[soup.faces[:, k]] for k in range(3))
    return a, b, c


def area(soup: Soup) -> float:
    a, b, c = corners(soup)
    return float(0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())


def volume(soup: Soup) -> float:
    a, b, c = corners(soup)
    return float(np.einsum("ni,ni->n", a, np.cross(b, c)).sum() / 6)


def rims(soup: Soup) -> int:
    """Edges of one face alone."""
    half = np.sort(np.concatenate([soup.faces[:, [0, 1]], soup.faces[:, [1, 2]], soup.faces[:, [2, 0]]]), axis=1)
    return int((np.unique(half, axis=0, return_counts=True)[1] == 1).sum())


@pytest.mark.parametrize(("door", "most", "true"), [(False, 4, 1.0), (True, 16, 1 - 32 / 400)])
def test_a_wall_keeps_its_outline_and_its_door(door: bool, most: int, true: float) -> None:
    found = decimated(sheet(door), most)
    assert len(found.faces) <= most
    assert area(found) == pytest.approx(true, abs=1e-6)
    assert np.cross(*(np.diff(np.stack(corners(found)), axis=0)))[:, 2].min() > 0  # none turned over


def test_a_box_is_a_box_in_twelve_triangles() -> None:
    found = decimated(box((1, 2, 3)), 12)
    assert len(found.faces) == 12 and rims(found) == 0
    assert volume(found) == pytest.approx(6, abs=1e-6)


def test_flat_things_lose_triangles_before_round_and_thin_ones() -> None:
    """A wall of 800 triangles, a bar a hundredth as wide and a ball: all that goes is flat."""
    wall, bar, round_one = sheet(), box((0.01, 1, 0.01), (3, 0, 0)), ball(2)
    parts = (wall, bar, round_one)
    starts = np.cumsum([0, *(len(p.vertices) for p in parts)])
    faces = np.concatenate([p.faces + s for p, s in zip(parts, starts, strict=False)])
    found = decimated(Soup(np.concatenate([p.vertices for p in parts]), faces), len(round_one.faces) + 20)
    middle = found.vertices[found.faces].mean(axis=1)
    on_ball, on_bar = np.linalg.norm(middle, axis=1) > 0.9, middle[:, 0] > 2.9
    of_ball = Soup(found.vertices, found.faces[on_ball & ~on_bar & (np.abs(middle[:, 2]) > 1e-9)])
    of_bar = Soup(found.vertices, found.faces[on_bar])
    assert area(of_bar) == pytest.approx(area(bar), rel=1e-3)
    assert volume(of_bar) == pytest.approx(1e-4, rel=1e-3)
    assert len(of_ball.faces) > 0.9 * len(round_one.faces)


def test_a_closed_shape_stays_closed() -> None:
    whole = ball(4)
    found = decimated(whole, 500)
    assert len(found.faces) <= 500 and rims(found) == 0
    assert area(found) == pytest.approx(area(whole), rel=0.01)
    assert np.abs(np.linalg.norm(found.vertices, axis=1) - 1).max() < 0.02


def test_a_mesh_that_is_small_enough_is_left_alone() -> None:
    whole = sheet()
    assert decimated(whole, len(whole.faces)) is whole


def test_no_part_is_lost() -> None:
    """Each of a hundred small boxes keeps its volume, when no more triangles are left than they need."""
    one = box((0.1, 0.1, 0.1), rounds=1)
    places = np.stack(np.meshgrid(np.arange(10.0), np.arange(10.0), [0.0]), axis=-1).reshape(-1, 3)
    vertices = (one.vertices + places[:, None]).reshape(-1, 3)
    faces = (one.faces + len(one.vertices) * np.arange(100)[:, None, None]).reshape(-1, 3)
    found = decimated(Soup(vertices, faces), 1200)
    assert len(found.faces) == 1200
    assert volume(found) == pytest.approx(0.1, rel=0.01)

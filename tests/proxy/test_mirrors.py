"""Mirrors: told where what lies behind a wall is what stands before it, and nothing else is taken for one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from mirelight.lighting.sight import Sight
from mirelight.model import Camera, ProxyMesh, triangles
from mirelight.proxy.depth import DepthMap
from mirelight.proxy.flats import Flat
from mirelight.proxy.mirrors import mirroring, mirrors_of, straight
from mirelight.proxy.types import Soup
from mirelight.proxy.views import rays

SPACING = 0.05
PANE = (-0.6, 0.6, 0.2, 2.0)  # in the wall z = 0: from, to, bottom, top
F64 = NDArray[np.float64]
QUAD = np.array([[0, 1, 2], [0, 2, 3]])
Box = tuple[tuple[float, float, float], tuple[float, float, float]]  # middle, size
FURNITURE: tuple[Box, ...] = (
    ((1.1, 0.4, 1.5), (0.6, 0.8, 0.5)),
    ((-1.0, 0.3, 2.2), (0.8, 0.6, 0.4)),
    ((0.2, 1.2, 2.6), (0.5, 0.3, 0.3)),
)
OTHER: tuple[Box, ...] = (
    ((0.3, 0.5, -1.0), (0.7, 1.0, 0.4)),
    ((-0.8, 0.4, -1.6), (0.5, 0.8, 0.5)),
    ((0.9, 0.9, -2.2), (0.6, 0.6, 0.4)),
)


def box(middle: tuple[float, float, float], size: tuple[float, float, float]) -> F64:
    """(12, 3, 3) triangles."""
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * np.array(size) / 2 + middle
    sides = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return np.concatenate([corners[list(side)][QUAD] for side in sides])


def room(deep: float, things: tuple[Box, ...]) -> F64:
    """Walls without that in z = 0, and what stands in it; `deep` below 0: behind that wall."""
    return np.concatenate(
        [
            box((0, 1.25, deep / 2), (4, 2.5, abs(deep)))[
                [0, 1, 2, 3, 4, 5, 6, 7, *((10, 11) if deep > 0 else (8, 9))]
            ],
            *(box(*x) for x in things),
        ]
    )


def wall() -> F64:
    """The wall in z = 0, but for the pane."""
    a, b, low, high = PANE
    parts = [(-2, a, 0, 2.5), (b, 2, 0, 2.5), (a, b, 0, low), (a, b, high, 2.5)]
    return np.concatenate(
        [np.array([[p, q, 0.0] for p, q in ((x, d), (r, d), (r, u), (x, u))])[QUAD] for x, r, d, u in parts]
    )


def seen(world: F64, *, over: F64 | None = None, eyes: float = 1.6) -> list[DepthMap]:
    """What cameras show of a world, before the wall and about as far from it as that; a colour for each triangle.

    `over`: what is seen behind the pane instead of what is there.
    """
    every = world if over is None else np.concatenate([world, over])
    vertices = every.reshape(-1, 3).astype(np.float32)
    mesh = ProxyMesh(vertices=vertices, faces=np.arange(len(vertices), dtype=np.int32).reshape(-1, 3))
    colors = np.random.default_rng(3).uniform(0.1, 0.8, (len(world), 3)).astype(np.float32)
    colors = colors if over is None else np.concatenate([colors, colors[: len(over)]])
    sight, normals = Sight(mesh), triangles.normals(mesh.vertices[mesh.faces].astype(np.float64))
    out = []
    for k in range(16):
        turn = 2 * np.pi * k / 16
        eye = np.array([1.2 * np.cos(turn), 1.4 + 0.2 * np.sin(3 * turn), eyes + 0.7 * np.sin(turn)])
        camera = Camera.look_at(eye, (0.3 * np.cos(3 * k), 1.0, 0.0 if k % 3 else 3.0), 120, 80, yfov=65)
        origins, ways = rays(camera)
        face, depth = sight.first_hits(np.broadcast_to(origins, ways.shape).reshape(-1, 3).copy(), ways.reshape(-1, 3))
        normal = normals[face] * -np.sign((normals[face] * ways.reshape(-1, 3)).sum(axis=1))[:, None]
        shape, one = depth.reshape(80, 120), np.ones((80, 120), np.float32)
        depths = np.where(face.reshape(80, 120) >= 0, shape, 0).astype(np.float32)
        turned, shown = (x.reshape(80, 120, 3).astype(np.float32) for x in (normal, colors[face]))
        out.append(DepthMap(camera, shown, one, depths, turned, 0.01 * one, one))
    return out


def flat() -> Flat:
    cell = 2 * SPACING
    size = (round(4 / cell), round(2.5 / cell))
    return Flat(np.array([0.0, 0, 1]), 0.0, np.eye(3)[:2], cell, np.array([-size[0] // 2, 0]), np.ones(size, bool))


def mirrored(world: F64) -> F64:
    return world * [1, 1, -1]


def pane_of(found: Flat) -> tuple[float, float]:
    """Share of the pane that is found, and of what is found that is not of the pane."""
    at, (a, b, low, high) = found.middles[:, :2], PANE
    inside = (at[:, 0] > a) & (at[:, 0] < b) & (at[:, 1] > low) & (at[:, 1] < high)
    there = found.there.ravel()
    return float(there[inside].mean()), float((~inside)[there].mean())


def test_a_second_room_that_is_the_first_turned_over_is_a_mirror() -> None:
    world = np.concatenate([room(3.0, FURNITURE), wall()])
    (found,) = mirrors_of(seen(world, over=mirrored(room(3.0, FURNITURE))), [flat()], SPACING).values()
    whole, beside = pane_of(found)
    assert whole > 0.9
    assert beside < 0.1


def test_another_room_behind_a_doorway_is_none_though_its_walls_stand_as_far() -> None:
    other = room(-3.0, OTHER)
    assert not mirrors_of(seen(np.concatenate([room(3.0, FURNITURE), wall(), other])), [flat()], SPACING)
    empty = room(-2.0, ())
    assert not mirrors_of(seen(np.concatenate([room(3.0, FURNITURE), wall(), empty])), [flat()], SPACING)


def test_where_somebody_stood_behind_the_wall_there_is_a_doorway() -> None:
    world = np.concatenate([room(3.0, FURNITURE), wall()])
    views = seen(world, over=mirrored(room(3.0, FURNITURE)))
    assert mirrors_of(views, [flat()], SPACING)
    behind = replace(views[0], camera=Camera.look_at((0, 1.2, -1.0), (0, 1.2, -3), 120, 80, yfov=65))
    assert not mirrors_of([*views, behind], [flat()], SPACING)


@pytest.mark.parametrize("degrees", [0, 30])
def test_a_rectangle_gets_its_corners_and_a_round_mirror_stays_round(degrees: float) -> None:
    x, y = np.meshgrid(np.arange(60) - 29.5, np.arange(60) - 29.5, indexing="ij")
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    u, v = c * x + s * y, c * y - s * x
    whole = (np.abs(u) < 9) & (np.abs(v) < 14)
    worn = whole & (u - v < 15)  # but for a corner
    made = straight(worn)
    assert (made ^ whole).sum() < 0.03 * whole.sum() < (worn ^ whole).sum()
    disc = x * x + y * y < 15**2
    np.testing.assert_array_equal(straight(disc), disc)


def test_faces_in_the_mirror_are_known() -> None:
    a, b, low, high = PANE
    found = flat()
    inside = (
        (found.middles[:, 0] > a)
        & (found.middles[:, 0] < b)
        & (found.middles[:, 1] > low)
        & (found.middles[:, 1] < high)
    )
    found = replace(found, there=inside.reshape(found.there.shape))
    quads = [
        [(0, 1, 0.01), (0.2, 1, 0.01), (0.2, 1.2, 0.01)],
        [(1, 1, 0), (1.2, 1, 0), (1.2, 1.2, 0)],
        [(0, 1, 0), (0, 1, 0.5), (0, 1.2, 0.5)],
    ]
    soup = Soup(np.array(quads, np.float64).reshape(-1, 3), np.arange(9).reshape(-1, 3))
    assert mirroring(soup, [found], SPACING).tolist() == [True, False, False]

"""Depth maps of a thin wall that is seen from both sides: which side it is taken for."""

from __future__ import annotations

import numpy as np
import pytest

from mirelight.base.progress import quiet
from mirelight.model import Camera, triangles
from mirelight.proxy.depth import DepthMap
from mirelight.proxy.fusion import fuse
from mirelight.proxy.nets import surface_of
from mirelight.proxy.views import rays

WALL, CELL = 0.5, 0.05  # x of the wall


def view(*at: float) -> DepthMap:
    """The wall at x = 0.5, a unit wide and high."""
    camera = Camera.look_at(at, (WALL, 0, 0), 60, 60, yfov=40)
    origins, ways = rays(camera)
    depth = (WALL - origins[..., 0]) / ways[..., 0]
    there = (np.abs((origins + ways * depth[..., None])[..., 1:]) < 0.5).all(axis=-1)
    one = np.ones(depth.shape, np.float32)
    facing = np.array([np.sign(at[0] - WALL), 0, 0], np.float32)
    return DepthMap(
        camera,
        np.zeros((*depth.shape, 3), np.float32),
        one,
        np.where(there, depth, 0).astype(np.float32),
        np.broadcast_to(facing, (*depth.shape, 3)),
        0 * one,
        one,
    )


@pytest.mark.parametrize(("inner", "outer"), [((-3.0, -2.0, 0.0), True), ((-0.9, 0.0, 0.0), False)])
def test_a_hollow_things_side_is_where_it_is_looked_at_from(inner: tuple[float, ...], outer: bool) -> None:
    """One view sees its inner side; if that stands inside, as in a room, the wall is the room's."""
    views = [view(3, y, z) for y, z in ((0.5, 0.5), (0.5, -0.5), (-0.5, 0.5), (-0.5, -0.5))]
    grid = fuse([*views, view(*inner)], np.full(3, 1.0), CELL, quiet)
    x = grid.low[0] + grid.cell * np.unravel_index(grid.nodes, grid.shape)[0]
    beyond = grid.distance[np.abs(x - WALL - CELL) < 0.6 * CELL]
    assert ((beyond > 0) == outer).mean() > 0.9


@pytest.mark.parametrize("high", [0.2, 0.1])
def test_a_floor_is_whole_however_low_it_is_looked_along(high: float) -> None:
    """A pixel's part of it is many cells long, and a ray long beneath it before it is deep."""
    seen = []
    for x in (-0.3, 0.3):
        camera = Camera.look_at((x, high, 3.0), (0, high, 0), 90, 60, yfov=40)
        origins, ways = rays(camera)
        down = ways[..., 1] < 0
        depth = np.where(down, -origins[..., 1] / np.where(down, ways[..., 1], -1), 0)
        there = (np.abs((origins + ways * depth[..., None])[..., [0, 2]]) < 0.9).all(axis=-1) & down
        one = np.ones(depth.shape, np.float32)
        normal = np.broadcast_to(np.array([0, 1, 0], np.float32), (*depth.shape, 3))
        depth = np.where(there, depth, 0).astype(np.float32)
        seen.append(DepthMap(camera, 0 * normal, one, depth, normal, 0 * one, one))
    soup = surface_of(fuse(seen, np.full(3, 1.0), 0.02, quiet))
    assert np.abs(soup.vertices[:, 1]).max() < 0.005
    assert triangles.areas(soup.vertices[soup.faces]).sum() > 0.9 * 1.8**2


def test_a_hollow_things_side_is_where_it_is_looked_at_from_higher_up() -> None:
    """Half of the views look into a plinth from below."""
    outer = [view(3, y, z) for y, z in ((0.5, 0.5), (0.5, -0.5), (-0.2, 0.5), (-0.2, -0.5))]
    inner = [view(-3, -2, z) for z in (-0.6, -0.2, 0.2, 0.6)]
    for up, kept in ((1.0, True), (-1.0, False)):
        grid = fuse([*outer, *inner], np.full(3, 1.0), CELL, quiet, up=np.array([0, up, 0]))
        x = grid.low[0] + grid.cell * np.unravel_index(grid.nodes, grid.shape)[0]
        beyond = grid.distance[np.abs(x - WALL - CELL) < 0.6 * CELL]
        assert ((beyond > 0) == kept).mean() > 0.9

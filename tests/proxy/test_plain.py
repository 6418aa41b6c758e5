"""Plain walls of what is no room: planes through what hangs about them; not through a hedge, whose colours differ."""

from __future__ import annotations

import numpy as np
import pytest

from mirelight.model import Camera
from mirelight.proxy.depth import DepthMap
from mirelight.proxy.flats import flats_of
from mirelight.proxy.plain import plain_of
from mirelight.proxy.views import rays

SPACING, AWAY = 0.03, 3.0


def shown(x: float, *, hedge: bool) -> DepthMap:
    """A sure floor before a wall at z = -3, whose splats hang by six spacings before and behind it."""
    camera = Camera.look_at((x, 1.5, 1.0), (0.3 * x, 1.0, -AWAY), 160, 120, yfov=60)
    origins, ways = rays(camera)
    floor = np.where(ways[..., 1] < -1e-6, -origins[..., 1] / np.minimum(ways[..., 1], -1e-6), np.inf)
    wall = (-AWAY - origins[..., 2]) / np.minimum(ways[..., 2], -1e-6)
    on_wall = wall < floor
    rng = np.random.default_rng(int(10 * x) + 50)
    waves = rng.normal(size=(15, 20)).repeat(8, axis=0).repeat(8, axis=1)
    depth = np.where(on_wall, wall + 6 * SPACING * waves, floor)
    normal = np.where(on_wall[..., None], [0.0, 0, 1], [0.0, 1, 0]) + 0.1 * rng.normal(size=(*depth.shape, 3))
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    green = rng.uniform(0.1, 0.5, depth.shape) if hedge else np.full(depth.shape, 0.7)
    color = np.where(on_wall, green, 0.3)[..., None].repeat(3, axis=2)
    spread = np.where(on_wall, 7 * SPACING, 0.1 * SPACING)
    trust = 1 / (1 + (spread / (2 * SPACING)) ** 2)
    one = np.ones(depth.shape, np.float32)
    return DepthMap(camera, *(a.astype(np.float32) for a in (color, one, depth, normal, spread, trust)))


@pytest.mark.parametrize("hedge", [False, True])
def test_a_plain_wall_is_a_plane_and_a_hedge_is_none(hedge: bool) -> None:
    views = [shown(x, hedge=hedge) for x in np.linspace(-1.5, 1.5, 7)]
    floor = [flat for flat in flats_of(views, SPACING, 10.0) if abs(flat.normal[1]) > 0.99]
    assert len(floor) == 1
    found = plain_of(views, floor, SPACING, 10.0)
    assert len(found) == (0 if hedge else 1)
    if found:
        assert abs(found[0].normal[2]) == pytest.approx(1, abs=5e-3)
        assert abs(found[0].offset) == pytest.approx(AWAY, abs=SPACING)

"""Where a first job's light comes from: the left, unless what is seen faces the right."""

from __future__ import annotations

import numpy as np
import pytest

from mirelight.apps.first_job.lighting import _facing, _towards_light
from mirelight.apps.first_job.view import FirstView
from mirelight.model import Camera, SplatLayer


def wall(turned: float) -> FirstView:
    """A wall, turned by so many degrees towards the right of who looks at it along -Z, from 4 away."""
    camera = Camera.look_at((0, 0, 4), (0, 0, 0), 64, 36, yfov=40)
    normal = np.array([np.sin(np.radians(turned)), 0, np.cos(np.radians(turned))])
    start, way = camera.rays()
    depth = (-(start @ normal) / (way @ normal)).astype(np.float32)
    color, clear = np.zeros((36, 64, 3), np.float32), np.zeros((36, 64), np.float32)
    picture = SplatLayer(camera=camera, color=color, transmittance=clear, depth=depth, median_depth=depth)
    return FirstView(camera, np.zeros(3), False, 0.2, 0.0, 0.0, picture)


@pytest.mark.parametrize(("turned", "side"), [(-50, "left"), (0, "left"), (5, "left"), (50, "right")])
def test_light_comes_from_the_side_that_a_wall_faces(turned: float, side: str) -> None:
    seen = wall(turned)
    normals = _facing(seen)
    assert len(normals) == 34 * 62
    true = [np.sin(np.radians(turned)), 0, np.cos(np.radians(turned))]
    np.testing.assert_allclose(normals, np.broadcast_to(true, normals.shape), atol=1e-4)
    found, way = _towards_light(seen)
    assert found == side
    assert np.linalg.norm(way) == pytest.approx(1)
    assert np.sign(way[0]) == (-1 if side == "left" else 1)
    assert way[1] > 0.5 and way[2] > 0


def test_an_empty_picture_is_lit_from_the_left() -> None:
    seen = wall(0)
    nothing = np.zeros((36, 64), np.float32)
    picture = SplatLayer(
        camera=seen.camera, color=seen.picture.color, transmittance=nothing + 1, depth=nothing, median_depth=nothing
    )
    side, _ = _towards_light(FirstView(seen.camera, seen.target, False, 0.2, 0.0, 0.0, picture))
    assert side == "left"

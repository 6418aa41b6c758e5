"""The side of a disc that was seen: of things the outside, of rooms the inside."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from mirelight.base.progress import quiet
from mirelight.lighting.albedo import face_normals
from mirelight.model import SplatCloud
from mirelight.proxy import ProxySettings
from mirelight.proxy.capture import look_at_capture
from mirelight.proxy.cells import cells_of
from mirelight.proxy.sampling import spread_on

from .clouds import box_shell

F64 = NDArray[np.float64]
ROOM, THING, STEP = 2.0, 0.8, 0.1


def _both_ways(*clouds: SplatCloud) -> SplatCloud:
    """Discs of all clouds, every other one turned over, as captures have them."""
    means, quats, scales, opacities, sh = (
        np.concatenate([getattr(cloud, name) for cloud in clouds])
        for name in ("means", "quats", "scales", "opacities", "sh")
    )
    w, x, y, z = quats[::2].T
    quats[::2] = np.stack([-x, w, z, -y], axis=1)  # half a turn about the disc's own first axis
    return replace(clouds[0], means=means, quats=quats, scales=scales, opacities=opacities, sh=sh)


def _outwards(splats: SplatCloud) -> tuple[F64, F64]:
    """For points spread over the sides of boxes: whether the front shows outwards, as a sign; how far out they lie."""
    soup = cells_of(look_at_capture(splats, "splats"), ProxySettings(), quiet)
    points, face = spread_on(soup.vertices, soup.faces, 5000)
    axis = np.abs(points).argmax(axis=1)[:, None]
    out = np.take_along_axis(face_normals(soup.mesh())[face] * np.sign(points), axis, axis=1)
    flat = np.abs(out[:, 0]) > 0.5  # at edges the side that a point is of is not the one that lies farthest out
    return np.sign(out[flat, 0]), np.abs(points[flat]).max(axis=1)


def test_a_thing_is_seen_from_outside() -> None:
    cosine, _ = _outwards(_both_ways(box_shell(THING, STEP, thin=0.05)))
    assert (cosine > 0).mean() > 0.98


@pytest.mark.parametrize("walls", [(0, 1, 2, 3, 4, 5), (0, 1, 2, 4)], ids=["room", "courtyard"])
def test_what_stands_inside_walls_tells_that_they_were_seen_from_inside(walls: tuple[int, ...]) -> None:
    around, inside = box_shell(ROOM, STEP, thin=0.05, faces=walls), box_shell(THING, STEP, thin=0.05)
    cosine, out = _outwards(_both_ways(around, inside))
    wall = out > (ROOM + THING) / 4
    assert (cosine[wall] < 0).mean() > 0.95
    assert (cosine[~wall] > 0).mean() > 0.95

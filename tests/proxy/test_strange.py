"""Captures that are not as captures are: a mesh without a fault, or a line that says what is wrong."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from mirelight.base.errors import InputError
from mirelight.model import Camera, Deferred
from mirelight.proxy import make
from mirelight.proxy.capture_views import capture_views
from mirelight.proxy.discs import neighbours_of
from mirelight.proxy.rods import _shaped
from mirelight.proxy.slender import Slender

from .clouds import ball, square

RING = tuple(
    Camera.look_at((4 * np.cos(a), 1.5, 4 * np.sin(a)), (0, 0, 0), 64, 48, yfov=40, name=f"{k}")
    for k, a in enumerate(np.linspace(0, 2 * np.pi, 6, endpoint=False))
)


def test_a_rod_without_width_is_none() -> None:
    """As discs tell of that are a thousand times as wide as those beside them: it has no middle of its own."""
    at, normals = square(1, 0.1, 1, 0.0)
    near, distance = neighbours_of(at, 20)
    told = Slender.none_of(len(at))
    told.there[:2], told.axis[:, 0], told.radius[1] = True, 1.0, 0.2
    made = _shaped(told, at, normals, near, distance[:, 5])
    assert list(made.rows) == [1] and np.isfinite(made.ring).all()


def test_cameras_in_other_units_are_said() -> None:
    far = [replace(x, world_from_camera=_scaled(x.world_from_camera, 60)) for x in RING]
    with pytest.raises(InputError, match=r"pictures of its 6 cameras .* are opaque") as refused:
        make(ball(3000), cameras=far)
    assert "give the cameras of this capture" in str(refused.value)


def _scaled(pose: NDArray[np.float64], by: float) -> NDArray[np.float64]:
    out = np.array(pose)
    out[:3, 3] *= by
    return out


def test_pictures_of_another_capture_are_said() -> None:
    """None shows what the splats show; where one does, only the others are left out."""
    cloud = ball(3000)
    pattern = (np.sin(9 * cloud.means) * 0.3).astype(np.float32)[:, None, :]
    cloud = replace(cloud, sh=pattern)
    rng = np.random.default_rng(0)
    others = [np.dstack([rng.uniform(0.01, 0.6, (48, 64, 3)) ** 2, np.ones((48, 64))]).astype(np.float32) for _ in RING]
    said: list[str] = []
    capture_views(cloud, RING, [Deferred.of(x) for x in others], report=said.append)
    assert len(said) == 1 and said[0].startswith("none of the 6 pictures of the capture shows what its splats show")

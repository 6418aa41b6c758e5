"""The splats in front of a depth, against composites of those splats alone."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from mirelight.compositor import Compositor
from mirelight.model import SplatCloud

from .compositor_clouds import PHYSICAL, VIEW, cloud


def some(splats: SplatCloud, chosen: Any) -> SplatCloud:
    arrays = {name: getattr(splats, name)[chosen] for name in ("means", "quats", "scales", "opacities", "sh")}
    return replace(splats, **arrays)


def far_sides(splats: SplatCloud) -> Any:
    """(N,) depth of each splat's centre and one standard deviation along the view axis."""
    back, eye = VIEW.world_from_camera[:3, 2], VIEW.world_from_camera[:3, 3]
    w, x, y, z = splats.quats.astype(np.float64).T
    turn = np.moveaxis(
        np.array(
            [
                [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
                [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
                [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
            ]
        ),
        2,
        0,
    )
    along = np.einsum("i,nij->nj", back, turn) * splats.scales
    return (eye - splats.means) @ back + np.linalg.norm(along, axis=1)


def test_what_lies_in_front_of_a_depth_is_the_composite_of_the_splats_that_do() -> None:
    splats = cloud(degree=1)
    far = far_sides(splats)
    depth = float(np.median(far))
    assert not np.any(np.abs(far - depth) < 1e-5) or len(far) % 2
    limit = np.full((VIEW.height, VIEW.width), depth + 1e-5, np.float32)
    limit[:, : VIEW.width // 3] = 0
    made = Compositor(splats, PHYSICAL).in_front(VIEW, limit)
    wanted = Compositor(some(splats, far < depth + 1e-5), PHYSICAL).composite(VIEW, depth=False)
    here = limit > 0
    assert (made.transmittance[~here] == 1).all() and not made.color[~here].any()
    np.testing.assert_allclose(made.color[here], wanted.color[here], atol=2e-6)
    np.testing.assert_allclose(made.transmittance[here], wanted.transmittance[here], atol=2e-6)
    assert 0.05 < made.transmittance[here].mean() < 0.98


def test_nothing_lies_in_front_of_nothing() -> None:
    made = Compositor(cloud(degree=0), PHYSICAL).in_front(VIEW, np.zeros((VIEW.height, VIEW.width), np.float32))
    assert (made.transmittance == 1).all() and not made.color.any()

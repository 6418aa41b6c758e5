"""Colours of places as means of the splats around them."""

from __future__ import annotations

import numpy as np

from mirelight.base import colour
from mirelight.base.conventions import frame_around, quaternion_from_rotation
from mirelight.base.sh import C0
from mirelight.estimate.around import evened
from mirelight.lighting import Tracer
from mirelight.lighting.observed import Samples, observed
from mirelight.model import F64, ProxyMesh, RenderSettings, SplatCloud
from tests.proxy.clouds import joined


def discs(points: F64, way: F64, color: F64) -> SplatCloud:
    """Flat discs at points (N, 3) that face one way, of colours (N, 3) linear."""
    quat = quaternion_from_rotation(frame_around(way).T).astype(np.float32)
    return SplatCloud(
        means=points.astype(np.float32),
        quats=np.tile(quat, (len(points), 1)),
        scales=np.tile(np.array([0.05, 0.05, 0.001], np.float32), (len(points), 1)),
        opacities=np.full(len(points), 0.9, np.float32),
        sh=((colour.srgb_encode(color) - 0.5) / C0)[:, None].astype(np.float32),
    )


def samples_of(splats: SplatCloud) -> Samples:
    """What they show; neither mesh nor tracer is asked."""
    mesh = ProxyMesh(vertices=np.eye(3, dtype=np.float32), faces=np.array([[0, 1, 2]], np.int32))
    return observed(splats, (), mesh, Tracer(mesh, RenderSettings(), layers=False, aovs=False)).samples


def test_noise_of_single_splats_is_taken_out_and_no_other_plane_mixed_in() -> None:
    """A floor of noisy splats with a wall of another colour at its end."""
    rng = np.random.default_rng(4)
    floor, wall = rng.uniform((0, 0, 0), (1, 0, 1), (1500, 3)), rng.uniform((0, 0, 0), (0, 1, 1), (1500, 3))
    gray = 0.3 * np.exp(0.4 * rng.standard_normal((1500, 1)) - 0.08) * np.ones(3)
    up, aside = np.array([0.0, 1.0, 0.0]), np.array([1.0, 0.0, 0.0])
    splats = joined(discs(floor, up, np.clip(gray, 0, 1)), discs(wall, aside, np.full((1500, 3), 0.9)))
    normals, spread = np.tile(up, (1500, 1)), np.tile(0.05 * np.eye(3)[[0, 2]], (1500, 1, 1))
    made = np.log(evened(samples_of(splats), gray, floor, normals, spread)[:, 0])
    assert made.std() < 0.5 * np.log(gray).std()
    inner = floor[:, 0] > 0.3
    assert abs(made[~inner].mean() - made[inner].mean()) < 0.05


def test_a_place_without_splats_around_keeps_its_colour() -> None:
    splats = discs(np.zeros((3, 3)), np.array([0.0, 1.0, 0.0]), np.full((3, 3), 0.5))
    places, up = np.array([[0.0, 0, 0], [9.0, 0, 0]]), np.tile([0.0, 1.0, 0.0], (2, 1))
    own, spread = np.array([[0.1] * 3, [0.2] * 3]), np.tile(0.05 * np.eye(3)[[0, 2]], (2, 1, 1))
    made = evened(samples_of(splats), own, places, up, spread)
    np.testing.assert_allclose(made, [[0.5] * 3, [0.2] * 3], rtol=1e-5)

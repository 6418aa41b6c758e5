"""The pinholes of a lens against the thin lens' circle of confusion, by projecting points."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mirelight.model import Camera, Exposure

RADIUS, FOCUS = 0.05, 2.0
CAMERA = replace(
    Camera.look_at((1, 2, 3), (0, 0.5, 0), 64, 48, yfov=50),
    exposure=Exposure(aperture_radius=RADIUS, focus_distance=FOCUS),
)


def pixels(depth: float, count: int = 256) -> np.ndarray:
    """(count, 2) where the pinholes see a point on the axis, from where the middle sees it."""
    point = CAMERA.world_from_camera @ [0, 0, -depth, 1]
    found = []
    for one in CAMERA.pinholes(count):
        x, y, z, _ = one.camera_from_world @ point
        found.append((one.cx - one.fx * x / z - CAMERA.cx, one.cy + one.fy * y / z - CAMERA.cy))
    return np.array(found)


@pytest.mark.parametrize("depth", [0.7, 1.5, 6.0])
def test_a_point_spreads_over_the_circle_of_confusion(depth: float) -> None:
    radius = CAMERA.fx * RADIUS * abs(1 / depth - 1 / FOCUS)
    away = np.linalg.norm(pixels(depth), axis=1)
    assert away.max() == pytest.approx(radius, rel=0.01)
    for share in (0.25, 0.5, 0.75):  # evenly: a disc of half the area holds half of them
        assert np.mean(away < radius * share**0.5) == pytest.approx(share, abs=0.01)
    np.testing.assert_allclose(pixels(depth).mean(axis=0), 0, atol=1e-9)


def test_what_is_in_focus_stays_in_its_pixel_and_pinholes_share_the_samples() -> None:
    np.testing.assert_allclose(pixels(FOCUS), 0, atol=1e-9)
    found = CAMERA.pinholes(8)
    assert [x.share for x in found] == [(k, 8) for k in range(8)]
    assert all(x.exposure is None and x.width == CAMERA.width for x in found)
    plain = CAMERA.pinhole
    assert plain.exposure is None and plain.pinholes(8) == (plain,)


def test_an_open_shutter_takes_every_place_once_in_no_order_of_the_lens() -> None:
    ends = np.stack([CAMERA.world_from_camera] * 2)
    ends[1, 0, 3] += 1.6
    found = replace(CAMERA, exposure=Exposure(aperture_radius=RADIUS, focus_distance=FOCUS, poses=ends)).pinholes(16)
    lens = Exposure(aperture_radius=RADIUS, focus_distance=FOCUS).points(16)
    middles = [x.position - (x.world_from_camera[:3, :2] @ point) for x, point in zip(found, lens, strict=True)]
    places = np.array([m[0] - CAMERA.position[0] for m in middles])
    np.testing.assert_allclose(np.sort(places), 0.05 + 0.1 * np.arange(16), atol=1e-9)
    assert abs(np.corrcoef(places, np.linalg.norm(lens, axis=1))[0, 1]) < 0.5


def test_no_lens_without_perspective_or_a_size() -> None:
    with pytest.raises(ValueError, match="perspective"):
        replace(CAMERA, projection="orthographic")
    with pytest.raises(ValueError, match="aperture_radius"):
        Exposure(aperture_radius=-1)

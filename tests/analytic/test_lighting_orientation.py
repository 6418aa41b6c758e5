"""Which way a panorama looks: the tracer's map coordinates against those of other programs, each in its own words.

A map here stores its coordinates (u, v), v from the top; asked is what is seen along a direction of glTF's world.
"""

from __future__ import annotations

import math

import numpy as np
import pytest

from mirelight.base import backend
from mirelight.io.job.placing import environment_rotation
from mirelight.model import Environment

from .lighting_scenes import Array

# Blender 5.0.1, Cycles: an Environment Texture (equirectangular) behind a Mapping node of that Z rotation, seen by a
# camera of 0.2 degrees turned to each direction; directions through the glTF importer's axes (x, -z, y).
BLENDER = {
    0: [
        ((1, 0, 0), 0.5, 0.5),
        ((0, 0, 1), 0.75, 0.5),
        ((0, 0, -1), 0.25, 0.5),
        ((1, 0, -1), 0.375, 0.5),
        ((-1, 0, 0.1), 0.9841, 0.5),
        ((1, 1, 0.5), 0.5738, 0.2677),
        ((0.3, -1, 1), 0.7036, 0.7431),
    ],
    30: [
        ((1, 0, 0), 0.4167, 0.5),
        ((0, 0, 1), 0.6667, 0.5),
        ((0, 0, -1), 0.1667, 0.5),
        ((1, 0, -1), 0.2917, 0.5),
        ((-1, 0, 0.1), 0.9008, 0.5),
        ((1, 1, 0.5), 0.4905, 0.2677),
        ((0.3, -1, 1), 0.6203, 0.7431),
    ],
}
WAYS = np.random.default_rng(0).normal(size=(200, 3))
WAYS /= np.linalg.norm(WAYS, axis=1, keepdims=True)


def ours(ways: Array, rotation: float) -> Array:
    """(N, 2) u and v that the tracer reads along unit directions."""
    mi = backend.mitsuba("llvm_ad_rgb")
    from mirelight.lighting.kernel.sky import Sky

    made = Environment(radiance=np.ones((4, 8, 3), np.float32), rotation=rotation)
    sky = Sky(made)
    u, v = sky.uv(mi.Vector3f(*(mi.Float(np.ascontiguousarray(c, dtype=np.float32)) for c in ways.T)))
    return np.stack([np.asarray(u) % 1, np.asarray(v)], axis=1).astype(np.float64)


def assert_same(found: Array, expected: Array, tolerance: float = 1e-5) -> None:
    apart = np.abs(found - expected)
    apart[:, 0] = np.minimum(apart[:, 0], 1 - apart[:, 0])  # u goes round
    assert apart.max() < tolerance


@pytest.mark.parametrize("turn", BLENDER)
def test_blender(turn: int) -> None:
    """The Mapping node turns the direction that is looked up, so its angle is the negative of the light's rotation."""
    ways = np.array([way for way, _, _ in BLENDER[turn]], np.float64)
    seen = np.array([(u, v) for _, u, v in BLENDER[turn]])
    assert_same(ours(ways / np.linalg.norm(ways, axis=1, keepdims=True), -turn), seen, tolerance=2e-4)


def test_the_khronos_viewer() -> None:
    """glTF Sample Renderer's panorama filter: (0.5 + 0.5 atan(z, x) / pi, 1 - acos(y) / pi), v from the picture's
    bottom; its environment rotation at 0."""
    u = 0.5 + 0.5 * np.arctan2(WAYS[:, 2], WAYS[:, 0]) / np.pi
    v_from_bottom = 1 - np.arccos(WAYS[:, 1]) / np.pi
    assert_same(ours(WAYS, 0), np.stack([u, 1 - v_from_bottom], axis=1))


def test_three_js() -> None:
    """equirectUv of its shader chunk `common`: (atan(z, x) / 2 pi + 0.5, asin(y) / pi + 0.5), v from the bottom."""
    u = np.arctan2(WAYS[:, 2], WAYS[:, 0]) / (2 * np.pi) + 0.5
    v_from_bottom = np.arcsin(WAYS[:, 1]) / np.pi + 0.5
    assert_same(ours(WAYS, 0), np.stack([u, 1 - v_from_bottom], axis=1))


@pytest.mark.parametrize("turn", [0.0, 25.0, -140.0])
def test_playcanvas(turn: float) -> None:
    """At (u, v) its map shines from (-sin phi sin theta, cos theta, cos phi sin theta), phi = (u - 0.5) 2 pi + skybox
    rotation, as measured in the running engine; `orientation = "playcanvas"` takes its angle."""
    u, v = np.meshgrid((np.arange(12) + 0.5) / 12, (np.arange(6) + 0.5) / 6)
    phi, theta = (u - 0.5) * 2 * np.pi + math.radians(turn), v * np.pi
    ways = np.stack([-np.sin(phi) * np.sin(theta), np.cos(theta), np.cos(phi) * np.sin(theta)], axis=-1)
    found = ours(ways.reshape(-1, 3), environment_rotation(turn, "playcanvas"))
    assert_same(found, np.stack([u.ravel(), v.ravel()], axis=1))


def test_mitsuba() -> None:
    """Its `envmap` at identity has +Z in the middle, and +X once turned by 90 degrees about +Y: the oracle's turn."""
    mi = backend.mitsuba("llvm_ad_rgb")
    import drjit as dr

    h, w = 64, 128
    pixels = np.zeros((h, w, 3), np.float32)
    pixels[..., 0] = (np.arange(w) + 0.5) / w
    turn = mi.ScalarTransform4f().rotate([0, 1, 0], 90.0)
    emitter = mi.load_dict({"type": "envmap", "bitmap": mi.Bitmap(pixels), "to_world": turn})
    si = dr.zeros(mi.SurfaceInteraction3f, len(WAYS))
    si.wi = -mi.Vector3f(*(mi.Float(np.ascontiguousarray(c, dtype=np.float32)) for c in WAYS.T))
    seen = np.asarray(emitter.eval(si).numpy())[0]
    expected = ours(WAYS, 0)[:, 0]
    inner = (expected > 0.02) & (expected < 0.98)  # the ramp has a step at the seam
    np.testing.assert_allclose(seen[inner], expected[inner], atol=0.005)

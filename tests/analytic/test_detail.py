"""What mirrors show of a capture: lattices of colours, against the pattern that splats were given."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from mirelight.compositor import Compositor
from mirelight.lighting import detail, lattices
from mirelight.model import Camera, Environment, Lighting, ProxyMesh, RenderSettings, SplatCloud

Array = NDArray[np.float64]
SIDE = 64
LIGHT = 0.6


def pattern(x: Array) -> Array:
    """Albedo of stripes across x, far narrower than the floor's triangles."""
    return np.asarray(0.4 + 0.3 * np.sin(8 * x))


def striped_floor() -> tuple[SplatCloud, ProxyMesh]:
    """A floor of discs in stripes, and a mesh of two gray triangles under it."""
    at = (np.arange(SIDE) + 0.5) / SIDE * 2 - 1
    x, z = (v.ravel() for v in np.meshgrid(at, at))
    count, light = len(x), LIGHT
    flat = np.tile([np.sqrt(0.5), np.sqrt(0.5), 0, 0], (count, 1))  # thin along Y once turned about X
    shown = np.repeat((pattern(x) * light)[:, None], 3, axis=1)
    splats = SplatCloud(
        means=np.stack([x, 0 * x, z], 1).astype(np.float32),
        quats=flat.astype(np.float32),
        scales=np.tile([0.012, 0.012, 1e-4], (count, 1)).astype(np.float32),
        opacities=np.full(count, 0.95, np.float32),
        sh=((shown - 0.5) / 0.28209479177387814)[:, None].astype(np.float32),
        color_space="lin_rec709_display",
    )
    return splats, ProxyMesh(
        vertices=np.array([[-1, 0, -1], [-1, 0, 1], [1, 0, 1], [1, 0, -1]], np.float32),
        faces=np.array([[0, 1, 2], [0, 2, 3]], np.int32),
        vertex_colors=np.full((4, 3), 0.5, np.float32),
        albedo=None,
    )


def test_lattices_hold_the_pattern_of_the_splats(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(detail, "MOST_POINTS", 3000)
    splats, floor = striped_floor()
    sky = Environment(name="sky", radiance=np.full((4, 8, 3), LIGHT, np.float32))
    found = detail.told(
        floor, [(np.array([0.2, 0.3, 0.0]), 0.2)], splats, (), Lighting(name="day", environment=sky), RenderSettings()
    )
    assert lattices.points_of(found.steps).sum() == len(found.colors) <= 3000
    kept = lattices.Detail.unpacked(found.packed())
    assert all(np.array_equal(getattr(kept, k), getattr(found, k)) for k in ("steps", "first", "colors"))

    face, corners = lattices.lattice(found.steps)
    places = (floor.vertices[floor.faces[face]] * corners[:, :, None]).sum(1)
    inside = np.abs(places).max(1) < 0.95
    error = found.colors[inside, 1] - pattern(places[inside, 0])
    assert np.sqrt((error**2).mean()) < 0.03 and abs(error.mean()) < 0.01

    import drjit as dr
    import mitsuba as mi

    from mirelight.lighting.kernel.detail import DeviceDetail

    linear = lattices.Detail(found.steps, found.first, (places @ np.diag([1, 0, 1]) + 2).astype(np.float32))
    rng = np.random.default_rng(3)
    u, v = rng.random((2, 500))
    u, v = np.where(u + v > 1, 1 - u, u), np.where(u + v > 1, 1 - v, v)
    which = rng.integers(0, 3, 500)  # the third has no lattice
    looked = DeviceDetail(linear).of(
        mi.UInt32(which.astype(np.uint32)), mi.Point2f(mi.Float(u), mi.Float(v)), mi.Vector3f(7), dr.ones(mi.Bool, 500)
    )
    weights = np.stack([1 - u - v, u, v], 1)
    truth = (floor.vertices[floor.faces[np.minimum(which, 1)]] * weights[:, :, None]).sum(1)[:, [0, 2]] + 2
    truth[which == 2] = 7
    np.testing.assert_allclose(np.array(looked)[[0, 2]].T, truth, atol=1e-5)


def test_discs_tell_what_no_picture_shows(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(detail, "MOST_POINTS", 3000)
    splats, floor = striped_floor()
    sky = Environment(name="sky", radiance=np.full((4, 8, 3), LIGHT, np.float32))
    camera = Camera.look_at((0.6, 1, 0), (0.6, 0, 0), 160, 160, yfov=40, name="half")
    views = (Compositor(splats).composite(camera),)
    mirrors = [(np.array([0.2, 0.3, 0.0]), 0.2)]
    error = {}
    for discs in (False, True):
        lighting = Lighting(name="day", environment=sky)
        found = detail.told(floor, mirrors, splats, views, lighting, RenderSettings(), discs=discs)
        face, corners = lattices.lattice(found.steps)
        places = (floor.vertices[floor.faces[face]] * corners[:, :, None]).sum(1)
        off = (found.colors[:, 1] - pattern(places[:, 0])) ** 2
        inside = np.abs(places).max(1) < 0.95
        for name, part in (("seen", np.abs(places - [0.6, 0, 0]).max(1) < 0.3), ("beside", places[:, 0] < -0.1)):
            error[name, discs] = float(np.sqrt(off[inside & part].mean()))
    assert error["seen", False] < 0.04 and error["seen", True] < 0.04
    assert error["beside", True] < 0.03 and error["beside", False] > 0.1

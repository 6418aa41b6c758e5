"""Colours of splats that lie off the surface, as an optimiser leaves them: what they blend to is what counts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mirelight.base.colour import srgb_decode, srgb_encode
from mirelight.base.errors import InputError, RenderError
from mirelight.base.sh import C0
from mirelight.compositor import Compositor
from mirelight.io.splats import merge
from mirelight.lighting import Tracer, captured_level, colored_by
from mirelight.model import (
    F32,
    F64,
    Camera,
    Deferred,
    Environment,
    Lighting,
    ProxyMesh,
    RenderSettings,
    SplatCloud,
    SplatLayer,
)
from mirelight.proxy.capture_views import capture_views
from mirelight.proxy.guess_tuning import GUESS

SETTINGS = RenderSettings(seed=1)
DAY = Lighting(name="day", environment=Environment(radiance=np.ones((1, 1, 3), np.float32)))
VIEWS = tuple(
    Camera.look_at((x, 2.5, z), (0.2 * x, 0, 0.2 * z), 60, 40, yfov=50, name=f"{x} {z}")
    for x, z in ((1.5, 0.5), (-1.5, 1.0), (0.3, 1.8), (0.5, -1.9))
)


def floor() -> ProxyMesh:
    """4 x 4 units at height 0, in faces of 0.1."""
    line = np.linspace(-2, 2, 41)
    x, z = np.meshgrid(line, line, indexing="ij")
    k = np.arange(41 * 41).reshape(41, 41)
    a, b, c, d = (q.ravel() for q in (k[:-1, :-1], k[:-1, 1:], k[1:, 1:], k[1:, :-1]))
    faces = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    return ProxyMesh(vertices=np.stack([x.ravel(), 0 * x.ravel(), z.ravel()], 1), faces=faces)


def cloud_of(means: F64, sizes: F64, opacities: F64, display: F64) -> SplatCloud:
    """Balls and ellipsoids along the axes."""
    at, size, opacity, sh = (x.astype(np.float32) for x in (means, sizes, opacities, (display - 0.5) / C0))
    quats = np.tile(np.array([1, 0, 0, 0], np.float32), (len(at), 1))
    return SplatCloud(means=at, quats=quats, scales=size, opacities=opacity, sh=sh[:, None])


def fuzzy() -> SplatCloud:
    """Half transparent balls about the floor: dark ones before it, bright ones behind it."""
    rng = np.random.default_rng(2)
    count = 6000
    means = rng.uniform((-2, -0.03, -2), (2, 0.03, 2), (count, 3))
    display = np.where(means[:, 1:2] > 0, 0.45, 0.8) * np.ones(3)
    sizes, opacities = rng.uniform(0.04, 0.06, (count, 3)), rng.uniform(0.3, 0.6, count)
    return cloud_of(means, sizes, opacities, display)


def shown(cloud: SplatCloud, camera: Camera) -> SplatLayer:
    return Compositor(cloud).composite(camera)


def test_the_proxy_looks_as_the_capture_does() -> None:
    """At a camera that gave no colours, under the captured light; the median of pixels that are as uneven as these is
    darker than their mean by 4 %."""
    cloud, mesh, camera = fuzzy(), floor(), Camera.look_at((-0.8, 2.2, -1.4), (0, 0, 0), 60, 40, yfov=35)
    views = capture_views(cloud, VIEWS)
    assert len(views) == len(VIEWS)
    layer = shown(cloud, camera)
    true = srgb_decode(layer.color)

    def off(given: tuple[SplatLayer, ...]) -> float:
        proxy = colored_by(cloud, mesh, DAY, SETTINGS, given)
        seen = Tracer(proxy, RenderSettings(seed=1, spp=64), layers=False, aovs=False).trace(DAY, camera)
        return float(np.mean(seen.beauty[..., :3][8:-8, 8:-8]) / np.mean(true[8:-8, 8:-8]) - 1)

    assert -0.05 < off(views) < 0.03
    assert off(()) > 0.15  # single splats, dark and bright, count alike


def test_the_level_is_that_of_the_surface() -> None:
    """Nothing blocks the sky: irradiance / pi is its radiance."""
    cloud, mesh = fuzzy(), floor()
    level = captured_level(cloud, mesh, DAY, SETTINGS, capture_views(cloud, VIEWS))
    assert level == pytest.approx(1.0, rel=0.02)


def test_pictures_stand_for_composites() -> None:
    """Each at its own exposure; one of something else, or damaged, is left out with a line; what is masked is not
    looked at."""
    cloud = fuzzy()
    plain = capture_views(cloud, VIEWS)

    def taken(k: int, stops: float) -> F32:
        """Half as bright in the dark half of what the splats show, as it is elsewhere."""
        light = srgb_decode(plain[k].color / np.maximum(1 - plain[k].transmittance, 1e-6)[..., None])
        dark = light < np.median(light)
        return np.dstack([np.where(dark, light / 2, light) * 2.0**stops, np.ones(light.shape[:2])]).astype(np.float32)

    rng = np.random.default_rng(4)
    masked = taken(1, -0.4)
    masked[:, 30:, 3] = 0
    other = np.dstack([rng.uniform(0.01, 0.6, (40, 60, 3)) ** 2, np.ones((40, 60))]).astype(np.float32)
    pictures = [Deferred.of(x) for x in (taken(0, 0.3), masked, other)]
    said: list[str] = []
    views = capture_views(cloud, VIEWS, [*pictures, Deferred("damaged", refused)], report=said.append)
    (line,) = said
    assert line.startswith("2 of 4 pictures of the capture are not used") and "shows something else" in line
    for k in (0, 1):
        alpha = 1 - views[k].transmittance
        there = alpha > 0.9
        light = srgb_decode(views[k].color / np.maximum(alpha, 1e-6)[..., None])
        np.testing.assert_allclose(light[there], taken(k, 0)[..., :3][there], rtol=0.05)
    assert not (1 - views[1].transmittance)[:, 30:].any()
    for k in (2, 3):
        np.testing.assert_array_equal(views[k].color, plain[k].color)


def test_white_of_a_picture_is_white_however_bright_it_was() -> None:
    """A picture of floats may hold the sun's disc; a capture's splats tell no more of it than that it was white."""
    cloud = fuzzy()
    plain = capture_views(cloud, VIEWS)
    light = srgb_decode(plain[0].color / np.maximum(1 - plain[0].transmittance, 1e-6)[..., None])
    seen = np.dstack([light, np.ones(light.shape[:2])]).astype(np.float32)
    seen[18:20, 28:30, :3] = 4e4
    view = capture_views(cloud, VIEWS[:1], [Deferred.of(seen)])[0]
    assert view.color.max() <= 1
    assert (view.color[18:20, 28:30] > 0.99 * (1 - view.transmittance[18:20, 28:30])[..., None]).all()


def refused() -> F32:
    raise InputError("a.png", "an image that cannot be decoded")


def test_discs_are_not_looked_at() -> None:
    fuzz = fuzzy()
    flat = replace(fuzz, scales=fuzz.scales * np.array([1, 0.05, 1], np.float32))
    on_the_floor = replace(flat, means=flat.means * np.array([1, 0, 1], np.float32))
    assert capture_views(on_the_floor, VIEWS) == ()
    assert capture_views(on_the_floor, ()) == ()
    assert len(capture_views(flat, VIEWS)) == len(VIEWS)  # about it, they are what an optimiser left


def test_where_no_camera_is_known_or_guessed_nothing_is_looked_at(monkeypatch: pytest.MonkeyPatch) -> None:
    """Splats of plain colours are looked at from where they look clear, here of few places."""
    monkeypatch.setattr("mirelight.proxy.guessed.GUESS", replace(GUESS, clear_grid=6))
    assert capture_views(fuzzy(), (), guess=tuple) == ()
    assert {view.camera.name.split("-")[0] for view in capture_views(fuzzy(), ())} == {"guessed"}


def test_a_proxy_that_no_picture_shows() -> None:
    """Where splats and mesh do not lie at one depth nothing is told."""
    cloud, mesh = fuzzy(), floor()
    away = ProxyMesh(vertices=mesh.vertices - np.array([0, 1, 0], np.float32), faces=mesh.faces)
    with pytest.raises(RenderError, match="nowhere where the capture's pictures show a surface"):
        colored_by(cloud, away, DAY, SETTINGS, capture_views(cloud, VIEWS))


def test_a_plain_floor_whose_splats_hang_has_its_colour() -> None:
    """Thin ones high above one half and below it, which no picture places; over the other half they lie on it."""
    rng = np.random.default_rng(5)
    high = rng.uniform((-2, -0.5, -2), (0, 1.2, 2), (9000, 3))
    on = rng.uniform((0, -0.01, -2), (2, 0.01, 2), (3000, 3))
    display = np.full((12000, 3), float(srgb_encode(np.array(0.3))))
    display[9000:] = float(srgb_encode(np.array(0.05)))
    opacities = np.concatenate([np.full(9000, 0.3), np.full(3000, 0.6)])
    cloud = cloud_of(np.concatenate([high, on]), np.full((12000, 3), 0.05), opacities, display)
    made = colored_by(cloud, floor(), DAY, SETTINGS, capture_views(cloud, VIEWS))
    assert made.vertex_colors is not None
    x, z = made.vertices[:, 0], made.vertices[:, 2]
    hanging = made.vertex_colors[(x < -0.5) & (x > -1.2) & (np.abs(z) < 0.8)]
    assert float(np.median(hanging)) == pytest.approx(0.3, rel=0.1)
    lying = made.vertex_colors[(x > 0.5) & (x < 1.2) & (np.abs(z) < 0.8)]
    assert float(np.median(lying)) == pytest.approx(0.05, rel=0.2)


def test_a_wall_beside_a_floor_takes_none_of_its_colour() -> None:
    """Pixels on outlines are mixtures: a dark slab in front of a bright floor stays dark at its rim."""
    rng = np.random.default_rng(3)
    cloud, mesh = fuzzy(), floor()
    slab = rng.uniform((-0.5, 0.98, -0.5), (0.5, 1.02, 0.5), (3000, 3))
    dark = np.full((3000, 3), float(srgb_encode(np.array(0.02))))
    thing = cloud_of(slab, np.full((3000, 3), 0.02), np.full(3000, 0.6), dark)
    both = merge([cloud, thing])
    corners = np.array([[-0.5, 1, -0.5], [-0.5, 1, 0.5], [0.5, 1, 0.5], [0.5, 1, -0.5]], np.float32)
    faces = np.array([[0, 1, 2], [0, 2, 3]]) + len(mesh.vertices)
    scene = ProxyMesh(
        vertices=np.concatenate([mesh.vertices, corners]), faces=np.concatenate([mesh.faces, faces.astype(np.int32)])
    )
    made = colored_by(both, scene, DAY, SETTINGS, capture_views(both, VIEWS))
    assert made.vertex_colors is not None
    on_slab = made.vertices[:, 1] > 0.9
    assert float(made.vertex_colors[on_slab].max()) < 0.06

"""Random clouds and cameras (hypothesis): the compositor agrees with the oracle, whatever they hold."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from mirelight.base import conventions
from mirelight.compositor import composite
from mirelight.model import Camera, CompositorSettings, SplatCloud

from .compositor_clouds import COMPACT, PHYSICAL, PLAYCANVAS, assert_agrees, splat_cloud, unit

FEW = settings(max_examples=60, deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow])


@st.composite
def clouds(draw: st.DrawFn) -> SplatCloud:
    """A few splats: any shape from points to sheets, faint to opaque, some at equal depths."""
    count = draw(st.integers(0, 40))
    r = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    spread = draw(st.sampled_from([0.0, 0.3, 2.0, 30.0]))
    scales = np.exp(
        r.normal(np.log(draw(st.sampled_from([0.01, 0.2, 2.0, 50.0]))), draw(st.sampled_from([0.0, 1.5])), (count, 3))
    )
    scales[r.random((count, 3)) < draw(st.sampled_from([0.0, 0.3]))] = 0
    opacities = r.random(count)
    opacities[r.random(count) < 0.2] = draw(st.sampled_from([0.0, 1.0, 0.5]))
    return splat_cloud(
        means=r.normal(0, 1, (count, 3)) * spread,
        quats=unit(r.normal(size=(count, 4))),
        scales=scales,
        opacities=opacities,
        sh=r.normal(0, 0.4, (count, draw(st.sampled_from([1, 4, 9, 16])), 3)),
        antialiased=draw(st.booleans()),
    )


@st.composite
def cameras(draw: st.DrawFn) -> Camera:
    """Small frames, from long lenses to 176 degrees, far off centre, orthographic, around and inside the cloud."""
    width, height = draw(st.integers(1, 40)), draw(st.integers(1, 40))
    eye = np.array([0.1, 0.2, 0.3]) + [draw(st.floats(-4, 4)) for _ in range(3)]
    f = max(width, height) * draw(st.sampled_from([0.02, 0.09, 0.5, 1.5, 20.0, 300.0]))
    return Camera(
        world_from_camera=conventions.look_at(eye, [0.05, 0.0, -0.05]),
        width=width,
        height=height,
        fx=f,
        fy=f * draw(st.sampled_from([1.0, 0.6])),
        cx=width * draw(st.floats(-2, 3)),
        cy=height * draw(st.floats(-2, 3)),
        projection=draw(st.sampled_from(["perspective", "perspective", "orthographic"])),
        near=draw(st.sampled_from([1e-4, 0.01, 0.2, 2.0])),
        far=draw(st.sampled_from([5.0, 1000.0])),
    )


@given(clouds(), cameras(), st.sampled_from([PHYSICAL, PLAYCANVAS, COMPACT]), st.sampled_from(["depth", "radial"]))
@FEW
def test_random_clouds_agree_with_the_oracle(
    splats: SplatCloud, camera: Camera, base: CompositorSettings, sort: str
) -> None:
    chosen = replace(base, sort=sort)  # type: ignore[arg-type]
    # float32 projection against float64: a millionth of the distance in px, times the kernel's slope
    assert_agrees(splats, camera, chosen, tolerance=3e-4, flips=max(4, camera.width * camera.height // 50))


@given(clouds(), cameras(), st.sampled_from([PHYSICAL, PLAYCANVAS]))
@FEW
def test_what_holds_for_every_picture(splats: SplatCloud, camera: Camera, base: CompositorSettings) -> None:
    layer = composite(splats, camera, base)
    assert np.isfinite(layer.color).all() and (layer.color >= 0).all()
    assert (layer.transmittance >= 0).all() and (layer.transmittance <= 1).all()
    covered = layer.transmittance < 1
    assert not layer.color[~covered].any() and not layer.depth[~covered].any()
    assert (layer.depth[covered] > 0).all()
    np.testing.assert_array_equal(layer.median_depth > 0, layer.transmittance <= 0.5)
    white = replace(splats, sh=np.zeros_like(splats.sh[:, :1]) + np.float32(0.5 / 0.28209479177387814))
    drawn = composite(white, camera, base)
    np.testing.assert_allclose(drawn.color, np.repeat(1 - drawn.transmittance[..., None], 3, 2), atol=2e-3)


def wild(r: np.random.Generator, *shape: int) -> np.ndarray:
    """Numbers of every size that float32 has, zeros, and some that are not numbers."""
    out = np.exp(r.uniform(-90, 88, shape)) * r.choice([-1, 1], shape)
    kind = r.random(shape)
    out[kind < 0.6] = r.normal(size=np.count_nonzero(kind < 0.6))
    out[kind < 0.1], out[kind < 0.06], out[kind < 0.03] = 0, np.nan, np.inf
    return np.asarray(out, dtype=np.float32)


@given(st.integers(0, 2**32 - 1), cameras(), st.sampled_from(["physical", "compact", "large"]), st.booleans())
@FEW
def test_no_number_in_a_cloud_spoils_the_picture(seed: int, camera: Camera, kind: str, linear: bool) -> None:
    r = np.random.default_rng(seed)
    fields = {"means": (60, 3), "quats": (60, 4), "scales": (60, 3), "opacities": (60,), "sh": (60, 4, 3)}
    tame = {"means": 1.0, "quats": 1.0, "scales": 0.3, "opacities": 0.5, "sh": 0.3}
    arrays = {n: wild(r, *shape) if r.random() < 0.5 else r.normal(0, tame[n], shape) for n, shape in fields.items()}
    base = PHYSICAL if kind == "physical" else replace(COMPACT, work_buffer=kind, linear=linear)  # type: ignore[arg-type]
    layer = composite(splat_cloud(**arrays), camera, base)
    assert np.isfinite(layer.color).all() and np.isfinite(layer.depth).all() and np.isfinite(layer.median_depth).all()
    assert (layer.transmittance >= 0).all() and (layer.transmittance <= 1).all()


@given(clouds(), st.integers(1, 24), st.integers(1, 24))
@FEW
def test_a_part_of_the_frame_is_that_part_of_the_picture(splats: SplatCloud, left: int, top: int) -> None:
    whole = Camera.look_at((2.1, 1.2, 3.3), (0.05, 0, -0.05), 48, 48, yfov=70)
    window = replace(whole, width=17, height=13, cx=whole.cx - left, cy=whole.cy - top)
    settings_ = CompositorSettings(profile="playcanvas", work_buffer="large", min_pixel_size=0.0)
    splats = replace(splats, scales=np.minimum(splats.scales, 0.05))  # below the engine's limit, which is per frame
    a, b = composite(splats, whole, settings_), composite(splats, window, settings_)
    cut = (slice(top, top + 13), slice(left, left + 17))
    wrong = np.abs(a.color[cut] - b.color).max(axis=2) > 2e-4
    assert np.count_nonzero(wrong) <= 3

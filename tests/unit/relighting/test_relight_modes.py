"""Relight modes as objects: the registry, what each reads, and factors that are the same from every view."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import Any, get_args

import numpy as np
import pytest

from mirelight import relighting
from mirelight.model import Camera, LightingBuffer, LightLayer, Profile, RelightMode, RelightSettings, SplatLayer

H, W = 10, 16
OTHER: dict[str, Any] = {  # another value for every setting
    "mode": None,
    "profile": None,
    "space": "display",
    "blend": 0.5,
    "brightness": 1.25,
    "background": 0.3,
    "delta": 0.2,
    "max_ratio": 1.5,
    "sh": "remove",
    "gloss": None,  # decides whether lobes are added to what comes of it
    "per": None,  # decides who is asked, not what comes of it
    "repair": None,  # decides what captured light is compared with
    "texture_scale": 0.5,
}


def view(x: float = 0.0) -> Camera:
    return Camera.look_at((x, 1, 4), (x, 0, 0), W, H)


def splats(camera: Camera, profile: Profile = "physical") -> SplatLayer:
    flat = np.full((H, W), 0.25, np.float32)
    color = np.random.default_rng(0).uniform(0, 0.75, (H, W, 3)).astype(np.float32)
    own: dict[str, Any] = {"color": color, "diffuse": 0.8 * color, "transmittance": flat}
    return SplatLayer(camera=camera, profile=profile, depth=flat, median_depth=flat, **own)


def lit(radiance: Any, camera: Camera) -> LightingBuffer:
    """Covers all but the left half of the columns."""
    coverage = np.zeros((H, W), np.float32)
    coverage[:, W // 2 :] = 1
    seen = np.broadcast_to(np.asarray(radiance, np.float32), (H, W, 3)) * coverage[..., None]
    up = np.broadcast_to(np.array([0, 1, 0], np.float32), (H, W, 3))
    return LightingBuffer(
        camera=camera,
        coverage=coverage,
        layers=(LightLayer(name="sun", direct=seen, indirect=0 * seen),),
        depth=coverage,
        position=up,
        normal=up,
        geometric_normal=up,
        albedo=np.full((H, W, 3), 0.5),
        variance=np.full((H, W, 3), 1e-4),
    )


def varied(seed: int) -> Any:
    return np.random.default_rng(seed).uniform(0.05, 3, (H, W, 3))


def test_the_registry_holds_every_name() -> None:
    assert set(relighting.MODES) == set(get_args(RelightMode))
    for name, mode in relighting.MODES.items():
        assert mode.name == name
        assert relighting.mode_of(RelightSettings(mode=name)) is mode


@pytest.mark.parametrize("profile", get_args(Profile))
@pytest.mark.parametrize("mode", get_args(RelightMode))
def test_a_setting_changes_the_frame_exactly_where_it_is_read(mode: RelightMode, profile: Profile) -> None:
    """Every field of the settings, changed alone: those that `reads` leaves out change not one bit."""
    assert set(OTHER) == {x.name for x in fields(RelightSettings)}
    settings = RelightSettings(mode=mode, profile=profile)
    camera = view()

    def rgba(chosen: RelightSettings) -> bytes:
        new, old = lit(varied(1), camera), lit(varied(2), camera)
        frame = relighting.apply(splats(camera, profile), new, chosen, captured=old, noise=False)
        return frame.rgba.tobytes()

    plain = rgba(settings)
    for name, value in OTHER.items():
        if value is not None:
            changed = rgba(replace(settings, **{name: value})) != plain
            assert changed == (name in relighting.reads(settings)), name
    assert {"mode", "profile"} <= relighting.reads(settings)


def test_a_point_has_one_factor_in_every_view() -> None:
    """Two views of one surface, the second of which sees much brighter captured light elsewhere."""
    new, old = varied(3), varied(4)
    brighter = old.copy()
    brighter[: H // 2] *= 50
    factors = []
    for x, captured in ((0.0, old), (0.7, brighter)):
        camera = view(x)
        settings = RelightSettings(mode="ratio", delta=0.1)
        light = lit(new, camera), lit(captured, camera)
        frame = relighting.apply(splats(camera), light[0], settings, captured=light[1], captured_level=1.7, noise=False)
        assert frame.factor is not None
        factors.append(frame.factor[H // 2 :, W // 2 :])
    np.testing.assert_array_equal(factors[0], factors[1])
    expected = np.minimum((2 * new + 0.1 * 1.7) / (2 * old + 0.1 * 1.7), 16)
    np.testing.assert_allclose(factors[0], expected[H // 2 :, W // 2 :], rtol=2e-6)


def test_noise_is_estimated_only_where_it_is_wanted() -> None:
    camera = view()
    new, old = lit(varied(5), camera), lit(varied(6), camera)
    for settings in (RelightSettings(), RelightSettings(mode="ratio")):
        noisy, plain = (
            relighting.apply(splats(camera), new, settings, captured=old, noise=wanted) for wanted in (True, False)
        )
        assert noisy.noise is not None and plain.noise is None
        np.testing.assert_array_equal(noisy.rgba, plain.rgba)
    assert relighting.apply(None, new, RelightSettings(), noise=False).noise is None

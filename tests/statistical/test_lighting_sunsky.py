"""A computed sun and sky against Mitsuba's own `sunsky` under `path`, which samples the plugin and no map of ours."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import path_oracle as oracle
import pytest
from ztest import Array, worst_and_allowed

from mirelight.base import backend, colour
from mirelight.lighting import Tracer, sunsky, tracer
from mirelight.model import Camera, Lighting, ProxyMesh, RenderSettings, SkyModel, SunLight, digest

SEEDS, SPP = 16, 64
VIEW = Camera.look_at([0.6, 2.0, 4], [0, 0.5, 0], 32, 24)
# a floor, a wall to the north and a slab above the floor: every way that the sky may look in
CORNERS = [
    [[-3, 0, -3], [-3, 0, 3], [3, 0, 3], [3, 0, -3]],
    [[-3, 0, -1.5], [3, 0, -1.5], [3, 2, -1.5], [-3, 2, -1.5]],
    [[-0.5, 0.6, -0.5], [-0.5, 0.6, 0.5], [0.5, 0.6, 0.5], [0.5, 0.6, -0.5]],
]
STAGE = ProxyMesh(
    vertices=np.array(CORNERS, np.float32).reshape(-1, 3),
    faces=np.array([[k, k + i, k + i + 1] for k in (0, 4, 8) for i in (1, 2)], np.int32),
)


def sun_at(elevation: float, azimuth: float) -> Array:
    """Towards the sun; azimuth from north (-Z) over east (+X), written out here anew."""
    e, a = np.radians([elevation, azimuth])
    return np.array([np.cos(e) * np.sin(a), np.sin(e), -np.cos(e) * np.cos(a)])


def plugin_pictures(model: SkyModel, **scales: float) -> Array:
    """The plugin in Mitsuba's own hands, turned from Z up to Y up by a transform."""
    mi = backend.mitsuba("llvm_ad_rgb")
    world: dict[str, Any] = {
        "type": "scene",
        "sensor": oracle.sensor(mi, VIEW),
        "mesh": oracle.mesh(mi, STAGE, {"type": "diffuse", "reflectance": {"type": "rgb", "value": 0.5}}, STAGE.faces),
        "sky": {
            "type": "sunsky",
            "to_world": mi.ScalarTransform4f().rotate([1, 0, 0], -90),
            "sun_direction": model.to_sun.tolist(),
            "turbidity": model.turbidity,
            "albedo": {"type": "rgb", "value": model.albedo.tolist()},
            **scales,
        },
    }
    scene = mi.load_dict(world)
    pictures = [oracle.path_beauty(mi, scene, spp=SPP, max_depth=3, seed=900 + k)[0] for k in range(SEEDS)]
    return np.stack(pictures).astype(np.float64)


def our_layers(model: SkyModel) -> dict[str, Array]:
    ours = Tracer(STAGE, RenderSettings(spp=SPP, max_depth=3))
    found: dict[str, list[Array]] = {}
    for seed in range(SEEDS):
        ours.settings = replace(ours.settings, seed=seed)
        for layer in ours.trace(sunsky.resolved(Lighting(sky=model)), VIEW).layers:
            found.setdefault(layer.name, []).append(layer.total.astype(np.float64))
    return {name: np.stack(pictures) for name, pictures in found.items()}


@pytest.mark.parametrize(("elevation", "azimuth", "turbidity"), [(50.0, 120.0, 3.0), (8.0, 235.0, 6.0)])
def test_sun_and_sky_are_the_plugins(elevation: float, azimuth: float, turbidity: float) -> None:
    """Layer by layer, once the scale to lux and cd/m² is taken out; two sides, so that a mirrored sky would show."""
    model = SkyModel(
        to_sun=sun_at(elevation, azimuth),
        turbidity=turbidity,
        albedo=np.array([0.2, 0.4, 0.1]),
        intensity=1 / sunsky.LUMINANCE,
    )
    ours = our_layers(model)
    assert list(ours) == ["sun", "sky"]
    for name, scales in (("sun", {"sky_scale": 0.0}), ("sky", {"sun_scale": 0.0})):
        theirs = plugin_pictures(model, **scales)
        worst, allowed = worst_and_allowed(ours[name], theirs, rounding=1e-3)
        assert worst < allowed, f"{name}: |t| = {worst:.2f}, chance allows {allowed:.2f}"
        assert ours[name].mean() == pytest.approx(theirs.mean(), rel=0.005)


def test_a_clear_noon_has_the_suns_lux_and_a_low_sun_less_and_redder() -> None:
    """A clear day's direct sun is 90 to 110 klx; the sky adds 10 to 25 klx on the ground."""
    high, low = (sunsky.resolved(Lighting(sky=SkyModel(to_sun=sun_at(e, 180)))) for e in (60.0, 5.0))
    (sun,), (evening,) = high.lights, low.lights
    assert 85_000 < sun.intensity < 110_000 and evening.intensity < sun.intensity / 3
    assert evening.color[0] / evening.color[2] > 5 > 2 > sun.color[0] / sun.color[2]
    for light in (sun, evening):
        assert light.color @ [0.2126, 0.7152, 0.0722] == pytest.approx(1)

    assert high.environment is not None
    rows = len(high.environment.pixels)
    theta = np.pi * (np.arange(rows // 2) + 0.5) / rows
    share = (np.cos(theta) * np.sin(theta) * (np.pi / rows) * 2 * np.pi)[:, None]
    ground = (high.environment.pixels[: rows // 2].mean(axis=1) * share).sum(axis=0) * high.environment.intensity
    assert 10_000 < ground @ [0.2126, 0.7152, 0.0722] < 25_000
    assert not high.environment.pixels[rows // 2 :].any()


def test_the_units_are_those_of_the_spectral_plugin() -> None:
    """The scale to cd/m², against the plugin's spectral form integrated over the CIE 1931 luminosity curve."""
    mi = backend.mitsuba("llvm_ad_rgb")
    model = SkyModel(to_sun=sun_at(45.0, 90.0))
    ways = np.array([[0, 1, 0], [0.6, 0.8, 0], [-0.6, 0.8, 0]])
    found = colour.luminance(sunsky._evaluated(mi, model, ways, sun=False)) * sunsky.LUMINANCE
    # cd/m²: W/(m² sr nm) from Mitsuba 3.9.1's llvm_ad_spectral at 1 nm steps from 360 to 720 nm, times 683.002 lm/W
    np.testing.assert_allclose(found, [2962.0, 10576.0, 3038.6], rtol=0.01)


def test_the_sun_light_and_the_skys_bright_spot_lie_where_the_sun_is() -> None:
    to_sun = sun_at(60, 90)
    np.testing.assert_allclose(to_sun, [0.5, np.sqrt(0.75), 0], atol=1e-12)  # east is +X
    lighting = sunsky.resolved(Lighting(sky=SkyModel(to_sun=to_sun)))
    (sun,), sky = lighting.lights, lighting.environment
    assert isinstance(sun, SunLight) and sky is not None
    assert sun.direction.tolist() == pytest.approx((-to_sun).tolist())
    h, w = sky.pixels.shape[:2]
    above = sky.pixels[: h // 3].sum(axis=-1)  # from 30 degrees up: the horizon is bright too
    row, column = np.unravel_index(np.argmax(above), above.shape)
    assert (row / h, column / w) == pytest.approx((1 / 6, 0.5), abs=0.01)


def test_every_light_model_and_the_fingerprint_know_the_sky() -> None:
    """Layers in both profiles, and another digest for another sun."""
    high, low = (Lighting(sky=SkyModel(to_sun=sun_at(e, 150), intensity=1e-5)) for e in (50.0, 20.0))
    names = []
    for settings in (RenderSettings(spp=1, profile="playcanvas"), RenderSettings(spp=4)):
        buffer = tracer(STAGE, settings).trace(sunsky.resolved(high, settings.variant), VIEW.resized(8, 6))
        names.append([x.name for x in buffer.layers])
        assert all(x.total.mean() > 0 for x in buffer.layers)
    assert names == [["sun", "sky"]] * 2 and high.layer_names == ("sun", "sky")
    assert digest(high) == digest(replace(high)) != digest(low)
    with pytest.raises(ValueError, match="sky model"):  # a prepared scene resolves skies, once
        tracer(STAGE, RenderSettings(spp=1)).trace(high, VIEW.resized(8, 6))

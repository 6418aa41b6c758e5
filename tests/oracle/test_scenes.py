"""The shipped scenes: they load, stay small, and relighting by ratio comes far closer to their path-traced truth."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from mirelight import colour
from mirelight.compositor import Compositor
from mirelight.io import job
from mirelight.io.png import encode_display
from mirelight.lighting import Tracer
from mirelight.model import (
    Camera,
    DisplaySettings,
    Frame,
    Job,
    LightingBuffer,
    RelightSettings,
    RenderSettings,
    SplatLayer,
)
from mirelight.relight import apply

SCENES = Path(__file__).parents[2] / "scenes"
CASES = (("courtyard", "evening"), ("courtyard", "night"), ("stage", "spots"), ("stage", "gels"), ("stage", "sunset"))
SHRINK = 4  # truth pixels along each axis for one of the test's
GAIN = 6.0  # dB by which the ratio must beat the tint; shipped frames at full size gain more

Picture = NDArray[np.float64]


def shown(rgba: NDArray[np.float32]) -> Picture:
    """Display values 0..1 as a PNG of the frame holds them."""
    return encode_display(rgba, DisplaySettings()) / 255.0


def psnr(a: Picture, b: Picture) -> float:
    return float(-10 * np.log10(np.mean((a - b) ** 2)))


@cache
def scene(name: str) -> Job:
    return job.load(SCENES / name / "job.toml")


@cache
def camera(name: str) -> Camera:
    front = next(x for x in scene(name).scene.cameras if x.name == "front")
    return front.resized(front.width // SHRINK, front.height // SHRINK)


@cache
def splats(name: str) -> SplatLayer:
    cloud = scene(name).scene.splats
    assert cloud is not None
    return Compositor(cloud).composite(camera(name))


@cache
def tracer(name: str) -> Tracer:
    proxy = scene(name).scene.proxy
    assert proxy is not None
    return Tracer(proxy, RenderSettings(spp=32, max_depth=5, seed=1))


@cache
def traced(name: str, lighting: str) -> LightingBuffer:
    found = scene(name).scene
    assert found.captured is not None
    chosen = found.captured if lighting == "captured" else next(x for x in found.lightings if x.name == lighting)
    return tracer(name).trace(chosen, camera(name))


def relit(name: str, lighting: str, settings: RelightSettings) -> Frame:
    captured = traced(name, "captured") if settings.mode == "ratio" else None
    return apply(splats(name), traced(name, lighting), settings, captured=captured)


@cache
def truth(name: str, lighting: str) -> Picture:
    """The true picture, averaged in linear light to the test's size."""
    from PIL import Image

    with Image.open(SCENES / name / "truth" / f"front.{lighting}.png") as image:
        values = np.asarray(image.convert("RGB"), dtype=np.float32) / 255
    linear = np.asarray(colour.srgb_decode(values))
    h, w, _ = linear.shape
    small = linear.reshape(h // SHRINK, SHRINK, w // SHRINK, SHRINK, 3).mean(axis=(1, 3))
    return np.asarray(colour.srgb_encode(small), dtype=np.float64)


@pytest.mark.parametrize(("name", "lighting"), CASES)
def test_ratio_is_closer_to_the_truth_than_the_tint(name: str, lighting: str) -> None:
    true = truth(name, lighting)
    tint = psnr(shown(relit(name, lighting, RelightSettings(mode="tint")).rgba), true)
    ratio = psnr(shown(relit(name, lighting, RelightSettings(mode="ratio")).rgba), true)
    assert ratio > tint + GAIN


@pytest.mark.parametrize("name", ["courtyard", "stage"])
def test_capture_shows_the_captured_light(name: str) -> None:
    """The splats were baked under the very light, at the very exposure, that the job names as captured."""
    frame = relit(name, "captured", RelightSettings(mode="ratio"))
    assert frame.unlit is not None
    day = {"courtyard": "day", "stage": "studio"}[name]
    assert psnr(shown(frame.unlit), truth(name, day)) > 25
    np.testing.assert_allclose(frame.rgba, frame.unlit, atol=1e-6)


@pytest.mark.parametrize("name", ["courtyard", "stage"])
def test_every_camera_and_lighting_has_its_truth(name: str) -> None:
    loaded = scene(name).scene
    for lighting in loaded.lightings:
        assert (SCENES / name / "truth" / f"front.{lighting.name}.png").is_file()


def test_scenes_stay_small() -> None:
    sizes = {path: path.stat().st_size for path in SCENES.rglob("*") if path.is_file()}
    assert max(sizes.values()) < 5_000_000
    assert sum(sizes.values()) < 15_000_000


@pytest.mark.parametrize("name", ["courtyard", "stage"])
def test_proxy_and_splats_share_their_space(name: str) -> None:
    """Most of the splats lie on the proxy: an offset of one percent of the scene would cost eleven dB."""
    import trimesh

    loaded = scene(name).scene
    assert loaded.splats is not None and loaded.proxy is not None
    mesh = trimesh.Trimesh(loaded.proxy.vertices, loaded.proxy.faces, process=False)
    chosen = loaded.splats.means[:: max(1, len(loaded.splats) // 800)]
    _, distance, _ = trimesh.proximity.closest_point(mesh, chosen)
    low, high = loaded.proxy.bounds
    assert np.median(distance) < 0.002 * float(np.linalg.norm(high - low))

"""Made-up frames to compare."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mirelight import relighting
from mirelight.io.image import write
from mirelight.model import (
    Camera,
    DisplaySettings,
    Frame,
    LightingBuffer,
    LightLayer,
    Provenance,
    RelightSettings,
    SplatLayer,
)

H, W = 48, 64


def smooth(seed: int, channels: int = 3) -> Any:
    """(H, W, channels) soft random values in 0..1."""
    rng = np.random.default_rng(seed)
    coarse = rng.random((7, 9, channels))
    rows, columns = np.linspace(0, 5.99, H), np.linspace(0, 7.99, W)
    r, c = rows.astype(int), columns.astype(int)
    fr, fc = (rows - r)[:, None, None], (columns - c)[None, :, None]
    top = coarse[r][:, c] * (1 - fc) + coarse[r][:, c + 1] * fc
    bottom = coarse[r + 1][:, c] * (1 - fc) + coarse[r + 1][:, c + 1] * fc
    return (top * (1 - fr) + bottom * fr).astype(np.float32)


def make_frame(
    seed: int = 0, *, light: Any = 1.0, sigma: float | None = None, profile: Any = "physical", opaque: bool = True
) -> Frame:
    """A relit frame: splats of a soft pattern, a proxy that covers the right three quarters at two depths."""
    camera = Camera.look_at((0, 0, 3), (0, 0, 0), W, H)
    one: Any = np.ones((H, W, 3), dtype=np.float32)
    coverage = one[..., 0].copy()
    coverage[:, : W // 4] = 0
    depth = np.where(np.arange(W) < W * 5 // 8, 2.0, 4.0) * coverage
    lit = 0.5 * light * one * coverage[..., None]
    buffer = LightingBuffer(
        camera=camera,
        coverage=coverage,
        layers=(LightLayer(name="sun", direct=lit, indirect=0 * one),),
        depth=depth,
        position=one,
        normal=one,
        geometric_normal=one,
        albedo=one,
        variance=None if sigma is None else one * (0.5 * sigma) ** 2 * coverage[..., None],
    )
    alpha = one[..., 0] if opaque else smooth(seed + 100, 1)[..., 0]
    splats = SplatLayer(
        camera=camera,
        color=smooth(seed) * alpha[..., None],
        transmittance=1 - alpha,
        depth=depth,
        median_depth=depth,
        profile=profile,
    )
    made_by = Provenance(
        mirelight="0.1.0", job="test.toml", settings={"compositor": {"profile": profile}, "render": {"spp": 64}}
    )
    return relighting.apply(splats, buffer, RelightSettings(profile=profile), made_by=made_by)


def brighter(frame: Frame, factor: Any) -> Frame:
    """The frame with its colour multiplied."""
    rgba = frame.rgba.copy()
    rgba[..., :3] *= np.asarray(factor, dtype=np.float32)
    return replace(frame, rgba=rgba)


Save = Callable[..., Path]


@pytest.fixture
def save(tmp_path: Path) -> Save:
    """save(frame, "a/b.exr"): writes a frame below the test's folder."""

    def to_file(frame: Frame, name: str, **display: Any) -> Path:
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        write(frame, path, DisplaySettings(**display))
        return path

    return to_file


@pytest.fixture
def made() -> Callable[..., Frame]:
    """made(seed, light=, sigma=, profile=, opaque=): see :func:`make_frame`."""
    return make_frame


@pytest.fixture
def lighter() -> Callable[..., Frame]:
    """lighter(frame, factor): see :func:`brighter`."""
    return brighter


@pytest.fixture(scope="module")
def page() -> Iterator[Any]:
    """A tab of headless Chromium, see browser.py."""
    from mirelight.apps.realtime.browser import find_browser

    executable = find_browser()
    spec = importlib.util.spec_from_file_location("browser", Path(__file__).with_name("browser.py"))
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    with module.chromium(executable) as tab:
        yield tab

"""Clouds, cameras and the comparison that the compositor's tests share."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mirelight.compositor import Compositor, composite, reference
from mirelight.model import Camera, CompositorSettings, SplatCloud, SplatLayer

IMAGES = ("color", "transmittance", "depth", "median_depth")
PHYSICAL = CompositorSettings()
PLAYCANVAS = CompositorSettings(profile="playcanvas", work_buffer="large")
COMPACT = CompositorSettings(profile="playcanvas")

VIEW = Camera.look_at((2.8, 0.6, 2.9), (-1, -0.3, -0.6), 96, 72, yfov=60)


def splat_cloud(**fields: Any) -> SplatCloud:
    """A cloud of arrays of any number type."""
    return SplatCloud(**fields)


def changed(splats: SplatCloud, **fields: Any) -> SplatCloud:
    """The cloud with other arrays, of any number type."""
    return replace(splats, **fields)


def cloud(count: int = 600, *, degree: int = 3, seed: int = 0, size: float = 0.15) -> SplatCloud:
    """Splats in a box of 8 x 5 x 8 around the origin: needles, discs and balls, faint and opaque."""
    r = np.random.default_rng(seed)
    return splat_cloud(
        means=r.uniform(-1, 1, (count, 3)) * [4, 2.5, 4],
        quats=unit(r.normal(size=(count, 4))),
        scales=np.exp(r.normal(np.log(size), 0.8, (count, 3))),
        opacities=r.beta(0.7, 0.7, count),
        sh=r.normal(0, 0.3, (count, (degree + 1) ** 2, 3)),
    )


def unit(v: NDArray[np.float64]) -> NDArray[np.float64]:
    """Rows scaled to length 1."""
    return np.asarray(v / np.linalg.norm(v, axis=-1, keepdims=True))


def one(
    *,
    mean: tuple[float, float, float] = (0, 0, 0),
    scale: float | tuple[float, float, float] = 0.1,
    opacity: float = 0.5,
    rgb: tuple[float, float, float] = (0.2, 0.5, 0.9),
) -> SplatCloud:
    """A single splat of one colour."""
    return splat_cloud(
        means=np.array([mean]),
        quats=np.array([[1, 0, 0, 0]]),
        scales=np.broadcast_to(scale, (1, 3)),
        opacities=np.array([opacity]),
        sh=((np.array([[rgb]]) - 0.5) / 0.28209479177387814),
    )


def stacked(*clouds: SplatCloud) -> SplatCloud:
    """One cloud of several."""
    names = ("means", "quats", "scales", "opacities", "sh")
    return splat_cloud(**{n: np.concatenate([getattr(c, n) for c in clouds]) for n in names})


def front(width: int = 64, height: int = 48, *, f: float = 60.0, distance: float = 4.0) -> Camera:
    """A camera on the +Z axis that looks at the origin; the axis meets the corner of four pixels."""
    return replace(Camera.look_at((0, 0, distance), (0, 0, 0), width, height), fx=f, fy=f)


def same_bits(a: SplatLayer, b: SplatLayer) -> bool:
    """Whether two layers are equal to the last bit."""
    return all(np.array_equal(getattr(a, name), getattr(b, name)) for name in IMAGES)


def assert_agrees(
    splats: SplatCloud,
    camera: Camera,
    settings: CompositorSettings = PHYSICAL,
    *,
    tolerance: float = 2e-5,
    flips: int = 2,
    compositor: Compositor | None = None,
) -> SplatLayer:
    """The fast compositor's layer, held to the oracle's.

    `flips` pixels may differ by more: a fragment whose alpha meets the clip, a pixel whose transmittance meets the
    stop or one half, and splats at the same depth fall on either side by rounding. Depths are compared relative to the
    deepest, where at least a thousandth of the pixel is covered.
    """
    fast = (compositor or Compositor(splats, settings)).composite(camera)
    slow = reference.composite(splats, camera, settings)
    for name in IMAGES:
        got, wanted = getattr(fast, name).astype(np.float64), getattr(slow, name).astype(np.float64)
        assert np.isfinite(got).all(), name
        scale = max(1.0, float(np.abs(wanted).max())) * (10 if "depth" in name else 1)
        wrong = np.abs(got - wanted) > tolerance * scale
        pixels = wrong.any(axis=-1) if wrong.ndim == 3 else wrong
        worst = float(np.abs(got - wanted).max())
        assert np.count_nonzero(pixels) <= flips, f"{name}: {np.count_nonzero(pixels)} pixels, worst {worst:.2e}"
    return fast


def psnr(a: NDArray[np.float32], b: NDArray[np.float32]) -> float:
    """dB against a peak of 1."""
    return float(-10 * np.log10(np.mean((a.astype(np.float64) - b) ** 2)))


__all__ = [
    "COMPACT",
    "IMAGES",
    "PHYSICAL",
    "PLAYCANVAS",
    "VIEW",
    "assert_agrees",
    "changed",
    "cloud",
    "composite",
    "front",
    "one",
    "psnr",
    "same_bits",
    "splat_cloud",
    "stacked",
    "unit",
]

"""Procedural albedo textures: linear Rec.709, tileable, made from filtered noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class Surface:
    """How a material looks: a texture that repeats every `size` metres; glossy where `roughness` is given."""

    texture: F32  # (h, w, 3) linear albedo
    size: float = 2.0  # metres covered by the texture
    roughness: float | None = None  # Beckmann alpha of a clear coat (index 1.5); None: diffuse
    metal: bool = False  # of that roughness, the texture its reflectance, in place of a coat

    @property
    def is_mirror(self) -> bool:
        """Whether pictures are seen in it."""
        return self.metal and self.roughness is not None and self.roughness < 0.01


def srgb(red: float, green: float, blue: float) -> F64:
    """Linear colour of display values 0..255."""
    c = np.array([red, green, blue]) / 255
    return np.asarray(np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4))


def clouds(size: int, seed: int, *, slope: float = 1.6, low: float = 1.0, stretch: tuple[float, float] = (1, 1)) -> F64:
    """Tileable noise (size, size), mean 0, deviation 1, amplitude ~ frequency^-slope above `low` cycles.

    `stretch` lengthens features along the rows and the columns.
    """
    rng = np.random.default_rng(seed)
    fy, fx = np.meshgrid(np.fft.fftfreq(size) * size, np.fft.rfftfreq(size) * size, indexing="ij")
    f = np.hypot(fy * stretch[0], fx * stretch[1])
    gain = np.where(f >= low, np.maximum(f, 1e-9) ** -slope, 0.0)
    out = np.fft.irfft2(np.fft.rfft2(rng.normal(size=(size, size))) * gain, s=(size, size))
    return np.asarray((out - out.mean()) / out.std())


def mix(a: F64, b: F64, t: F64) -> F64:
    """Colours (3,) or (h, w, 3) blended by t (h, w), clipped to 0..1."""
    k = np.clip(t, 0, 1)[..., None]
    return np.asarray(a * (1 - k) + b * k)


def step(x: F64, edge: float, width: float) -> F64:
    """Smooth step of x across `edge`."""
    t = np.clip((x - edge) / width + 0.5, 0, 1)
    return t * t * (3 - 2 * t)


def _finish(colour: F64, low: float = 0.02, high: float = 0.86) -> F32:
    return np.clip(colour, low, high).astype(np.float32)


def plaster(base: F64, worn: F64, stain: F64, seed: int, size: int = 1024) -> F32:
    """Lime wash: broad tonal clouds, patches worn to an older coat, faint drips and grit."""
    broad = clouds(size, seed, slope=1.9, low=1)
    patches = clouds(size, seed + 1, slope=1.45, low=2)
    drips = clouds(size, seed + 2, slope=1.5, low=3, stretch=(0.12, 1.0))
    grit = clouds(size, seed + 3, slope=0.35, low=24)
    colour = base * (1 + 0.07 * broad)[..., None]
    colour = mix(colour, worn * (1 + 0.05 * broad)[..., None], 0.8 * step(patches, 1.25, 0.5))
    colour = mix(colour, stain + np.zeros_like(colour), 0.16 * step(drips, 0.9, 1.6))
    return _finish(colour * (1 + 0.035 * grit)[..., None])


def stone(base: F64, vein: F64, seed: int, size: int = 1024) -> F32:
    """Limestone: soft clouds, darker pits, thin veins."""
    broad = clouds(size, seed, slope=1.5, low=1)
    ridges = np.abs(clouds(size, seed + 1, slope=1.6, low=2))
    grit = clouds(size, seed + 2, slope=0.5, low=16)
    colour = base * (1 + 0.11 * broad)[..., None]
    colour = mix(colour, vein + np.zeros_like(colour), 0.45 * step(-ridges, -0.06, 0.1))
    colour = mix(colour, vein * 0.8 + np.zeros_like(colour), 0.55 * step(grit, 1.9, 0.8))
    return _finish(colour * (1 + 0.05 * grit)[..., None])


def terracotta(base: F64, seed: int, size: int = 1024, spread: float = 0.22) -> F32:
    """Fired clay whose tone drifts over the texture, so that tiles cut from it differ."""
    tone = clouds(size, seed, slope=1.2, low=2)
    hue = clouds(size, seed + 1, slope=1.3, low=2)
    grit = clouds(size, seed + 2, slope=0.6, low=20)
    warm = np.array([1.0, 1.10, 1.22])
    colour = base * (1 + spread * tone)[..., None] * warm ** (0.7 * hue[..., None])
    pale = srgb(214, 186, 158)
    colour = mix(colour, pale + np.zeros_like(colour), 0.4 * step(clouds(size, seed + 3, slope=1.3, low=4), 1.4, 0.9))
    return _finish(colour * (1 + 0.06 * grit)[..., None])


def wood(base: F64, dark: F64, seed: int, size: int = 512) -> F32:
    """Grain along the columns' direction (v)."""
    grain = clouds(size, seed, slope=0.9, low=2, stretch=(8.0, 0.5))
    broad = clouds(size, seed + 1, slope=1.6, low=1)
    return _finish(mix(base * (1 + 0.1 * broad)[..., None], dark + np.zeros((size, size, 3)), 0.35 + 0.25 * grain))


def paint(base: F64, under: F64, seed: int, size: int = 512) -> F32:
    """Brushed paint, chipped to what is under it here and there."""
    brush = clouds(size, seed, slope=1.0, low=2, stretch=(5.0, 0.6))
    chips = clouds(size, seed + 1, slope=1.1, low=6)
    colour = base * (1 + 0.12 * brush)[..., None]
    return _finish(mix(colour, under + np.zeros_like(colour), 0.9 * step(chips, 2.0, 0.4)))


def plain(base: F64, seed: int, size: int = 256, contrast: float = 0.1) -> F32:
    """One colour with slight clouds."""
    return _finish(base * (1 + contrast * clouds(size, seed, slope=1.3, low=1))[..., None])


def palette(colours: Sequence[F64], seed: int, count: int = 64, spread: float = 0.18) -> F32:
    """A row of `count` colours drawn between neighbours of a list, for leaves and petals: (1, count, 3)."""
    rng = np.random.default_rng(seed)
    table = np.array(colours)
    k = rng.uniform(0, len(table) - 1, count)
    low = np.minimum(k.astype(int), len(table) - 2)
    t = (k - low)[:, None]
    colour = (table[low] * (1 - t) + table[low + 1] * t) * (1 + rng.normal(0, spread, (count, 1)))
    return _finish(colour[None])


def painted_tiles(tile: int = 128, across: int = 4, seed: int = 0) -> F32:
    """Glazed tiles with a star and quarter circles in cobalt, ochre and white; `across` squared, with joints."""
    x, y = np.meshgrid(*2 * [(np.arange(tile) + 0.5) / tile * 2 - 1])
    angle, radius = np.arctan2(y, x), np.hypot(x, y)
    white, cobalt, ochre, teal = srgb(236, 230, 214), srgb(28, 62, 128), srgb(214, 150, 46), srgb(58, 132, 140)
    edge = 3.0 / tile
    star = 0.50 + 0.20 * np.cos(8 * angle)
    colour = white + np.zeros((tile, tile, 3))
    corner = np.hypot(1 - np.abs(x), 1 - np.abs(y))
    colour = mix(colour, teal, step(-corner, -0.62, edge))
    colour = mix(colour, white, step(-corner, -0.50, edge))
    colour = mix(colour, cobalt, step(-corner, -0.40, edge))
    colour = mix(colour, cobalt, step(star - radius, 0, edge))
    colour = mix(colour, ochre, step(star * 0.55 - radius, 0, edge))
    colour = mix(colour, white, step(0.12 - radius, 0, edge))
    joint = np.maximum(np.abs(x), np.abs(y))
    colour = mix(colour, srgb(150, 140, 126), step(joint, 0.965, edge))
    tone = np.random.default_rng(seed).normal(1, 0.06, (across, across)).repeat(tile, 0).repeat(tile, 1)
    return _finish(np.tile(colour, (across, across, 1)) * tone[..., None])

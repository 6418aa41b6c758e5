"""Light from all around: maps and suns of a lighting, seen in any direction or drawn as one equirectangular picture.

A map's rows go from +Y down, `conventions` says which way its columns look. Suns are drawn so that a surface that faces
them receives exactly their illuminance, however small their disc is beside a pixel.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from mirelight.base import conventions
from mirelight.base.conventions import Matrix
from mirelight.model import F32, F64, Lighting, ParallelLight, SunLight

MOST_ROWS = 1024  # of a map that is kept with a data set, or drawn
SUN_DIAMETER = 0.53  # degrees, of a directional light, which has none
# The frame whose map has the view direction in its middle and the camera's right at u = 0.75 (skylibs, Stanford-ORB).
CAMERA_FROM_MAP = np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]])
_FINE = 16  # samples along a pixel's side where a sun's edge may be


@dataclass(frozen=True, slots=True, eq=False)
class Map:
    """An equirectangular map of a lighting."""

    radiance: F32  # (h, w, 3) linear, row 0 is +Y
    rotation: float  # degrees about +Y, counter-clockwise seen from above
    factor: F64  # (3,) linear

    def seen(self, way: Matrix, world_from_way: Matrix | None = None) -> Matrix:
        """(..., 3) radiance in unit directions (..., 3), which are the world's, or turned to it by a rotation (3, 3);
        between pixels by bilinear interpolation."""
        turn = conventions.rotation_from_euler((0, self.rotation, 0)).T
        if world_from_way is not None:
            turn = turn @ world_from_way
        return _looked_up(self.radiance, np.einsum("...j,ij->...i", way, turn)) * self.factor


@dataclass(frozen=True, slots=True, eq=False)
class Sun:
    """A sun as a disc far away."""

    direction: F64  # (3,) unit, the way its light travels
    lux: F64  # (3,) linear
    diameter: float = SUN_DIAMETER  # degrees

    @staticmethod
    def of(light: ParallelLight) -> Sun:
        """A distant light as a disc."""
        diameter = light.angular_diameter if isinstance(light, SunLight) else SUN_DIAMETER
        return Sun(light.direction, light.color * light.intensity, diameter)


@dataclass(frozen=True, slots=True, eq=False)
class Surroundings:
    """All light of a lighting that comes from far away."""

    maps: tuple[Map, ...] = ()
    suns: tuple[Sun, ...] = ()

    @property
    def rows(self) -> int:
        """As many as its finest map has; 512 or more with a sun, else at least 8."""
        finest = max((len(x.radiance) for x in self.maps), default=0)
        return min(max(finest, 512 if self.suns else 8), MOST_ROWS)

    @property
    def parts(self) -> tuple[object, ...]:
        """All that decides it, for keys."""
        maps = [(x.radiance, x.rotation, x.factor) for x in self.maps]
        return maps, [(x.direction, x.lux, x.diameter) for x in self.suns]

    def picture(self, rows: int | None = None, world_from_map: Matrix | None = None) -> F32:
        """The light as a map.

        Args:
            rows: of the picture, which is twice as wide; None: :attr:`rows`.
            world_from_map: (3, 3) rotation from the picture's own axes to the world's; None: they are the same.

        Returns:
            (rows, 2 rows, 3) linear radiance.
        """
        rows = rows or self.rows
        turn = np.eye(3) if world_from_map is None else np.asarray(world_from_map, dtype=np.float64)
        out = np.zeros((rows, 2 * rows, 3))
        way = conventions.map_pixels(rows)
        for one in self.maps:
            out += replace(one, radiance=shrunk(one.radiance, rows)).seen(way, turn)
        for sun in self.suns:
            _draw(out, turn.T @ -np.asarray(sun.direction), sun)
        return out.astype(np.float32)


class Lookup:
    """Maps of one size seen in the same directions, between pixels by bilinear interpolation.

    Args:
        way: (..., 3) unit, in the maps' own axes.
        rows: of the maps, which are twice as wide unless `columns` says else.
        columns: of the maps.
    """

    def __init__(self, way: Matrix, rows: int, columns: int | None = None) -> None:
        width = columns or 2 * rows
        x = (0.5 + np.arctan2(way[..., 2], way[..., 0]) / (2 * np.pi)) * width - 0.5
        y = np.arccos(np.clip(way[..., 1], -1, 1)) / np.pi * rows - 0.5
        x, y = np.round(x, 9), np.round(y, 9)  # a pixel's own centre gives that pixel, bit for bit
        left, top = np.floor(x).astype(np.int64), np.floor(y).astype(np.int64)
        self._right_share, self._low_share = (x - left)[..., None], (y - top)[..., None]
        self._rows = [np.clip(top + i, 0, rows - 1) for i in (0, 1)]
        self._columns = [(left + i) % width for i in (0, 1)]

    def __call__(self, radiance: F32) -> Matrix:
        """(..., 3) of a map (rows, columns, 3)."""
        (left, right), share, low = self._columns, self._right_share, self._low_share
        upper, lower = (radiance[row, left] * (1 - share) + radiance[row, right] * share for row in self._rows)
        return np.asarray(upper * (1 - low) + lower * low)


def surroundings_of(lighting: Lighting) -> Surroundings | None:
    """What a lighting has all around, as light and no more than that: its environment and its suns. None: nothing.

    Args:
        lighting: resolved, without a sky model or a mix (`mirelight.pipeline.prepared.Prepared.resolved`).
    """
    around = lighting.environment
    maps = () if around is None else (Map(around.pixels, around.rotation, np.full(3, around.intensity)),)
    suns = tuple(Sun.of(x) for x in lighting.lights if isinstance(x, ParallelLight))
    return Surroundings(maps, suns) if maps or suns else None


def shrunk(radiance: F32, most: int = MOST_ROWS) -> F32:
    """A map (H, W, 3) of at most so many rows and twice as many columns, each pixel the mean of those that it stands
    for."""
    height, width, _ = radiance.shape
    down, across = -(-height // most), -(-width // (2 * most))
    if (down, across) == (1, 1):
        return radiance
    padded = np.pad(radiance, ((0, -height % down), (0, -width % across), (0, 0)), mode="edge")
    share = np.sin(np.pi * (np.arange(len(padded)) + 0.5) / len(padded)) if not height % down else np.ones(len(padded))
    weights = share.reshape(-1, down, 1, 1, 1)
    blocks = padded.reshape(len(padded) // down, down, -1, across, 3).astype(np.float64) * weights
    return np.asarray(blocks.sum(axis=1).mean(axis=2) / weights.sum(axis=1)[:, 0], dtype=np.float32)


def solid_angles(rows: int) -> Matrix:
    """(rows, 1) sr of a pixel of a map that is twice as wide."""
    edges = np.cos(np.pi * np.arange(rows + 1) / rows)
    return np.asarray((edges[:-1] - edges[1:])[:, None] * np.pi / rows)


def _looked_up(radiance: F32, way: Matrix) -> Matrix:
    """(h, w, 3) a map seen in directions, between pixels by bilinear interpolation."""
    height, width, _ = radiance.shape
    if (height, width) == (1, 1):
        return np.asarray(np.broadcast_to(radiance[0, 0].astype(np.float64), way.shape))
    return Lookup(way, height, width)(radiance)


def _draw(out: Matrix, to_sun: Matrix, sun: Sun) -> None:
    """Add a sun's disc to a picture; `to_sun` in the picture's axes."""
    rows, columns = out.shape[:2]
    radius, pixel = np.radians(sun.diameter / 2), np.pi / rows
    facing = np.maximum(conventions.map_pixels(rows) @ to_sun, 0)
    near = np.argwhere(facing >= np.cos(min(radius + pixel, np.pi / 2)))
    fine = (np.arange(_FINE) + 0.5) / _FINE
    v = (near[:, 0, None, None] + fine[None, :, None]) / rows
    u = (near[:, 1, None, None] + fine[None, None, :]) / columns
    covered = (conventions.map_direction(u, v) @ to_sun >= np.cos(radius)).mean(axis=(1, 2))
    share = np.zeros((rows, columns))
    share[tuple(near.T)] = covered
    if not share.any():  # smaller than a sample: the pixel that it is in
        share.flat[np.argmax(facing)] = 1.0
    received = float((share * facing * solid_angles(rows)).sum())
    out += share[..., None] * (np.asarray(sun.lux) / received)

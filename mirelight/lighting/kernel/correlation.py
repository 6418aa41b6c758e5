"""How alike pictures are around points of a surface, on the device: planes are carried from picture to picture and the
windows around them compared (normalized cross-correlation)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
from numpy.typing import NDArray

from mirelight.lighting.kernel.memory import floats, integers
from mirelight.lighting.kernel.types import Float, UInt32, Vector3f
from mirelight.model import F32, Camera

_NONE = 0xFFFFFFFF  # stands where a picture has no further one beside it
_LEAST_FACING = 0.15  # cosine: planes seen more aslant count as seen so
_PER_CAMERA = 16  # camera from world in three rows, focal lengths, middle
_PER_POSE = 12  # right, up, back, position


@dataclass(frozen=True, slots=True)
class Windows:
    """What of two pictures is compared."""

    radius: int  # px, every second pixel
    color: float  # display values, summed over channels: pixels of another colour count less
    noise: float  # display values: contrast of this much tells nothing
    best: int  # pictures that count, those most alike: the others may have something before it

    def pixels(self) -> list[tuple[int, int]]:
        """Columns and rows from the middle."""
        line = [x for x in range(-self.radius, self.radius + 1) if x % 2 == 0]
        return [(x, y) for y in line for x in line if x * x + y * y <= self.radius**2 + 1]


class Correlation:
    """Pictures, and pixels of theirs whose surface is sought.

    Args:
        cameras: of the pictures, at the pictures' size.
        pictures: (h, w, 4) each: display values, and whether a pixel counts.
        beside: of each picture the others that it is compared with.
        picture: (P,) the picture of each pixel.
        column, row: (P,) its place there.
        windows: what is compared.
    """

    def __init__(
        self,
        cameras: Sequence[Camera],
        pictures: Sequence[F32],
        beside: Sequence[Sequence[int]],
        picture: NDArray[np.int64],
        column: NDArray[np.int64],
        row: NDArray[np.int64],
        windows: Windows,
    ) -> None:
        self.windows = windows
        sizes = [x.shape[0] * x.shape[1] for x in pictures]
        self._texels = floats(np.concatenate([x.ravel() for x in pictures]))
        self._start = integers(np.cumsum(sizes) - sizes)
        self._width = integers([x.width for x in cameras])
        self._height = integers([x.height for x in cameras])
        self._cameras = floats(np.concatenate([_projection(x) for x in cameras]))
        self._poses = floats(np.concatenate([_pose(x) for x in cameras]))
        self._most = max(len(x) for x in beside)
        table = np.full((len(beside), self._most), _NONE, np.uint32)
        for k, others in enumerate(beside):
            table[k, : len(others)] = others
        self._beside = integers(table)
        self._picture = integers(picture)
        self._column = integers(column)
        self._row = integers(row)

    def of(self, depth: F32, normal: F32) -> F32:
        """(P,) mean correlation with the `best` others that are most alike, -1 where fewer than two show the place.

        Args:
            depth: (P,) along the view axis, world units.
            normal: (P, 3) unit, facing the eye.
        """
        planes = mi.Vector3f(*(floats(normal[:, k]) for k in range(3)))
        found = self._alike(floats(depth), planes)
        dr.eval(found)
        return np.array(found, np.float32)

    def _alike(self, depth: Float, normal: Vector3f) -> Float:
        window = _Window(self, depth, normal)
        most = dr.opaque(mi.UInt32, self._most)
        first = tuple(mi.Float(-1) for _ in range(self.windows.best))

        def more(k: UInt32, *_: Float) -> Any:
            return k < most

        def step(k: UInt32, *best: Float) -> tuple[Any, ...]:
            other = dr.gather(mi.UInt32, self._beside, self._picture * most + k)
            there = other != _NONE
            alike = window.alike(dr.select(there, other, 0), there)
            kept = []
            for value in best:  # the largest ones, sorted
                kept.append(dr.maximum(value, alike))
                alike = dr.minimum(value, alike)
            return (k + 1, *kept)

        loop: Any = dr.while_loop  # its stub knows no states of several types
        _, *best = loop((dr.zeros(mi.UInt32, dr.width(depth)), *first), more, step)
        total, count = mi.Float(0), mi.Float(0)
        for value in best:
            total += dr.select(value > -1, value, 0)
            count += dr.select(value > -1, 1.0, 0.0)
        return dr.select(count >= 2, total / dr.maximum(count, 1), -1)

    def texel(self, start: UInt32, width: UInt32, x: UInt32, y: UInt32) -> Any:
        """Display values and whether it counts, of a pixel."""
        return dr.gather(mi.Vector4f, self._texels, start + dr.fma(y, width, x))

    def camera_of(self, picture: UInt32) -> tuple[list[list[Float]], list[Float]]:
        """Rows of camera from world, and (fx, fy, cx, cy)."""
        values = [dr.gather(mi.Float, self._cameras, picture * _PER_CAMERA + k) for k in range(_PER_CAMERA)]
        return [values[:4], values[4:8], values[8:12]], values[12:]

    def frame_of(self, picture: UInt32) -> tuple[UInt32, UInt32, UInt32]:
        """Its first pixel among all, its width and its height."""
        return tuple(dr.gather(mi.UInt32, x, picture) for x in (self._start, self._width, self._height))  # type: ignore[return-value]


class _Window:
    """The pixels around a pixel, and where its plane has them in space."""

    def __init__(self, pixels: Correlation, depth: Float, normal: Vector3f) -> None:
        self._pixels = pixels
        own = pixels._picture
        pose = [dr.gather(mi.Float, pixels._poses, own * _PER_POSE + k) for k in range(_PER_POSE)]
        right, up, back, eye = (mi.Vector3f(*pose[3 * k : 3 * k + 3]) for k in range(4))
        _, (fx, fy, cx, cy) = pixels.camera_of(own)
        start, width, height = pixels.frame_of(own)

        def ray(x: Float, y: Float) -> Vector3f:
            aside: Vector3f = right * ((x - cx) / fx) + up * ((cy - y) / fy)
            return aside - back

        x, y = mi.Float(pixels._column) + 0.5, mi.Float(pixels._row) + 0.5
        ahead = ray(x, y)
        facing = dr.minimum(dr.dot(normal, ahead), -_LEAST_FACING * dr.norm(ahead))
        middle = pixels.texel(start, width, pixels._column, pixels._row)
        self._middle, self._there = middle, (depth > 0) & (middle.w > 0.5)
        self._colors, self._weights, self._points = [], list[Float](), list[Any]()
        self.sum, self.mean, square = mi.Float(0), [mi.Float(0)] * 3, mi.Float(0)
        windows = pixels.windows
        self._at, wide = windows.pixels(), 2 * (0.7 * windows.radius) ** 2  # px²: how fast its rim counts less
        for across, down in self._at:
            column = mi.UInt32(dr.clip(mi.Int32(pixels._column) + across, 0, mi.Int32(width) - 1))
            line = mi.UInt32(dr.clip(mi.Int32(pixels._row) + down, 0, mi.Int32(height) - 1))
            color = _less(pixels.texel(start, width, column, line), middle)
            other: Float = dr.abs(color[0]) + dr.abs(color[1]) + dr.abs(color[2])
            weight = dr.exp(-other / windows.color - (across * across + down * down) / wide)
            way = ray(x + across, y + down)
            along = facing / dr.minimum(dr.dot(normal, way), facing * 0.2)
            self._colors.append(color)
            self._weights.append(weight)
            self._points.append(eye + way * (depth * along))
            self.sum += weight
            self.mean = [a + weight * b for a, b in zip(self.mean, color, strict=True)]
            square += weight * _dot(color, color)
        self._floor = self.sum * (3 * windows.noise**2)
        self._spread = square - _dot(self.mean, self.mean) / self.sum + self._floor

    def alike(self, other: UInt32, there: Any) -> Float:
        """Correlation with what another picture shows of the window; -1 where it does not."""
        pixels = self._pixels
        rows, (fx, fy, cx, cy) = pixels.camera_of(other)
        start, width, height = pixels.frame_of(other)
        most = mi.Float(width) - 1.001, mi.Float(height) - 1.001
        mean, square, both = [mi.Float(0)] * 3, mi.Float(0), mi.Float(0)
        seen = there & self._there
        for at, color, weight, p in zip(self._at, self._colors, self._weights, self._points, strict=True):
            own = [r[0] * p.x + r[1] * p.y + r[2] * p.z + r[3] for r in rows]
            ahead = dr.maximum(-own[2], 1e-6)
            x, y = cx + fx * own[0] / ahead - 0.5, cy - fy * own[1] / ahead - 0.5
            if at == (0, 0):
                seen &= (own[2] < 0) & (x >= 1) & (x <= most[0] - 1) & (y >= 1) & (y <= most[1] - 1)
            value = self._between(start, width, dr.clip(x, 0, most[0]), dr.clip(y, 0, most[1]))
            if at == (0, 0):
                seen &= value.w > 0.5
            shown = _less(value, self._middle)
            mean = [a + weight * b for a, b in zip(mean, shown, strict=True)]
            square += weight * _dot(shown, shown)
            both += weight * _dot(shown, color)
        spread = dr.maximum(square - _dot(mean, mean) / self.sum, 0) + self._floor
        common = both - _dot(mean, self.mean) / self.sum
        return dr.select(seen, common / dr.sqrt(self._spread * spread), -1)

    def _between(self, start: UInt32, width: UInt32, x: Float, y: Float) -> Any:
        """What a picture shows between four pixels' middles."""
        column, line = mi.UInt32(x), mi.UInt32(y)
        s, t = x - mi.Float(column), y - mi.Float(line)
        texel = self._pixels.texel
        above = texel(start, width, column, line) * (1 - s) + texel(start, width, column + 1, line) * s
        below = texel(start, width, column, line + 1) * (1 - s) + texel(start, width, column + 1, line + 1) * s
        return above * (1 - t) + below * t


def _less(value: Any, by: Any) -> list[Float]:
    return [value.x - by.x, value.y - by.y, value.z - by.z]


def _dot(a: Sequence[Float], b: Sequence[Float]) -> Float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _projection(camera: Camera) -> F32:
    lens = np.array([camera.fx, camera.fy, camera.cx, camera.cy])
    return np.concatenate([camera.camera_from_world[:3].ravel(), lens]).astype(np.float32)


def _pose(camera: Camera) -> F32:
    return np.ascontiguousarray(camera.world_from_camera[:3].T).ravel().astype(np.float32)

"""A camera as a file has it: a pose in the capture's axes, a lens, and what the lens bends.

All that is rendered are pinholes, so each picture is seen through pinholes: a bent one through that of its middle,
which shows less than a fisheye does, but nothing that it does not; a panorama through the six sides of a cube.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from mirelight.model import F64, Camera
from mirelight.model.arrays import freeze

Size = tuple[int, int]  # width, height in pixels

STRAIGHT = 0.01  # px; a lens that bends less than this is taken as straight
_GRID = 33  # points along each side of the picture at which a distortion is measured


@dataclass(frozen=True, slots=True, kw_only=True)
class Intrinsics:
    """A pinhole in pixels; the centre of the top left pixel is (0.5, 0.5)."""

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float

    @property
    def size(self) -> Size:
        """Width and height in pixels."""
        return self.width, self.height

    def fitted(self, size: Size) -> Intrinsics:
        """The lens on another pixel grid: what is seen from top to bottom stays, pixels keep their shape, and a wider
        or narrower picture shows more or less at both sides."""
        if size == self.size:
            return self
        s = size[1] / self.height
        return Intrinsics(
            width=size[0],
            height=size[1],
            fx=self.fx * s,
            fy=self.fy * s,
            cx=size[0] / 2 + (self.cx - self.width / 2) * s,
            cy=self.cy * s,
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Angle:
    """A centred lens given by its field of view, with square pixels."""

    degrees: float  # the whole angle, above 0 and below 180
    side: Literal["vertical", "horizontal", "longer"]  # of the picture, that it spans
    size: Size | None = None  # the picture's, where the file says it

    def fitted(self, size: Size) -> Intrinsics:
        """The lens on a pixel grid."""
        own = self.size or size
        across = {"vertical": own[1], "horizontal": own[0], "longer": max(own)}[self.side]
        f = across / (2 * math.tan(math.radians(self.degrees) / 2))
        lens = Intrinsics(width=own[0], height=own[1], fx=f, fy=f, cx=own[0] / 2, cy=own[1] / 2)
        return lens.fitted(size)


@dataclass(frozen=True, slots=True, kw_only=True)
class Distortion:
    """How a lens bends what a pinhole shows, as COLMAP and OpenCV write it.

    With (x, y) on the plane one unit in front of the eye and r² = x² + y²: x' = x (1 + k1 r² + k2 r⁴ + …) /
    (1 + d1 r² + …) + 2 p1 x y + p2 (r² + 2 x²) + s1 r², and y' with x and y, p1 and p2 exchanged, and s2. A fisheye has
    (x, y) θ / r in place of (x, y), with θ = atan r the angle to where it looks.
    """

    model: str  # as the file names it
    radial: tuple[float, ...] = ()  # k1, k2, …
    divisor: tuple[float, ...] = ()  # d1, d2, … (k4, k5, k6 of OpenCV)
    tangential: tuple[float, float] = (0.0, 0.0)  # p1, p2
    prism: tuple[float, float] = (0.0, 0.0)  # s1, s2
    fisheye: bool = False

    def shifts(self, x: F64, y: F64) -> tuple[F64, F64]:
        """How far points of the plane one unit in front of the eye are moved, along x (to the right) and y (down)."""
        p1, p2 = self.tangential
        s1, s2 = self.prism
        with np.errstate(all="ignore"):
            near = _angle_over_tangent(np.hypot(x, y)) if self.fisheye else 1.0
            u, v = x * near, y * near
            r2 = u * u + v * v
            factor = _series(self.radial, r2) / _series(self.divisor, r2) * near
            dx = x * (factor - 1) + 2 * p1 * u * v + p2 * (r2 + 2 * u * u) + s1 * r2
            dy = y * (factor - 1) + 2 * p2 * u * v + p1 * (r2 + 2 * v * v) + s2 * r2
        return dx, dy

    def size(self, lens: Intrinsics) -> Size:
        """Width and height in pixels of the file's picture."""
        return lens.size

    def at(self, lens: Intrinsics, u: F64, v: F64) -> tuple[F64, F64]:
        """Where in the file's picture, in its pixels, those at (u, v) of the pinhole are."""
        dx, dy = self.shifts((u - lens.cx) / lens.fx, (v - lens.cy) / lens.fy)
        return u + lens.fx * dx, v + lens.fy * dy

    def largest_shift(self, lens: Intrinsics) -> float:
        """How far, in pixels, the lens moves a point of the pinhole's picture at most."""
        u = np.linspace(0, lens.width, _GRID)
        v = np.linspace(0, lens.height, _GRID)
        x, y = np.meshgrid((u - lens.cx) / lens.fx, (v - lens.cy) / lens.fy)
        dx, dy = self.shifts(x, y)
        with np.errstate(all="ignore"):
            shift = float(np.hypot(lens.fx * dx, lens.fy * dy).max())
        return shift if math.isfinite(shift) else math.inf


def _angle_over_tangent(r: F64) -> F64:
    return np.asarray(np.arctan(r) / np.where(r > 0, r, 1.0) + (r <= 0), np.float64)


def _series(coefficients: tuple[float, ...], r2: F64) -> F64:
    out = np.ones_like(r2)
    power = np.ones_like(r2)
    for k in coefficients:
        power = power * r2
        out = out + k * power
    return out


ALL_AROUND = "EQUIRECTANGULAR"  # as COLMAP and nerfstudio name the model
Side = Literal["front", "right", "back", "left", "up", "down"]

# Columns: what is right, up and behind for each side, in the panorama's own axes (+X right, +Y up, -Z its middle).
_SIDES: dict[Side, F64] = {
    "front": np.array([[1.0, 0, 0], [0, 1, 0], [0, 0, 1]]),
    "right": np.array([[0.0, 0, -1], [0, 1, 0], [1, 0, 0]]),
    "back": np.array([[-1.0, 0, 0], [0, 1, 0], [0, 0, -1]]),
    "left": np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]]),
    "up": np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]),
    "down": np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]]),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Panorama:
    """Where a side of a cube is in an equirectangular picture of all directions.

    The picture's middle is where its camera looks, its left and right rims are behind it, its rows go from straight up
    to straight down (COLMAP's EQUIRECTANGULAR, nerfstudio's cameras.py).
    """

    side: Side
    width: int  # of the panorama, twice its height
    model: str = ALL_AROUND

    def lens(self) -> Intrinsics:
        """The pinhole of 90 degrees whose pixels are as large in its middle as the panorama's."""
        across = max(round(self.width / math.pi), 1)
        return Intrinsics(width=across, height=across, fx=across / 2, fy=across / 2, cx=across / 2, cy=across / 2)

    def largest_shift(self, lens: Intrinsics) -> float:
        """0: its sides are pinholes."""
        return 0.0

    def size(self, lens: Intrinsics) -> Size:
        """Width and height in pixels of the file's picture."""
        return self.width, self.width // 2

    def at(self, lens: Intrinsics, u: F64, v: F64) -> tuple[F64, F64]:
        """Where in the panorama, in its pixels, those at (u, v) of the side's pinhole are."""
        way = np.stack([(u - lens.cx) / lens.fx, (lens.cy - v) / lens.fy, -np.ones_like(u)], axis=-1)
        x, y, z = np.moveaxis(way @ _SIDES[self.side].T, -1, 0)
        turn = np.arctan2(x, -z) / math.tau + 0.5
        return np.asarray(turn * self.width), np.arctan2(np.hypot(x, z), y) / math.pi * (self.width // 2)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FileCamera:
    """One camera of a file."""

    name: str  # fit for a file's name
    world_from_camera: F64  # (4, 4) rigid, in the capture's axes; looks along its -Z, +Y is up
    lens: Intrinsics | Angle
    distortion: Distortion | Panorama | None = None  # None: a pinhole
    picture: str = ""  # what it took, as the file names it, perhaps without suffix; "": it names none
    mask: str = ""  # black where that picture does not count

    def __post_init__(self) -> None:
        freeze(self, "world_from_camera", (4, 4), np.float64)

    def size(self, fallback: Size) -> Size:
        """Width and height in pixels that the file asks for; `fallback` where it says none."""
        return self.lens.size or fallback

    def shift(self) -> float:
        """The largest shift of its distortion in pixels, 0 for a pinhole."""
        if self.distortion is None:
            return 0.0
        return self.distortion.largest_shift(self.lens.fitted(self.size((1920, 1080))))

    def to_camera(self, size: Size, world_from_camera: F64 | None = None) -> Camera:
        """The pinhole on a pixel grid; a distortion is left out.

        Args:
            size: width and height in pixels.
            world_from_camera: another pose (4, 4), rigid.
        """
        lens = self.lens.fitted(size)
        return Camera(
            name=self.name,
            world_from_camera=self.world_from_camera if world_from_camera is None else world_from_camera,
            width=lens.width,
            height=lens.height,
            fx=lens.fx,
            fy=lens.fy,
            cx=lens.cx,
            cy=lens.cy,
        )


def pinholes(cameras: Iterable[FileCamera]) -> tuple[FileCamera, ...]:
    """Cameras as files have them, each panorama in six.

    All front sides come before all right ones, and so on, so that a few that are evenly taken look all ways.
    """
    taken = tuple(cameras)
    whole = [(x, x.distortion) for x in taken if isinstance(x.distortion, Panorama)]
    out = [x for x in taken if not isinstance(x.distortion, Panorama)]
    for side, turn in _SIDES.items():
        for one, bend in whole:
            pose = one.world_from_camera.copy()
            pose[:3, :3] = pose[:3, :3] @ turn
            name = f"{one.name}_{side}"
            out.append(replace(one, name=name, world_from_camera=pose, distortion=replace(bend, side=side)))
    return tuple(out)

"""A camera as a file has it: a pose in the capture's axes, a lens, and what the lens bends."""

from __future__ import annotations

import math
from dataclasses import dataclass
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
    (1 + d1 r² + …) + 2 p1 x y + p2 (r² + 2 x²), and y' with x and y, p1 and p2 exchanged.
    """

    model: str  # as the file names it
    radial: tuple[float, ...] = ()  # k1, k2, …
    divisor: tuple[float, ...] = ()  # d1, d2, … (k4, k5, k6 of OpenCV)
    tangential: tuple[float, float] = (0.0, 0.0)  # p1, p2

    def shifts(self, x: F64, y: F64) -> tuple[F64, F64]:
        """How far points of the plane one unit in front of the eye are moved, along x (to the right) and y (down)."""
        r2 = x * x + y * y
        p1, p2 = self.tangential
        with np.errstate(all="ignore"):
            factor = _series(self.radial, r2) / _series(self.divisor, r2)
            dx = x * (factor - 1) + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
            dy = y * (factor - 1) + 2 * p2 * x * y + p1 * (r2 + 2 * y * y)
        return dx, dy

    def largest_shift(self, lens: Intrinsics) -> float:
        """How far, in pixels, the lens moves a point of the pinhole's picture at most."""
        u = np.linspace(0, lens.width, _GRID)
        v = np.linspace(0, lens.height, _GRID)
        x, y = np.meshgrid((u - lens.cx) / lens.fx, (v - lens.cy) / lens.fy)
        dx, dy = self.shifts(x, y)
        with np.errstate(all="ignore"):
            shift = float(np.hypot(lens.fx * dx, lens.fy * dy).max())
        return shift if math.isfinite(shift) else math.inf


def _series(coefficients: tuple[float, ...], r2: F64) -> F64:
    out = np.ones_like(r2)
    power = np.ones_like(r2)
    for k in coefficients:
        power = power * r2
        out = out + k * power
    return out


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FileCamera:
    """One camera of a file."""

    name: str  # fit for a file's name
    world_from_camera: F64  # (4, 4) rigid, in the capture's axes; looks along its -Z, +Y is up
    lens: Intrinsics | Angle
    distortion: Distortion | None = None  # None: a pinhole
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

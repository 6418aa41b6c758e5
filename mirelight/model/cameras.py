"""Cameras."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from mirelight.base import conventions
from mirelight.model import shown
from mirelight.model.arrays import F64, ArrayHolder, freeze
from mirelight.model.exposure import Exposure


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Camera(ArrayHolder):
    """A pinhole or orthographic camera. A camera-space point (x, y, z), z < 0 in front, lands on pixel
    ``(cx + fx x / w, cy - fy y / w)`` with ``w = -z`` (perspective) or ``w = 1`` (orthographic)."""

    name: str = "camera"
    world_from_camera: F64  # (4, 4) rigid; columns right, up, back, position (world units)
    width: int  # px
    height: int  # px
    fx: float  # px (perspective) or px per world unit (orthographic)
    fy: float  # px or px per world unit
    cx: float  # px from the left edge of the image; width / 2 is centred
    cy: float  # px from the top edge; height / 2 is centred
    projection: Literal["perspective", "orthographic"] = "perspective"
    near: float = 0.01  # world units along the view axis; nearer splats and surfaces are not seen
    far: float = float("inf")  # world units
    time: float | None = None  # s, of the animation that it was taken from; not part of what it sees
    frame: float | None = None  # of its path, from 1, where things move by it; not part of what it sees
    exposure: Exposure | None = None  # its lens and shutter; None: a pinhole, which all is sharp to
    share: tuple[int, int] | None = None  # (number, count) among the pinholes whose mean is one picture

    def __post_init__(self) -> None:
        freeze(self, "world_from_camera", (4, 4), np.float64)
        r = self.world_from_camera[:3, :3]
        if not np.allclose(r @ r.T, np.eye(3), atol=1e-4) or np.linalg.det(r) < 0:
            raise ValueError("world_from_camera is not rigid (scale, shear or mirror); see conventions.rigid_part")
        if self.width < 1 or self.height < 1:
            raise ValueError(f"image of {self.width} x {self.height} pixels")
        if not (self.fx > 0 and self.fy > 0 and 0 < self.near < self.far):
            raise ValueError("fx and fy must be positive, and 0 < near < far")
        if self.exposure is not None and self.exposure.aperture_radius > 0 and self.projection != "perspective":
            raise ValueError("a lens needs a perspective camera")

    def __repr__(self) -> str:
        unit = "px" if self.projection == "perspective" else "px a unit"
        return (
            f"Camera({shown.view(self)}, {self.projection}, focal {self.fx:.6g} {self.fy:.6g} {unit}, "
            f"at {shown.point(self.position)}, looks along {shown.point(-self.world_from_camera[:3, 2])}"
            f"{'' if self.exposure is None else f', {self.exposure}'})"
        )

    @property
    def camera_from_world(self) -> F64:
        """(4, 4) inverse of `world_from_camera`."""
        r, t = self.world_from_camera[:3, :3], self.world_from_camera[:3, 3]
        out = np.eye(4)
        out[:3, :3], out[:3, 3] = r.T, -r.T @ t
        return out

    @property
    def position(self) -> F64:
        """(3,) eye position, world units."""
        return self.world_from_camera[:3, 3]

    @property
    def pinhole(self) -> Camera:
        """The camera through the middle of its lens, where it stands at its own moment."""
        return self if self.exposure is None else replace(self, exposure=None)

    def pinholes(self, count: int) -> tuple[Camera, ...]:
        """So many whose mean is its picture, each with its share of the samples; itself where it is one.

        A point of the lens looks through a picture that is shifted, so that what lies in focus stays in its pixel.
        """
        exposure, plain = self.exposure, self.pinhole
        if exposure is None:
            return (self,)
        out = []
        poses = exposure.poses_at(self.world_from_camera, count)
        frames = exposure.frames_at(self.frame, count)
        for k, (right, up) in enumerate(exposure.points(count)):
            pose = poses[k].copy()
            pose[:3, 3] += right * pose[:3, 0] + up * pose[:3, 1]
            shift = right / exposure.focus_distance, up / exposure.focus_distance
            cx, cy = self.cx + self.fx * shift[0], self.cy - self.fy * shift[1]
            out.append(replace(plain, world_from_camera=pose, cx=cx, cy=cy, share=(k, count), frame=frames[k]))
        return tuple(out)

    def rays(self) -> tuple[F64, F64]:
        """(H, W, 3) where the pixels' centres look from, or (3,) if from one point, and (H, W, 3) directions, one deep
        along the view axis. Without BLAS, whose bits depend on its threads."""
        x = (np.arange(self.width) + 0.5 - self.cx) / self.fx
        y = (self.cy - np.arange(self.height) - 0.5) / self.fy
        own = np.empty((self.height, self.width, 3))
        own[..., 0], own[..., 1], own[..., 2] = x[None, :], y[:, None], -1.0
        turn = self.world_from_camera[:3, :3]
        if self.projection == "perspective":
            return self.position, np.einsum("...j,ij->...i", own, turn)
        ahead = own * (0, 0, 1)
        return self.position + np.einsum("...j,ij->...i", own - ahead, turn), np.einsum("...j,ij->...i", ahead, turn)

    def resized(self, width: int, height: int) -> Camera:
        """The same view on another pixel grid (used for `texture_scale` and small tests)."""
        sx, sy = width / self.width, height / self.height
        return replace(
            self,
            width=width,
            height=height,
            fx=self.fx * sx,
            fy=self.fy * sy,
            cx=self.cx * sx,
            cy=self.cy * sy,
        )

    def scaled(self, share: float) -> Camera:
        """The same view in a picture of that share of the width and height; at least one pixel is left."""
        return self.resized(max(1, round(self.width * share)), max(1, round(self.height * share)))

    @staticmethod
    def perspective(
        world_from_camera: ArrayLike,
        width: int,
        height: int,
        *,
        yfov: float,
        name: str = "camera",
        near: float = 0.01,
        far: float = float("inf"),
    ) -> Camera:
        """A centred pinhole camera with square pixels; `yfov` is the vertical field of view in degrees."""
        f = height / (2 * np.tan(np.radians(yfov) / 2))
        return Camera(
            name=name,
            world_from_camera=np.asarray(world_from_camera),
            width=width,
            height=height,
            fx=float(f),
            fy=float(f),
            cx=width / 2,
            cy=height / 2,
            near=near,
            far=far,
        )

    @staticmethod
    def look_at(
        position: ArrayLike, target: ArrayLike, width: int, height: int, *, yfov: float = 45.0, **named: Any
    ) -> Camera:
        """A centred pinhole camera at `position` looking at `target`; `named` as for :meth:`perspective`."""
        return Camera.perspective(conventions.look_at(position, target), width, height, yfov=yfov, **named)

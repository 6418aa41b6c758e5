"""Clouds of splats on surfaces that are known exactly."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from mirelight.model import SplatCloud

F64 = NDArray[np.float64]


def on_surface(points: F64, normals: F64, size: float, *, thin: float, opacity: float = 0.95) -> SplatCloud:
    """Discs of that size on a surface; `thin` is the share of it that they are thick."""
    n = len(points)
    z = np.array([0.0, 0.0, 1.0])
    half = normals + z  # the rotation that takes z to the normal, by half-way vectors
    w = 1 + normals[:, 2]
    quats = np.stack([w, -half[:, 1], half[:, 0], np.zeros(n)], axis=1)
    quats[w < 1e-9] = (0, 1, 0, 0)
    return SplatCloud(
        means=points.astype(np.float32),
        quats=(quats / np.linalg.norm(quats, axis=1, keepdims=True)).astype(np.float32),
        scales=np.tile(np.array([size, size, size * thin], np.float32), (n, 1)),
        opacities=np.full(n, opacity, np.float32),
        sh=np.zeros((n, 1, 3), np.float32),
    )


def sphere_points(count: int) -> F64:
    """Evenly spread unit vectors."""
    k = np.arange(count) + 0.5
    z, turn = 1 - 2 * k / count, k * np.pi * (3 - np.sqrt(5))
    flat = np.sqrt(1 - z * z)
    return np.stack([flat * np.cos(turn), flat * np.sin(turn), z], axis=1)


def ball(count: int = 4000, *, thin: float = 0.3, centre: tuple[float, float, float] = (0, 0, 0)) -> SplatCloud:
    """A ball of radius 1."""
    n = sphere_points(count)
    return on_surface(n + np.array(centre), n, 0.7 * np.sqrt(4 * np.pi / count), thin=thin)


def fog(opacity: float) -> SplatCloud:
    """Blobs all through a ball, so few that nobody asks where they were seen from."""
    n = 450
    return replace(
        ball(n),
        means=np.random.default_rng(0).normal(size=(n, 3)).astype(np.float32),
        scales=np.full((n, 3), 0.31, np.float32),
        opacities=np.full(n, opacity, np.float32),
    )


def square(side: float, step: float, normal_axis: int, offset: float) -> tuple[F64, F64]:
    """A grid of points on a square across one axis, and their normals."""
    x = np.arange(-side / 2 + step / 2, side / 2, step)
    u, v = (a.ravel() for a in np.meshgrid(x, x, indexing="ij"))
    points = np.zeros((len(u), 3))
    points[:, (normal_axis + 1) % 3], points[:, (normal_axis + 2) % 3], points[:, normal_axis] = u, v, offset
    normals = np.zeros_like(points)
    normals[:, normal_axis] = 1
    return points, normals


def box_shell(side: float, step: float, *, thin: float, faces: tuple[int, ...] = (0, 1, 2, 3, 4, 5)) -> SplatCloud:
    """Faces of a box; 2 axis + 1 is the one at the positive end."""
    both = [square(side, step, k // 2, side / 2 if k % 2 else -side / 2) for k in faces]
    return on_surface(np.concatenate([p for p, _ in both]), np.concatenate([n for _, n in both]), 0.7 * step, thin=thin)


def joined(*clouds: SplatCloud) -> SplatCloud:
    """All their splats as one capture."""
    return SplatCloud(
        means=np.concatenate([c.means for c in clouds]),
        quats=np.concatenate([c.quats for c in clouds]),
        scales=np.concatenate([c.scales for c in clouds]),
        opacities=np.concatenate([c.opacities for c in clouds]),
        sh=np.concatenate([c.sh for c in clouds]),
    )

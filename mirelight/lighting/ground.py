"""Objects set down on the ground under them. NumPy only."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mirelight.base import conventions
from mirelight.base.errors import InputError
from mirelight.model import F64, Inserted, ProxyMesh

_FOOT = 0.02  # of an object's height: vertices that low may carry it
_MOST_FEET = 256  # of those that are looked at
_LEAST_SPREAD = 1e-3  # of feet across their line
_STEEPEST = 0.7  # cosine to upright, below which objects stay as they are
_AT_ONCE = 1 << 22  # pairs of a foot and a triangle


@dataclass(frozen=True, slots=True, eq=False)
class Ground:
    """Triangles that carry things, and where they are seen from above."""

    corners: F64  # (F, 3, 3)
    low: F64  # (F, 2) along X and Z
    high: F64

    @staticmethod
    def of(mesh: ProxyMesh) -> Ground:
        """All of a mesh."""
        corners = mesh.vertices[mesh.faces].astype(np.float64)
        flat = corners[..., [0, 2]]
        return Ground(corners, flat.min(axis=1), flat.max(axis=1))

    def within(self, low: F64, high: F64) -> Ground:
        """Those over a rectangle, its corners (2,) along X and Z."""
        over = (self.high >= low) & (self.low <= high)
        near = over[:, 0] & over[:, 1]  # numpy's tests of all along an axis of two are slow
        return Ground(self.corners[near], self.low[near], self.high[near])

    def heights(self, points: F64, reach: float) -> F64:
        """(N,) the highest Y on the vertical line through each point (N, 3), up to `reach`; -inf: none."""
        places = points[:, [0, 2]]
        corners = self.within(places.min(axis=0), places.max(axis=0)).corners
        out = np.full(len(points), -np.inf)
        step = max(_AT_ONCE // max(len(points), 1), 1)
        for at in range(0, len(corners), step):
            found = _heights(corners[at : at + step], places)
            found[found > reach] = -np.inf
            np.maximum(out, found.max(axis=1, initial=-np.inf), out=out)
        return out


def box_round(axes: F64, placed: ProxyMesh) -> F64:
    """(4, 4) round a mesh the least box along axes (3, 3): world from the cube of side 1 about 0."""
    own = placed.vertices.astype(np.float64) @ np.linalg.inv(axes).T
    low, high = own.min(axis=0), own.max(axis=0)
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = axes * (high - low), axes @ ((low + high) / 2)
    return out


def dropped(one: Inserted, mesh: ProxyMesh, ground: Ground) -> tuple[ProxyMesh, F64]:
    """(the mesh moved along Y by the least gap between its lowest vertices and the ground under them, first turned to
    lie along that ground where that is asked for; the (3, 3) turn).

    Raises:
        InputError: there is no ground under or over them.
    """
    low, high = mesh.bounds
    height = float(high[1] - low[1])
    feet = np.unique(mesh.vertices[mesh.vertices[:, 1] <= low[1] + _FOOT * height], axis=0).astype(np.float64)
    feet = feet[np.linspace(0, len(feet) - 1, min(len(feet), _MOST_FEET)).astype(int)]
    heights = ground.heights(feet, reach=float(high[1]))
    if not np.isfinite(heights).any():
        remedy = "move it over the ground, or leave drop out"
        raise InputError(one.source, f"nothing of the proxy lies under {one.name!r} to drop it on", remedy)
    turn = _along(feet, heights) if one.drop == "tilt" else np.eye(3)
    middle = feet.mean(axis=0)
    feet, vertices = ((x - middle) @ turn.T + middle for x in (feet, mesh.vertices.astype(np.float64)))
    if one.drop == "tilt":
        heights = ground.heights(feet, reach=float(high[1]))
    gaps = (feet[:, 1] - heights)[np.isfinite(heights)]
    down = float(gaps.min()) if len(gaps) else 0.0
    return mesh.turned(turn, vertices - np.array([0, down, 0])), turn


def _along(feet: F64, heights: F64) -> F64:
    """(3, 3) the turn from upright to the plane through the ground under feet (N, 3); none where that is too steep, or
    the feet stand in a line."""
    known = np.isfinite(heights)
    flat = feet[known][:, [0, 2]] - feet[known][:, [0, 2]].mean(axis=0) if known.any() else np.zeros((0, 2))
    if len(flat) < 3 or np.linalg.svd(flat, compute_uv=False)[1] < _LEAST_SPREAD * np.abs(flat).max():
        return np.eye(3)
    a, _, b = slope(feet[known], heights[known])
    up = np.array([-a, 1.0, -b]) / np.sqrt(1 + a * a + b * b)
    if up[1] < _STEEPEST:
        return np.eye(3)
    return conventions.turn_onto((0, 1, 0), up)


def slope(points: F64, heights: F64) -> F64:
    """(3,) how much the plane through heights over points (N, 3) rises along X and Z; of Y: 0."""
    flat = points[:, [0, 2]] - points[:, [0, 2]].mean(axis=0)
    (a, b, _), *_ = np.linalg.lstsq(np.column_stack([flat, np.ones(len(flat))]), heights, rcond=None)
    return np.array([a, 0.0, b])


def _heights(corners: F64, at: F64) -> F64:
    """(N, F) Y of each triangle over each place (N, 2); -inf where it does not lie over it."""
    flat = corners[..., [0, 2]]
    e1, e2 = flat[:, 1] - flat[:, 0], flat[:, 2] - flat[:, 0]
    area = e1[:, 0] * e2[:, 1] - e1[:, 1] * e2[:, 0]
    w = at[:, None] - flat[None, :, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        u = (w[..., 0] * e2[:, 1] - w[..., 1] * e2[:, 0]) / area
        v = (e1[:, 0] * w[..., 1] - e1[:, 1] * w[..., 0]) / area
        y = corners[:, 0, 1] * (1 - u - v) + corners[:, 1, 1] * u + corners[:, 2, 1] * v
        inside = (u >= -1e-9) & (v >= -1e-9) & (u + v <= 1 + 1e-9)
    return np.where(inside, y, -np.inf)

"""Splats on surfaces: where they lie, how large they are, and the colour that light gives them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mirelight.base.sh import C0
from mirelight.model import Camera, SplatCloud
from scenegen.geometry import Soup
from scenegen.recipe import Recipe
from scenegen.truth import Truth

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]
I64 = NDArray[np.int64]
OVERLAP = 0.82  # a splat's deviation over the Poisson-disc radius


@dataclass(frozen=True, kw_only=True)
class Points:
    """Points on the surface with their outward normals."""

    positions: F64  # (N, 3)
    normals: F64  # (N, 3) unit

    def __len__(self) -> int:
        return len(self.positions)

    def where(self, mask: NDArray[Any]) -> Points:
        """Those that a mask or index picks."""
        return Points(positions=self.positions[mask], normals=self.normals[mask])


@dataclass(frozen=True, kw_only=True)
class Triangles:
    """All triangles of a scene in one list."""

    corners: F64  # (F, 3, 3)
    normals: F64  # (F, 3, 3) unit, at the corners
    areas: F64  # (F,)

    @staticmethod
    def of(soups: Sequence[Soup]) -> Triangles:
        """Gathered from soups."""
        corners = np.concatenate([s.positions for s in soups])
        cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        return Triangles(
            corners=corners,
            normals=np.concatenate([s.normals for s in soups]),
            areas=np.linalg.norm(cross, axis=1) / 2,
        )

    def points(self, face: I64, rng: np.random.Generator) -> Points:
        """One point on each listed face, uniformly at random."""
        r1, r2 = np.sqrt(rng.random(len(face))), rng.random(len(face))
        weight = np.stack([1 - r1, r1 * (1 - r2), r1 * r2], axis=1)[:, :, None]
        normal = (self.normals[face] * weight).sum(axis=1)
        normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-9)
        return Points(positions=(self.corners[face] * weight).sum(axis=1), normals=normal)

    def spread(self, per_square_metre: F64 | float, rng: np.random.Generator) -> I64:
        """Faces (M,) to put points on for a density, one number or one for each face; a fraction becomes a chance."""
        wanted = self.areas * per_square_metre
        count = np.floor(wanted + rng.random(len(wanted))).astype(np.int64)
        return np.repeat(np.arange(len(wanted)), count)


@dataclass(frozen=True, kw_only=True)
class Seen:
    """What an orbit of cameras sees of points."""

    spacing: F64  # (N,) metres that look one wanted distance apart in the nearest view; inf where nothing sees it
    eye: F64  # (N, 3) unit mean direction towards the cameras that see it
    flip: NDArray[np.bool_]  # (N,) seen from behind its normal


def look(points: Points, orbit: tuple[Camera, ...], truth: Truth, pixels: float, margin: float = 0.06) -> Seen:
    """Visibility of points from every camera; the frame is widened by `margin` of its size."""
    n = len(points)
    spacing, eye, facing = np.full(n, np.inf), np.zeros((n, 3)), np.zeros(n)
    for camera in orbit:
        towards = camera.position - points.positions
        distance = np.linalg.norm(towards, axis=1)
        towards /= distance[:, None]
        local = -towards @ camera.world_from_camera[:3, :3]  # camera-space direction of the point
        depth = np.maximum(-local[:, 2], 1e-6)
        x, y = camera.fx * local[:, 0] / depth / camera.width, camera.fy * local[:, 1] / depth / camera.height
        inside = (local[:, 2] < -0.05) & (np.abs(x) < 0.5 + margin) & (np.abs(y) < 0.5 + margin)
        index = np.flatnonzero(inside)
        cosine = np.einsum("ij,ij->i", towards[index], points.normals[index])
        side = np.where(cosine < 0, -1.0, 1.0)[:, None]
        start = points.positions[index] + points.normals[index] * side * 2e-3
        blocked = truth.hits(
            start.astype(np.float32), towards[index].astype(np.float32), (distance[index] - 5e-3).astype(np.float32)
        )
        index, cosine = index[~blocked], cosine[~blocked]
        grazing = np.maximum(np.abs(cosine), 0.15)
        wanted = pixels * distance[index] * depth[index] / camera.fx / grazing**0.25
        spacing[index] = np.minimum(spacing[index], wanted)
        eye[index] += towards[index] * grazing[:, None]
        facing[index] += cosine
    length = np.linalg.norm(eye, axis=1, keepdims=True)
    return Seen(spacing=spacing, eye=eye / np.maximum(length, 1e-9), flip=facing < 0)


def candidates(
    triangles: Triangles, recipe: Recipe, truth: Truth, probes: float = 1500.0, dense: float = 6.0
) -> tuple[Points, Seen]:
    """Dense points on everything that the orbit sees, about eight for each splat to come, or four.

    Args:
        triangles: of the scene.
        recipe: whose orbit and distances.
        truth: to look along rays.
        probes: a square metre, by which it is told what is seen; few are enough for many cameras.
        dense: points on a square as wide as the distance of neighbouring splats.
    """
    rng = np.random.default_rng(1)
    low, high = recipe.spacing
    probe = np.concatenate([np.arange(len(triangles.areas)), triangles.spread(probes, rng)])
    seen = look(triangles.points(probe, rng), recipe.orbit, truth, recipe.pixels_per_splat)
    finest = np.full(len(triangles.areas), np.inf)
    np.minimum.at(finest, probe, seen.spacing)
    density = np.where(np.isfinite(finest), dense / np.clip(finest, low, high) ** 2, 0.0)
    points = triangles.points(triangles.spread(density, rng), rng)
    seen = look(points, recipe.orbit, truth, recipe.pixels_per_splat)
    visible = np.isfinite(seen.spacing)
    points = points.where(visible)
    turned = np.where(seen.flip[visible], -1.0, 1.0)[:, None]
    return (
        Points(positions=points.positions, normals=points.normals * turned),
        Seen(spacing=np.clip(seen.spacing[visible], low, high), eye=seen.eye[visible], flip=seen.flip[visible]),
    )


def thin_out(points: Points, spacing: F64, seed: int) -> I64:
    """Indices of a maximal Poisson-disc subset: no two kept points of like normals nearer than the smaller spacing."""
    import numba

    @numba.njit(cache=False)  # type: ignore[untyped-decorator]
    def eliminate(
        p: F64, n: F64, r: F64, order: I64, cell: float, heads: I64, links: I64, keys: I64, mask: int
    ) -> NDArray[np.bool_]:
        kept = np.zeros(len(p), np.bool_)
        for i in order:
            reach = int(np.ceil(r[i] / cell))
            free = True
            cx, cy, cz = int(np.floor(p[i, 0] / cell)), int(np.floor(p[i, 1] / cell)), int(np.floor(p[i, 2] / cell))
            for dx in range(-reach, reach + 1):
                for dy in range(-reach, reach + 1):
                    for dz in range(-reach, reach + 1):
                        slot = ((cx + dx) * 73856093 ^ (cy + dy) * 19349663 ^ (cz + dz) * 83492791) & mask
                        j = heads[slot]
                        while j >= 0 and free:
                            d = (p[i, 0] - p[j, 0]) ** 2 + (p[i, 1] - p[j, 1]) ** 2 + (p[i, 2] - p[j, 2]) ** 2
                            near = min(r[i], r[j])
                            if d < near * near:
                                like = n[i, 0] * n[j, 0] + n[i, 1] * n[j, 1] + n[i, 2] * n[j, 2]
                                if like > 0.5:
                                    free = False
                            j = links[j]
                        if not free:
                            break
                    if not free:
                        break
                if not free:
                    break
            if free:
                kept[i] = True
                slot = (cx * 73856093 ^ cy * 19349663 ^ cz * 83492791) & mask
                links[i] = heads[slot]
                heads[slot] = i
        return kept

    size = 1 << 21
    cell = float(np.median(spacing))
    order = np.random.default_rng(seed).permutation(len(points))
    heads, links = np.full(size, -1, np.int64), np.full(len(points), -1, np.int64)
    kept = eliminate(points.positions, points.normals, spacing, order, cell, heads, links, links, size - 1)
    return np.flatnonzero(kept)


@dataclass(frozen=True, kw_only=True)
class Shape:
    """Flat gaussians fitted to the surface around their centres."""

    positions: F64  # (N, 3)
    frames: F64  # (N, 3, 3) columns: two tangents, normal
    deviations: F64  # (N, 3) metres

    def where(self, mask: NDArray[Any]) -> Shape:
        """Those that a mask picks."""
        return Shape(positions=self.positions[mask], frames=self.frames[mask], deviations=self.deviations[mask])


def shape(kept: Points, radius: F64, support: Points) -> Shape:
    """Gaussians as wide as the surface allows: shrunk across edges and thin strips, pulled back from borders.

    Args:
        kept: centres.
        radius: (N,) Poisson-disc radius at each.
        support: dense points of the same visible surface.
    """
    from scipy.spatial import cKDTree

    tree = cKDTree(support.positions)
    n = len(kept)
    helper = np.where(np.abs(kept.normals[:, :1]) < 0.7, [[1.0, 0, 0]], [[0, 1.0, 0]])
    u = np.cross(kept.normals, helper)
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    v = np.cross(kept.normals, u)
    near, index = tree.query(kept.positions, k=40, workers=2)
    reach = np.minimum(1.6 * radius, near[:, -1])[:, None]
    offset = support.positions[index] - kept.positions[:, None]
    like = np.einsum("nkj,nj->nk", support.normals[index], kept.normals) > 0.7
    used = ((near <= reach) & like).astype(np.float64)
    a, b = np.einsum("nkj,nj->nk", offset, u), np.einsum("nkj,nj->nk", offset, v)
    total = np.maximum(used.sum(axis=1), 1)
    ma, mb = (used * a).sum(1) / total, (used * b).sum(1) / total
    # A full disc of radius R has variance R^2 / 4 along each tangent; what is missing of it shrinks the gaussian.
    full = reach[:, 0] ** 2 / 4
    caa = (used * (a - ma[:, None]) ** 2).sum(1) / total / full
    cbb = (used * (b - mb[:, None]) ** 2).sum(1) / total / full
    cab = (used * (a - ma[:, None]) * (b - mb[:, None])).sum(1) / total / full
    few = total < 6
    caa, cbb, cab = np.where(few, 0.5, caa), np.where(few, 0.5, cbb), np.where(few, 0.0, cab)
    values, vectors = np.linalg.eigh(np.stack([np.stack([caa, cab], -1), np.stack([cab, cbb], -1)], axis=1))
    share = np.clip(np.sqrt(np.maximum(values, 0)) * 1.25, 0.28, 1.0)
    axes = vectors[:, 0, :, None] * u[:, None] + vectors[:, 1, :, None] * v[:, None]  # (N, 2, 3)
    frames = np.stack([axes[:, 0], axes[:, 1], np.cross(axes[:, 0], axes[:, 1])], axis=2)
    wide = OVERLAP * radius[:, None] * share
    deviations = np.concatenate([wide, 0.08 * wide.min(axis=1, keepdims=True)], axis=1)
    pull = np.where(few, 0.0, 0.35)[:, None]
    positions = kept.positions + pull * (ma[:, None] * u + mb[:, None] * v)
    assert frames.shape == (n, 3, 3)
    return Shape(positions=positions, frames=frames, deviations=deviations)


def bake(form: Shape, eye: F64, truth: Truth, spp: int, seed: int) -> F32:
    """Mean radiance (N, 3) that each gaussian's patch of surface sends towards `eye`."""
    out = np.zeros((len(form.positions), 3), np.float32)
    rng = np.random.default_rng(seed)
    step = max(1, 2_000_000 // spp)
    for start in range(0, len(out), step):
        part = slice(start, start + step)
        p, frames, dev, along = form.positions[part], form.frames[part], form.deviations[part], eye[part]
        jitter = rng.normal(size=(len(p), spp, 2)).clip(-2, 2) * dev[:, None, :2] * 0.6
        lift = 2.5 * dev[:, :2].max(axis=1)
        at = p[:, None] + np.einsum("njk,nsk->nsj", frames[:, :, :2], jitter) + (along * lift[:, None])[:, None]
        colour, share = truth.radiance(
            at.astype(np.float32), (-along).astype(np.float32), (2.2 * lift).astype(np.float32), spp, seed + start
        )
        out[part] = np.where(share[:, None] > 0.02, colour, np.nan)
    return out


def cloud(form: Shape, colour: F64, opacity: float = 0.97) -> SplatCloud:
    """The splats, colours display-encoded in 0..1."""
    from scipy.spatial.transform import Rotation

    xyzw = Rotation.from_matrix(form.frames).as_quat()
    return SplatCloud(
        means=form.positions.astype(np.float32),
        quats=xyzw[:, [3, 0, 1, 2]].astype(np.float32),
        scales=form.deviations.astype(np.float32),
        opacities=np.full(len(colour), opacity, np.float32),
        sh=((colour - 0.5) / C0)[:, None, :].astype(np.float32),
    )

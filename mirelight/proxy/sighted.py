"""A mesh moved until it lies where depth maps show the surface: as a whole, and by one way along its normals.

Splats of a trained capture lie about their surface like a fog: those that no picture shows pull a mesh off that is
brought near to all of them. Depth maps leave them out, and tell how sure each of their pixels is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mirelight.base import conventions
from mirelight.base.progress import ShareProgress
from mirelight.lighting.sight import Sight
from mirelight.model import F64, ProxyMesh, triangles
from mirelight.proxy.depth import DepthMap
from mirelight.proxy.mesh_tuning import MESH
from mirelight.proxy.types import Int
from mirelight.proxy.views import rays, turned

_SWELLING = 7  # the unknown of `small_step`
_WAYS = (
    (_SWELLING,),
    tuple(range(6)),
    tuple(range(7)),
    (*range(6), _SWELLING),
)  # unknowns of `small_step`, simplest first


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """A mesh as a whole: swollen first, then turned, scaled and moved."""

    pose: F64  # (4, 4)
    swelling: float = 0.0  # how far vertices go along their normals, in the mesh's own units

    def of(self, at: F64, normals: F64) -> F64:
        """(N, 3) where points with these normals come to lie."""
        return turned(at + self.swelling * normals, self.pose[:3, :3]) + self.pose[:3, 3]

    @property
    def size(self) -> float:
        """By how much it grows."""
        return float(np.cbrt(np.linalg.det(self.pose[:3, :3])))

    def then(self, step: F64, swelling: float) -> Fit:
        """With a step after it: (4, 4), and a way along the normals before that."""
        return Fit(step @ self.pose, self.swelling + swelling / self.size)


@dataclass(frozen=True, slots=True, eq=False)
class _Seen:
    """A mesh where pixels look at it."""

    misfit: float  # 0..1
    at: F64  # (M, 3) points of the mesh
    normal: F64  # (M, 3) there
    target: F64  # (M, 3) where the map has the surface in the same pixels
    weight: F64  # (M,)
    off: F64  # (M,) from the mesh to the target along the normal


class _Rays:
    """Pixels of depth maps that show a surface."""

    def __init__(self, views: Sequence[DepthMap], scale: float) -> None:
        seen = [view.depth > 0 for view in views]
        step = max(sum(int(x.sum()) for x in seen) // MESH.sighted_most_rays, 1)
        starts, ways, depths, weights = [], [], [], []
        for view, there in zip(views, seen, strict=True):
            origins, directions = rays(view.camera)
            starts.append(np.broadcast_to(origins, directions.shape)[there][::step])
            ways.append(directions[there][::step])
            depths.append(view.depth[there][::step].astype(np.float64))
            weights.append(view.trust[there][::step].astype(np.float64) ** 2)
        self._from, self._way = np.concatenate(starts), np.concatenate(ways)
        self._depth, self._weight, self._scale = np.concatenate(depths), np.concatenate(weights), scale

    def of(self, at: F64, faces: Int) -> _Seen:
        """What they show of a mesh; pixels that miss it are as far off as can be."""
        mesh = ProxyMesh(vertices=at.astype(np.float32), faces=faces.astype(np.int32))
        face, depth = Sight(mesh).first_hits(self._from, self._way)
        hit = face >= 0
        start, way, weight = self._from[hit], self._way[hit], self._weight[hit]
        there, target = (start + way * x[hit, None] for x in (depth, self._depth))
        normal = triangles.normals(at[faces])[face[hit]]
        off = ((target - there) * normal).sum(axis=1)
        near = 1 / (1 + (off / self._scale) ** 2)
        misfit = 1 - float((weight * near).sum()) / max(float(self._weight.sum()), 1e-300)
        return _Seen(misfit, there, normal, target, weight, off)


def sighted(views: Sequence[DepthMap], at: F64, faces: Int, start: F64, spacing: float, report: ShareProgress) -> Fit:
    """What brings a mesh to where depth maps have the surface; the start where nothing is much better.

    Args:
        views: depth maps of the capture.
        at: (V, 3) vertices, in the same space.
        faces: (F, 3).
        start: (4, 4) a first guess.
        spacing: of the capture's splats, world units.
        report: hears what is being done.
    """
    looking = _Rays(views, MESH.sighted_sharp * spacing)
    normals = triangles.vertex_normals(at, faces)
    best = Fit(start)
    least = looking.of(best.of(at, normals), faces).misfit
    for k, unknowns in enumerate(_WAYS):
        report("aligning the mesh", k / len(_WAYS))
        found, misfit = _descended(looking, at, normals, faces, Fit(start), unknowns, MESH.sighted_sharp * spacing)
        if misfit < (1 - MESH.sighted_better) * least:
            best, least = found, misfit
    return best


def _descended(
    looking: _Rays, at: F64, normals: F64, faces: Int, start: Fit, unknowns: Sequence[int], scale: float
) -> tuple[Fit, float]:
    """The best on the way down from a start, and its misfit: what is far off counts less and less."""
    best = now = start
    least, wide = np.inf, np.inf
    for k in range(MESH.sighted_rounds):
        seen = looking.of(now.of(at, normals), faces)
        if seen.misfit < least:
            best, least = now, seen.misfit
        elif wide < scale:
            break
        if not len(seen.off):
            break
        wide = wide / 2 if k else 2 * float(np.median(np.abs(seen.off)))
        weight = seen.weight / (1 + (seen.off / max(wide, scale)) ** 2) ** 2
        now = now.then(*small_step(seen.at, seen.normal, seen.target, seen.normal, weight, unknowns))
    return best, least


def small_step(
    p: F64, facing: F64, q: F64, n: F64, weight: F64, unknowns: Sequence[int] = tuple(range(8))
) -> tuple[F64, float]:
    """The small similarity, and way along the points' normals before it, that bring points nearest to planes, by least
    squares.

    Args:
        p: (N, 3) points.
        facing: (N, 3) their normals.
        q: (N, 3) a point of each one's plane.
        n: (N, 3) the planes' normals.
        weight: (N,).
        unknowns: which may change: 0 to 2 turn, 3 to 5 move, 6 scales, 7 swells.
    """
    centre = (weight[:, None] * q).sum(axis=0) / weight.sum()
    own = p - centre
    size = np.sqrt((weight * (own**2).sum(axis=1)).sum() / weight.sum())
    own = own / size  # all eight unknowns of one magnitude
    columns = [np.cross(own, n), n, (own * n).sum(axis=1)[:, None], (facing * n).sum(axis=1)[:, None]]
    rows = np.concatenate(columns, axis=1) * np.isin(np.arange(8), unknowns)
    rest = ((q - p) * n).sum(axis=1) / size
    matrix = np.einsum("n,ni,nj->ij", weight, rows, rows)
    found = np.linalg.solve(
        matrix + 1e-4 * np.trace(matrix) / 7 * np.eye(8), np.einsum("n,ni,n->i", weight, rows, rest)
    )
    angle = float(np.linalg.norm(found[:3]))
    axis = found[:3] / max(angle, 1e-30)
    half = min(angle, 0.3) / 2
    rotation = conventions.rotation_from_quaternion([np.cos(half), *(axis * np.sin(half))])
    scaled = rotation * float(np.exp(np.clip(found[6], -0.2, 0.2)))
    move = centre + found[3:6] * size - scaled @ centre
    return conventions.compose(move) @ conventions.compose(rotation=scaled), float(found[7] * size)

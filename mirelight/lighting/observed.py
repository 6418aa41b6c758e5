"""What a capture shows of the surface: colours at places on a mesh, of its splats or of pictures of them.

A splat that was fitted as a disc lies on the surface and has its colour. Those that an optimiser made from pictures do
not: most are half transparent and lie before or behind the surface, and only what they blend to along a ray is what
was photographed. So of such captures colours are taken from composites at the cameras of the capture, each pixel where
its ray meets the mesh.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from mirelight.base import colour, conventions, sh
from mirelight.base.errors import RenderError
from mirelight.lighting import along_axes
from mirelight.lighting.trace import Tracer
from mirelight.model import F32, F64, I32, ProxyMesh, SplatCloud, SplatLayer, triangles

REACH = 0.01  # of the bounds' diagonal: splats farther off the mesh say nothing about it
OPAQUE = 0.8  # alpha from which a pixel shows the surface alone
AGREE = (0.03, 0.004)  # of the depth, and of the bounds' diagonal: how far apart the depths of mesh and splats may lie
GRAZING = 0.15  # cosine below which a pixel covers too much of the surface
STEP = 4.0  # footprints: pixels whose neighbours hit the mesh farther off than on a plane at `GRAZING` lie on outlines
MOST_AROUND = 1 << 18  # samples that are kept to average over
_TOGETHER = 8  # samples whose mean is the colour at a place
_ASKED = 16  # pixels whose median is the colour at a place
_CELLS = 64  # along the diagonal: cells of the surface that are shown alike often
_HANGS = 0.5  # of the pixels of such a cell, that are sure: with fewer it is a plain wall, whose splats hang anywhere
_KNOWN = 1e-3  # weight of what is seen about a place, from which it is known
_PLANE = 0.7  # least cosine between faces of one surface

Int = NDArray[np.int64]


@dataclass(frozen=True, slots=True, eq=False)
class Deposits:
    """N places on a mesh, and what is seen there."""

    face: I32  # (N,)
    corners: F32  # (N, 3) barycentric weights of the face's corners
    weight: F64  # (N,) how much of the surface each stands for, and how surely
    color: F64  # (N, 3) linear, what is seen from all sides
    spread: F64  # (N, 2, 3) world units: a standard deviation of what shows the place, both ways along it
    side: F64  # (N,) 1: the front of the face was seen, -1: its back; 0: not known

    def on(self, mesh: ProxyMesh) -> tuple[F64, F64]:
        """(N, 3) places in world space, (N, 3) unit normals of their faces."""
        v = mesh.vertices[mesh.faces[self.face]].astype(np.float64)
        return (v * self.corners[:, :, None]).sum(axis=1), triangles.normals(v)

    def seen(self, mesh: ProxyMesh) -> tuple[F64, F64]:
        """(N, 3) places in world space, (N, 3) unit normals on the side that was seen; if not known, the front."""
        points, normals = self.on(mesh)
        return points, np.where(self.side[:, None] < 0, -normals, normals)


@dataclass(frozen=True, slots=True, eq=False)
class Samples:
    """N colours in space, to average over."""

    points: F64  # (N, 3) world units
    planes: F64  # (N, 3) unit normals, either sign
    color: F64  # (N, 3) linear
    weight: F64  # (N,)


class Observed(Protocol):
    """What a capture shows of one mesh."""

    def deposits(self, most: int) -> Deposits:
        """At about so many places at most, evenly spread. Raises RenderError where none is on the mesh."""

    def at(self, points: F64, normals: F64) -> tuple[F64, NDArray[np.bool_]]:
        """(N, 3) colours at points (N, 3) on faces with unit normals (N, 3), and (N,) where any is known."""

    @property
    def samples(self) -> Samples:
        """All that is known, thinned out to `MOST_AROUND`."""


def observed(splats: SplatCloud, views: Sequence[SplatLayer], mesh: ProxyMesh, tracer: Tracer) -> Observed:
    """What splats show of a mesh, or what pictures of them do, where there are any.

    Args:
        splats: world space.
        views: composites of them at the cameras of the capture; none for splats that lie on the surface as discs.
        mesh: world space.
        tracer: of that mesh.
    """
    return _Pictures(views, mesh, tracer) if views else _Splats(splats, mesh, tracer)


class _Splats:
    """Colours of the surface as single splats show them."""

    def __init__(self, splats: SplatCloud, mesh: ProxyMesh, tracer: Tracer) -> None:
        self._splats, self._mesh, self._tracer = splats, mesh, tracer

    def deposits(self, most: int) -> Deposits:
        """Splats on the nearest face along their own axes, the flattest first; `most` of them, evenly taken."""
        splats = self._splats
        low, high = self._mesh.bounds
        reach = REACH * float(np.linalg.norm(high.astype(np.float64) - low))
        step = max(-(-len(splats) // most), 1)
        means, scales = (x[::step].astype(np.float64) for x in (splats.means, splats.scales))
        axes = conventions.rotation_from_quaternion(splats.quats[::step])  # columns
        face, corners, distance = along_axes.nearest(self._tracer, means, axes, scales, reach)
        near = np.flatnonzero(face >= 0)
        if not len(near):
            raise RenderError(
                f"no splat lies within {reach:.3g} world units of the proxy, so it cannot take their colours; "
                "check both transforms, or give the proxy an albedo"
            )
        longer = np.argsort(-scales[near], axis=1, kind="stable")[:, :2]
        lengths = np.take_along_axis(scales[near], longer, axis=1)
        closeness = np.maximum(1 - (distance[near] / reach) ** 2, 1e-3) ** 2
        shown = sh.mean_display(splats.sh[::step][near])
        both = np.take_along_axis(axes[near].astype(np.float64).swapaxes(1, 2), longer[:, :, None], axis=1)
        return Deposits(
            face=face[near],
            corners=np.maximum(corners[near], 0),  # rounded below nothing, they would cancel what another splat tells
            weight=splats.opacities[::step][near] * np.minimum(lengths, reach).prod(axis=1) * closeness,
            color=splats.light(shown).astype(np.float64),
            spread=both * lengths[:, :, None],
            side=np.zeros(len(near)),
        )

    def at(self, points: F64, normals: F64) -> tuple[F64, NDArray[np.bool_]]:
        """Of the splats nearest to each point, as they blend there."""
        from scipy.spatial import cKDTree

        splats = self._splats
        near = cKDTree(splats.means).query(points, k=[*range(1, min(_TOGETHER, len(splats)) + 1)], workers=-1)[1]
        every, of = np.unique(near, return_inverse=True)
        scales, axes = (
            splats.scales[every].astype(np.float64),
            conventions.rotation_from_quaternion(splats.quats[every]),
        )
        of = of.reshape(near.shape)
        away = points[:, None] - splats.means[every].astype(np.float64)[of]
        own = np.einsum("nkji,nkj->nki", axes.astype(np.float64)[of], away) / np.maximum(scales, 1e-12)[of]
        flattest = np.argmin(scales, axis=1)
        np.put_along_axis(own, flattest[of][..., None], 0.0, axis=2)  # the mesh may lie a little beside it
        facing = np.take_along_axis(axes.astype(np.float64), flattest[:, None, None], axis=2)[..., 0]
        weight = splats.opacities[every][of] * np.exp(-0.5 * (own**2).sum(axis=2))
        weight *= np.abs(np.einsum("nkj,nj->nk", facing[of], normals)) > _PLANE
        color = splats.light(sh.mean_display(splats.sh[every])).astype(np.float64)
        return _weighed(weight, color[of])

    @cached_property
    def samples(self) -> Samples:
        """Splats as points with a normal and a colour."""
        splats = self._splats
        step = max(-(-len(splats) // MOST_AROUND), 1)
        axes = conventions.rotation_from_quaternion(splats.quats[::step].astype(np.float64))
        thinnest = np.argsort(splats.scales[::step].astype(np.float64), axis=1, kind="stable")[:, :1]
        return Samples(
            points=splats.means[::step].astype(np.float64),
            planes=np.take_along_axis(axes, thinnest[:, None], axis=2)[..., 0],
            color=splats.light(sh.mean_display(splats.sh[::step])).astype(np.float64),
            weight=splats.opacities[::step].astype(np.float64),
        )


@dataclass(frozen=True, slots=True, eq=False)
class Pixels:
    """N pixels of pictures that show the mesh."""

    pixel: Int  # (N,) row of each in its picture, (y, x) as y * width + x
    points: F64  # (N, 3) where their rays meet it
    face: I32  # (N,)
    cosine: F64  # (N,) between ray and face
    side: F64  # (N,) 1: the ray meets the face's front, -1: its back
    footprint: F64  # (N,) world units: a pixel's width, across the ray
    color: F64  # (N, 3) linear
    sure: NDArray[np.bool_]  # (N,) whether the splats lie there; else they hang anywhere along the ray

    @property
    def area(self) -> F64:
        """Area of the surface that each pixel shows (N,)."""
        return np.asarray(self.footprint**2 / self.cosine)

    @staticmethod
    def together(parts: Sequence[Pixels]) -> Pixels:
        """Those of several pictures (N,) in all, one after the other."""
        return Pixels(*(np.concatenate([getattr(x, name) for x in parts]) for name in Pixels.__slots__))

    def taken(self, rows: Int) -> Pixels:
        """The same of some pixels, by their rows (M,)."""
        return Pixels(*(getattr(self, name)[rows] for name in self.__slots__))


class _Pictures:
    """Colours of the surface as pictures of the splats show them."""

    def __init__(self, views: Sequence[SplatLayer], mesh: ProxyMesh, tracer: Tracer) -> None:
        self._mesh = mesh
        self._normals = triangles.normals(mesh.vertices[mesh.faces].astype(np.float64))
        low, high = mesh.bounds
        self._size = float(np.linalg.norm(high.astype(np.float64) - low))
        shown = Pixels.together([pixels_of(x, tracer, self._normals, self._size, hanging=True) for x in views])
        self._pixels = shown.taken(self._telling(shown))

    def deposits(self, most: int) -> Deposits:
        """At pixels, each with the median colour of those about it, in whichever picture: highlights that few of them
        show, and what poses that are a little off mix in from beyond an edge, have no part in it."""
        pixels = self._pixels
        if not len(pixels.face):
            raise RenderError(
                "the proxy is nowhere where the capture's pictures show a surface, so it cannot take their colours; "
                "check both transforms, or give the proxy an albedo"
            )
        rows = self._even(most)
        some = pixels.taken(rows)
        own = self._normals[some.face]
        near, _ = self._near(some.points, _ASKED)
        plane = self._in_plane(near, own)
        plane[:, 0] = True  # itself, or one at the same place
        color = np.nanmedian(np.where(plane[:, :, None], pixels.color[near], np.nan), axis=1)
        return Deposits(
            face=some.face,
            corners=triangles.barycentric(self._mesh.vertices[self._mesh.faces[some.face]].astype(float), some.points),
            weight=np.ones(len(rows)),
            color=color,
            spread=conventions.frame_around(own)[:, :2] * some.footprint[:, None, None] * np.sqrt(0.5),
            side=some.side,
        )

    def at(self, points: F64, normals: F64) -> tuple[F64, NDArray[np.bool_]]:
        """Of the pixels about each point, in whichever picture."""
        pixels = self._pixels
        near, distance = self._near(points, _TOGETHER)
        weight = pixels.cosine[near] * np.exp(-0.5 * (distance / pixels.footprint[near]) ** 2)
        return _weighed(weight * self._in_plane(near, normals), pixels.color[near])

    def _in_plane(self, near: Int, normals: F64) -> NDArray[np.bool_]:
        """(N, K) which of pixels (N, K) show a surface that looks along normals (N, 3), or away from them."""
        planes = self._normals[self._pixels.face[near]]
        return np.asarray(np.abs(np.einsum("nkj,nj->nk", planes, normals)) > _PLANE)

    @cached_property
    def samples(self) -> Samples:
        """Pixels as points with a normal and a colour."""
        some = self._pixels.taken(self._even(MOST_AROUND))
        return Samples(some.points, self._normals[some.face], some.color, some.cosine)

    def _telling(self, pixels: Pixels) -> Int:
        """Rows of those that are sure; all where most are not, as on a plain wall, whose splats hang anywhere."""
        of = self._cells(pixels)
        sure = np.bincount(of, pixels.sure) / np.bincount(of)
        return np.flatnonzero(pixels.sure | (sure < _HANGS)[of])

    def _cells(self, pixels: Pixels) -> Int:
        """(N,) the part of the surface that each pixel shows."""
        cell = np.floor(pixels.points * (_CELLS / self._size)).astype(np.int64)
        return np.unique(cell, axis=0, return_inverse=True)[1].ravel().astype(np.int64)

    def _even(self, most: int) -> Int:
        """Rows of at most so many pixels, about as many of each part of the surface however often it is shown."""
        pixels = self._pixels
        of = self._cells(pixels)
        share = pixels.area / np.bincount(of, pixels.area)[of]
        ends = np.cumsum(share)
        asked = (np.arange(min(most, len(share))) + 0.5) / min(most, len(share)) * ends[-1]
        return np.unique(np.minimum(np.searchsorted(ends, asked), len(share) - 1)).astype(np.int64)

    def _near(self, points: F64, count: int) -> tuple[Int, F64]:
        """(N, K) rows of the nearest pixels of points (N, 3), and (N, K) how far they lie."""
        distance, near = self._tree.query(points, k=[*range(1, min(count, len(self._pixels.face)) + 1)], workers=-1)
        return near.astype(np.int64), distance

    @cached_property
    def _tree(self) -> Any:
        from scipy.spatial import cKDTree

        return cKDTree(self._pixels.points)


def _weighed(weight: F64, color: F64) -> tuple[F64, NDArray[np.bool_]]:
    """(N, 3) means of colours (N, K, 3) by weights (N, K), and (N,) whether there is any weight to speak of."""
    whole = weight.sum(axis=1)
    return np.einsum("nk,nkc->nc", weight, color) / np.maximum(whole, 1e-300)[:, None], whole > _KNOWN


def pixels_of(view: SplatLayer, tracer: Tracer, normals: F64, size: float, *, hanging: bool = False) -> Pixels:
    """Those of a picture in which splats and mesh lie at one depth, but for outlines.

    Args:
        view: from a camera of the capture.
        tracer: of the mesh.
        normals: (F, 3) unit, of its faces.
        size: world units, of its bounds' diagonal.
        hanging: those too whose splats lie at many depths, as those of a plain wall.
    """
    camera = view.camera
    origins, directions = camera.rays()
    shape = directions.shape[:2]
    ways = directions.reshape(-1, 3)
    starts = np.ascontiguousarray(np.broadcast_to(origins, ways.shape))
    face, depth = tracer.sight().first_hits(starts, ways)
    depth = np.where(face >= 0, depth, 0.0)
    length = np.linalg.norm(ways, axis=1)
    facing = -np.einsum("nk,nk->n", normals[face], ways) / length
    cosine = np.abs(facing)
    alpha = (1 - view.transmittance).ravel()
    footprint = depth / camera.fx if camera.projection == "perspective" else np.full(len(depth), 1 / camera.fx)
    kept = (face >= 0) & (alpha > OPAQUE) & (cosine > GRAZING)
    near = np.maximum(AGREE[0] * depth, AGREE[1] * size)
    sure = np.abs(view.median_depth.ravel() - depth) < near
    apart = np.abs(view.median_depth - view.depth).ravel() > near
    kept &= sure | (apart & hanging)
    kept &= ~_outlines(depth.reshape(shape), (footprint * STEP / GRAZING).reshape(shape)).ravel()
    rows = np.flatnonzero(kept)
    shown = view.color.reshape(-1, 3)[rows] / alpha[rows, None]
    color = shown if view.linear else colour.srgb_decode(np.maximum(shown, 0))
    points = starts[rows] + depth[rows, None] * ways[rows]
    side = np.where(facing[rows] < 0, -1.0, 1.0)
    return Pixels(rows, points, face[rows], cosine[rows], side, footprint[rows], color.astype(np.float64), sure[rows])


def _outlines(depth: F64, step: F64) -> NDArray[np.bool_]:
    """(H, W) pixels beside which the mesh is farther or nearer by a step (H, W): there colours are a mixture."""
    out = np.zeros(depth.shape, bool)
    for axis in (0, 1):
        apart = np.abs(np.diff(depth, axis=axis))
        first, second = (np.take(step, np.arange(depth.shape[axis] - 1) + k, axis=axis) for k in (0, 1))
        jump = apart > np.minimum(first, second)
        lead = [slice(None)] * 2
        lead[axis] = slice(None, -1)
        out[tuple(lead)] |= jump
        lead[axis] = slice(1, None)
        out[tuple(lead)] |= jump
    return out

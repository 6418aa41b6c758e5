"""Light on splats: each splat has a place on the proxy, found once, and takes the irradiance there.

A splat's place is the nearest point of the proxy along its own axes, the flattest first; a splat that finds none within
reach takes the place of the nearest one that does, and so does one whose place is dark on both sides: such a place lies
inside something, and no capture shows it. Its side is the front of the face, unless that is the dark inside of
something.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mirelight.base import conventions
from mirelight.base.errors import RenderError
from mirelight.base.progress import ShareProgress, counted, part, quiet
from mirelight.lighting import along_axes
from mirelight.lighting.albedo import UNLIT
from mirelight.lighting.appearance import shown
from mirelight.lighting.mirrors import planes_of
from mirelight.lighting.trace import Tracer
from mirelight.model import (
    F32,
    F64,
    I32,
    Camera,
    Environment,
    Lighting,
    LightingBuffer,
    ProxyMesh,
    RenderSettings,
    SplatCloud,
    triangles,
)

Int = NDArray[np.intp]

REACH = 0.02  # of the bounds' diagonal
MARGIN = 2.0**-18  # of the largest coordinate plus the longest edge: how far off edges points must lie for rays
TINY = np.finfo(np.float64).tiny
FEW, MANY = 4, 32
LIE = "where splats lie"
SELDOM = 8  # times as many where most splats are seldom met


@dataclass(frozen=True, slots=True, eq=False)
class Places:
    """Where N splats lie on a proxy."""

    points: F64  # (N, 3) world space
    normals: F64  # (N, 3) unit, to the side that is seen
    near: float  # share of splats that found the proxy within reach


def tracer_for(proxy: ProxyMesh, settings: RenderSettings) -> Tracer:
    """A tracer of layers at points, which reads light on the surface where it is given some.

    Raises:
        BackendError: the variant cannot be used on this machine.
    """
    own = replace(settings, noise=None, denoise=False, indirect="surface")
    return Tracer(proxy, own, aovs=False)


def lamps_in_view(tracer: Tracer, lighting: Lighting, camera: Camera) -> LightingBuffer:
    """The proxy by the direct light of a lighting's lamps, seen with as many samples as frames."""
    settings = replace(tracer.settings, max_depth=1, noise=None, denoise=False)
    return tracer.tuned(settings, layers=False, aovs=False).trace(lighting, camera, emission=False)


def places_of(
    splats: SplatCloud,
    proxy: ProxyMesh,
    tracer: Tracer,
    reference: Lighting | None,
    samples: tuple[int, int] = (FEW, MANY),
    progress: ShareProgress = quiet,
) -> Places:
    """Where splats lie on the proxy.

    Args:
        splats: N of them, world space.
        proxy: the tracer's own.
        tracer: from :func:`tracer_for`.
        reference: light that the splats were seen in, which tells the side; None: an even sky.
        samples: a splat, to tell the dark side: of all, and of those that few have found dark.
        progress: hears how far it is.

    Raises:
        RenderError: no splat lies within 2 % of the proxy's diagonal.
    """
    progress(LIE, 0.0)
    low, high = proxy.bounds
    reach = REACH * float(np.linalg.norm(high.astype(np.float64) - low))
    means = splats.means.astype(np.float64)
    face, corners = _nearest(splats, proxy, tracer, reach)
    found, lost = np.flatnonzero(face >= 0), np.flatnonzero(face < 0)
    if not len(found):
        raise RenderError(
            f"no splat lies within {reach:.3g} world units of the proxy, so none takes light from it; "
            "check both transforms"
        )
    corner = proxy.vertices[proxy.faces[face]].astype(np.float64)
    points, normals = (corner * _off_edges(corner, corners)[:, :, None]).sum(axis=1), triangles.normals(corner)
    if len(lost):
        _take_over(lost, found, points[found], means, points, normals)
    reference = reference or Lighting(environment=Environment(radiance=np.ones((1, 1, 3), np.float32)))

    def bright(rows: Int | slice, ways: F64, spp: int, low: float, high: float) -> F64:
        heard = counted(part(progress, low, high), LIE)
        return np.asarray(shown(tracer, reference, points[rows], ways, spp, heard).mean(axis=1), np.float64)

    front = bright(slice(None), normals, samples[0], 0.1, 0.4)
    dim = np.flatnonzero(front <= UNLIT * front.mean())
    if len(dim):  # seldom met, or dark
        many = samples[1] * (SELDOM if len(dim) > len(front) / 2 else 1)  # as where little light is let in
        front[dim] = bright(dim, normals[dim], many, 0.4, 0.8)
        dark = dim[front[dim] <= UNLIT * front.mean()]
        back = bright(dark, -normals[dark], many, 0.8, 1.0)
        normals[dark[back > front[dark]]] *= -1
        front[dark] = np.maximum(front[dark], back)
        unseen = dark[front[dark] <= UNLIT * front.mean()]
        if 0 < len(unseen) < len(means):  # inside something, where nothing can have been captured
            lit = np.setdiff1d(np.arange(len(means)), unseen, assume_unique=True)
            _take_over(unseen, lit, means[lit], means, points, normals)
    return Places(points, normals, len(found) / len(means))


def _nearest(splats: SplatCloud, proxy: ProxyMesh, tracer: Tracer, reach: float) -> tuple[I32, F32]:
    """For each of N splats (N,) the face on which it lies, -1: none, and (N, 3) weights of its corners; of those that
    show what a mirror does, where that is."""
    means, axes = splats.means.astype(np.float64), conventions.rotation_from_quaternion(splats.quats)  # columns
    face, corners, _ = along_axes.nearest(tracer, means, axes, splats.scales, reach)
    for plane in planes_of(proxy):
        some = np.flatnonzero((face < 0) & plane.behind(means))
        turned = plane.points(means[some]), plane.axes(axes[some])
        face[some], corners[some], _ = along_axes.nearest(tracer, *turned, splats.scales[some], reach)
    return face, corners


def _off_edges(corner: F64, weights: F32) -> F64:
    """Barycentric weights (N, 3) of points on faces (N, 3, 3) that a ray finds there: on an edge it may slip through.

    A point nearer to an edge than rays start off surfaces is taken that far inside; to the middle where the face is too
    slim. All others stay as they are, to the bit.
    """
    across = np.linalg.norm(np.roll(corner, -1, axis=1) - np.roll(corner, 1, axis=1), axis=2)  # the side, from a corner
    heights = np.linalg.norm(triangles.crossed(corner), axis=1, keepdims=True) / np.maximum(across, TINY)
    margin = MARGIN * (np.abs(corner).max(axis=(1, 2)) + across.max(axis=1))[:, None] + TINY
    least = margin / np.maximum(heights, 3 * margin)
    inside = np.maximum(weights, least)
    return np.where((weights < least).any(axis=1, keepdims=True), inside / inside.sum(axis=1, keepdims=True), weights)


def _take_over(who: Int, whose: Int, where: F64, means: F64, points: F64, normals: F64) -> None:
    """Gives some splats the places of others: those nearest to them, by where the others count as being (K, 3)."""
    from scipy.spatial import cKDTree

    _, nearest = cKDTree(where).query(means[who])
    points[who], normals[who] = points[whose[nearest]], normals[whose[nearest]]

"""Colours for a proxy, from the splats that lie on it and the light that they were captured under.

A splat shows c = a E / pi, so a = pi c / E, with E traced at the splat's own place on the proxy. What the estimate is
for is the light that surfaces send each other: a surface's own albedo cancels in a ratio. So the mean colour around a
vertex counts and fine texture does not, and vertices are enough to hold it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mirelight.lighting.albedo_inpainting import Filling, add_rows
from mirelight.lighting.appearance import shown
from mirelight.lighting.clipped import Shown, hidden
from mirelight.lighting.observed import Deposits, observed
from mirelight.lighting.pooling import pooled
from mirelight.lighting.trace import Tracer
from mirelight.model import F32, F64, Lighting, ProxyMesh, RenderSettings, SplatCloud, SplatLayer, triangles
from mirelight.model.profiles import BRIGHTEST

MOST_SPLATS = 1 << 18  # evenly taken where there are more: 2^16 leave halos half a metre wide around a yard's doors
SPP = (4, 4, 16)  # samples a splat in each round of light by colours and colours by light: many splats share a vertex,
# the first two rounds bring all but 3 %, and with 16 in each frames come no closer to the truth
_LIT = 0.5  # share of the places that the first samples find light at: of fewer, later rounds have more samples
_MOST_TIMES = 8  # as many, where light comes in through small openings
_SAMPLED = 1 << 17  # splats that are sampled so often; where there are more, each has less, half of it at the least
FLOOR = 0.01  # of the mean irradiance: where there was no light, no colour can be found
DARKEST = 0.01
UNLIT = 0.01  # of the mean irradiance: a front darker than this is the inside of something, and the back was seen
CLIPPED = 0.03  # of display white: splats that near it may have been brighter
_MANY = 0.1  # share of clipped splats in bright light from which a vertex's colour is told by the others
_OVEREXPOSED = 1e-4  # what a splat in such light counts then
_START = 0.5  # albedo that the first round's light is traced with
_LEAN = 0.25  # samples that the mean around a vertex, found along the surface, counts as
_POOL = 2.0  # times the splats' distance: the finest cells over which colours of fine meshes are pooled, and patches

Int = NDArray[np.int64]


@dataclass(frozen=True, slots=True, eq=False)
class _Shape:
    """A mesh whose vertices each look one way, and which of them splats lie at: M of its V."""

    mesh: ProxyMesh
    area: F64  # (F,) twice the areas of faces
    way: Int  # (V,) 0 to 5: which of the six main directions a vertex looks along
    met: Int  # (M,) vertices at the corners of faces with splats
    corner: Int  # (N, 3) of the splats' faces: rows of `met`
    spacing: float  # between places that splats tell apart

    @staticmethod
    def of(mesh: ProxyMesh, way: Int, deposits: Deposits) -> _Shape:
        """Of a mesh whose vertices look along `way` (V,)."""
        met, corner = np.unique(mesh.faces[deposits.face].astype(np.int64), return_inverse=True)
        area = np.linalg.norm(triangles.crossed(mesh.vertices[mesh.faces].astype(np.float64)), axis=1)
        spacing = _POOL * float(np.sqrt(area.sum() / 2 / len(deposits.face)))
        return _Shape(mesh, np.asarray(area), way, met, corner.reshape(-1, 3), spacing)

    @property
    def met_share(self) -> float:
        """Share of the area whose faces have a splat at a corner."""
        there = np.zeros(len(self.mesh.vertices), bool)
        there[self.met] = True
        return float(self.area[there[self.mesh.faces].any(axis=1)].sum() / max(self.area.sum(), 1e-300))


@dataclass(frozen=True, slots=True, eq=False)
class VertexColors:
    """What splats say about a proxy's colours, and how much they know."""

    values: F32  # (V, 3) linear, of the vertices that :func:`with_vertex_colors` makes
    met: float  # share of the proxy's area whose faces have a splat at a corner; the rest takes its neighbours' colours
    lit: bool  # False: no captured light falls on any splat, so colours are the brightest that there are


def colored_by(
    splats: SplatCloud,
    proxy: ProxyMesh,
    captured: Lighting,
    settings: RenderSettings,
    views: Sequence[SplatLayer] = (),
) -> ProxyMesh:
    """The proxy with vertex colours that look like the splats under the captured light.

    Each splat lands on the nearest face along its own axes, the flattest first. Vertices take the mean over the splats
    on their faces, those of splats and of light apart: pi sum(w c) / (sum(w E) + 0.01 mean E), where no splat counts as
    brighter than the brightest surface would be in the light there. Of a fine mesh, which has more vertices than there
    are splats, the mean around them counts as well (`pooling`), and a little that along the surface (`filling`), which
    is all that vertices without splats have. Vertices on an edge between faces that look different ways are split, so
    that a corner of a room keeps the colours of its walls apart. E holds light reflected by the proxy, so colours and
    light are found in turns. Where splats end at display white, what they hide is guessed from what is alike around
    (`clipped`): to leave them out alone would leave the dark ones.

    Args:
        splats: in world space; their colour averaged over directions is used, as linear light.
        proxy: in world space. Its own colours are left out, its glow is not.
        captured: what the splats were captured under.
        settings: seed, depth and variant of the tracing.
        views: composites of the splats at the cameras of the capture, from which colours are taken in place of single
            splats; none for splats that lie on the surface as discs.

    Raises:
        RenderError: no splat lies on the proxy.
        BackendError: the variant cannot be used on this machine.
    """
    if not len(proxy.faces):
        return proxy
    mesh, way = _split_by_orientation(proxy)
    return replace(mesh, vertex_colors=_colors(splats, views, mesh, way, captured, settings).values)


def with_vertex_colors(proxy: ProxyMesh, colors: F32) -> ProxyMesh:
    """The proxy with the values (V, 3) that :func:`vertex_colors` found for it."""
    return replace(_split_by_orientation(proxy)[0], vertex_colors=colors) if len(proxy.faces) else proxy


def vertex_colors(
    splats: SplatCloud,
    proxy: ProxyMesh,
    captured: Lighting,
    settings: RenderSettings,
    views: Sequence[SplatLayer] = (),
) -> VertexColors:
    """The colours of :func:`colored_by` alone."""
    if not len(proxy.faces):
        return VertexColors(np.zeros((0, 3), np.float32), 1.0, True)
    return _colors(splats, views, *_split_by_orientation(proxy), captured, settings)


def _colors(
    splats: SplatCloud,
    views: Sequence[SplatLayer],
    mesh: ProxyMesh,
    way: Int,
    captured: Lighting,
    settings: RenderSettings,
) -> VertexColors:
    """Of a mesh whose vertices look along `way` (V,)."""
    tracer = Tracer(mesh, settings, layers=False, aovs=False)
    deposits = observed(splats, views, mesh, tracer).deposits(MOST_SPLATS)
    shape = _Shape.of(mesh, way, deposits)
    told = np.zeros(len(way), bool)
    for k in range(3):
        told[mesh.faces[deposits.face, k][deposits.weight * deposits.corners[:, k] > 0]] = True
    filling = Filling.of(mesh, way, told, shape.spacing)
    colors = np.asarray(mesh.vertex_colors)
    lit, times = True, 1
    for done, samples in enumerate(SPP):
        spp = times * (samples * _SAMPLED // max(len(deposits.face), _SAMPLED))
        light = irradiance_at(deposits, mesh, tracer, captured, spp)
        lit = bool(light.any())
        if not done and lit:
            times = int(np.clip(_LIT / light.any(axis=1).mean(), 1, _MOST_TIMES))
        found = _albedo(shape, deposits, light, filling, noisy=times > 1)
        # lighter surfaces send each other more, and so come out darker next time: halfway, the turns settle
        colors = np.sqrt(found * colors) if done else found
        tracer.recolor(colors)
    return VertexColors(colors, shape.met_share, lit)


def _split_by_orientation(proxy: ProxyMesh) -> tuple[ProxyMesh, Int]:
    """The mesh in plain gray, a vertex for each of the six main directions that its faces look along; (V,) which."""
    faces = proxy.faces.astype(np.int64)
    kept, corner = np.unique(faces * 6 + _ways(proxy)[:, None], return_inverse=True)
    old = kept // 6

    def of_old(values: F32 | None) -> F32 | None:
        return None if values is None else values[old]

    split = replace(
        proxy,
        vertices=proxy.vertices[old],
        faces=corner.reshape(faces.shape).astype(np.int32),
        normals=of_old(proxy.normals),
        uvs=of_old(proxy.uvs),
        vertex_colors=np.full((len(old), 3), _START, np.float32),
        materials=tuple(replace(m, base_color=np.ones(3), base_color_texture=None) for m in proxy.materials),
        albedo=None,
    )
    return split, kept % 6


def _ways(mesh: ProxyMesh) -> Int:
    """(F,) 0 to 5: which of the six main directions faces look along."""
    n = face_normals(mesh)
    axis = np.abs(n).argmax(axis=1)
    return np.asarray(2 * axis + (np.take_along_axis(n, axis[:, None], axis=1)[:, 0] < 0))


def face_normals(mesh: ProxyMesh) -> F64:
    """(F, 3) unit normals of the faces; degenerate ones have length 0."""
    return triangles.normals(mesh.vertices[mesh.faces].astype(np.float64))


def irradiance_at(deposits: Deposits, mesh: ProxyMesh, tracer: Tracer, captured: Lighting, spp: int) -> F64:
    """(N, 3) at the splats' places, on the side that was seen. Where that is not sure, the front, unless it is the dark
    inside of something: where little light is let in, few samples of a surface that was seen find any."""
    points, normals = deposits.seen(mesh)
    light = np.pi * shown(tracer, captured, points, normals, spp).astype(np.float64)
    brightness = light.mean(axis=1)
    inside = np.flatnonzero((deposits.side <= 0) & (brightness <= UNLIT * brightness.mean()))
    if len(inside):
        behind = np.pi * shown(tracer, captured, points[inside], -normals[inside], spp)
        light[inside] = np.maximum(light[inside], behind)
    return light


def _albedo(shape: _Shape, deposits: Deposits, light: F64, filling: Filling, *, noisy: bool) -> F32:
    """(V, 3) sums of the splats' colours over sums of their light; of clipped ones, the colours that they hide.

    `noisy`: most samples find no light, so that only sums over many places tell how much there is.
    """
    mean = np.average(light.mean(axis=1), weights=deposits.weight)
    color = deposits.color
    if not noisy:
        color = np.minimum(color, _whitest(shape, deposits, light) + FLOOR * mean / np.pi)
    over = _overexposed(shape, deposits, light)
    found = _told(shape, deposits, color, light, np.where(over, _OVEREXPOSED, 1.0), filling)
    if not over.any():
        return found
    clipped = over[:, None] & (deposits.color >= 1 - CLIPPED)
    patch = filling.patches.of_vertex[shape.mesh.faces[deposits.face]]
    seen = Shown(patch, deposits.corners, deposits.weight, deposits.color, light, over, clipped)
    albedo = (hidden(seen, *_patches(shape, filling), shape.spacing)[patch] * deposits.corners[:, :, None]).sum(axis=1)
    color = np.where(clipped, np.maximum(color, albedo * light / np.pi), color)
    whole = _told(shape, deposits, color, light, np.ones(len(light)), filling)
    beside = np.zeros(len(found), bool)  # elsewhere nothing is guessed
    beside[shape.mesh.faces[deposits.face[over]]] = True
    return np.asarray(np.where(beside[:, None], whole, found), dtype=np.float32)


def _patches(shape: _Shape, filling: Filling) -> tuple[F64, Int]:
    """(P, 3) middles of patches, (P,) which way they look."""
    of, n = filling.patches.of_vertex, filling.patches.walk.shape[0]
    places = np.stack([np.bincount(of, x, minlength=n) for x in shape.mesh.vertices.T.astype(np.float64)], axis=1)
    ways = np.zeros(n, np.int64)
    ways[of] = shape.way
    return places / np.bincount(of, minlength=n)[:, None], ways


def _told(shape: _Shape, deposits: Deposits, color: F64, light: F64, count: F64, filling: Filling) -> F32:
    """(V, 3) what splats tell that show such colours (N, 3), count (N,) each, under light (N, 3)."""
    mean = np.average(light.mean(axis=1), weights=deposits.weight)
    values = np.concatenate([color, light, np.ones((len(light), 1))], axis=1)
    sums, samples = _around(shape, deposits, values * (deposits.weight * count)[:, None], count)
    c, e, w = np.split(_means(shape, sums, samples, filling), [3, 6], axis=1)
    found = np.pi * c / np.maximum(e + FLOOR * mean * w, 1e-300)
    return np.asarray(np.clip(found, DARKEST, BRIGHTEST), dtype=np.float32)


def _whitest(shape: _Shape, deposits: Deposits, light: F64) -> F64:
    """(N, 3) what the brightest surface shows at the splats' places, in their light or that around them.

    A splat that is brighter tells the colour of something else: one on a thin dark post, of the wall behind it. Light
    of few samples is noisy, and would hold back true colours where it is too dark by chance: hence that around.
    """
    if not light.any():  # then nothing is told at all
        return np.full(light.shape, np.inf)
    sums, _ = _around(shape, deposits, np.column_stack([light, np.ones(len(light))]) * deposits.weight[:, None])
    around = sums[:, :3] / np.maximum(sums[:, 3:], 1e-300)
    there = (around[shape.corner] * deposits.corners[:, :, None]).sum(axis=1)
    return np.asarray(np.maximum(light, there) * BRIGHTEST / np.pi)


def _means(shape: _Shape, sums: F64, samples: F64, filling: Filling) -> F64:
    """(V, C) means from sums (M, C) over samples (M, 1) of the vertices met, leaning on those around them."""
    out = filling.around(shape.met, sums)
    known = sums[:, 6] > 0
    at, n = shape.met[known], samples[known]
    out[at] = (n * sums[known] / sums[known, 6:] + _LEAN * out[at]) / (n + _LEAN)
    return out


def _overexposed(shape: _Shape, deposits: Deposits, light: F64) -> NDArray[np.bool_]:
    """(N,) splats in light that brings a white surface to display white, near a vertex where many such are clipped."""
    bright = light.max(axis=1) * BRIGHTEST > np.pi
    brightest = deposits.color.max(axis=1)
    white = np.abs(brightest - 1) < CLIPPED
    if white.sum() <= (brightest >= 1 + CLIPPED).sum():  # brightness goes on past white: nothing is clipped there
        return np.zeros(len(bright), bool)
    values = np.stack([bright, bright & white], axis=1) * deposits.weight[:, None]
    sums, _ = _around(shape, deposits, values)
    clipped = (sums[:, 1] > _MANY * sums[:, 0])[shape.corner].any(axis=1)
    return np.asarray(bright & clipped)


def _around(shape: _Shape, deposits: Deposits, values: F64, count: F64 | None = None) -> tuple[F64, F64]:
    """(M, C) sums of values (N, C) that count as so many samples (N,) at the vertices met, pooled with those around;
    (M, 1) how many samples each vertex has of its own.

    Vertices at which no splat has weight have 0. `count`: None stands for one sample each.
    """
    count = np.ones(len(values)) if count is None else count
    sums, samples = np.split(_at_vertices(shape, deposits, np.column_stack([values, count])), [-1], axis=1)
    known = samples[:, 0] > 0
    at = shape.mesh.vertices[shape.met[known]].astype(np.float64)
    out = np.zeros(sums.shape)
    out[known] = pooled(sums[known], samples[known, 0], at, shape.way[shape.met[known]], shape.spacing)
    return out, samples


def _at_vertices(shape: _Shape, deposits: Deposits, values: F64) -> F64:
    """(M, C) sums of values (N, C) at the vertices met, shared by the corners of their faces."""
    sums = np.zeros((len(shape.met), values.shape[1]))
    for k in range(3):
        add_rows(sums, shape.corner[:, k], values * deposits.corners[:, k, None])
    return sums

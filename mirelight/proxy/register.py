"""A mesh that misfits moved onto its splats: turned, moved, scaled, swollen as a whole; on discs vertex by vertex."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from mirelight.base.errors import InputError
from mirelight.base.progress import ShareProgress, part, passed, quiet
from mirelight.model import F32, F64, Camera, ProxyMesh, SplatCloud, triangles
from mirelight.proxy.advice import best_guess
from mirelight.proxy.capture import Capture, look_at_capture, normals_of
from mirelight.proxy.depth import DepthMap, DepthMaps
from mirelight.proxy.inside import hidden_share, places
from mirelight.proxy.judge import seen_by
from mirelight.proxy.make import DEPTHS, refuse_strangers
from mirelight.proxy.mesh_tuning import MESH
from mirelight.proxy.sampling import spread_on
from mirelight.proxy.sighted import Fit, sighted, small_step
from mirelight.proxy.slanted import slanted
from mirelight.proxy.tuning import TUNING
from mirelight.proxy.types import Int, ProxySettings
from mirelight.proxy.views import around, from_points, moved, turned

_SETTINGS = ProxySettings()


def register(
    splats: SplatCloud,
    mesh: ProxyMesh,
    progress: ShareProgress | None = None,
    *,
    cameras: Sequence[Camera] = (),
    source: str | Path = "mesh",
) -> ProxyMesh:
    """The mesh moved onto the splats; its faces, texture coordinates and colours stay as they are.

    First the best of the usual mistakes is undone (turned, moved, scaled). Then the whole is aligned, with a scale and
    a swelling (all vertices move as far along their normals), where that brings it nearer: to depth maps of the splats
    (see `sighted`), or, where splats are discs on the surface, to these, by the iterated closest point method with
    planes. To discs vertices are moved one by one, too: onto the planes of those around them whose normal agrees, in
    rounds that look ever closer, where that brings the mesh nearer still.

    Args:
        splats: the capture, in world space.
        mesh: the proxy to be fitted.
        progress: hears what is being done.
        cameras: those of the capture's pictures, in world space, which depth maps are taken from; none: from around.
        source: whom to name in an error, usually the mesh's file.

    Raises:
        InputError: splats or a mesh without a surface.
    """
    report = progress or quiet
    report("looking at the splats", 0.0)
    capture = look_at_capture(splats, "splats")
    faces = mesh.faces.astype(np.int64)
    at = mesh.vertices.astype(np.float64) - capture.middle
    if not triangles.areas(at[faces]).sum() > 0:
        raise InputError(source, "a mesh without area", "give a mesh with triangles")
    # Vertices in one place move as one, so that seams of textures and of normals do not tear.
    _, first, place = np.unique(mesh.vertices, axis=0, return_index=True, return_inverse=True)
    place = place.ravel()
    v, f = at[first], place[faces]
    guess = best_guess(capture, v, f)
    if capture.surfels:
        fit, settled = _onto_discs(capture, v, f, guess, part(report, 0.1, 1.0))
    else:
        views = _views(capture, cameras, part(report, 0.1, 0.5))
        fit = sighted(views, v, f, guess, capture.spacing, part(report, 0.5, 1.0))
        settled = fit.of(v, triangles.vertex_normals(v, f))
    moved_to = (settled[place] + capture.middle).astype(np.float32)
    return replace(
        mesh, vertices=moved_to, normals=None if mesh.normals is None else _turned_normals(mesh.normals, fit.pose)
    )


def _views(capture: Capture, cameras: Sequence[Camera], report: ShareProgress) -> list[DepthMap]:
    """Depth maps, smooth, of the capture's cameras or of some around it, and inside where much is hidden from those."""
    maps = DepthMaps(capture, _SETTINGS, middle=True)
    if cameras:
        there = [moved(camera, -capture.middle) for camera in cameras]
        refuse_strangers(capture, there, "splats")
        views = [maps.of(camera) for camera in passed(seen_by(there), report, DEPTHS)]
    else:
        outer = around(capture.splats.means, capture.radius, MESH.judge_views, MESH.judge_pixels)
        views = [maps.of(camera) for camera in passed(outer, report, DEPTHS)]
        if hidden_share(capture, views) > TUNING.inside_hidden:
            inner = from_points(places(capture), MESH.judge_pixels // 2, 1e-3 * capture.radius)
            views += [maps.of(camera) for camera in inner]
    return [slanted(view, capture.spacing) for view in views]


def _onto_discs(capture: Capture, v: F64, f: Int, guess: F64, report: ShareProgress) -> tuple[Fit, F64]:
    """What brings a mesh nearest to discs as a whole, and where vertices come to lie then."""
    report("aligning the mesh", 0.0)
    normals = normals_of(capture)
    misfit = _Misfit(capture, normals)
    fit = _aligned(capture, misfit, v, f, guess)
    at = fit.of(v, triangles.vertex_normals(v, f))
    return fit, _settled(capture, normals, at, f, misfit, part(report, 0.5, 1.0))


def _turned_normals(normals: F32, pose: F64) -> F32:
    return turned(normals, (pose[:3, :3] / np.cbrt(np.linalg.det(pose[:3, :3]))).astype(np.float32))


class _Misfit:
    """How far splats lie from a mesh, as a mean: off its planes, or past its rims."""

    def __init__(self, capture: Capture, normals: F64) -> None:
        step = max(len(normals) // MESH.register_splats, 1)
        self.at, self.normals = capture.splats.means[::step].astype(np.float64), normals[::step]
        self._most = 0.1 * capture.radius

    def of(self, points: F64, area: float) -> tuple[Int, F64]:
        """(N,) the nearest of points spread over the mesh of that area, (N,) how far splats lie from it."""
        from scipy.spatial import cKDTree

        distance, index = cKDTree(points).query(self.at, workers=-1)
        nearest = points[index]
        off = np.abs(np.einsum("nk,nk->n", self.at - nearest, self.normals))
        past = distance - 2 * np.sqrt(area / len(points))  # nearer than that, the point is as near as points lie
        return index, np.asarray(np.minimum(np.maximum(off, past), self._most))

    def mesh(self, at: F64, faces: Int) -> float:
        """Mean misfit of a mesh to the splats."""
        return float(
            self.of(spread_on(at, faces, MESH.register_points)[0], float(triangles.areas(at[faces]).sum()))[1].mean()
        )


def _aligned(capture: Capture, misfit: _Misfit, at: F64, faces: Int, start: F64) -> Fit:
    """What brings a mesh nearest to splats, from a first guess; the guess where that is best.

    A mesh is taken as swollen only where that tells much more, once its vertices have moved: what is off to both sides
    is none, and faces that do not agree on an outside have none to move to.
    """
    rigid = _descended(capture, misfit, at, faces, start, swells=False)
    swollen = _descended(capture, misfit, at, faces, start, swells=True)
    normals = triangles.vertex_normals(at, faces)
    error, less = (misfit.mesh(fit.of(at, normals), faces) for fit in (rigid, swollen))
    far = abs(swollen.swelling) * swollen.size > capture.spacing  # less is how splats lie about a surface
    return swollen if far and less < (1 - MESH.register_swollen) * error else rigid


def _descended(capture: Capture, misfit: _Misfit, at: F64, faces: Int, start: F64, *, swells: bool) -> Fit:
    """The best fit on the way down from a guess."""
    points, face = spread_on(at, faces, MESH.register_points)
    normals = triangles.crossed(at[faces])[face]
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
    area = float(triangles.areas(at[faces]).sum())

    def apart(fit: Fit) -> tuple[F64, F64, F64, float]:
        index, off = misfit.of(moved := fit.of(points, normals), area * fit.size**2)
        return moved[index], turned(normals[index], fit.pose[:3, :3] / fit.size), off, float(off.mean())

    best = now = Fit(start)
    p, facing, off, error = apart(now)
    least = error
    for _ in range(MESH.register_steps):
        reach = max(2 * float(np.median(off)), 0.5 * capture.spacing)
        weight = 1 / (1 + (off / reach) ** 2) ** 2
        now = now.then(*small_step(p, facing if swells else 0 * facing, misfit.at, misfit.normals, weight))
        p, facing, off, error = apart(now)
        if error > least * (1 - MESH.register_enough):
            break
        best, least = now, error
    return best


def _settled(capture: Capture, normals: F64, v: F64, f: Int, misfit: _Misfit, report: ShareProgress) -> F64:
    """Vertices moved onto the planes of splats, where that brings the mesh nearer to them.

    It does not where the mesh fits already, and where triangles are much larger than what their corners look at: a wall
    of two triangles knows its plane better than its corners do.
    """
    from scipy.spatial import cKDTree

    best, least = v, (1 - MESH.register_gain) * misfit.mesh(v, f)
    q = capture.splats.means.astype(np.float64)
    tree, weight = cKDTree(q), capture.splats.opacities.astype(np.float64)
    for k, reach in enumerate(
        np.geomspace(MESH.register_widest, MESH.register_narrowest, MESH.register_rounds) * capture.spacing
    ):
        report("moving vertices onto the splats", k / MESH.register_rounds)
        own = triangles.vertex_normals(v, f)
        distance, index = tree.query(v, k=min(MESH.register_planes, len(q)), workers=-1)
        n, step = normals[index], q[index] - v[:, None]
        agree = np.abs(np.einsum("vki,vi->vk", n, own)) ** 4
        w = weight[index] * agree * np.exp(-0.5 * (distance / reach) ** 2)
        total = w.sum(axis=1)
        height = (n * step).sum(axis=2)
        stays = (MESH.register_stay * total + 1e-9)[:, None, None] * np.eye(3)
        matrix = np.einsum("vk,vki,vkj->vij", w, n, n) + stays
        move = np.linalg.solve(matrix, np.einsum("vk,vki,vk->vi", w, n, height)[..., None])[..., 0]
        length = np.linalg.norm(move, axis=1)
        move *= np.minimum(1, 2 * reach / np.maximum(length, 1e-30))[:, None]
        v = v + _shared(move, total / (total + 0.5), f)
        error = misfit.mesh(v, f)
        if error < least:
            best, least = v, error
    return best


def _shared(move: F64, sure: F64, f: Int) -> F64:
    """Moves smoothed over the mesh; a vertex that is not sure of its own follows its neighbours."""
    from scipy.sparse import coo_matrix

    edges = np.concatenate([f[:, [0, 1]], f[:, [1, 2]], f[:, [2, 0]]])
    edges = np.concatenate([edges, edges[:, ::-1]])
    n = len(move)
    graph = coo_matrix((np.ones(len(edges)), (edges[:, 0], edges[:, 1])), shape=(n, n)).tocsr()
    degree = np.maximum(np.asarray(graph.sum(axis=1)).ravel(), 1)
    own = 4 * sure + 1e-6  # against the neighbours' mean
    out = move * sure[:, None]
    for _ in range(MESH.register_spread):
        out = (own[:, None] * move + (graph @ out) / degree[:, None]) / (own + 1)[:, None]
    return out

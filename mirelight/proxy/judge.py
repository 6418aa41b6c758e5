"""How well a mesh fits splats: seen from around, or through given cameras."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mirelight.base import conventions
from mirelight.compositor import Compositor
from mirelight.lighting.sight import Sight
from mirelight.model import F32, F64, Camera, ProxyMesh, SplatCloud, SplatLayer, triangles
from mirelight.proxy.advice import Figures, advice_on
from mirelight.proxy.agreement import agreement
from mirelight.proxy.capture import Capture, look_at_capture
from mirelight.proxy.depth import DepthMap, DepthMaps
from mirelight.proxy.flats import flats_of
from mirelight.proxy.mesh_tuning import MESH
from mirelight.proxy.slanted import slanted
from mirelight.proxy.tuning import TUNING
from mirelight.proxy.types import ProxyQuality, ProxySettings, ViewQuality
from mirelight.proxy.views import around, moved, rays

WRONG = 0.01  # a picture's scale alone: of the capture's size: a gap that the heat map shows in full yellow
_DEFAULT = ProxySettings()


def judge(
    splats: SplatCloud,
    mesh: ProxyMesh,
    cameras: Sequence[Camera] | None = None,
    *,
    captured: Sequence[Camera] = (),
    settings: ProxySettings = _DEFAULT,
    source: str | Path = "splats",
) -> ProxyQuality:
    """How well a mesh fits splats, in figures, words and a picture.

    Args:
        splats: the capture, in world space.
        mesh: the proxy, in the same space.
        cameras: where to look from, with as many pixels along the longer side as `TUNING` has (`view_least_pixels` to
            `judge_pixels`); None: from `judge_views` sides.
        captured: cameras of the capture's pictures, by which it is told whether these agree on the mesh; none: it is
            not told.
        settings: the variant that it runs on.
        source: whom to name in an error.

    Raises:
        InputError: splats without a surface.
        BackendError: the variant cannot run here.
    """
    capture = look_at_capture(splats, source)
    there = None if cameras is None else tuple(moved(_small(c), -capture.middle) for c in cameras)
    took = tuple(moved(c, -capture.middle) for c in captured)
    local = replace(
        mesh, vertices=(mesh.vertices.astype(np.float64) - capture.middle).astype(np.float32), normals=None, uvs=None
    )
    sight = Sight(local, settings.variant, settings.threads)
    return judged(capture, DepthMaps(capture, settings), local, sight, there, settings, took)


def seen_by(cameras: Sequence[Camera]) -> tuple[Camera, ...]:
    """Of a capture's cameras as many as a capture without is looked at from, evenly taken, as :func:`judge` takes them.

    A room from around shows the backs of its walls.
    """
    return tuple(_small(camera) for camera in cameras[:: -(-len(cameras) // MESH.judge_views)])


def judged(
    capture: Capture,
    maps: DepthMaps,
    mesh: ProxyMesh,
    sight: Sight,
    cameras: Sequence[Camera] | None,
    settings: ProxySettings,
    captured: Sequence[Camera] = (),
) -> ProxyQuality:
    """As :func:`judge`, of a capture that is known, everything in its space; `sight` into the mesh."""
    chosen = (
        around(capture.splats.means, capture.radius, MESH.judge_views, MESH.judge_pixels)
        if cameras is None
        else cameras
    )
    compositor = Compositor(capture.splats, variant=settings.variant, threads=settings.threads)
    views = [maps.of(camera) for camera in chosen]
    normals = triangles.normals(mesh.vertices[mesh.faces].astype(np.float64))
    seen = [_compared(compositor.composite(x.camera, depth=False), x, sight, normals) for x in views]
    some = slice(None, None, -(-len(views) // MESH.judge_waves))
    waves = _waves([slanted(x, capture.spacing) for x in views[some]], seen[some], capture)
    wavy, wavy_high = _quantiles(waves, (0.5, 0.9))
    pictures = agreement(compositor, captured, sight, 2 * capture.radius)
    shown = sum(x.shown for x in seen)
    covered = sum(x.covered for x in seen)
    leaked, hit = sum(x.leaked for x in seen), sum(x.hit for x in seen)
    gaps = np.concatenate([x.gaps for x in seen])
    size = 2 * capture.radius
    uncovered = 1 - covered / shown if shown else 1.0
    median, high = _quantiles(gaps, (0.5, 0.95))
    leaks = leaked / hit if hit else 0.0
    by_view = tuple(x.quality(camera.name, WRONG * size) for x, camera in zip(seen, chosen, strict=True))
    return ProxyQuality(
        uncovered=uncovered,
        gap_median=median,
        gap_95=high,
        leaks=leaks,
        wavy=wavy,
        wavy_90=wavy_high,
        pictures=pictures,
        size=size,
        triangles=len(mesh.faces),
        views=len(views),
        by_view=by_view,
        advice=advice_on(capture, mesh, Figures(uncovered, median, leaks, wavy, pictures)),
        heat=_sheet([x.heat for x in by_view]),
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Compared:
    """One view of splats and mesh."""

    alpha: F32  # (H, W)
    gray: F32  # (H, W) how bright the splats look, display values, premultiplied
    surface: NDArray[np.bool_]  # (H, W) where splats show one: no fog, and no sky of a few large ones
    on_mesh: NDArray[np.bool_]  # (H, W)
    normal: F64  # (H, W, 3) of the mesh, unit
    gap: F64  # (H, W) how far behind the mesh the splats' surface lies along the view, NaN where one is not

    @property
    def shown(self) -> int:
        return int(self.surface.sum())

    @property
    def covered(self) -> int:
        return int((self.surface & self.on_mesh).sum())

    @property
    def leaked(self) -> int:
        return int(((self.alpha < MESH.judge_empty) & self.on_mesh).sum())

    @property
    def hit(self) -> int:
        return int(self.on_mesh.sum())

    @property
    def gaps(self) -> F64:
        return np.abs(self.gap[np.isfinite(self.gap)])

    def quality(self, camera: str, wrong: float) -> ViewQuality:
        gaps = self.gaps
        return ViewQuality(
            camera=camera,
            shown=self.shown / self.alpha.size,
            uncovered=1 - self.covered / self.shown if self.shown else 0.0,
            gap_median=float(np.median(gaps)) if len(gaps) else float("nan"),
            before=float(np.mean(self.gap[np.isfinite(self.gap)] > 0)) if len(gaps) else 0.0,
            heat=self.picture(wrong),
        )

    def picture(self, wrong: float) -> NDArray[np.uint8]:
        """(H, W, 3): gray as the splats look; red, blue and yellow over it."""
        gray = np.clip(self.gray, 0, 1)[..., None] * 0.7 + 0.05
        out = np.repeat(gray, 3, axis=2).astype(np.float64)
        off = np.nan_to_num(np.clip(np.abs(self.gap) / wrong, 0, 1))[..., None]
        out = out * (1 - off) + off * (1.0, 0.85, 0.1)
        missed = self.surface & ~self.on_mesh
        out[missed] = 0.25 * out[missed] + 0.75 * np.array((1.0, 0.1, 0.05))
        out[(self.alpha < MESH.judge_empty) & self.on_mesh] = (0.15, 0.35, 1.0)
        return np.rint(np.clip(out, 0, 1) * 255).astype(np.uint8)


def _compared(layer: SplatLayer, view: DepthMap, sight: Sight, normals: F64) -> _Compared:
    origins, directions = rays(view.camera)
    shape = view.depth.shape
    starts = np.broadcast_to(origins, directions.shape).reshape(-1, 3)
    face, distance = sight.first_hits(starts, directions.reshape(-1, 3))
    on_mesh = (face >= 0).reshape(shape)
    both = on_mesh & (view.depth > 0) & (layer.transmittance < 1 - TUNING.depth_opaque)
    depth = np.where(both, distance.reshape(shape), 0.0)
    long = np.linalg.norm(directions, axis=-1)
    gap = np.where(both, (view.depth - depth) * long, np.nan)
    normal = np.zeros(directions.shape)
    normal[on_mesh] = normals[face[face >= 0]]
    surface = (layer.transmittance < 1 - TUNING.depth_opaque) & (view.trust > MESH.judge_sure)
    return _Compared(1 - layer.transmittance, layer.color.mean(axis=-1), surface, on_mesh, normal, gap)


def _waves(views: Sequence[DepthMap], seen: Sequence[_Compared], capture: Capture) -> F64:
    """(P,) degrees between the mesh's normals and those of the large planes that pixels of the splats lie on."""
    out = []
    places = [origins + ways * x.depth[..., None] for x in views for origins, ways in [rays(x.camera)]]
    left = [
        own.on_mesh & (x.depth > 0) & (np.abs(own.gap) < MESH.judge_near * capture.spacing)
        for x, own in zip(views, seen, strict=True)
    ]
    least = MESH.judge_large * sum(int(x.sum()) for x in left)
    for flat in flats_of(views, capture.spacing, capture.radius):
        normals, points = [], []
        for free, place, own in zip(left, places, seen, strict=True):
            on = free & (np.abs(flat.off(place)) < TUNING.plane_tolerance * capture.spacing) & flat.inside(place)
            on &= np.abs(np.einsum("hwi,i->hw", own.normal, flat.normal)) > TUNING.plane_cosine
            normals.append(own.normal[on])
            points.append(place[on])
            free &= ~on
        if sum(map(len, points)) > least and not _is_bent(np.concatenate(points), flat.normal, capture.spacing):
            cosine = np.abs(np.concatenate(normals) @ flat.normal)
            out.append(np.degrees(np.arccos(np.minimum(cosine, 1))))
    return np.concatenate(out) if out else np.zeros(0)


def _is_bent(points: F64, normal: F64, spacing: float) -> bool:
    """Whether points (P, 3) beside a plane lie on the cap of something round: then their distances from the plane bend
    as a whole, where those of an uneven plane go up and down."""
    if len(points) < MESH.judge_fewest:
        return True
    x, y, off = ((points - points.mean(axis=0)) @ conventions.frame_around(normal[None])[0].T).T
    bent = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=1)
    rest = off - bent @ np.linalg.lstsq(bent, off, rcond=None)[0]
    return bool(off.std() > MESH.judge_even * spacing and rest.var() < MESH.judge_bent * off.var())


def _quantiles(values: F64, shares: tuple[float, float]) -> tuple[float, float]:
    """Two quantiles; NaN where there is nothing."""
    low, high = np.quantile(values, shares) if len(values) else (np.nan, np.nan)
    return float(low), float(high)


def _small(camera: Camera) -> Camera:
    """The camera with its own pixels, but along the longer side no fewer and no more than are looked at."""
    longer = max(camera.width, camera.height)
    return camera.scaled(min(max(longer, TUNING.view_least_pixels), MESH.judge_pixels) / longer)


def _sheet(pictures: Sequence[NDArray[np.uint8]]) -> NDArray[np.uint8]:
    """Pictures in rows of four, on black."""
    height, width = max(p.shape[0] for p in pictures), max(p.shape[1] for p in pictures)
    columns = min(len(pictures), 4)
    rows = -(-len(pictures) // columns)
    out = np.zeros((rows * height, columns * width, 3), np.uint8)
    for i, picture in enumerate(pictures):
        y, x = i // columns * height, i % columns * width
        out[y : y + picture.shape[0], x : x + picture.shape[1]] = picture
    return out

"""How bright a capture's light is on the whole: the constant of a scene that keeps ratios of light finite.

In a view it would be the mean over the pixels that see the proxy, and then one point of the surface would have another
factor in the next view. Here it is a mean over the surface that was captured.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mirelight.base import colour
from mirelight.base.errors import RenderError
from mirelight.lighting.albedo import UNLIT, face_normals
from mirelight.lighting.appearance import shown
from mirelight.lighting.engine import EngineTracer
from mirelight.lighting.observed import observed
from mirelight.lighting.trace import Tracer
from mirelight.model import F64, I32, Lighting, ProxyMesh, RenderSettings, SplatCloud, SplatLayer, rules_of, triangles

POINTS = 1 << 12  # places on the surface; their mean is known to about one percent
SPP = 16  # samples at each


def captured_level(
    splats: SplatCloud | None,
    proxy: ProxyMesh,
    captured: Lighting,
    settings: RenderSettings,
    views: Sequence[SplatLayer] = (),
) -> float:
    """Mean luminance of the captured light, lit radiance over albedo (irradiance / pi), over the captured surface.

    The surface is where splats lie on the proxy: a few thousand of them, evenly taken, weighted by opacity, extent and
    closeness. Without splats on it, it is the whole proxy by area, each point on its brighter side.

    Args:
        splats: what was captured, world space.
        proxy: world space; with the colours that frames are lit with, as light goes from surface to surface.
        captured: what it was captured under.
        views: as for :func:`mirelight.lighting.colored_by`.
        settings: profile, seed, depth, variant and threads count.

    Returns:
        0 or more; 0 for a proxy without area.

    Raises:
        BackendError: the variant cannot be used on this machine.
    """
    if not len(proxy.faces):
        return 0.0
    settings = replace(settings, spp=SPP, noise=None, denoise=False)
    tracer = Tracer(proxy, settings, layers=False, aovs=False)
    engine = None if rules_of(settings.profile).path_traced else EngineTracer(proxy, settings)

    found = _captured_places(splats, views, proxy, tracer)
    places = found or _everywhere(proxy)

    def brightness(of: NDArray[np.integer], side: float) -> F64:
        face, points, normals = places.face[of], places.points[of], side * places.normals[of]
        if engine is not None:
            light = engine.irradiance(captured, face, points, normals) / np.pi
        else:
            light = shown(tracer, captured, points, normals, SPP).astype(np.float64)
        return light @ colour.REC709_LUMINANCE

    every = np.arange(len(places.face))
    if not len(every):
        return 0.0
    front = brightness(every, 1.0)
    hidden = (
        every if found is None else np.flatnonzero((places.side <= 0) & (front <= UNLIT * front.mean()))
    )  # an inside?
    if len(hidden):
        front[hidden] = np.maximum(front[hidden], brightness(hidden, -1.0))
    return float(np.average(front, weights=places.weight))


@dataclass(frozen=True, slots=True, eq=False)
class _Places:
    """Points of a mesh, N of them."""

    face: I32  # (N,)
    points: F64  # (N, 3) world space
    normals: F64  # (N, 3) unit
    weight: F64  # (N,) their sum is above 0
    side: F64  # (N,) 1: what was seen is the front, -1: the back; 0: not known


def _captured_places(
    splats: SplatCloud | None, views: Sequence[SplatLayer], mesh: ProxyMesh, tracer: Tracer
) -> _Places | None:
    """Where splats lie on the mesh; None where none does."""
    if splats is None or not len(splats):
        return None
    try:
        found = observed(splats, views, mesh, tracer).deposits(POINTS)
    except RenderError:
        return None
    return _Places(found.face, *found.seen(mesh), found.weight, found.side) if found.weight.sum() > 0 else None


def _everywhere(mesh: ProxyMesh) -> _Places:
    """Points spread evenly over a mesh by area; none where it has no area."""
    v = mesh.vertices[mesh.faces].astype(np.float64)
    face, corners = triangles.strewn(v, POINTS)
    points = (v[face] * corners[:, :, None]).sum(axis=1)
    return _Places(face.astype(np.int32), points, face_normals(mesh)[face], np.ones(len(face)), np.zeros(len(face)))

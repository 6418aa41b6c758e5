"""What mirrors show of a capture: colours of its proxy finer than vertices hold them. NumPy only.

Light that surfaces send each other needs the mean colour around a vertex, but a mirror shows every tile of a floor. So
faces near mirrors get colours on a lattice of points, without texture coordinates (Yuksel, Keyser and House, "Mesh
colors", 2010), each as the capture shows it over the captured light there: the finer, the nearer the mirror.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from mirelight.lighting.albedo import DARKEST, irradiance_at
from mirelight.lighting.lattices import Detail, lattice, points_of, starts
from mirelight.lighting.observed import Deposits, observed
from mirelight.lighting.trace import Tracer
from mirelight.model import F64, I32, Lighting, ProxyMesh, RenderSettings, SplatCloud, SplatLayer
from mirelight.model.profiles import BRIGHTEST

Bool = NDArray[np.bool_]

MOST_POINTS = 1 << 18  # of all lattices together
FINEST = 1 / 256  # of the distance to a mirror: steps that show no more
SPP = 16  # of light at each point: a mirror's pixel shows several
MIRRORS = 0.45  # roughness below which what is mirrored is told apart
_MOST_STEPS = 512
_DOUBT = 0.1  # of the mean light: as little tells no more than the vertices do
_INSET = 0.25  # of a step: points of a lattice keep off the edges of their face, where other faces begin
_ROUGH = 8  # steps of a first lattice that tells how near a face comes


def told(
    mesh: ProxyMesh,
    mirrors: Sequence[tuple[F64, float]],
    splats: SplatCloud,
    views: Sequence[SplatLayer],
    captured: Lighting,
    settings: RenderSettings,
    *,
    discs: bool = True,
) -> Detail:
    """The colours near mirrors.

    Args:
        mesh: the proxy in world space, with the vertex colours that its splats have told.
        mirrors: centre (3,) and radius of each thing that mirrors, world units.
        splats: what was captured, world space.
        views: as for :func:`mirelight.lighting.colored_by`.
        captured: what it was captured under.
        settings: seed, depth and variant count.
        discs: the splats lie on the surface as discs, so that each tells its colour beside the views.

    Raises:
        BackendError: the variant cannot be used on this machine.
    """
    tracer = Tracer(mesh, replace(settings, noise=None, denoise=False), layers=False, aovs=False)
    steps = _steps(mesh, mirrors)
    face, corners = lattice(steps)
    assert mesh.vertex_colors is not None
    colors = (mesh.vertex_colors[mesh.faces[face]] * corners[:, :, None]).sum(axis=1)
    moved = corners * (1 - _INSET / steps[face, None]) + _INSET / 3 / steps[face, None]
    nothing = np.zeros((len(face), 3))
    one, spread = np.ones(len(face)), np.zeros((len(face), 2, 3))
    places = Deposits(face, moved.astype(np.float32), one, nothing, spread, side=0 * one)
    shown, known = observed(splats, views, mesh, tracer).at(*places.on(mesh))
    if views and discs:
        shown, known = _both((shown, known), observed(splats, (), mesh, tracer).at(*places.on(mesh)))
    some = np.flatnonzero(known)
    if len(some):
        there = Deposits(*(np.asarray(getattr(places, x))[some] for x in Deposits.__slots__))
        light = irradiance_at(there, mesh, tracer, captured, SPP)
        doubt = max(_DOUBT * float(light.mean()), 1e-300)  # in the dark the vertices are believed
        reflected = np.minimum(np.pi * shown[some], BRIGHTEST * light)
        colors[some] = np.maximum((reflected + doubt * colors[some]) / (light + doubt), DARKEST)
    return Detail(steps, starts(steps), colors.astype(np.float32))


def _both(one: tuple[F64, Bool], other: tuple[F64, Bool]) -> tuple[F64, Bool]:
    """(N, 3) colours and (N,) where they are known, of two that do: their mean where both are, as they err apart."""
    shares = np.stack([one[1], other[1]]).astype(np.float64)[..., None]
    whole = shares.sum(axis=0)
    mean = (shares[0] * one[0] + shares[1] * other[0]) / np.maximum(whole, 1)
    return np.asarray(mean), np.asarray(whole[:, 0] > 0)


def _steps(mesh: ProxyMesh, mirrors: Sequence[tuple[F64, float]]) -> I32:
    """(F,) steps along the edges of each face: as fine by distance from the mirrors as the number of points allows."""
    v = mesh.vertices[mesh.faces].astype(np.float64)
    edge = np.sqrt(((v - np.roll(v, 1, axis=1)) ** 2).sum(axis=2).max(axis=1))
    away = np.full(len(v), np.inf)
    _, weights = lattice(np.array([_ROUGH], np.int32))
    for centre, radius in mirrors:
        for w in weights:
            apart = np.linalg.norm(np.einsum("fkc,k->fc", v, w) - centre, axis=1)
            np.minimum(away, np.maximum(apart - edge / _ROUGH, radius), out=away)

    def at(step: float) -> I32:
        n = np.minimum(np.ceil(edge / np.maximum(step * away, 1e-30)), _MOST_STEPS)
        return np.where((n > 1) & np.isfinite(away), n, 0).astype(np.int32)

    low, high = FINEST, FINEST * 2.0**20
    if points_of(at(low)).sum() <= MOST_POINTS:
        return at(low)
    for _ in range(40):
        middle = float(np.sqrt(low * high))
        low, high = (middle, high) if points_of(at(middle)).sum() > MOST_POINTS else (low, middle)
    return at(high)

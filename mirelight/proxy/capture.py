"""A look at a capture before a proxy is made of it: what is solid, where it is, how dense, of which kind."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from mirelight.base.errors import InputError
from mirelight.model import F64, SplatCloud, shown
from mirelight.model.scene import SOLID
from mirelight.proxy.axes import axes_of
from mirelight.proxy.dome import on_dome
from mirelight.proxy.joining import joined
from mirelight.proxy.tuning import TUNING
from mirelight.proxy.types import Int

# bounds of what can be read as a surface at all: nothing is tuned by them
FEWEST = 50  # splats that a surface takes
SMALLEST = 1e-12  # world units: squares of distances in what is smaller leave single precision (1e-10 is as 1)


@dataclass(frozen=True, slots=True, eq=False)
class Capture:
    """Solid splats around the origin."""

    splats: SplatCloud  # moved by -middle
    middle: F64  # (3,) world units
    half: F64  # (3,) half the extent of the box around the origin that holds their centres
    radius: float  # of the ball around the origin that holds their centres
    spacing: float  # median distance between neighbours, world units
    surfels: bool  # thin discs that lie on a surface, rather than needles, blobs and discs that lie about it


def look_at_capture(splats: SplatCloud, source: str | Path) -> Capture:
    """The solid part of a capture, joined down to `capture_most_splats` of `TUNING`.

    Raises:
        InputError: too few splats, none that shows, all in one place, or too far from the origin.
    """
    solid, middle, half = solid_part(splats, source)
    inside = solid[(np.abs(splats.means[solid] - middle) <= half).all(axis=1)]
    kept = take(splats, inside)
    low, high = (f(kept.means, axis=0).astype(np.float64) for f in (np.min, np.max))
    middle, half = (low + high) / 2, (high - low) / 2
    means = kept.means.astype(np.float64) - middle
    radius = float(np.linalg.norm(means, axis=1).max())
    kept = replace(kept, means=means.astype(np.float32))
    surfels = are_discs(kept)
    if len(kept) > TUNING.capture_most_splats:
        kept = joined(kept, TUNING.capture_most_splats)
    means = kept.means.astype(np.float64)
    spacing = spacing_of(means, means[:: max(len(means) // TUNING.capture_sample, 1)])
    if not spacing > 0:
        raise InputError(source, "most splats lie in the same place as another", "check the file")
    if np.median(np.sort(kept.scales, axis=1)[:, 1]) < TUNING.capture_points * spacing:
        raise InputError(source, "no surface: its splats are points, with nothing between them", "check their scales")
    return Capture(kept, middle, half, radius, spacing, surfels)


def are_discs(splats: SplatCloud) -> bool:
    """Whether splats are thin discs that lie in each other's planes, each with the surface's own colour.

    Optimisers that flatten splats (2DGS, PGSR) leave discs about a surface, at all heights and angles: what they look
    like together is right, and no single disc is.
    """
    from scipy.spatial import cKDTree

    solid = np.flatnonzero(splats.opacities >= SOLID)
    some = take(splats, solid[:: max(len(solid) // TUNING.capture_sample, 1)])
    if not len(some):
        return True
    axes, scales = axes_of(some)
    if not np.quantile(scales[:, 0] / np.maximum(scales[:, 1], 1e-30), TUNING.capture_alike) < TUNING.capture_surfel:
        return False
    means, at = splats.means[solid].astype(np.float64), some.means.astype(np.float64)
    _, near = cKDTree(means).query(at, k=min(7, len(means)), workers=-1)
    way = means[near.reshape(len(at), -1)[:, 1:]] - at[:, None]
    off = np.abs(np.einsum("nk,njk->nj", axes[:, :, 0], way))
    away = np.linalg.norm(way, axis=2)
    return not np.median(off[away > 0] / away[away > 0] if (away > 0).any() else [0.0]) > TUNING.capture_aslant


def solid_part(splats: SplatCloud, source: str | Path) -> tuple[Int, F64, F64]:
    """Rows of splats that show, strays among them; middle (3,) and half the extent (3,) of a box that holds the rest.

    Raises:
        InputError: too few splats, none that shows, all in one place, or too far from the origin.
    """
    if len(splats) < FEWEST:
        raise InputError(source, f"{shown.count(len(splats), 'splat')}, too few for a surface", "give a capture")
    with np.errstate(over="ignore", invalid="ignore"):
        sound = np.isfinite(splats.means).all(axis=1) & np.isfinite(splats.scales).all(axis=1)
        sound &= np.isfinite(splats.quats).all(axis=1) & (np.linalg.norm(splats.quats, axis=1) > 0)
    solid = np.flatnonzero(sound & (splats.opacities >= SOLID) & (np.sort(splats.scales, axis=1)[:, 1] > 0))
    if len(solid) >= FEWEST:
        solid = solid[~on_dome(splats.means[solid].astype(np.float64))]
    if len(solid) < FEWEST:
        found = f"{len(solid)} of {len(splats)} splats show (opacity {SOLID} and more), too few for a surface"
        raise InputError(source, found, "check the file; a capture that is all transparent has no proxy")
    low, high = np.quantile(
        splats.means[solid].astype(np.float64), [TUNING.capture_stray, 1 - TUNING.capture_stray], axis=0
    )
    middle, half = (low + high) / 2, (high - low) / 2 * (1 + 2 * TUNING.capture_margin)
    size = float(np.linalg.norm(half))
    if not size > 0:
        raise InputError(source, "all splats lie in one place", "check the file")
    if size < SMALLEST:
        raise InputError(source, f"it is {2 * size:.3g} units in size", "scale it up before it is saved")
    half = np.maximum(half, 0.05 * size)  # a flat capture has no extent along one axis
    step = float(np.spacing(np.float32(np.abs(middle).max())))
    if step > 2e-5 * size:
        found = f"it lies {np.abs(middle).max():.3g} units from the origin and is {2 * size:.3g} in size"
        remedy = "numbers of single precision are too coarse there: move it to the origin before it is saved"
        raise InputError(source, found, remedy)
    return solid, middle, half


def take(splats: SplatCloud, rows: Int) -> SplatCloud:
    """The splats of some rows (N,) alone."""
    return replace(
        splats,
        means=splats.means[rows],
        quats=splats.quats[rows],
        scales=splats.scales[rows],
        opacities=splats.opacities[rows],
        sh=splats.sh[rows, :1],
    )


def spacing_of(means: F64, asked: F64) -> float:
    """The median distance between neighbours among points (N, 3) of a surface, around some of them (M, 3)."""
    return float(np.median(_sixth(means, asked))) / 1.8


def density(means: F64, asked: F64) -> F64:
    """(M,) how many points (N, 3) of a surface a square unit has around some (M, 3); up to 100 times the usual."""
    away = _sixth(means, asked)
    return np.asarray(1 / np.maximum(away, 0.1 * np.median(away)) ** 2)


def _sixth(means: F64, asked: F64) -> F64:
    """(M,) how far the sixth neighbour of points (M, 3) is: of a plane's hexagons it lies 1 to 2 spacings off."""
    from scipy.spatial import cKDTree

    near, _ = cKDTree(means).query(asked, k=min(7, len(means)), workers=-1)
    return np.asarray(near[:, -1])


def normals_of(capture: Capture) -> F64:
    """(N, 3) unit normals of the surface at splats, either sign.

    Of flat ones their thinnest axis; of blobs that of the mixture of a splat and its neighbours.
    """
    axes, scales = axes_of(capture.splats)
    out = np.ascontiguousarray(axes[:, :, 0])
    blob = np.flatnonzero(scales[:, 0] > TUNING.capture_flat * scales[:, 1])
    if not len(blob):
        return out
    from scipy.spatial import cKDTree

    means = capture.splats.means.astype(np.float64)
    _, near = cKDTree(means).query(means[blob], k=min(TUNING.capture_mixed, len(means)), workers=-1)
    own = np.einsum("nik,nk,njk->nij", axes, scales**2, axes)
    total, weight = np.zeros((len(blob), 3, 3)), capture.splats.opacities.astype(np.float64)
    for k in range(near.shape[1]):
        step = means[near[:, k]] - means[blob]
        total += weight[near[:, k], None, None] * (own[near[:, k]] + step[:, :, None] * step[:, None, :])
    out[blob] = np.linalg.eigh(total)[1][:, :, 0]
    return out

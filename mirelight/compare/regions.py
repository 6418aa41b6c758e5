"""Where to score: everywhere, where the proxy covers, and in a band around silhouettes."""

from __future__ import annotations

import numpy as np

from mirelight.compare.types import Bool, Picture, RegionName
from mirelight.model import F32

_DEPTH_STEP = 0.05  # share of the depth by which a neighbour must leave the surface's plane to be another surface


def regions(reference: Picture, test: Picture, counted: Bool, band: int) -> dict[RegionName, Bool]:
    """Masks (H, W) by name, each inside `counted`; empty ones are left out, "all" comes first.

    Coverage and depth are taken from the reference, else from the test; without a coverage channel, alpha stands in
    where it varies.
    """
    found: dict[RegionName, Bool] = {"all": counted}
    source = reference if reference.coverage is not None else test
    covered = _covered(source, reference, test)
    if covered is not None:
        found["covered"] = counted & covered
        found["silhouette"] = counted & grown(silhouettes(covered, source.depth), band)
    return {name: mask for name, mask in found.items() if mask.any()}


def _covered(source: Picture, reference: Picture, test: Picture) -> Bool | None:
    if source.coverage is not None:
        return np.asarray(source.coverage > 0.5)
    for picture in (reference, test):
        if picture.alpha.min() < 0.5 < picture.alpha.max():
            return np.asarray(picture.alpha > 0.5)
    return None


def silhouettes(covered: Bool, depth: F32 | None) -> Bool:
    """(H, W) pixels beside an edge of the cover, or beside a jump of depth that a plane cannot explain."""
    edges = np.zeros(covered.shape, dtype=bool)
    for axis in (0, 1):
        step = np.moveaxis(covered, axis, 0)
        here = np.moveaxis(edges, axis, 0)
        changes = step[1:] != step[:-1]
        here[1:] |= changes
        here[:-1] |= changes
        if depth is not None:
            z = np.moveaxis(depth, axis, 0)
            known = step[2:] & step[1:-1] & step[:-2]
            bend = np.abs(z[2:] - 2 * z[1:-1] + z[:-2])
            here[1:-1] |= known & (bend > _DEPTH_STEP * z[1:-1])
    return edges


def grown(mask: Bool, radius: int) -> Bool:
    """The mask (H, W) and every pixel within `radius` of it along both axes (a square)."""
    out = mask
    for axis in (0, 1):
        wide = np.moveaxis(out, axis, 0).copy()
        source = np.moveaxis(out, axis, 0)
        for shift in range(1, min(radius, len(source) - 1) + 1):
            wide[shift:] |= source[:-shift]
            wide[:-shift] |= source[shift:]
        out = np.moveaxis(wide, 0, axis)
    return out

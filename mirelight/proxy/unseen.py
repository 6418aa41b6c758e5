"""Triangles that stop light where a capture's cameras saw nothing, so that it does not pass through walls nobody saw.

Two things are made. Space that is hidden behind the surface in some picture, that no picture looks through (space
carving: Kutulakos and Seitz, 2000), and that lies just behind the surface is taken as solid: light does not come
through cracks. Farther behind it may be the open: a beam of the sun comes into a room through space that no camera
looked into. Space in no picture at all is left open, as the sky is such space; but large planes go on in it (`beyond`).
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from mirelight.errors import InputError
from mirelight.lighting.sight import Sight
from mirelight.model import F64, Camera
from mirelight.proxy.beyond import Look, beyond_pictures
from mirelight.proxy.fusion import Grid
from mirelight.proxy.nets import surface_of
from mirelight.proxy.pictures import Bool, Pictures
from mirelight.proxy.sampling import spread, spread_on
from mirelight.proxy.tidy import smoothed, without_crumbs
from mirelight.proxy.types import Progress, ProxySettings, Soup

MOST_CELLS = 2_000_000
MOST_ALONG = 512  # cells along the longest side
BEHIND = 1.0  # cells behind the surface that still count as seen
THIN = 2  # cells: half as thick as hidden space must be
ALONG = 0.7  # cosine to the surface's normal, from its nearest point to what lies behind it and not beside
DEEP = 3  # cells behind the surface that are taken as solid
FEWEST_FACES = 60  # of a part of its boundary
ROUNDS = 4  # of smoothing its steps
LEAST_SEEN = 0.5  # of the surface, that a capture's cameras have seen
_SAMPLE = 20_000
_MARKS = 500_000  # points of the surface


def closing(
    soup: Soup,
    cameras: Sequence[Camera],
    spacing: float,
    settings: ProxySettings,
    progress: Progress,
    source: str | Path,
) -> Soup:
    """What closes a surface against light from where no camera saw: fronts face the space that was seen.

    Args:
        soup: the surface, in the space of the cameras.
        cameras: those of the capture.
        spacing: of the capture's splats.
        settings: the variant.
        progress: hears what is done.
        source: whom to name in an error.

    Raises:
        InputError: the cameras do not see the surface.
    """
    low, high = soup.vertices.min(axis=0), soup.vertices.max(axis=0)
    extent = np.maximum(high - low, 1e-3 * float((high - low).max()))
    cell = max(float(np.cbrt(np.prod(extent) / MOST_CELLS)), float(extent.max()) / MOST_ALONG, spacing)
    progress("looking for what no camera saw", 0.0)
    sight = Sight(soup.mesh(), settings.variant, settings.threads)
    pictures = Pictures.of(soup, cameras, sight)
    seen = float(pictures.states(spread(soup.vertices, soup.faces, _SAMPLE).astype(np.float32), cell)[0].mean())
    if seen < LEAST_SEEN:
        found = f"its {len(cameras):,} cameras see {seen:.0%} of its surface"
        raise InputError(source, found, "give the cameras of this capture, in its own axes; or none")
    progress("looking for what no camera saw", 0.3)
    room = (DEEP + THIN + 1) * cell  # so that what bounds the scene has something behind it
    hidden = _boundary_of_hidden(soup, pictures, low - room, high + room, cell)
    progress("carrying on walls", 0.7)

    def look(before: float) -> Look:
        return lambda points: pictures.states(points.astype(np.float32), -before)

    further = beyond_pictures(soup, pictures.eyes, spacing, look)
    return hidden.beside(further)


def _boundary_of_hidden(soup: Soup, pictures: Pictures, low: F64, high: F64, cell: float) -> Soup:
    """Between what cameras looked through and what is hidden from all, just behind the surface."""
    from scipy.ndimage import binary_opening, generate_binary_structure

    size = np.ceil((high - low) / cell).astype(int) + 1
    shape = (int(size[0]), int(size[1]), int(size[2]))
    place = np.indices(shape, dtype=np.float32).reshape(3, -1).T
    free, shown = pictures.states((place * np.float32(cell) + low.astype(np.float32)), BEHIND * cell)
    del place
    hidden = (shown & ~free).reshape(shape)
    hidden = binary_opening(hidden, generate_binary_structure(3, 1), THIN)
    solid = _behind(hidden, soup, low, cell).ravel()
    nodes = np.flatnonzero(free | solid)
    grid = Grid(low, cell, shape, nodes, np.where(free[nodes], 1.0, -1.0).astype(np.float32))
    return smoothed(without_crumbs(surface_of(grid), FEWEST_FACES), ROUNDS)


def _behind(hidden: Bool, soup: Soup, low: F64, cell: float) -> Bool:
    """Hidden cells that lie behind the surface, not beside its rim: within `DEEP` cells, along its normal."""
    from scipy.spatial import cKDTree

    at, face = spread_on(soup.vertices, soup.faces, _MARKS)
    a, b, c = (soup.vertices[soup.faces[face, k]] for k in range(3))
    normal = np.cross(b - a, c - a)
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300)
    place = np.argwhere(hidden)
    middles = low + place * cell
    distance, near = cKDTree(at).query(middles, distance_upper_bound=DEEP * cell, workers=-1)
    there = np.flatnonzero(np.isfinite(distance))
    step = middles[there] - at[near[there]]
    along = np.abs((step * normal[near[there]]).sum(axis=1))
    out = np.zeros_like(hidden)
    out[tuple(place[there[along >= ALONG * distance[there]]].T)] = True
    return out

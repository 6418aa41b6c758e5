"""Triangles that stop light where a capture's cameras saw nothing, so that it does not pass through walls nobody saw.

Two things are made. Space that is hidden behind the surface in some picture, and that no picture looks through, is
taken as solid, and its boundary is closed (space carving: Kutulakos and Seitz, 2000). Space in no picture at all is
left open, as the sky is such space; but large planes go on in it (`beyond`).
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from mirelight.errors import InputError
from mirelight.lighting.sight import Sight
from mirelight.model import F64, Camera
from mirelight.proxy.beyond import beyond_pictures
from mirelight.proxy.fusion import Grid
from mirelight.proxy.nets import surface_of
from mirelight.proxy.pictures import Pictures
from mirelight.proxy.sampling import spread
from mirelight.proxy.tidy import smoothed, without_crumbs
from mirelight.proxy.types import Progress, ProxySettings, Soup

MOST_CELLS = 2_000_000
MOST_ALONG = 512  # cells along the longest side
BEHIND = 1.0  # cells behind the surface that still count as seen
THIN = 2  # cells: half as thick as hidden space must be
FEWEST_FACES = 60  # of a part of its boundary
ROUNDS = 4  # of smoothing its steps
LEAST_SEEN = 0.5  # of the surface, that a capture's cameras have seen
_SAMPLE = 20_000


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
    pictures = Pictures.of(soup, cameras, Sight(soup.mesh(), settings.variant, settings.threads))
    seen = float(pictures.states(spread(soup.vertices, soup.faces, _SAMPLE).astype(np.float32), cell)[0].mean())
    if seen < LEAST_SEEN:
        found = f"its {len(cameras):,} cameras see {seen:.0%} of its surface"
        raise InputError(source, found, "give the cameras of this capture, in its own axes; or none")
    progress("looking for what no camera saw", 0.3)
    hidden = _boundary_of_hidden(pictures, low - cell, high + cell, cell)
    progress("carrying on walls", 0.7)
    further = beyond_pictures(
        soup, pictures.eyes, spacing, lambda points: pictures.states(points.astype(np.float32), 0.0)[1]
    )
    return joined(hidden, further)


def joined(one: Soup, other: Soup) -> Soup:
    """Both as one, nothing welded."""
    return Soup(
        np.concatenate([one.vertices, other.vertices]),
        np.concatenate([one.faces, other.faces + len(one.vertices)]),
    )


def _boundary_of_hidden(pictures: Pictures, low: F64, high: F64, cell: float) -> Soup:
    """Between what cameras looked through and what is hidden from all."""
    from scipy.ndimage import binary_opening, generate_binary_structure

    size = np.ceil((high - low) / cell).astype(int) + 1
    shape = (int(size[0]), int(size[1]), int(size[2]))
    place = np.indices(shape, dtype=np.float32).reshape(3, -1).T
    free, shown = pictures.states((place * np.float32(cell) + low.astype(np.float32)), BEHIND * cell)
    del place
    hidden = (shown & ~free).reshape(shape)
    hidden = binary_opening(hidden, generate_binary_structure(3, 1), THIN).ravel()
    nodes = np.flatnonzero(free | hidden)
    grid = Grid(low, cell, shape, nodes, np.where(free[nodes], 1.0, -1.0).astype(np.float32))
    return smoothed(without_crumbs(surface_of(grid), FEWEST_FACES), ROUNDS)

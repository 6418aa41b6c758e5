"""Triangles that stop light where a capture's cameras saw nothing, so that it does not pass through walls nobody saw.

Two things are made. What was seen is the front of something: a second sheet stands behind it, at most as thick as the
space that is hidden from all cameras (space carving: Kutulakos and Seitz, 2000). So light does not come through cracks
between faces, and bars and frames that were seen from the front alone cast shadows of something with a depth. Farther
behind it may be the open: a beam of the sun comes into a room through space that no camera looked into. Space in no
picture at all is left open, as the sky is such space; but large planes go on in it (`beyond`).
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from mirelight.errors import InputError
from mirelight.lighting.sight import Sight
from mirelight.model import F64, Camera
from mirelight.proxy.beyond import Look, beyond_pictures
from mirelight.proxy.pictures import Pictures
from mirelight.proxy.sampling import areas_of, face_normals_of, spread
from mirelight.proxy.tidy import compact, parts_of
from mirelight.proxy.types import Int, Progress, ProxySettings, Soup

DEEP = 3.0  # spacings of the splats: how far behind the surface its second sheet stands
CRUMB = 5.0  # squares of spacings: less of a second sheet is hidden by chance, as behind the bars of a lantern's cage
BEHIND = 0.25  # spacings behind the surface that still count as seen
LEAST_SEEN = 0.5  # of the surface, that a capture's cameras have seen
_SAMPLE = 20_000
_ALIKE = 511  # steps to a normal's component: vertices of faces that are nearer to parallel stay one


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
    progress("looking for what no camera saw", 0.0)
    sight = Sight(soup.mesh(), settings.variant, settings.threads)
    pictures = Pictures.of(soup, cameras, sight)
    some = spread(soup.vertices, soup.faces, _SAMPLE).astype(np.float32)
    seen = float(pictures.states(some, DEEP * spacing)[0].mean())
    if seen < LEAST_SEEN:
        found = f"its {len(cameras):,} cameras see {seen:.0%} of its surface"
        raise InputError(source, found, "give the cameras of this capture, in its own axes; or none")
    progress("looking for what no camera saw", 0.3)
    backs = _backs(soup, pictures, spacing)
    progress("carrying on walls", 0.7)

    def look(before: float) -> Look:
        return lambda points: pictures.states(points.astype(np.float32), -before)

    further = beyond_pictures(soup, pictures.eyes, spacing, look)
    return backs.beside(further)


def _backs(soup: Soup, pictures: Pictures, spacing: float) -> Soup:
    """The faces once more, moved back and turned over, where all their corners are hidden there from all cameras.

    Fronts look out of what both sheets enclose, so a ray that meets a back first started inside.
    """
    normal = face_normals_of(soup.vertices, soup.faces)
    step = np.round((normal + 1) * _ALIKE).astype(np.int64)
    way = (step[:, 0] << 20) | (step[:, 1] << 10) | step[:, 2]
    key = (soup.faces << 30) | way[:, None]  # a corner of faces of one plane is moved once
    _, first, corner = np.unique(key, return_index=True, return_inverse=True)
    at = soup.vertices[soup.faces.ravel()[first]] - DEEP * spacing * normal[first // 3]
    free, shown = pictures.states(at.astype(np.float32), BEHIND * spacing)
    faces = corner.reshape(-1, 3)
    hidden = np.flatnonzero((shown & ~free)[faces].all(axis=1))
    hidden = hidden[connected_area(soup, hidden) > CRUMB * spacing**2]
    return compact(Soup(at, faces[hidden][:, ::-1]))


def connected_area(soup: Soup, chosen: Int) -> F64:
    """(C,) area of what each of those faces is connected with among them."""
    faces = soup.faces[chosen]
    part = parts_of(faces)
    return np.asarray(np.bincount(part, areas_of(soup.vertices, faces))[part])

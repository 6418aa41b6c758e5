"""A second sheet behind what was seen, in few triangles: it stops light, and nobody looks at it.

Behind large planes it is made of rectangles: a plane is looked at in square cells, and those that lie behind its
surface and are hidden from all cameras become as few rectangles as rows of cells allow. Behind all else the faces
themselves are moved back, and their corners in one voxel become one.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from mirelight.lighting.sight import Sight
from mirelight.model import F64, triangles
from mirelight.proxy.pictures import Pictures
from mirelight.proxy.planes import Bool, Plane, Sheet
from mirelight.proxy.tidy import compact, parts_of
from mirelight.proxy.tuning import TUNING
from mirelight.proxy.types import Int, Soup
from mirelight.proxy.views import turned

_ALIKE = 511  # steps to a normal's component, as ten bits hold: vertices of faces that are nearer to parallel stay one
_CORNERS = np.array([[0, 0, 0], [0, 1, 1], [0, 1, 1]], bool)  # from a cell to its four corners


def backs_of(soup: Soup, planes: Sequence[Plane], sight: Sight, pictures: Pictures, spacing: float) -> Soup:
    """The surface once more, moved back and turned over, where it is hidden there from all cameras.

    Fronts look out of what both sheets enclose, so a ray that meets a back first started inside.

    Args:
        soup: the surface.
        planes: its planes, the largest first.
        sight: into the surface.
        pictures: what the cameras saw of it.
        spacing: of the capture's splats.
    """
    normal = triangles.normals(soup.vertices[soup.faces])
    rest, out = np.ones(len(soup.faces), bool), Soup(np.zeros((0, 3)), np.zeros((0, 3), np.int64))
    for level in _levels(soup, planes, normal, spacing):
        rest[level.faces] = False
        out = out.beside(_behind_plane(soup, level, planes, sight, pictures, spacing))
    return out.beside(_behind_things(soup, np.flatnonzero(rest), normal, pictures, spacing))


def _levels(soup: Soup, planes: Sequence[Plane], normal: F64, spacing: float) -> Iterator[Plane]:
    """Planes divided into what faces one side and is no thicker than `back_level` of `TUNING`: normals to that side."""
    area = triangles.areas(soup.vertices[soup.faces])
    for plane in planes:
        middle = soup.vertices[soup.faces[plane.faces]].mean(axis=1)
        at = turned(middle, plane.normal[None])[:, 0]
        step = np.floor((at - plane.offset) / (TUNING.back_level * spacing) + 0.5).astype(np.int64)
        side = np.where(turned(normal[plane.faces], plane.normal[None])[:, 0] < 0, -1, 1)
        for one in (1, -1):
            for k in np.unique(step):
                here = np.flatnonzero((step == k) & (side == one))
                faces = plane.faces[here]
                total = float(area[faces].sum())
                if total >= TUNING.back_least * spacing**2:
                    yield Plane(one * plane.normal, one * float((at[here] * area[faces]).sum()) / total, faces, total)


def _behind_plane(
    soup: Soup, plane: Plane, planes: Sequence[Plane], sight: Sight, pictures: Pictures, spacing: float
) -> Soup:
    """Rectangles; `plane` is one level."""
    from scipy.ndimage import binary_dilation, label

    corners = soup.vertices[soup.faces[plane.faces].ravel()]
    behind = replace(plane, offset=plane.offset - TUNING.back_deep * spacing)
    sheet = Sheet.of(behind, planes, corners.min(axis=0), corners.max(axis=0), TUNING.back_cell * spacing)
    own = np.zeros(len(soup.faces) + 1, bool)  # the last: no face
    own[plane.faces] = True
    face, far = sight.first_hits(sheet.middles(), np.broadcast_to(plane.normal, (sheet.inside.size, 3)))
    under = (own[face] & (far < (TUNING.back_deep + TUNING.back_level) * spacing)).reshape(sheet.inside.shape)
    asked = binary_dilation(np.pad(under, ((0, 1), (0, 1))), _CORNERS)
    hidden = np.zeros(asked.shape, bool)
    hidden[asked] = _hidden(sheet.lattice()[asked.ravel()], pictures, spacing)
    chosen = under & hidden[:-1, :-1] & hidden[1:, :-1] & hidden[:-1, 1:] & hidden[1:, 1:]
    part, _ = label(chosen)
    chosen &= (np.bincount(part.ravel()) * TUNING.back_cell**2 > TUNING.back_crumb)[part]
    made = sheet.rectangles(chosen)
    return Soup(made.vertices, made.faces[:, ::-1])


def _behind_things(soup: Soup, faces: Int, normal: F64, pictures: Pictures, spacing: float) -> Soup:
    """Faces moved back, fewer and larger."""
    step = np.round((normal[faces] + 1) * _ALIKE).astype(np.int64)
    way = (step[:, 0] << 20) | (step[:, 1] << 10) | step[:, 2]
    key = (soup.faces[faces] << 30) | way[:, None]  # a corner of faces of one plane is moved once
    _, first, corner = np.unique(key, return_index=True, return_inverse=True)
    at = soup.vertices[soup.faces[faces].ravel()[first]] - TUNING.back_deep * spacing * normal[faces[first // 3]]
    hidden = _hidden(at, pictures, spacing)[corner.reshape(-1, 3)].all(axis=1)
    chosen = np.flatnonzero(hidden)
    chosen = chosen[connected_area(soup, faces[chosen]) > TUNING.back_crumb * spacing**2]
    return _coarse(compact(Soup(at, corner.reshape(-1, 3)[chosen][:, ::-1])), TUNING.back_voxel * spacing)


def _coarse(soup: Soup, voxel: float) -> Soup:
    """Corners in a voxel become one, in their middle; of the same faces one stays."""
    if not len(soup.faces):
        return soup
    i = np.floor((soup.vertices - soup.vertices.min(axis=0)) / voxel).astype(np.int64)
    _, index = np.unique((i[:, 0] << 42) | (i[:, 1] << 21) | i[:, 2], return_inverse=True)
    count = np.bincount(index)
    vertices = np.stack([np.bincount(index, soup.vertices[:, k]) for k in range(3)], axis=1) / count[:, None]
    merged = compact(Soup(vertices, index[soup.faces]))
    _, once = np.unique(np.sort(merged.faces, axis=1), axis=0, return_index=True)
    return compact(Soup(merged.vertices, merged.faces[np.sort(once)]))


def _hidden(at: F64, pictures: Pictures, spacing: float) -> Bool:
    free, shown = pictures.states(at.astype(np.float32), TUNING.back_behind * spacing)
    return np.asarray(shown & ~free)


def connected_area(soup: Soup, chosen: Int) -> F64:
    """(C,) area of what each of those faces is connected with among them."""
    faces = soup.faces[chosen]
    part = parts_of(faces)
    return np.asarray(np.bincount(part, triangles.areas(soup.vertices[faces]))[part])

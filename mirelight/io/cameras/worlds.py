"""The worlds that trainers move a capture to before they train, and leave their splats in.

Each turns, moves and scales what it is given, by rules of its own. nerfstudio's data parsers: the mean of the cameras'
up becomes +Z, the mean of their places the origin, and the farthest coordinate of a place 1 (its camera_utils.py,
`auto_orient_and_center_poses` with methods "up" and "poses"; nerfstudio_dataparser.py, colmap_dataparser.py). gsplat's
examples: what the cameras look at becomes the origin, their median distance from there 1, and then the principal axes
of the model's points the axes, more of the points below (its examples, datasets/normalize.py and datasets/colmap.py).
"""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from mirelight.base import conventions
from mirelight.base.conventions import Matrix
from mirelight.base.errors import InputError
from mirelight.io.cameras import reading
from mirelight.io.gltf.fields import Fields
from mirelight.model import F64

if TYPE_CHECKING:
    from collections.abc import Sequence

    from mirelight.io.cameras.placed import FileCamera

COLMAP_TO_NERFSTUDIO = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])  # -Y, which is up, to +Z
_POINTS = 2_000  # of a model that are compared with splats
_CENTRES = 200_000  # of splats that they are compared with
# Eigenvectors have no sign: of the turns that keep axes axes, gsplat's is the one by which points meet splats.
_TURNS = tuple(np.diag([*signs, 1.0]) for signs in ((1.0, 1.0, 1.0), (-1.0, -1.0, 1.0), (1.0, -1.0, -1.0), (-1, 1, -1)))


def of_nerfstudio(cameras: Sequence[FileCamera], read: Matrix) -> Matrix:
    """The matrix (4, 4) from a capture to the world that nerfstudio trains in by default.

    Args:
        cameras: all of the capture.
        read: (4, 4) from the capture to the axes that nerfstudio reads it in.
    """
    poses = read @ np.stack([x.world_from_camera for x in cameras])
    turn = conventions.turn_onto(_up(poses), (0, 0, 1))
    middle = poses[:, :3, 3].mean(axis=0)
    scale = 1 / max(float(np.abs((poses[:, :3, 3] - middle) @ turn.T).max()), 1e-12)
    return np.asarray(_similarity(scale * turn, -scale * turn @ middle) @ read)


def said_by_nerfstudio(path: Path) -> Matrix:
    """The same of a training's own dataparser_transforms.json. Raises InputError."""
    data = reading.load_json(path)
    if not isinstance(data, dict):
        raise InputError(path, "the JSON is not an object")
    fields = Fields(path, "", data)
    matrix = reading.rows(fields, "transform")
    reading.rigid(matrix, partial(fields.fail, "transform"))
    scale = fields.number("scale", 1.0)
    if not 1e-9 < scale < 1e9:
        raise fields.fail("scale", f"{scale:g}", "it must be positive")
    return np.asarray(np.diag([scale, scale, scale, 1.0]) @ matrix)


def of_gsplat(cameras: Sequence[FileCamera], points: F64, centres: F64) -> Matrix:
    """The matrix (4, 4) from a COLMAP model to the world that gsplat's examples train in by default.

    Args:
        cameras: all of the model.
        points: (M, 3) its points.
        centres: (N, 3) of the splats, which tell the signs that the points' axes have.
    """
    poses = np.stack([x.world_from_camera for x in cameras])
    turn = conventions.turn_onto(_up(poses), (0, -1, 0))
    places, ahead = poses[:, :3, 3] @ turn.T, -poses[:, :3, 2] @ turn.T
    nearest = places - np.einsum("ni,ni->n", places, ahead)[:, None] * ahead  # to the origin, of what each looks at
    middle = np.median(nearest, axis=0)
    scale = 1 / max(float(np.median(np.linalg.norm(places - middle, axis=1))), 1e-12)
    looking = _similarity(scale * turn, -scale * middle)
    there = points @ looking[:3, :3].T + looking[:3, 3]
    centre = np.median(there, axis=0)
    axes = np.linalg.eigh(np.cov(there - centre, rowvar=False))[1][:, ::-1].T
    if np.linalg.det(axes) < 0:
        axes[0] *= -1
    lying = _similarity(axes, -axes @ centre) @ looking
    turned = [np.asarray(x @ lying) for x in _TURNS]
    return turned[int(np.argmin(apart(points, turned, centres)))]


def apart(points: F64, matrices: Sequence[Matrix], centres: F64) -> list[float]:
    """How far points lie from splats, placed by each matrix: the median, as a share of how far the points spread.

    Args:
        points: (M, 3) that pictures showed.
        matrices: (4, 4) each.
        centres: (N, 3) of the splats.
    """
    from scipy.spatial import cKDTree

    some, tree = points[:: -(-len(points) // _POINTS)], cKDTree(centres[:: -(-len(centres) // _CENTRES)])
    out = []
    for m in matrices:
        there = some @ m[:3, :3].T + m[:3, 3]
        spread = float(np.median(np.linalg.norm(there - np.median(there, axis=0), axis=1)))
        out.append(float(np.median(tree.query(there)[0])) / max(spread, 1e-12))
    return out


def _up(poses: F64) -> F64:
    """(3,) the mean of the cameras' ups, of poses (N, 4, 4); that of the first where it is nothing."""
    mean = poses[:, :3, 1].mean(axis=0)
    return np.asarray(mean if np.linalg.norm(mean) > 1e-9 else poses[0, :3, 1])


def _similarity(linear: F64, moved: F64) -> Matrix:
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = linear, moved
    return out

"""Tables of transforms and orientations as matrices and angles in mirelight's conventions."""

from __future__ import annotations

import numpy as np

from mirelight.base import conventions
from mirelight.base.conventions import Matrix
from mirelight.io.job.scene_tables import Transform


def matrix(transform: Transform) -> Matrix:
    """The transform as a matrix (4, 4)."""
    if transform.matrix is not None:
        return np.asarray(transform.matrix, dtype=np.float64)
    rotation = np.eye(3)
    if transform.rotation_euler is not None:
        rotation = conventions.rotation_from_euler(transform.rotation_euler)
    elif transform.rotation_quaternion is not None:
        rotation = conventions.rotation_from_quaternion(transform.rotation_quaternion)
    return conventions.compose(transform.translation or (0, 0, 0), rotation, transform.scale or 1.0)


def is_identity(m: Matrix) -> bool:
    """True where the matrix changes nothing."""
    return bool(np.array_equal(m, np.eye(4)))


def environment_rotation(rotation: float, orientation: str) -> float:
    """An environment's rotation in mirelight's (Blender's) convention, in degrees.

    PlayCanvas looks along (-sin phi, 0, cos phi) at phi = (u - 0.5) 360° + rotation, Blender along
    (cos phi, 0, sin phi) at phi = (u - 0.5) 360° - rotation: the same direction where ours is -90° - theirs.
    """
    if orientation != "playcanvas":
        return rotation
    turned = (-90.0 - rotation) % 360.0
    return turned - 360.0 if turned > 180.0 else turned

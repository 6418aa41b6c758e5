"""Tables of transforms and orientations as matrices and angles in mirelight's conventions."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mirelight.base import conventions
from mirelight.base.conventions import Matrix
from mirelight.io.job.scene_tables import Transform
from mirelight.model import AreaLight, DirectionalLight, Light, PointLight, SpotLight, SunLight


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


def placed_light(light: Light, m: Matrix) -> Light:
    """The light carried through a matrix: place and direction move; range, radius and intensity stay, as in KHR."""
    match light:
        case DirectionalLight() | SunLight():
            return replace(light, direction=m[:3, :3] @ light.direction)
        case PointLight():
            return replace(light, position=_moved(m, light.position))
        case SpotLight():
            return replace(light, position=_moved(m, light.position), direction=m[:3, :3] @ light.direction)
        case AreaLight():
            return replace(light, world_from_light=conventions.rigid_part(m @ light.world_from_light))


def _moved(m: Matrix, point: Matrix) -> Matrix:
    return np.asarray(m[:3, :3] @ point + m[:3, 3])


def environment_rotation(rotation: float, orientation: str) -> float:
    """An environment's rotation in mirelight's (Blender's) convention, in degrees.

    PlayCanvas looks along (-sin phi, 0, cos phi) at phi = (u - 0.5) 360° + rotation, Blender along
    (cos phi, 0, sin phi) at phi = (u - 0.5) 360° - rotation: the same direction where ours is -90° - theirs.
    """
    if orientation != "playcanvas":
        return rotation
    turned = (-90.0 - rotation) % 360.0
    return turned - 360.0 if turned > 180.0 else turned

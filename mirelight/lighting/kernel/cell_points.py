"""The points of a surface's cells, on the device, as a view whose pixels are the cells."""

from __future__ import annotations

from typing import Protocol

import drjit as dr
import mitsuba as mi
import numpy as np

from mirelight.lighting.kernel.memory import floats, in_fours, integers, rgb
from mirelight.lighting.kernel.mirrors import FirstHit
from mirelight.lighting.kernel.proxy import DeviceProxy
from mirelight.lighting.kernel.samples import Tiles, mix
from mirelight.lighting.kernel.types import Float, Point3f, UInt32
from mirelight.model import F32, I32


class Pieces(Protocol):
    """Pieces of a surface, N of them, with P points each."""

    @property
    def faces(self) -> I32:
        """Of each of N cells the faces of its P points (N, P)."""

    @property
    def corners(self) -> F32:
        """(N, P, 2) barycentric coordinates"""

    @property
    def normals(self) -> F32:
        """(N, P, 3) of those faces, on the side that counts"""


class CellPoints:
    """Stands in for a camera: pixel k is cell k, its samples go round the cell's points."""

    def __init__(self, cells: Pieces) -> None:
        self.points = dr.opaque(mi.UInt32, cells.faces.shape[1])
        self.faces = integers(np.append(cells.faces.ravel(), np.zeros(2, np.int32)))
        self.corners = floats(np.append(cells.corners.ravel(), np.zeros(4, np.float32)))
        self.normals = in_fours(cells.normals)

    def sequence(self, pixel: UInt32, sample: UInt32, tiles: Tiles, seed: UInt32) -> tuple[UInt32, UInt32]:
        """(index, stream) of a sample: each piece has a sequence of its own."""
        return sample, mix(pixel, seed)

    def first_hit(self, surface: DeviceProxy, pixel: UInt32, sample: UInt32, stream: UInt32) -> FirstHit:
        """A point of the cell."""
        point = pixel * self.points + (sample + mix(stream, 11)) % self.points
        face = dr.gather(mi.UInt32, self.faces, point)
        corners, way = dr.gather(mi.Point2f, self.corners, point), -rgb(self.normals, point, True)
        return FirstHit(mi.Bool(face == face), face, corners, way)

    def depth(self, p: Point3f, far: None) -> Float:
        """Zero: points on the surface have no depth."""
        return mi.Float(p.x * 0)

"""Objects at random places on the ground, where they fit. NumPy only.

A place fits where the ground carries the whole of the foot, nothing of the proxy and no other object is in the way, and
the object's top is seen from the middle of where places are tried: what is inside a wall or behind a house is not.
"""

from __future__ import annotations

import math
import random
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from mirelight.base import conventions
from mirelight.base.errors import InputError
from mirelight.lighting.ground import Ground, box_round, dropped, slope
from mirelight.model import F64, Inserted, ProxyMesh, shown

_TRIES = 200
# of an object's size, that ground under its foot may rise and fall, and reach into it: where no place is as level as a
# floor, as on a blanket or grass, twice as much, and then twice again
_UNEVEN = (0.05, 0.1, 0.2)
_GRID = np.array([[x, -0.5, z, 1] for x in (-0.45, 0, 0.45) for z in (-0.45, 0, 0.45)])  # of the foot, in its box
_SIDES = np.array(
    [
        [0, 1, 3],
        [0, 3, 2],
        [4, 7, 5],
        [4, 6, 7],
        [0, 5, 1],
        [0, 4, 5],
        [2, 3, 7],
        [2, 7, 6],
        [0, 2, 6],
        [0, 6, 4],
        [1, 5, 7],
        [1, 7, 3],
    ]
)


@dataclass(frozen=True, slots=True, eq=False)
class _Spot:
    """A place whose ground carries the whole foot of an object."""

    mesh: ProxyMesh  # over it
    yaw: F64  # (3, 3) its turn
    rises: float  # by how much the ground rises and falls under the foot, world units


def scattered(one: Inserted, place: int, ground: Ground, taken: Sequence[F64]) -> tuple[ProxyMesh, F64]:
    """The mesh where it fits, and its turn (3, 3). The places that are tried depend on the seed and `place` alone.

    Args:
        one: with its `scatter`.
        place: in the job's list of objects.
        ground: the proxy.
        taken: boxes (4, 4) of the objects that are there already.

    Raises:
        InputError: it fits nowhere.
    """
    where, mesh = one.scatter, one.mesh.value
    assert where is not None
    size = float(np.linalg.norm(mesh.bounds[1] - mesh.bounds[0]))
    reach = where.center[[0, 2]] - where.radius - size, where.center[[0, 2]] + where.radius + size
    near, spots = ground.within(*reach), list[_Spot]()
    for attempt in range(_TRIES):
        spot = _spot(one, f"{where.seed} {place} {attempt}", near)
        if spot is not None:
            spots.append(spot)
            if (found := _set_down(one, spot, near, taken, _UNEVEN[0])) is not None:
                return found
    for uneven, spot in product(_UNEVEN[1:], spots):
        if (found := _set_down(one, spot, near, taken, uneven)) is not None:
            return found
    remedy = "give scatter a larger radius or another centre, or make the object smaller"
    found_none = f"{one.name!r} fits nowhere within {where.radius:g} of {shown.point(where.center)}"
    raise InputError(one.source, f"{found_none} ({_TRIES} places tried)", remedy)


def _spot(one: Inserted, drawn: str, ground: Ground) -> _Spot | None:
    """A place that is drawn by a text; None where it has no ground."""
    where, mesh = one.scatter, one.mesh.value
    assert where is not None
    stream = random.Random(drawn)  # a stream that Python promises to keep
    away, around, turn = where.radius * math.sqrt(stream.random()), stream.random(), stream.random()
    yaw = conventions.rotation_from_euler((0, 360 * turn if where.turn else 0, 0))
    at = where.center + away * np.array([math.sin(2 * math.pi * around), 0, math.cos(2 * math.pi * around)])
    middle = (mesh.bounds[0] + mesh.bounds[1]).astype(np.float64) / 2
    middle[1] = mesh.bounds[0][1]
    there = mesh.turned(yaw, (mesh.vertices - middle) @ yaw.T + at)
    foot = (_GRID @ box_round(yaw, there).T)[:, :3]
    heights = ground.heights(foot, reach=float(there.bounds[1][1]))
    if not np.isfinite(heights).all():
        return None
    level = slope(foot, heights) if one.drop == "tilt" else np.zeros(3)
    return _Spot(there, yaw, float(np.ptp(heights - foot[:, [0, 2]] @ level[[0, 2]])))


def _set_down(
    one: Inserted, spot: _Spot, ground: Ground, taken: Sequence[F64], uneven: float
) -> tuple[ProxyMesh, F64] | None:
    """The mesh set down with its turn; None where it does not fit on ground that is so uneven, a share of its size."""
    assert one.scatter is not None
    size = np.linalg.norm(box_round(spot.yaw, spot.mesh)[:3, :3], axis=0)
    allowed = uneven * float(size.max())
    if spot.rises > allowed:
        return None
    mesh, tilt = dropped(one, spot.mesh, ground)
    turn = tilt @ spot.yaw
    box = box_round(turn, mesh)
    clear = _raised(box, min(allowed / max(float(size[1]), 1e-9), 0.5))
    flat = conventions.box_corners(clear)[:, [0, 2]]
    if _touches(clear, ground.within(flat.min(axis=0), flat.max(axis=0)).corners):
        return None
    if any(_touches(box, _sides(other)) or _touches(other, _sides(box)) for other in taken):
        return None
    eye = one.scatter.center + np.array([0, size[1], 0])
    top_middle = (box @ np.array([0, 0.5, 0, 1]))[:3]
    return None if _hidden(eye, top_middle, ground) else (mesh, turn)


def _raised(box: F64, share: float) -> F64:
    """A box without the lowest share of its height."""
    out = box.copy()
    out[:3, 1] *= 1 - share
    out[:3, 3] += box[:3, 1] * share / 2
    return out


def _sides(box: F64) -> F64:
    """(12, 3, 3) corners of the triangles of a box."""
    return np.asarray(conventions.box_corners(box)[_SIDES])


def _touches(box: F64, corners: F64) -> bool:
    """Whether a triangle (F, 3, 3) reaches into a box (4, 4): no axis parts them (Akenine-Möller 2001)."""
    size = np.linalg.norm(box[:3, :3], axis=0)
    padded = box[:3, :3] + np.where(size > 0, 0, 1e-9) * np.eye(3)
    own = (corners - box[:3, 3]) @ np.linalg.inv(padded).T
    own = own[(own.max(axis=1) > -0.5).all(axis=1) & (own.min(axis=1) < 0.5).all(axis=1)]
    edges = np.roll(own, -1, axis=1) - own
    axes = np.concatenate(
        [np.cross(edges[:, :, None], np.eye(3)).reshape(-1, 9, 3), np.cross(edges[:, :1], edges[:, 1:2])], axis=1
    )
    along = np.einsum("fak,fck->fac", axes, own)
    reach = 0.5 * np.abs(axes).sum(axis=-1)
    parted: NDArray[np.bool_] = (along.min(axis=-1) > reach) | (along.max(axis=-1) < -reach)
    return bool((~parted.any(axis=1)).any())


def _hidden(eye: F64, to: F64, ground: Ground) -> bool:
    """Whether something of the ground lies between two points (Möller and Trumbore 1997)."""
    corners, way = ground.corners, to - eye
    e1, e2, off = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0], eye - corners[:, 0]
    p, q = np.cross(way, e2), np.cross(off, e1)
    with np.errstate(divide="ignore", invalid="ignore"):
        inverse = 1 / np.einsum("fk,fk->f", e1, p)
        u, v = np.einsum("fk,fk->f", off, p) * inverse, (q @ way) * inverse
        t = np.einsum("fk,fk->f", e2, q) * inverse
        return bool(((u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0) & (t < 1)).any())

"""Axes, matrices and angles, written once.

World: right-handed, Y up. Camera: looks along its -Z, +X right, +Y up (glTF 2.0 §3.10). Matrices are row-major (4, 4)
float64 acting on column vectors. Image row 0 is the top; pixel centres lie at +0.5. Quaternions are wxyz. A light's
direction is the direction in which it shines: its node's -Z (KHR_lights_punctual). Euler angles are in degrees, applied
X, then Y, then Z about the fixed axes (matrix Rz Ry Rx), as PlayCanvas and three.js' order "ZYX" do.
Image-based light: an equirectangular map's row 0 is +Y; at rotation 0 the column centre u = 0.5 looks along +X and
u = 0.75 along +Z (Blender's world texture seen in glTF axes); `rotation` turns the light about +Y, counter-clockwise
seen from above, in degrees.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Matrix = NDArray[np.float64]

_PARALLEL = 1e-6  # sine of an angle between two directions that are one
_UNIT = 5e-16  # so near to 1 is the length of a vector that was scaled to 1


def unit(vector: ArrayLike) -> Matrix:
    """The vector scaled to length 1; (..., 3) float64; one that has it stays, bit for bit. A zero vector raises
    ValueError."""
    v = np.asarray(vector, dtype=np.float64)
    length = np.linalg.norm(v, axis=-1, keepdims=True)
    if not np.all(length > 0) or not np.all(np.isfinite(length)):
        raise ValueError("a direction of length zero")
    return np.asarray(v / np.where(np.abs(length - 1) < _UNIT, 1.0, length))


def look_at(position: ArrayLike, target: ArrayLike, up: ArrayLike = (0.0, 1.0, 0.0)) -> Matrix:
    """world_from_camera (4, 4) of a camera at `position` looking at `target`; takes another up where it is parallel."""
    eye = np.asarray(position, dtype=np.float64)
    back = unit(eye - np.asarray(target, dtype=np.float64))
    upward = unit(up)
    if np.linalg.norm(np.cross(upward, back)) < 1e-6:
        upward = np.array([0.0, 0.0, -1.0]) if abs(back[2]) < 0.9 else np.array([1.0, 0.0, 0.0])
    right = unit(np.cross(upward, back))
    out = np.eye(4)
    out[:3, 0], out[:3, 1], out[:3, 2], out[:3, 3] = right, np.cross(back, right), back, eye
    return out


def map_direction(u: ArrayLike, v: ArrayLike) -> Matrix:
    """(..., 3) unit directions that places of an equirectangular map look in, in its own axes; `u` from its left edge
    and `v` from its top, 0 to 1, broadcasting."""
    phi, theta = 2 * np.pi * (np.asarray(u) - 0.5), np.pi * np.asarray(v)
    across = np.sin(theta)
    return np.stack(np.broadcast_arrays(np.cos(phi) * across, np.cos(theta), np.sin(phi) * across), axis=-1)


def map_pixels(rows: int) -> Matrix:
    """(rows, 2 rows, 3) unit directions that the pixel centres of an equirectangular map look in, in its own axes."""
    u, v = (np.arange(2 * rows) + 0.5) / (2 * rows), (np.arange(rows) + 0.5) / rows
    return map_direction(u, v[:, None])


def rotation_from_quaternion(wxyz: ArrayLike) -> Matrix:
    """Rotation matrices (..., 3, 3) of quaternions (..., 4) wxyz, normalised first."""
    q = np.asarray(wxyz, dtype=np.float64)
    w, x, y, z = np.moveaxis(q / np.linalg.norm(q, axis=-1, keepdims=True), -1, 0)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def quaternion_from_rotation(rotation: ArrayLike) -> Matrix:
    """Quaternion (4,) wxyz, w >= 0, of one rotation matrix (3, 3) (Shepperd's method)."""
    r = np.asarray(rotation, dtype=np.float64)
    four = np.array([np.trace(r), r[0, 0], r[1, 1], r[2, 2]])
    k = int(np.argmax(four))
    if k == 0:
        q = np.array([1 + four[0], r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]])
    else:
        i, j, m = k - 1, k % 3, (k + 1) % 3
        q = np.empty(4)
        q[0] = r[m, j] - r[j, m]
        q[1 + i] = 1 + r[i, i] - r[j, j] - r[m, m]
        q[1 + j] = r[j, i] + r[i, j]
        q[1 + m] = r[m, i] + r[i, m]
    q = q / (np.linalg.norm(q) if q[0] >= 0 else -np.linalg.norm(q))
    return np.asarray(q, dtype=np.float64)


def multiply_quaternions(a: ArrayLike, b: ArrayLike) -> Matrix:
    """Hamilton product a b (rotation b first), (..., 4) wxyz, broadcasting."""
    aw, ax, ay, az = np.moveaxis(np.asarray(a, dtype=np.float64), -1, 0)
    bw, bx, by, bz = np.moveaxis(np.asarray(b, dtype=np.float64), -1, 0)
    return np.stack(
        [
            aw * bw - ax * bx - ay * by - az * bz,
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
        ],
        axis=-1,
    )


def slerp(a: ArrayLike, b: ArrayLike, t: float) -> Matrix:
    """Spherical interpolation of quaternions (4,) along the shorter arc (glTF appendix C.4); it goes on past both."""
    p, q = np.asarray(a, dtype=np.float64), np.asarray(b, dtype=np.float64)
    p, q = p / np.linalg.norm(p), q / np.linalg.norm(q)
    dot = float(p @ q)
    angle = np.arccos(min(abs(dot), 1.0))
    if angle < 1e-6:
        return p
    q = q if dot >= 0 else -q
    return np.asarray((np.sin((1 - t) * angle) * p + np.sin(t * angle) * q) / np.sin(angle))


def pose_at(poses: ArrayLike, at: float) -> Matrix:
    """The rigid pose (4, 4) at a place between those of a sequence (n, 4, 4), at least two, counted from 0: straight on
    and turning evenly from one to the next, and on in the same way before the first and after the last."""
    every = np.asarray(poses, dtype=np.float64)
    k = int(np.clip(np.floor(at), 0, len(every) - 2))
    t = at - k
    if t in (0.0, 1.0):
        return np.array(every[k + int(t)])
    first, second = (quaternion_from_rotation(x[:3, :3]) for x in every[k : k + 2])
    turn = rotation_from_quaternion(slerp(first, second, t))
    return compose((1 - t) * every[k, :3, 3] + t * every[k + 1, :3, 3], turn)


def turn_onto(one: ArrayLike, other: ArrayLike) -> Matrix:
    """(3, 3) the shortest rotation of a direction (3,) onto another, of any lengths (Rodrigues' formula); of opposite
    ones half a turn about an axis across them."""
    one, other = unit(one), unit(other)
    axis, cosine = np.cross(one, other), float(one @ other)
    if np.linalg.norm(axis) < _PARALLEL:
        if cosine > 0:
            return np.eye(3)
        about = unit(np.cross(one, (1.0, 0, 0) if abs(one[0]) < _PARALLEL else (0, 1.0, 0)))
        return np.asarray(2 * np.outer(about, about) - np.eye(3))
    skew = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    return np.asarray(np.eye(3) + skew + skew @ skew / (1 + cosine))


def rotation_from_euler(degrees: ArrayLike) -> Matrix:
    """Rotation (3, 3) Rz Ry Rx from Euler angles (x, y, z) in degrees."""
    x, y, z = np.radians(np.asarray(degrees, dtype=np.float64))
    cx, sx, cy, sy, cz, sz = np.cos(x), np.sin(x), np.cos(y), np.sin(y), np.cos(z), np.sin(z)
    rx = np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]])
    ry = np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
    rz = np.array([[cz, -sz, 0], [sz, cz, 0], [0, 0, 1]])
    return np.asarray(rz @ ry @ rx)


def compose(translation: ArrayLike = (0, 0, 0), rotation: ArrayLike | None = None, scale: ArrayLike = 1.0) -> Matrix:
    """Matrix (4, 4) that scales, then rotates ((3, 3)), then translates."""
    out = np.eye(4)
    r = np.eye(3) if rotation is None else np.asarray(rotation, dtype=np.float64)
    out[:3, :3] = r * np.broadcast_to(np.asarray(scale, dtype=np.float64), (3,))
    out[:3, 3] = np.asarray(translation, dtype=np.float64)
    return out


def rigid_part(matrix: ArrayLike) -> Matrix:
    """The matrix (4, 4) with scale taken out: translation kept, rotation from its -Z and +Y axes.

    Raises:
        ValueError: the axes are degenerate (a node scaled to zero).
    """
    m = np.asarray(matrix, dtype=np.float64)
    back = unit(m[:3, 2])
    right = unit(np.cross(m[:3, 1], back))
    out = np.eye(4)
    out[:3, 0], out[:3, 1], out[:3, 2], out[:3, 3] = right, np.cross(back, right), back, m[:3, 3]
    return out


def frame_around(way: Matrix) -> Matrix:
    """(..., 3, 3) rows: two directions across unit ones (..., 3), and these (Duff et al. 2017)."""
    x, y, z = np.moveaxis(way, -1, 0)
    sign = np.where(z >= 0, 1.0, -1.0)
    a = -1 / (sign + z)
    b = x * y * a
    first = np.stack([1 + sign * x * x * a, sign * b, -sign * x], axis=-1)
    second = np.stack([b, sign + y * y * a, -y], axis=-1)
    return np.stack([first, second, way], axis=-2)


def box_corners(box: Matrix) -> Matrix:
    """Corners (8, 3) of a box (4, 4): world from the cube of side 1 about 0."""
    half = (-0.5, 0.5)
    cube = np.array([[x, y, z, 1] for x in half for y in half for z in half])
    return np.asarray((cube @ box.T)[:, :3])

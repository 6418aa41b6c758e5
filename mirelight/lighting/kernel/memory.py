"""NumPy arrays as device arrays.

On a CPU Dr.Jit takes a NumPy array's memory as it lies, and compiles packet gathers only where that memory is aligned:
left to chance, the same frame would compile to several kernels.
"""

from __future__ import annotations

from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
from numpy.typing import ArrayLike, NDArray

from mirelight.lighting.kernel.types import Bool, Float, UInt32, Vector3f
from mirelight.model import F32

ALIGNMENT = 64  # bytes, a cache line and the widest vector


def floats(array: ArrayLike) -> Float:
    """A flat Float array of a copy of the values."""
    return mi.Float(_aligned(np.asarray(array, np.float32)))


def integers(array: ArrayLike) -> UInt32:
    """A flat UInt32 array of a copy of the values."""
    return mi.UInt32(_aligned(np.asarray(array, np.uint32)))


def rgb(buffer: Float, index: UInt32, active: Bool) -> Vector3f:
    """What `in_fours` packed, of one row each."""
    q = dr.gather(mi.Vector4f, buffer, index, active)
    return mi.Vector3f(q.x, q.y, q.z)


def in_fours(rows: F32) -> Float:
    """(..., 3) as a flat buffer of groups of four, two more than there are."""
    flat = rows.reshape(-1, 3)
    padded = np.zeros((len(flat) + 2, 4), np.float32)
    padded[: len(flat), :3] = flat
    return floats(padded)


def _aligned(array: NDArray[Any]) -> NDArray[Any]:
    room = np.empty(array.nbytes + ALIGNMENT, np.uint8)
    start = -room.ctypes.data % ALIGNMENT
    out = room[start : start + array.nbytes].view(array.dtype)
    out[:] = array.ravel()
    return out

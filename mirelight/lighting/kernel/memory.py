"""NumPy arrays as device arrays.

On a CPU Dr.Jit takes a NumPy array's memory as it lies, and compiles packet gathers only where that memory is aligned:
left to chance, the same frame would compile to several kernels.
"""

from __future__ import annotations

from typing import Any

import mitsuba as mi
import numpy as np
from numpy.typing import ArrayLike, NDArray

from mirelight.lighting.kernel.types import Float, UInt32

ALIGNMENT = 64  # bytes, a cache line and the widest vector


def floats(array: ArrayLike) -> Float:
    """A flat Float array of a copy of the values."""
    return mi.Float(_aligned(np.asarray(array, np.float32)))


def integers(array: ArrayLike) -> UInt32:
    """A flat UInt32 array of a copy of the values."""
    return mi.UInt32(_aligned(np.asarray(array, np.uint32)))


def _aligned(array: NDArray[Any]) -> NDArray[Any]:
    room = np.empty(array.nbytes + ALIGNMENT, np.uint8)
    start = -room.ctypes.data % ALIGNMENT
    out = room[start : start + array.nbytes].view(array.dtype)
    out[:] = array.ravel()
    return out

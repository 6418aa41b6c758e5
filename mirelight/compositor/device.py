"""The Dr.Jit back end of one variant: its array types, and the sizes that suit its vector width."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from types import ModuleType
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from mirelight.base import backend
from mirelight.base.machine import collector_held
from mirelight.model import Variant

Array: TypeAlias = Any  # a Dr.Jit array; its types exist only once a variant is loaded


@dataclass(frozen=True, slots=True)
class Device:
    """One loaded variant; two of the same settings are equal."""

    dr: ModuleType  # drjit
    types: ModuleType  # drjit.llvm or drjit.cuda
    variant: Variant
    tile_width: int  # px; one lane blends a whole tile, so its pixels share registers with its neighbours'
    tile_height: int  # px
    persistent_lanes: int  # lanes that take tiles from the queue
    digit: int  # bits that one counting sort keeps the order of equal values for

    def frozen(self, trace: Callable[..., Array]) -> Callable[..., Array]:
        """A function of arrays that is traced once and replayed from then on, whatever their sizes.

        Tracing the blend in Python costs as much as blending a small frame. What `trace` uses besides its arguments is
        compiled in. Each of its kernels has to read one array of its own size directly: Dr.Jit takes the launch's size
        from it.
        """
        replayed = self.dr.freeze(lambda *arrays: trace(*arrays), auto_opaque=False, limit=16, warn_after=1 << 30)

        def run(*arrays: Array) -> Array:
            with collector_held():  # freeing a Mitsuba scene inside a recording ends the process
                return replayed(*arrays)

        return run

    def later(self) -> None:
        """What is traced from here on stands behind all before it in the kernel."""
        jit = self.dr.JitBackend
        self.dr.detail.new_scope(jit.CUDA if self.variant == "cuda_ad_rgb" else jit.LLVM)

    def constant(self, value: float) -> Array:
        """A float that kernels load instead of having it compiled in."""
        return self.dr.opaque(self.types.Float, float(value))

    def count(self, value: int) -> Array:
        """An unsigned integer that kernels load instead of having it compiled in."""
        return self.dr.opaque(self.types.UInt32, int(value))

    def floats(self, values: ArrayLike) -> Array:
        """Values in Dr.Jit's own memory, flat.

        Dr.Jit would only view a NumPy array; where that is unaligned, packet gathers from it silently become scalar
        ones, and kernels are compiled anew.
        """
        flat = np.asarray(values, dtype=np.float32).reshape(-1)
        if self.variant == "cuda_ad_rgb":
            return self.types.Float(np.ascontiguousarray(flat))
        owned = self.dr.empty(self.types.Float, len(flat))
        owned.numpy()[:] = flat  # a view of the same memory
        return owned


@cache
def _vector_width() -> int:
    """Lanes of Dr.Jit's vectors, which it does not tell: from the same flags of the processor, 16, 8 or 4."""
    from pathlib import Path

    try:
        flags = Path("/proc/cpuinfo").read_text()
    except OSError:
        return 4
    return 16 if "avx512vl" in flags else 8 if "avx" in flags else 4


def open_device(variant: Variant, threads: int | None) -> Device:
    """Load `variant`; `threads` is the number of worker threads of LLVM kernels (None: every core).

    Raises:
        BackendError: no sound libLLVM, or no CUDA where it was asked for.
    """
    dr, types = backend.drjit(variant, threads)
    if variant == "cuda_ad_rgb":
        # With more than 2^8 buckets Dr.Jit's counting sort leaves shared memory, and its threads race for places.
        return Device(dr, types, variant, 4, 4, 1 << 16, 8)
    return Device(dr, types, variant, 4, 8, _vector_width() * max(1, dr.thread_count()), 32)

"""What a camera sees of a mesh: the nearest face and its distance, without any light."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from mirelight.base import backend
from mirelight.model import F64, I32, ProxyMesh, Variant

if TYPE_CHECKING:
    from mirelight.lighting.kernel.proxy import DeviceProxy

Bool = NDArray[np.bool_]


class Sight:
    """A mesh made ready for rays.

    Args:
        mesh: what is looked at.
        variant: where rays are traced.
        threads: worker threads, process-wide; None: as they are.

    Raises:
        BackendError: the variant cannot be used on this machine.
    """

    def __init__(self, mesh: ProxyMesh, variant: Variant = "llvm_ad_rgb", threads: int | None = None) -> None:
        backend.mitsuba(variant, threads)
        self._surface: DeviceProxy | None = None
        if len(mesh.faces):
            from mirelight.lighting.kernel.proxy import DeviceProxy

            self._surface = DeviceProxy(mesh)

    @classmethod
    def over(cls, surface: DeviceProxy) -> Sight:
        """Into a mesh that is on the device already: large ones take seconds to be made ready."""
        out = cls.__new__(cls)
        out._surface = surface
        return out

    def first_hits(self, origins: F64, directions: F64) -> tuple[I32, F64]:
        """The nearest point of the mesh along each ray.

        Args:
            origins: (N, 3) world space, or (3,) for all.
            directions: (N, 3) directions of any length.

        Returns:
            (N,) face, -1 where there is none; (N,) how often the direction goes into the distance, infinite there.
        """
        from mirelight.lighting.kernel import probes

        if self._surface is None or not len(directions):
            return np.full(len(directions), -1, np.int32), np.full(len(directions), np.inf)
        return probes.first_hits(self._surface, np.broadcast_to(origins, directions.shape), directions)

    def blocked(self, origins: F64, directions: F64) -> Bool:
        """Whether the mesh lies on each ray; takes less time than to find where.

        Args:
            origins: as for `first_hits`.
            directions: as for `first_hits`.

        Returns:
            (N,).
        """
        from mirelight.lighting.kernel import probes

        if self._surface is None or not len(directions):
            return np.zeros(len(directions), bool)
        return probes.blocked(self._surface, np.broadcast_to(origins, directions.shape), directions)

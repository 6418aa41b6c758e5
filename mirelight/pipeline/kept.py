"""Where what frames are made from is found and kept between runs. `mirelight.store.Store` is such a place."""

from __future__ import annotations

import time
from collections import OrderedDict
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace
from typing import Protocol, TypeVar

from mirelight.model import F32, Camera, CellLight, LightingBuffer, ProxyMesh, SurfaceCells, SurfaceTransport

T = TypeVar("T")

WAIT = 0.25  # seconds between two looks at what another process makes


class Kept(Protocol):
    """A place for artefacts; `mirelight.store.Store` is one."""

    def array(self, key: str) -> F32 | None:
        """A kept array; None where there is none."""

    def has_array(self, key: str) -> bool:
        """Whether there is such an array."""

    def keep_array(self, key: str, values: F32) -> None:
        """Keep an array under its key."""

    def mesh(self, key: str) -> ProxyMesh | None:
        """A kept mesh of vertices and faces alone; None where there is none."""

    def keep_mesh(self, key: str, mesh: ProxyMesh) -> None:
        """Keep the vertices and faces of a mesh."""

    def light(self, key: str, camera: Camera) -> LightingBuffer | None:
        """A kept buffer of the view of `camera`; None where there is none."""

    def keep_light(self, key: str, buffer: LightingBuffer) -> None:
        """Keep a traced buffer under its key."""

    def cells(self, key: str) -> SurfaceCells | None:
        """Kept cells of a surface; None where there are none."""

    def keep_cells(self, key: str, cells: SurfaceCells) -> None:
        """Keep cells under their key."""

    def transport(self, key: str, count: int) -> SurfaceTransport | None:
        """Kept transport between `count` cells; None where there is none."""

    def keep_transport(self, key: str, transport: SurfaceTransport) -> None:
        """Keep transport under its key."""

    def cell_lights(self, key: str, count: int) -> tuple[CellLight, ...] | None:
        """Kept light on `count` cells; None where there is none."""

    def keep_cell_lights(self, key: str, lights: tuple[CellLight, ...], count: int) -> None:
        """Keep light on `count` cells under its key."""

    def claim(self, name: str) -> AbstractContextManager[bool]:
        """Whether work of that name is this process's own until the block ends."""


def made_once(kept: Kept, name: str, find: Callable[[], T | None], make: Callable[[], T]) -> T:
    """What is kept, or made now; one process makes it, and others wait.

    Args:
        kept: the place that is shared.
        name: of the work, for its claim.
        find: looks for it there.
        make: makes it, and keeps it there.
    """
    while True:
        found = find()
        if found is not None:
            return found
        with kept.claim(name) as mine:
            if mine:
                found = find()  # made while the claim was taken
                return make() if found is None else found
        time.sleep(WAIT)


class KeptInMemory:
    """Keeps traced light in memory, the newest of it; everything else where `beneath` keeps it.

    Args:
        beneath: another place.
        most: bytes of light.
    """

    def __init__(self, beneath: Kept, most: int = 2**30) -> None:
        self._beneath, self._most = beneath, most
        self._light: OrderedDict[str, LightingBuffer] = OrderedDict()

    def array(self, key: str) -> F32 | None:
        """See :class:`Kept`."""
        return self._beneath.array(key)

    def has_array(self, key: str) -> bool:
        """See :class:`Kept`."""
        return self._beneath.has_array(key)

    def keep_array(self, key: str, values: F32) -> None:
        """See :class:`Kept`."""
        self._beneath.keep_array(key, values)

    def mesh(self, key: str) -> ProxyMesh | None:
        """See :class:`Kept`."""
        return self._beneath.mesh(key)

    def keep_mesh(self, key: str, mesh: ProxyMesh) -> None:
        """See :class:`Kept`."""
        self._beneath.keep_mesh(key, mesh)

    def light(self, key: str, camera: Camera) -> LightingBuffer | None:
        """Buffers of one key are of one view, whatever its camera is called."""
        found = self._light.get(key)
        if found is None:
            return None
        self._light.move_to_end(key)
        return replace(found, camera=camera)

    def keep_light(self, key: str, buffer: LightingBuffer) -> None:
        """The oldest goes where there is more than may be kept."""
        self._light[key] = buffer
        self._light.move_to_end(key)
        while len(self._light) > 1 and sum(x.nbytes for x in self._light.values()) > self._most:
            self._light.popitem(last=False)

    def cells(self, key: str) -> SurfaceCells | None:
        """See :class:`Kept`."""
        return self._beneath.cells(key)

    def keep_cells(self, key: str, cells: SurfaceCells) -> None:
        """See :class:`Kept`."""
        self._beneath.keep_cells(key, cells)

    def transport(self, key: str, count: int) -> SurfaceTransport | None:
        """See :class:`Kept`."""
        return self._beneath.transport(key, count)

    def keep_transport(self, key: str, transport: SurfaceTransport) -> None:
        """See :class:`Kept`."""
        self._beneath.keep_transport(key, transport)

    def cell_lights(self, key: str, count: int) -> tuple[CellLight, ...] | None:
        """See :class:`Kept`."""
        return self._beneath.cell_lights(key, count)

    def keep_cell_lights(self, key: str, lights: tuple[CellLight, ...], count: int) -> None:
        """See :class:`Kept`."""
        self._beneath.keep_cell_lights(key, lights, count)

    def claim(self, name: str) -> AbstractContextManager[bool]:
        """See :class:`Kept`."""
        return self._beneath.claim(name)


class KeptNowhere:
    """Keeps nothing."""

    def array(self, key: str) -> F32 | None:
        """There is none."""
        return None

    def has_array(self, key: str) -> bool:
        """There is none."""
        return False

    def keep_array(self, key: str, values: F32) -> None:
        """Forgets it."""

    def mesh(self, key: str) -> ProxyMesh | None:
        """There is none."""
        return None

    def keep_mesh(self, key: str, mesh: ProxyMesh) -> None:
        """Forgets it."""

    def light(self, key: str, camera: Camera) -> LightingBuffer | None:
        """There is none."""
        return None

    def keep_light(self, key: str, buffer: LightingBuffer) -> None:
        """Forgets it."""

    def cells(self, key: str) -> SurfaceCells | None:
        """There are none."""
        return None

    def keep_cells(self, key: str, cells: SurfaceCells) -> None:
        """Forgets them."""

    def transport(self, key: str, count: int) -> SurfaceTransport | None:
        """There is none."""
        return None

    def keep_transport(self, key: str, transport: SurfaceTransport) -> None:
        """Forgets it."""

    def cell_lights(self, key: str, count: int) -> tuple[CellLight, ...] | None:
        """There is none."""
        return None

    def keep_cell_lights(self, key: str, lights: tuple[CellLight, ...], count: int) -> None:
        """Forgets it."""

    def claim(self, name: str) -> AbstractContextManager[bool]:
        """Nobody else is here."""
        return nullcontext(True)

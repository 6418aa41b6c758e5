"""Light that is kept on the surface: cells of the proxy, and what falls on them from each light."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from mirelight.model.arrays import F32, F64, I32, ArrayHolder, freeze


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SurfaceCells(ArrayHolder):
    """Pieces of the proxy's two sides, C of them: one voxel, one of six facing directions, one connected surface.

    Two points of a cell see each other just above the surface, so a cell never lies on both sides of a wall. Cells are
    in the order of a hash table: those of bucket b are starts[b] to starts[b + 1].
    """

    size: float  # edge of a voxel, world units
    origin: F64  # (3,) corner of voxel 0, 0, 0
    keys: NDArray[np.uint32]  # (C, 2) y << 16 | x, and direction << 16 | z
    starts: NDArray[np.uint32]  # (B + 1,) B a power of two
    anchors: F32  # (C, 3) a point above each cell, from which all of it is seen
    faces: I32  # (C, P) triangles of some points of each, spread evenly over it
    corners: F32  # (C, P, 2) their barycentric coordinates
    normals: F32  # (C, P, 3) of those triangles, on the cell's side

    def __post_init__(self) -> None:
        freeze(self, "faces", (None, None), np.int32)
        cells, points = self.faces.shape
        freeze(self, "origin", (3,), np.float64)
        freeze(self, "keys", (cells, 2), np.uint32)
        freeze(self, "starts", (None,), np.uint32)
        freeze(self, "anchors", (cells, 3))
        freeze(self, "corners", (cells, points, 2))
        freeze(self, "normals", (cells, points, 3))
        buckets = len(self.starts) - 1
        sound = buckets > 0 and buckets & (buckets - 1) == 0 and int(self.starts[-1]) == cells
        if not (sound and self.size > 0 and np.all(self.starts[1:] >= self.starts[:-1])):
            raise ValueError("SurfaceCells.starts: not a table of these cells")

    def __len__(self) -> int:
        return len(self.keys)

    def some(self, most: int) -> SurfaceCells:
        """At most so many of the cells, from all over the surface, as a table of their own: those of the first buckets,
        which are the same in a table of half as many."""
        buckets = len(self.starts) - 1
        while buckets > 1 and int(self.starts[buckets]) > most:
            buckets //= 2
        n = int(self.starts[buckets])
        rows = {name: getattr(self, name)[:n] for name in ("keys", "anchors", "faces", "corners", "normals")}
        return replace(self, starts=self.starts[: buckets + 1], **rows)


SKY, NOTHING, LOST = 0xFFFFFFFF, 0xFFFFFFFE, 0xFFFFFFFD  # where rays end that end on no node


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SurfaceTransport(ArrayHolder):
    """How light goes between the C cells of a surface, whatever the light: where R rays of each cell end.

    They end on nodes: the cells, and behind them E places that have no cell.
    """

    seed: int  # of the rays' directions, which are drawn again where they are asked for
    target: NDArray[np.uint32]  # (R, C) a node, SKY, or NOTHING where no light comes back; two independent halves
    albedo: NDArray[np.uint32]  # (R, C) at the ray's end, linear, red << 20 | green << 10 | blue of 1023 steps each
    faces: I32  # (E, 1) triangle of each place
    corners: F32  # (E, 1, 2) barycentric coordinates
    normals: F32  # (E, 1, 3) against the ray that ends there
    beyond: NDArray[np.uint32]  # (E,) where one ray from each place ends
    beyond_albedo: NDArray[np.uint32]  # (E,)

    def __post_init__(self) -> None:
        freeze(self, "target", (None, None), np.uint32)
        freeze(self, "albedo", self.target.shape, np.uint32)
        freeze(self, "faces", (None, 1), np.int32)
        places = len(self.faces)
        freeze(self, "corners", (places, 1, 2))
        freeze(self, "normals", (places, 1, 3))
        freeze(self, "beyond", (places,), np.uint32)
        freeze(self, "beyond_albedo", (places,), np.uint32)
        if len(self.target) == 0 or len(self.target) % 8:
            raise ValueError(f"SurfaceTransport.target: {len(self.target)} rays, expected a multiple of 8")
        for ends in (self.target, self.beyond):
            if np.any((ends >= self.nodes) & (ends < NOTHING)):
                raise ValueError("SurfaceTransport: rays that end nowhere")

    @property
    def cells(self) -> int:
        """How many cells there are."""
        return int(self.target.shape[1])

    @property
    def nodes(self) -> int:
        """Cells, and places without one."""
        return self.cells + len(self.faces)

    @property
    def nbytes(self) -> int:
        """Size of all arrays in bytes."""
        return 2 * self.target.nbytes + len(self.faces) * (4 + 8 + 12 + 8)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CellLight(ArrayHolder):
    """One light's irradiance / pi on every cell, from two independent fills: (2, C, 3) each, linear."""

    name: str  # of the layer that it belongs to
    kind: Literal["lights", "environment", "emission"]
    direct: F32  # at once, as far as it is sampled towards the light
    first_bounce: F32 | None  # at once, as far as a reflected ray meets it; None for lights, which no ray meets
    indirect: F32  # after one reflection and more
    rays: int = 0  # of each cell that reflected light was gathered along, in both halves
    spread: NDArray[np.uint16] | None = None  # (G, S) of an environment's samples: see `mirelight.lighting.sky_guiding`

    def __post_init__(self) -> None:
        for name in ("direct", "first_bounce", "indirect"):
            freeze(self, name, (2, None, 3))
        freeze(self, "spread", (None, None), np.uint16)

    def scaled(self, factor: F64 | float) -> CellLight:
        """With the light's intensity or colour multiplied, a number or linear [r, g, b]."""
        by = np.asarray(factor, np.float32)
        first_bounce = None if self.first_bounce is None else self.first_bounce * by
        return replace(self, direct=self.direct * by, first_bounce=first_bounce, indirect=self.indirect * by)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PointLayers(ArrayHolder):
    """Irradiance that each of K lights brings to N points, linear; their sum is all that falls there."""

    names: tuple[str, ...]  # (K,)
    direct: F32  # (K, N, 3)
    indirect: F32  # (K, N, 3)
    variance: F32 | None  # (K, N, 3) of the mean of direct + indirect; None from fewer than two batches of samples

    def __post_init__(self) -> None:
        for name in ("direct", "indirect", "variance"):
            freeze(self, name, (len(self.names), None, 3))

    @property
    def total(self) -> F32:
        """(N, 3) irradiance of all lights together."""
        return np.asarray((self.direct + self.indirect).sum(axis=0), np.float32)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SurfaceCache(ArrayHolder):
    """Light on the surface for every view of a scene: what `Tracer` reads in place of tracing on."""

    cells: SurfaceCells
    lights: tuple[CellLight, ...]

    def __post_init__(self) -> None:
        for light in self.lights:
            if light.direct.shape[1] != len(self.cells):
                raise ValueError(f"light {light.name!r}: {light.direct.shape[1]} cells, expected {len(self.cells)}")

    def joined(self, other: SurfaceCache) -> SurfaceCache:
        """With the lights of another cache of the same cells.

        Raises:
            ValueError: other cells; two lights of one name.
        """
        if other.cells is not self.cells and not np.array_equal(other.cells.keys, self.cells.keys):
            raise ValueError("two caches of different cells")
        names = [x.name for x in self.lights]
        for light in other.lights:
            if light.name in names:
                raise ValueError(f"two lights named {light.name!r}")
        return replace(self, lights=(*self.lights, *other.lights))

"""Light of the sky on cells of a surface, sample by sample; and samples spread as it was found, on the device."""

from __future__ import annotations

from collections.abc import Iterator

import drjit as dr
import mitsuba as mi
import numpy as np
from numpy.typing import NDArray

from mirelight.lighting.kernel.cell_points import CellPoints
from mirelight.lighting.kernel.memory import integers
from mirelight.lighting.kernel.proxy import DeviceProxy
from mirelight.lighting.kernel.samples import mix, number, pair
from mirelight.lighting.kernel.sky import Sky, sky_irradiance
from mirelight.lighting.kernel.types import Bool, Float, UInt32
from mirelight.model import F32, SurfaceCells

LANES = 1 << 21
WHOLE = 1 << 16


class Spread:
    """How the light samples of a sky are spread on each cell.

    Args:
        starts: (G, S) from `lighting.sky_guiding.guide_sky_sampling`; None: evenly everywhere.
        groups: (C,) which row is each cell's.
    """

    def __init__(self, starts: NDArray[np.uint16] | None, groups: NDArray[np.int64]) -> None:
        if starts is None:
            starts, groups = np.array([[0, WHOLE // 2]], np.uint16), np.zeros(len(groups), np.int64)
        ends = np.append(starts[:, 1:], np.full((len(starts), 1), WHOLE), axis=1)
        rows = starts.astype(np.uint32) << 16 | (ends - starts).astype(np.uint32)
        self.rows = integers(np.append(rows.ravel(), np.zeros(2, np.uint32)))
        self.groups = integers(np.append(groups, np.zeros(2, np.int64)))
        self.steps = dr.opaque(mi.UInt32, starts.shape[1])

    def choice(self, cell: UInt32, even: Float, active: Bool) -> tuple[Float, Float]:
        """(a number in [0, 1) for a light sample, from an even one; what its light counts), on a cell."""
        x = even * mi.Float(self.steps)
        step = dr.minimum(mi.UInt32(x), self.steps - 1)
        row = dr.gather(mi.UInt32, self.groups, cell, active)
        q = dr.gather(mi.UInt32, self.rows, row * self.steps + step, active)
        start, wide = mi.Float(q >> 16) * (1 / WHOLE), mi.Float(q & (WHOLE - 1)) * (1 / WHOLE)
        spread = start + wide * (x - mi.Float(step))
        return dr.select(active, spread, even), dr.select(active, wide * mi.Float(self.steps), 1)


def sample_sky(
    surface: DeviceProxy, sky: Sky, cells: SurfaceCells, spread: Spread, seed: int, samples: int, bins: int
) -> Iterator[tuple[int, NDArray[np.uint32], F32, F32]]:
    """Samples of the sky's map on every cell.

    Yields:
        the first cell of some; (n, samples) which of so many equal parts of [0, 1) each sample is from; (n, samples, 3)
        its light; (n, samples) what it counts.
    """
    points = CellPoints(cells)
    each = dr.opaque(mi.UInt32, samples)
    step = LANES // samples
    for first in range(0, len(cells), step):
        count = min(step, len(cells) - first)
        lane = dr.arange(mi.UInt32, count * samples)
        cell = lane // each
        sample = lane - cell * each
        cell += dr.opaque(mi.UInt32, first)
        stream = mix(cell, mi.UInt32(dr.opaque(mi.UInt32, seed)))
        _, face, uv, d, *_ = points.first_hit(surface, cell, sample, stream)
        at = surface.at(face, uv, d, mi.Bool(True))
        even = (mi.Float(sample) + number(sample, stream)) / mi.Float(each)
        choice, times = spread.choice(cell, even, mi.Bool(True))
        light = sky_irradiance(surface, sky, at, None, choice, pair(sample, mix(stream, 2)), mi.Bool(True)) * dr.inv_pi
        where = dr.minimum(mi.UInt32(choice * bins), bins - 1)
        dr.eval(where, light, times)
        values = np.stack([light.x.numpy(), light.y.numpy(), light.z.numpy()], axis=1)
        yield (
            first,
            where.numpy().reshape(count, samples),
            values.reshape(count, samples, 3),
            times.numpy().reshape(count, samples),
        )

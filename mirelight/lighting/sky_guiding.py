"""Where the sky is seen from each piece of a surface, so that its light is sampled there: windows, not told of.

A sky's light samples are numbers in [0, 1), each a direction, equally many for equal light (`environment`). From inside
a room nearly all of them end on a wall. So some are sent out from every cell, and for the cells of a few neighbouring
voxels together the numbers are spread anew: densely where light came in, thinly elsewhere, so that nothing is left out
and what was missed costs noise, not light. More samples, spread like that, then bring the cells' own light, and tell
better how to spread those of a picture.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from numpy.typing import NDArray

from mirelight.model import F32, F64, SurfaceCells

if TYPE_CHECKING:
    from mirelight.lighting.kernel.proxy import DeviceProxy
    from mirelight.lighting.kernel.sky import Sky

U16: TypeAlias = NDArray[np.uint16]
I64: TypeAlias = NDArray[np.int64]

FIRST, LATER = 32, 32  # samples of each cell that look for windows; in each half of its own light
BINS = 128  # equal parts of the samples that a group's light is told in
STEPS = 64  # equal shares of a group's samples, as they are spread anew
WHOLE = 1 << 16  # a share's place in [0, 1) is a whole number of these
ANYWHERE, AROUND = 0.15, 0.4  # of the samples, spread as if nothing were known; as the wider group's
NEAR, WIDER = 2, 3  # voxels of a group along each axis; how many times as many of a wider one: powers of two
MOST = 1 << 15  # groups


@dataclass(frozen=True, slots=True, eq=False)
class _Found:
    """What samples have sample_sky to groups."""

    squares: F64  # (G, BINS) of light, summed
    sent: F64  # (G, BINS) samples, as many as were to be expected

    def wider(self, of: I64) -> _Found:
        """Of wider groups, where `of` (G,) says which each belongs to."""
        place = (of[:, None] * BINS + np.arange(BINS)).ravel()
        squares, sent = (np.bincount(place, x.ravel()).reshape(-1, BINS) for x in (self.squares, self.sent))
        return _Found(squares.astype(np.float64), sent.astype(np.float64))

    @property
    def light(self) -> F64:
        """(G, BINS) how samples are best shared out between bins: their root mean squares; rows add to 1 or 0."""
        light = np.sqrt(self.squares / self.sent)
        padded = np.pad(light, ((0, 0), (1, 1)), mode="edge")
        light = light + 0.5 * (padded[:, :-2] + padded[:, 2:])
        total = light.sum(axis=1, keepdims=True)
        return np.asarray(light / np.where(total > 0, total, 1))


def groups(cells: SurfaceCells) -> I64:
    """(C,) which group each cell belongs to: one of neighbouring voxels that face the same way."""
    return _groups(cells)[0]


def _groups(cells: SurfaceCells) -> tuple[I64, I64]:
    """(C,) which group each cell belongs to, and which wider one; larger groups where they are too many."""
    near, log2_size = _of_voxels(cells, NEAR), NEAR
    while int(near.max(initial=0)) >= MOST:
        log2_size += 1
        near = _of_voxels(cells, log2_size)
    return near, _of_voxels(cells, log2_size + WIDER)


def _of_voxels(cells: SurfaceCells, log2_size: int) -> I64:
    x, y = cells.keys[:, 0] & 0xFFFF, cells.keys[:, 0] >> 16
    z, way = cells.keys[:, 1] & 0xFFFF, cells.keys[:, 1] >> 16
    code = np.zeros(len(cells), np.uint64)
    for part in (way, y >> log2_size, x >> log2_size, z >> log2_size):
        code = code << np.uint64(16) | part.astype(np.uint64)
    return np.unique(code, return_inverse=True)[1].astype(np.int64).ravel()


def guide_sky_sampling(surface: DeviceProxy, sky: Sky, cells: SurfaceCells, seed: int) -> tuple[U16, F32]:
    """How light samples of a sky are spread on cells, and what they bring.

    Args:
        surface, sky: on the device.
        cells: of that proxy, one or more.
        seed: of the samples.

    Returns:
        (G, STEPS) where each equal share of a group's samples starts in [0, 1), of WHOLE; it ends where the next
        starts. (2, C, 3) irradiance / pi of the sky as far as it is sampled, in two halves.
    """
    from mirelight.lighting.kernel.sky_guiding import Spread, sample_sky

    near, wide = _groups(cells)
    of = np.zeros(int(near.max()) + 1, np.int64)
    of[near] = wide
    count = np.bincount(near).astype(np.float64)[:, None]
    squares, sent = np.zeros(len(of) * BINS), np.zeros((len(of), BINS))
    direct = np.zeros((2, len(cells), 3), np.float32)
    share = np.full((len(of), BINS), 1 / BINS)
    for number, samples in enumerate((FIRST, LATER, LATER)):
        if number < 2:  # both halves of the light in one way
            share = share if number == 0 else _shares(_Found(squares.reshape(-1, BINS), sent), of)
            spread = Spread(inverse(share), near)
        sent = sent + samples * count * share
        own = (seed + 0x2F9BE6CC * (number + 1)) & 0xFFFFFFFF
        for first, bins, values, times in sample_sky(surface, sky, cells, spread, own, samples, BINS):
            rows = near[first : first + len(bins), None] * BINS + bins
            bright = values.sum(axis=2, dtype=np.float64)
            squares += np.bincount(rows.ravel(), np.square(bright).ravel(), len(squares))
            if number:
                direct[number - 1, first : first + len(bins)] = (values * times[..., None]).mean(axis=1)
    return inverse(_shares(_Found(squares.reshape(-1, BINS), sent), of)), direct


def _shares(known: _Found, of: I64) -> F64:
    """(G, BINS) the part of a group's samples that goes to each bin."""
    share = (1 - AROUND) * known.light + AROUND * known.wider(of).light[of]
    total = share.sum(axis=1, keepdims=True)
    return np.where(total > 0, (1 - ANYWHERE) * share / np.where(total > 0, total, 1) + ANYWHERE / BINS, 1 / BINS)


def inverse(share: F64) -> U16:
    """(G, STEPS) where equal shares of samples start, if such parts of them go to each bin (G, BINS), all above 0."""
    row = np.arange(len(share))
    ends = np.cumsum(share, axis=1)
    ends /= ends[:, -1:]
    starts = np.concatenate([np.zeros((len(share), 1)), ends[:, :-1]], axis=1)
    out = np.zeros((len(share), STEPS))
    for k in range(1, STEPS):
        bin_ = np.minimum((ends <= k / STEPS).sum(axis=1), BINS - 1)
        out[:, k] = (bin_ + (k / STEPS - starts[row, bin_]) / (ends - starts)[row, bin_]) / BINS
    return np.minimum(np.rint(out * WHOLE), WHOLE - 1).astype(np.uint16)
